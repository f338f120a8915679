# SPDX-License-Identifier: Apache-2.0
"""PX4's simulator, held by a peer that plays PX4: units, time, and one step for each answer."""

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("pymavlink")
from heli_core.rows import ACTUATOR, MEAS, PLANT  # noqa: E402
from heli_core.ticks import Rate  # noqa: E402
from heli_dynamics_sim.plant import PlantStatus  # noqa: E402
from heli_dynamics_sim.trim import trim  # noqa: E402
from heli_flight.ardupilot.physics import STEP, Physics  # noqa: E402
from heli_flight.ardupilot.protocol import REPLY  # noqa: E402
from heli_flight.ardupilot.server import helicopter_of  # noqa: E402
from heli_flight.ardupilot.servos import deflections  # noqa: E402
from heli_flight.px4.server import Px4Order  # noqa: E402
from heli_flight.px4.servos import file_text, pulses_of, servo_numbers  # noqa: E402
from heli_flight.px4.session import (  # noqa: E402
    MULTICOPTER,
    NO_LOCKSTEP,
    SLOW,
    AnswerRefused,
    Px4Flight,
    Px4Session,
)
from heli_flight.px4.telemetry import SensorTelemetry  # noqa: E402
from support.px4_peer import ACCEL, BARO, GYRO, MAG, Px4Peer, mixed  # noqa: E402
from support.sitl_client import angles  # noqa: E402

CALM = {"wind.turbulence": False, "wind.profile_speed_mps": [0.0, 0.0, 0.0]}


class Pair:
    """A session and its peer, byte for byte, without a socket."""

    def __init__(self, order=None, calm=True, longest_s=float("inf"), **peer):
        order = order or Px4Order(seed=1)
        settings = order.resolved()
        if calm:
            nodes = {**settings.nodes, "plant": {**settings.nodes["plant"], **CALM}}
            settings = replace(settings, nodes=nodes)
        servos = servo_numbers(helicopter_of(settings))
        self.settings, self.said = settings, []
        self.physics = Physics(settings, Rate.at_least(order.rate_hz), servos)
        self.flight = Px4Flight(self.physics, None)
        telemetry = SensorTelemetry(settings, self.physics)
        self.session = Px4Session(self.flight, telemetry, self.said.append, longest_s)
        self.peer = Px4Peer(**peer)
        self.peer.hear(self.session.begin())
        assert self.session.hear(self.peer.hello()) == b""

    def send(self, data):
        """HIL_SENSOR that come back for some bytes."""
        return self.peer.hear(self.session.hear(data))

    def step(self, *controls, **more):
        assert self.send(self.peer.answer(*controls, **more)) == 1


def test_what_px4_flies_is_watched_step_by_step():
    pair, ticks = Pair(), []
    pair.flight.watch = lambda physics: ticks.append(physics.tick)
    for _ in range(3):
        pair.step(armed=False)
    pair.session.miss()
    assert ticks == [1, 2, 3, 4]


@pytest.mark.parametrize("counts_from_first", [True, False])
def test_each_answer_is_one_step_and_one_hil_sensor(counts_from_first):
    pair = Pair(counts_from_first=counts_from_first)
    for count in range(1, 801):
        pair.step(armed=False)
        assert pair.physics.tick == count
    sensors, truths = pair.peer.sensors, pair.peer.truths
    steps_us = {b.time_usec - a.time_usec for a, b in zip(sensors, sensors[1:], strict=False)}
    assert steps_us == {2500}
    assert len(truths) == 400  # every 5000 us, as PX4 asks
    for mask in (MAG, BARO):
        assert 10 < sum(s.fields_updated & mask == mask for s in sensors) < 800
    assert all(s.fields_updated & (ACCEL | GYRO) == ACCEL | GYRO for s in sensors)
    assert len(pair.peer.fixes) > 5
    assert pair.flight.refused.total() == 0 and pair.said == []


def test_what_is_told_is_what_our_sensors_measure_in_px4s_units():
    pair = Pair(Px4Order(seed=4, world="honest"), calm=False)
    for _ in range(400):
        fixes = len(pair.peer.fixes)
        pair.step(armed=False)
        y, told = pair.physics.y, pair.peer.sensors[-1]
        np.testing.assert_allclose([told.xacc, told.yacc, told.zacc], y[MEAS.force], rtol=1e-5)
        np.testing.assert_allclose(
            [told.xgyro, told.ygyro, told.zgyro], y[MEAS.rate], rtol=1e-5, atol=1e-8
        )
        if told.fields_updated & MAG:
            field_t = np.array([told.xmag, told.ymag, told.zmag]) * 1e-4
            np.testing.assert_allclose(field_t, y[MEAS.mag], rtol=1e-5)
        if told.fields_updated & BARO:
            assert 100.0 * told.abs_pressure == pytest.approx(y[MEAS.baro], rel=1e-6)
        if len(pair.peer.fixes) > fixes:
            fix = pair.peer.fixes[-1]
            np.testing.assert_allclose([fix.vn, fix.ve, fix.vd], 100.0 * y[MEAS.gps_vel], atol=0.51)
    # On the skids; noise beside it.
    assert np.mean([s.zacc for s in pair.peer.sensors]) == pytest.approx(-9.81, abs=0.5)
    # The sensors' errors are in it, as they are not in the truth.
    assert np.std([s.xgyro for s in pair.peer.sensors]) > 1e-5


