# SPDX-License-Identifier: Apache-2.0
"""Faults: what each does to the samples and commands of its time, and to nothing else."""

import math
import re

import numba
import numpy as np
import pytest

from heli_core.errors import ParameterCause as Cause
from heli_core.errors import ParameterError, PlantConfigError
from heli_core.faults import KINDS, NONE, PAST_S, PLACES, Fault, begun, faults_of
from heli_core.rows import ACTUATOR, AIR, MEAS, PLANT
from heli_core.ticks import TICKS_PER_S
from heli_dynamics_sim.faults import FaultLog
from heli_dynamics_sim.noise import NOISE, NoiseStreams
from heli_dynamics_sim.plant import advance, initial_state, measure

TICKS, BEGIN, END = 240, 50, 170
NUMBERS = {
    "gps": MEAS.gps_pos, "gps_velocity": MEAS.gps_vel, "imu": MEAS.imu, "accel": MEAS.force,
    "gyro": MEAS.rate, "mag": MEAS.mag, "baro": slice(MEAS.baro, MEAS.baro + 1),
    "imu2": MEAS.imu2, "accel2": MEAS.force2, "gyro2": MEAS.rate2,
    "rotor_speed": slice(MEAS.rotor, MEAS.rotor + 1),
}  # fmt: skip
FLAGS = {"gps": MEAS.gps_valid, "gps_velocity": MEAS.gps_valid, "mag": MEAS.mag_valid,
         "baro": MEAS.baro_valid, "rotor_speed": MEAS.rotor_valid}  # fmt: skip
WHOLE = {**NUMBERS, "gps": slice(MEAS.gps_pos.start, MEAS.gps_vel.stop)}


def text(what, kind, value="", until=True):
    mapping = f"{{what: {what}, kind: {kind}, start_s: {BEGIN / 100}"
    mapping += f", duration_s: {(END - BEGIN) / 100}" if until else ""
    return mapping + (f", value: {value}}}" if value else "}")


@pytest.fixture(scope="module")
def flown(plant_config):
    """flown(*faults): measurements (ticks, 23) of the aircraft in wind with its trim's command."""

    def fly(*faults, ticks=TICKS, **changes):
        changes = {"sensors.imu2.enabled": True} | changes
        config = plant_config(faults=faults or ("none",), **changes)
        state, y = initial_state(config, 3), np.zeros((ticks, MEAS.size))
        u, rows = state.faults.u.copy(), NoiseStreams(3).rows(ticks)
        for tick in range(ticks):
            measure(state, tick, rows[tick], config.params, y[tick])
            advance(state, u, config.params)
        return y

    return fly


@pytest.fixture(scope="module")
def clean(flown):
    return flown()


def samples(y, what):
    """Ticks of a sensor's samples while the faults last."""
    periods = {"gps": 20, "gps_velocity": 20, "mag": 2, "baro": 5, "rotor_speed": 2}
    every = periods.get(what, 1)
    ticks = [t for t in range(BEGIN, END) if t % every == 0]
    if what in FLAGS:
        assert (y[ticks, FLAGS[what]] == 1.0).all()
    return ticks, every


def others(y, what):
    """Everything but a sensor's own numbers while the faults last."""
    kept = y.copy()
    kept[BEGIN:END, WHOLE[what]] = 0.0
    kept[BEGIN:END, FLAGS.get(what, MEAS.wind)] = 0.0
    return kept


@pytest.mark.parametrize("what", NUMBERS)
class TestSensors:
    def test_bias_and_drift(self, flown, clean, what):
        ticks, _ = samples(clean, what)
        at = NUMBERS[what]
        value = np.arange(1.0, 1.0 + at.stop - at.start)
        for kind in ("bias", "drift"):
            y = flown(text(what, kind, value.tolist()))
            lasted = np.ones(len(ticks)) if kind == "bias" else (np.array(ticks) - BEGIN) / 100.0
            expected = clean[ticks, at] + lasted[:, None] * value
            np.testing.assert_allclose(y[ticks, at], expected, rtol=1e-14, atol=1e-12)
            np.testing.assert_array_equal(others(y, what), others(clean, what))

    def test_freeze_repeats_the_last_sample(self, flown, clean, what):
        ticks, every = samples(clean, what)
        y, last = flown(text(what, "freeze")), (BEGIN - 1) // every * every
        for tick in ticks:
            np.testing.assert_array_equal(y[tick, WHOLE[what]], clean[last, WHOLE[what]])
        np.testing.assert_array_equal(others(y, what), others(clean, what))
        if what in FLAGS:
            np.testing.assert_array_equal(y[:, FLAGS[what]], clean[:, FLAGS[what]])

    def test_zero(self, flown, clean, what):
        ticks, _ = samples(clean, what)
        y = flown(text(what, "zero"))
        assert not y[ticks, WHOLE[what]].any()
        np.testing.assert_array_equal(others(y, what), others(clean, what))

    @pytest.mark.parametrize("kind", ["loss", "nan"])
    def test_what_is_lost_or_not_a_number_has_not_come(self, flown, clean, what, kind):
        ticks, _ = samples(clean, what)
        y = flown(text(what, kind))
        if what in ("imu", "accel", "gyro", "imu2", "accel2", "gyro2"):
            whole = MEAS.imu2 if what.endswith("2") else MEAS.imu
            assert np.isnan(y[BEGIN:END, whole]).all()
            np.testing.assert_array_equal(y[:BEGIN], clean[:BEGIN])
            np.testing.assert_array_equal(y[END:], clean[END:])
            return
        if what == "gps_velocity":
            assert np.isnan(y[ticks, MEAS.gps_vel]).all()
            assert (y[ticks, MEAS.gps_valid] == 1.0).all()
        else:
            assert not y[BEGIN:END, FLAGS[what]].any()
            assert not y[BEGIN:END, WHOLE[what]].any()
        y[:, MEAS.gps_tick] = clean[:, MEAS.gps_tick]
        np.testing.assert_array_equal(others(y, what), others(clean, what))

    def test_old_samples(self, flown, clean, what):
        ticks, every = samples(clean, what)
        at, lag = WHOLE[what], max(1, round(20 / every)) * every
        late = flown(text(what, "delay", 0.2))
        twice, swapped = flown(text(what, "duplicate")), flown(text(what, "reorder"))
        for tick in ticks:
            odd = tick // every % 2
            np.testing.assert_array_equal(late[tick, at], clean[tick - lag, at])
            np.testing.assert_array_equal(twice[tick, at], clean[tick - odd * every, at])
            order = (1 + 2 * odd) * every
            source = tick - order if order <= tick else 0
            np.testing.assert_array_equal(swapped[tick, at], clean[source, at])
        for y in (late, twice, swapped):
            np.testing.assert_array_equal(others(y, what), others(clean, what))

    def test_jumps_have_both_signs(self, flown, clean, what):
        ticks, _ = samples(clean, what)
        at = NUMBERS[what]
        y = flown(text(what, "jump", [2.0] * (at.stop - at.start)))
        moved = y[ticks, at] - clean[ticks, at]
        np.testing.assert_allclose(np.abs(moved), 2.0, rtol=1e-9)
        assert (moved > 0.0).any()
        assert (moved < 0.0).any()


def test_noise_is_so_many_times_larger(flown):
    """The variance that comes on top is (k^2 - 1) times that of the sample; of 2400, 5 sigma."""
    white = 0.0015 * 10.0
    quiet = {"sensors__imu__gyro_noise_density": 0.0015}
    loud = text("gyro", "noise", 3.0, until=False)
    y, before = flown(loud, ticks=850, **quiet), flown(ticks=850, **quiet)
    added = (y - before)[BEGIN:, MEAS.rate].ravel()
    spread = white * math.sqrt(8.0)
    assert np.std(added) == pytest.approx(spread, rel=5.0 / math.sqrt(2.0 * added.size))
    assert abs(np.mean(added)) < 5.0 * spread / math.sqrt(added.size)