def test_the_truth_is_where_the_aircraft_is():
    pair = Pair()
    for _ in range(4):
        pair.step(armed=False)
    truth, where = pair.peer.truths[-1], pair.settings.nodes["plant"]
    assert truth.lat * 1e-7 == pytest.approx(where["origin.latitude_deg"], abs=1e-3)
    assert truth.lon * 1e-7 == pytest.approx(where["origin.longitude_deg"], abs=1e-3)
    assert truth.alt * 1e-3 == pytest.approx(
        where["origin.altitude_m"] - pair.physics.row[STEP.plant][PLANT.down], abs=0.01
    )
    assert truth.zacc == pytest.approx(-1000, abs=20)  # mg
    np.testing.assert_allclose(truth.attitude_quaternion, pair.physics.told[REPLY.quat], atol=1e-6)


def test_outputs_move_the_axis_that_px4_means():
    settings = Px4Order(seed=1).resolved()
    helicopter = helicopter_of(settings)
    k, pulse_us, u = servo_numbers(helicopter), np.zeros(4), np.zeros(4)

    def moved(*wanted):
        pulses_of(np.array([*mixed(*wanted), *([0.0] * 11)]), pulse_us)
        deflections(pulse_us, k, u)
        return u.copy()

    middle = moved(0.0, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(middle[ACTUATOR.attitude], 0.0, atol=1e-12)
    for i, (roll, pitch, yaw) in enumerate(((0.4, 0, 0), (0, 0.4, 0), (0, 0, 0.4))):
        away = moved(roll, pitch, 0.0, yaw) - middle
        expected = np.zeros(4)
        expected[i] = 0.4 if i < 2 else -0.4  # the pedal's positive turns the nose left
        np.testing.assert_allclose(away, expected, atol=1e-12)
    assert moved(0.0, 0.0, 0.2, 0.0)[ACTUATOR.col] != middle[ACTUATOR.col]


def test_a_pilot_with_px4s_signs_takes_off_and_hovers():
    pair = Pair()
    helicopter = helicopter_of(pair.settings)
    hover = trim(helicopter)
    k = servo_numbers(helicopter)
    blades = k.pitch_gain * hover.u[ACTUATOR.col] + k.pitch_offset
    col = k.col_min + (blades - k.pitch_min) / k.pitch_per_col
    roll0, pitch0, _ = angles(hover.x[PLANT.quat])
    for _ in range(8 * 400):
        told = pair.physics.told
        north, east, down = told[REPLY.pos]
        v_n, v_e, v_d = told[REPLY.vel]
        roll, pitch, yaw = angles(told[REPLY.quat])
        p, q, r = told[REPLY.gyro]
        aside = -0.05 * east - 0.1 * v_e
        ahead = 0.05 * north + 0.1 * v_n
        want_roll = roll0 + min(max(aside, -0.1), 0.1)
        want_pitch = pitch0 + min(max(ahead, -0.1), 0.1)
        sink = min(max(0.8 * (-3.0 - down), -1.0), 1.0) - v_d
        pair.step(
            mixed(
                0.386 * (2.0 * (want_roll - roll) - 0.1 * p),
                0.386 * (2.0 * (want_pitch - pitch) - 0.1 * q),
                min(max(col - 0.12 * sink, -0.5), 0.5),
                min(max(-0.3 * yaw - 0.1 * r, -1.0), 1.0),
            )
        )
    assert pair.physics.status == PlantStatus.OK, pair.said
    assert -pair.physics.told[REPLY.pos][2] == pytest.approx(3.0, abs=0.5)
    assert math.hypot(*pair.physics.told[REPLY.pos][:2]) < 2.0


def test_it_stands_until_px4_has_armed():
    pair = Pair()
    for _ in range(200):
        pair.step(mixed(0.0, 0.0, 0.5, 0.0), armed=False)
    assert abs(pair.physics.told[REPLY.pos][2]) < 0.05
    for _ in range(800):
        pair.step(mixed(0.0, 0.0, 0.5, 0.0))
    assert pair.said[0] == "PX4 has armed" and -pair.physics.told[REPLY.pos][2] > 0.5


def test_an_answer_that_is_not_the_one_waited_for_is_no_step():
    pair = Pair()
    pair.step(armed=False)
    ahead = pair.peer.answer(time_us=pair.peer.now_us + 10**9)
    again = pair.peer.answer(armed=False)
    assert pair.send(again) == 1
    assert pair.send(again) == 0  # a second one to the same
    assert pair.send(ahead) == 0
    assert pair.send(b"".join([again] * 500)) == 0  # a flood
    assert pair.flight.refused == {AnswerRefused.OLD: 501, AnswerRefused.CLOCK: 1}
    assert pair.physics.tick == 2
    pair.step(armed=False)


def test_what_is_no_message_or_of_another_is_counted_and_the_flight_goes_on():
    pair = Pair()
    pair.step(armed=False)
    stranger = Px4Peer(system=9)
    stranger.sensors = pair.peer.sensors
    good = pair.peer.answer(armed=False)
    assert pair.send(stranger.answer()) == 0
    assert pair.send(bytes([0x00, 0x55, 0xFF]) * 40) == 0
    spoiled = bytearray(good)
    spoiled[-1] ^= 0xFF
    assert pair.send(bytes(spoiled)) == 0
    assert pair.flight.refused[AnswerRefused.SYSTEM] == 1
    assert pair.flight.refused[AnswerRefused.MALFORMED] > 0
    # In pieces, and behind them.
    count = 0
    for i in range(len(good)):
        count += pair.send(good[i : i + 1])
    assert count == 1 and pair.physics.tick == 2


def test_a_frame_longer_than_any_message_is_passed_over():
    pair = Pair()
    # 255 bytes of content that no message of this number has.
    oversize = bytes([0xFD, 255, 0, 0, 0, 1, 1, 93, 0, 0]) + bytes(255 + 2)
    assert pair.send(oversize) == 0
    assert pair.flight.refused[AnswerRefused.MALFORMED] > 0
    pair.step(armed=False)


def test_numbers_that_no_output_has_keep_the_last_ones():
    pair = Pair()
    pair.step([1.0, 0.1, 0.2, 0.3, 0.4])
    pair.step([1.0, math.nan, 7.0, math.inf, 0.1])
    np.testing.assert_allclose(pair.session.servos[:5], [1.0, 0.1, 0.2, 0.3, 0.1], atol=1e-6)
    assert np.isfinite(pair.physics.told).all() and len(pair.flight.notes) == 1


def test_a_px4_without_lockstep_and_a_multicopter_are_named_once():
    pair = Pair()
    for _ in range(3):
        assert pair.send(pair.peer.answer(flags=0)) == 0
    for _ in range(3):
        pair.step([0.5, 0.5, 0.5, 0.5])
    assert pair.flight.notes == [NO_LOCKSTEP, MULTICOPTER]
    assert pair.flight.refused == {AnswerRefused.LOCKSTEP: 3}


def test_it_goes_on_without_an_answer_while_px4_starts_and_says_so_later():
    pair = Pair()
    assert pair.peer.hear(pair.session.miss()) == 1
    assert pair.flight.notes == []
    pair.step(armed=False)
    assert pair.peer.hear(pair.session.miss()) == 1
    assert pair.flight.notes == [SLOW] and pair.flight.unanswered == 2


def test_it_ends_at_its_length():
    pair = Pair(longest_s=0.05)
    for _ in range(20):
        pair.step(armed=False)
    assert pair.session.done
    assert pair.send(pair.peer.answer()) == 0 and pair.session.miss() == b""


def test_the_same_answers_give_the_same_bytes():
    def sent():
        pair = Pair(Px4Order(seed=3, world="honest"), calm=False)
        out = []
        for i in range(100):
            data = pair.session.hear(pair.peer.answer(mixed(0.01 * math.sin(i), 0.0, 0.1, 0.0)))
            pair.peer.hear(data)
            out.append(data)
        return b"".join(out)

    assert sent() == sent()


def test_a_sensor_that_fails_is_not_new(tmp_path):
    path = tmp_path / "faults.yaml"
    path.write_text("faults:\n- {what: gps, kind: loss, start_s: 0.5}\n")
    pair = Pair(Px4Order(seed=1, faults=path))
    for _ in range(200):
        pair.step(armed=False)
    before = len(pair.peer.fixes)
    for _ in range(400):
        pair.step(armed=False)
    assert before > 0 and len(pair.peer.fixes) == before


@pytest.mark.parametrize("name", ["helion", "logo600", "xcell60"])
def test_parameters_are_those_that_the_way_back_assumes(name):
    order = Px4Order(aircraft=name)
    values = order.parameters()
    assert values["CA_AIRFRAME"] == 11 and 0.05 < values["MPC_THR_HOVER"] < 0.95
    assert [values[f"PWM_MAIN_FUNC{i}"] for i in range(1, 6)] == [101, 201, 202, 203, 204]
    assert [values[f"CA_SP0_ANG{i}"] for i in range(3)] == [0.0, 120.0, 240.0]
    for line in file_text(values, name).splitlines()[1:]:
        cells = line.split("\t")
        assert len(cells) == 5 and cells[4] in ("6", "9") and math.isfinite(float(cells[3]))