def test_a_share_is_lost(flown):
    y = flown(text("imu", "loss", 0.3, until=False), ticks=1250)
    lost = np.isnan(y[BEGIN:, 0])
    assert not np.isnan(y[:BEGIN]).any()
    assert lost.mean() == pytest.approx(0.3, abs=5.0 * math.sqrt(0.3 * 0.7 / lost.size))


def test_faults_of_one_sensor_add_up_in_their_order(flown, clean):
    moved, stuck = text("baro", "bias", 100.0), text("baro", "freeze")
    ticks, before = samples(clean, "baro")[0], clean[45, MEAS.baro]
    np.testing.assert_array_equal(flown(stuck, moved)[ticks, MEAS.baro], before + 100.0)
    np.testing.assert_array_equal(flown(moved, stuck)[ticks, MEAS.baro], before)


def test_a_receiver_that_is_stuck_says_so_with_fresh_stamps(flown, clean):
    y, ticks = flown(text("gps", "freeze")), samples(clean, "gps")[0]
    np.testing.assert_array_equal(y[ticks, MEAS.gps_tick], clean[ticks, MEAS.gps_tick])
    assert len(set(y[ticks, MEAS.gps_tick])) == len(ticks)


@pytest.fixture
def commanded(plant_config):
    """commanded(text, commands (n, 4)): what reaches the servos from tick BEGIN - 1 on (n, 4)."""

    def send(fault, commands):
        config = plant_config(faults=(fault,), delay_ticks=0)
        state, y, still = initial_state(config, 1), np.zeros(MEAS.size), np.zeros(NOISE.size)
        reached = []
        for i, u in enumerate(commands):
            measure(state, BEGIN - 1 + i, still, config.params, y)
            advance(state, np.array(u), config.params)
            reached.append(state.faults.u.copy())
        return np.array(reached)

    return send


@pytest.mark.parametrize(
    ("kind", "value", "expected"),
    [
        ("stuck", "", [0.1, 0.1, 0.1, 0.1]),
        ("stuck", -0.5, [0.1, -0.5, -0.5, -0.5]),
        ("offset", 0.05, [0.1, 0.25, 0.15, 0.05]),
        ("slow", 2.0, [0.1, 0.12, 0.1, 0.08]),
        ("dead_zone", 0.15, [0.1, 0.1, 0.1, 0.1]),
        ("dead_zone", 0.05, [0.1, 0.2, 0.1, 0.0]),
        ("runaway", 40.0, [0.1, 0.5, 0.9, 1.0]),
        ("runaway", -70.0, [0.1, -0.6, -1.0, -1.0]),
    ],
)
@pytest.mark.parametrize(
    ("what", "at"),
    [("delta_lat", ACTUATOR.lat), ("delta_lon", ACTUATOR.lon), ("delta_ped", ACTUATOR.ped),
     ("delta_col", ACTUATOR.col)],
)  # fmt: skip
def test_actuators(commanded, what, at, kind, value, expected):
    commands = np.tile([[0.1], [0.2], [0.1], [0.0]], 4)
    reached = commanded(text(what, kind, value), commands)
    assert reached[:, at] == pytest.approx(expected, abs=1e-12)
    rest = [i for i in range(4) if i != at]
    np.testing.assert_array_equal(reached[:, rest], commands[:, rest])


def test_a_gust_begins_and_ends_at_rest(plant_config, flown, clean):
    calm = {"wind__turbulence": False, "wind__profile_speed_mps": [0.0, 0.0, 0.0]}
    y = flown(text("wind", "gust", [4.0, -2.0, 1.0]), **calm)[:, MEAS.wind]
    assert not y[: BEGIN + 1].any()
    assert not y[END:].any()
    assert y[(BEGIN + END) // 2] == pytest.approx([4.0, -2.0, 1.0])
    assert y[BEGIN + 30] == pytest.approx([2.0, -1.0, 0.5])
    assert np.abs(np.diff(y, axis=0)).max() < 0.11
    config = plant_config(faults=(text("wind", "gust", [4.0, -2.0, 1.0]),), **calm)
    state = initial_state(config, 1)
    measure(state, BEGIN + 60, np.zeros(NOISE.size), config.params, np.zeros(MEAS.size))
    for part in (AIR.main, AIR.tail, AIR.fuselage):
        assert state.air[part] == pytest.approx([4.0, -2.0, 1.0])


def test_an_engine_that_stops_stays_off(plant_config, parameters):
    """From the tick of its beginning on, as by `engine.fail_time_s`; cleared or not."""
    on = {"terms__rotor_speed": True}
    stops = text("engine", "stop", until=False)
    config = plant_config(faults=(stops,), **on)
    failed = plant_config(engine__fail_time_s=BEGIN / 100, **on)
    assert failed.params.fail_tick == BEGIN
    states = initial_state(config, 3), initial_state(failed, 3)
    for tick, noise in enumerate(NoiseStreams(3).rows(BEGIN + 30)):
        for state, of in zip(states, (config, failed), strict=True):
            measure(state, tick, noise, of.params, np.zeros(MEAS.size))
            advance(state, state.faults.u.copy(), of.params)
        assert states[0].x[PLANT.engine_out] == float(tick >= BEGIN)
    np.testing.assert_array_equal(states[0].x, states[1].x)
    assert states[0].x[PLANT.omega] < 0.97 * config.params.aircraft.engine.speed
    cleared = config.in_flight(parameters(terms__rotor_speed=True))
    measure(states[0], BEGIN + 30, np.zeros(NOISE.size), cleared.params, np.zeros(MEAS.size))
    assert states[0].x[PLANT.engine_out] == 1.0
    with pytest.raises(PlantConfigError) as caught:
        plant_config(faults=(stops,))
    assert (caught.value.cause, caught.value.key) == (Cause.CONFLICT, "faults: what")


def test_faults_that_are_over_or_far_leave_every_bit(flown, clean):
    far = Fault("gps", "bias", 1000.0, value=(1.0, 2.0, 3.0)), Fault("delta_col", "stuck", 1000.0)
    np.testing.assert_array_equal(flown(*(fault.text for fault in far)), clean)


def test_they_come_in_flight_with_the_same_types(plant_config, parameters):
    config = plant_config()
    later = config.in_flight(parameters(faults=(text("gps", "freeze"),)))
    assert numba.typeof(later.params) == numba.typeof(config.params)
    assert later.params.faults.sensors.shape[0] == 1
    assert config.params.faults.sensors.shape[0] == 0


@pytest.mark.parametrize(
    "fault",
    [
        Fault("gps", "loss", 20.0, 10.0),
        Fault("imu", "bias", 1.5, math.inf, (0.0, 0.0, 1e-7, 0.1, -3.0, 0.0)),
        Fault("baro", "noise", 0.0, 3.0, (7.5,)),
        Fault("delta_ped", "stuck", 3.0, math.inf, (-0.25,)),
        Fault("wind", "gust", 3.0, 2.0, (1.0, 2.0, 3.0)),
        Fault("engine", "stop", 3.0),
    ],
)
def test_a_fault_reads_back_as_it_was_written(fault):
    assert faults_of(["none", fault.text]) == (fault,)


def test_what_has_no_beginning_begins_now_and_the_rest_stays_as_it_was_written():
    texts = ("{what: gps, kind: loss, start_s: 3}", "{what: baro, kind: zero}", NONE,
             "{kind: gust, start_s: now, what: wind, duration_s: 2, value: [1, 2, 3]}")  # fmt: skip
    started = begun(texts, 7.25)
    assert (started[0], started[2]) == (texts[0], NONE)
    assert faults_of(started)[1:] == (
        Fault("baro", "zero", 7.25), Fault("wind", "gust", 7.25, 2.0, (1.0, 2.0, 3.0)),
    )  # fmt: skip
    for text in texts[1::2]:
        with pytest.raises(ParameterError) as caught:
            faults_of([text])
        assert caught.value.key == "start_s"
        assert caught.value.cause in (Cause.MISSING, Cause.TYPE)


def test_the_log_tells_what_came_and_what_was_taken_back_before_its_end():
    log, over, lasts = FaultLog(), Fault("gps", "loss", 1.0, 1.0), Fault("baro", "loss", 1.0)
    log.change((), (over, lasts), 1.0)
    assert log.facts((over, lasts), 3.0) == {
        "faults": lasts.words,
        "faults_in_flight": f"{over.words}; {lasts.words}",
    }
    log.change((over, lasts), (), 3.0)
    assert log.lines[2:] == [f"{lasts.words}, cleared at 3 s"]
    for at in range(1000):
        log.change((), (Fault("gps", "nan", float(at)),), float(at))
    assert len(log.lines) == 200 and log.lines[-1] == "and more"
    assert FaultLog().facts((), 0.0) == {}


def test_words():
    assert Fault("gps", "drift", 20.0, 10.0, (2.0, 0.0, 0.0)).words == (
        "gps drift 2, 0, 0 from 20 to 30 s"
    )
    assert Fault("imu", "freeze", 3.5).words == "imu freeze from 3.5 s on"


@pytest.mark.parametrize(
    ("wrong", "cause", "key"),
    [
        ("{what: gsp, kind: loss, start_s: 1.0}", Cause.CHOICE, "what"),
        ("{what: gps, kind: los, start_s: 1.0}", Cause.CHOICE, "kind"),
        ("{what: gps, kind: stuck, start_s: 1.0}", Cause.CHOICE, "kind"),
        ("{what: delta_col, kind: loss, start_s: 1.0}", Cause.CHOICE, "kind"),
        ("{what: wind, kind: bias, start_s: 1.0}", Cause.CHOICE, "kind"),
        ("{what: gps, kind: loss}", Cause.MISSING, "start_s"),
        ("{what: engine, kind: loss, start_s: 1.0}", Cause.CHOICE, "kind"),
        (
            "{what: engine, kind: stop, start_s: 1.0, duration_s: 3.0}",
            Cause.CONFLICT,
            "duration_s",
        ),
        ("{what: engine, kind: stop, start_s: 1.0, value: 3.0}", Cause.CONFLICT, "value"),
        ("{kind: loss, start_s: 1.0}", Cause.MISSING, "what"),
        (
            "{what: gps, kind: loss, start_s: 1.0, durations: 3.0}",
            Cause.UNKNOWN_KEY,
            "durations",
        ),
        ("{what: gps, kind: loss, start_s: 1.0, what: imu}", Cause.TWICE, "what"),
        ("{what: gps, kind: loss, start_s: -1.0}", Cause.BOUNDS, "start_s"),
        ("{what: gps, kind: loss, start_s: .nan}", Cause.BOUNDS, "start_s"),
        ("{what: gps, kind: loss, start_s: soon}", Cause.TYPE, "start_s"),
        ("{what: gps, kind: loss, start_s: true}", Cause.TYPE, "start_s"),
        ("{what: gps, kind: loss, start_s: [1.0]}", Cause.TYPE, "start_s"),
        (
            "{what: gps, kind: loss, start_s: 1.0, duration_s: 1e9}",
            Cause.BOUNDS,
            "duration_s",
        ),
        ("{what: gps, kind: bias, start_s: 1.0}", Cause.MISSING, "value"),
        (
            "{what: gps, kind: bias, start_s: 1.0, value: [1.0, 2.0]}",
            Cause.LENGTH,
            "value",
        ),
        ("{what: imu, kind: bias, start_s: 1.0, value: [1.0]}", Cause.LENGTH, "value"),
        (
            "{what: mag, kind: bias, start_s: 1.0, value: [0, 0, .inf]}",
            Cause.BOUNDS,
            "value",
        ),
        ("{what: gps, kind: bias, start_s: 1.0, value: [[1]]}", Cause.TYPE, "value"),
        ("{what: gps, kind: bias, start_s: 1.0, value: {x: 1}}", Cause.TYPE, "value"),
        ("{what: gps, kind: freeze, start_s: 1.0, value: 1.0}", Cause.CONFLICT, "value"),
        ("{what: gps, kind: loss, start_s: 1.0, value: 0.0}", Cause.BOUNDS, "value"),
        ("{what: gps, kind: loss, start_s: 1.0, value: 1.5}", Cause.BOUNDS, "value"),
        ("{what: baro, kind: noise, start_s: 1.0, value: 1.0}", Cause.BOUNDS, "value"),
        ("{what: imu, kind: delay, start_s: 1.0, value: 3.0}", Cause.BOUNDS, "value"),
        ("{what: delta_col, kind: slow, start_s: 1.0, value: 0.0}", Cause.BOUNDS, "value"),
        (
            "{what: delta_col, kind: stuck, start_s: 1.0, value: 1.2}",
            Cause.BOUNDS,
            "value",
        ),
        (
            "{what: wind, kind: gust, start_s: 1.0, value: [1, 2, 3]}",
            Cause.MISSING,
            "duration_s",
        ),
        ("gps loss", Cause.TYPE, ""),
        ("[1, 2]", Cause.TYPE, ""),
        ("{what: gps", Cause.SYNTAX, ""),
        ("", Cause.TYPE, ""),
    ],
)
def test_bad_faults_are_one_sentence(wrong, cause, key):
    with pytest.raises(ParameterError) as caught:
        faults_of(["none", wrong])
    refusal = caught.value
    assert (refusal.cause, refusal.key) == (cause, key)
    assert refusal.where.startswith("faults: entry 2") and "\n" not in str(refusal)


def test_a_refusal_says_what_is_allowed_and_what_was_meant():
    with pytest.raises(ParameterError) as caught:
        faults_of(["{what: gps, kind: los, start_s: 1.0}"])
    refusal = caught.value
    assert refusal.where.split(": ") == ["faults", "entry 1", "of gps"]
    assert (refusal.cause, refusal.key, refusal.value) == (Cause.CHOICE, "kind", "los")
    assert refusal.allowed == f"one of {', '.join(PLACES['gps'].kinds)}"
    assert set(re.findall(r"\w+", refusal.problem)) & set(PLACES["gps"].kinds) == {"loss"}
    with pytest.raises(ParameterError) as caught:
        faults_of(["{what: gps, kind: loss, start_s: 1.0, value: 1.5}"])
    assert caught.value.allowed == KINDS["loss"].allowed
    with pytest.raises(ParameterError) as caught:
        faults_of(["{what: gps, kind: loss, start_s: 1.0, durations: 3.0}"])
    assert caught.value.meant == "duration_s"


def test_samples_too_old_to_be_remembered_are_refused(plant_config):
    """Three periods have to fit into what is remembered; to the tick."""
    fault, longest = text("gps", "reorder"), int(PAST_S * TICKS_PER_S / 3)
    plant_config(faults=(fault,), sensors__gps__period_ticks=longest)
    with pytest.raises(PlantConfigError) as caught:
        plant_config(faults=(fault,), sensors__gps__period_ticks=longest + 1)
    assert str(caught.value).split(": ")[:3] == ["faults", "entry 1", "gps reorder"]
    assert f" {(longest + 1) / TICKS_PER_S:g} s " in str(caught.value)


def test_there_may_not_be_too_many():
    with pytest.raises(ParameterError) as caught:
        faults_of(["{what: gps, kind: loss, start_s: 1.0}"] * 65)
    assert caught.value.cause == Cause.LENGTH and caught.value.value == 65
