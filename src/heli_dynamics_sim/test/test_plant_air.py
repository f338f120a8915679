# SPDX-License-Identifier: Apache-2.0
"""Air at the parts of the aircraft, log profile, random gusts."""

import math

import numpy as np
import pytest

from heli_core.errors import ParameterCause, PlantConfigError
from heli_core.rows import AIR, MEAS, PLANT
from heli_dynamics_sim import plant, wind
from heli_dynamics_sim import wind as air
from heli_dynamics_sim import wind as gusts
from heli_dynamics_sim.airframe import make_state
from heli_dynamics_sim.noise import NoiseStreams
from heli_dynamics_sim.plant import initial_state

ARM, HEIGHT, HUB = 1.035, 0.172, 0.337  # tail and hub of the default aircraft, m
STEADY = {
    "wind__towards_deg": 180.0,
    "wind__profile_altitude_m": [0.0],
    "wind__profile_speed_mps": [4.0],
}
PARTS = {f"wind__parts__{name}": True for name in ("main", "tail", "fuselage")}


def rows_of(config, ticks, attitude=(0.0, 0.0, 0.0), seed=3):
    """(ticks, 12) air at an aircraft that is held level at 10 m."""
    state, k = initial_state(config, seed), config.params
    state.x[:] = make_state((0.0, 0.0, -10.0), *attitude)
    noise, y = NoiseStreams(seed).rows(ticks), np.zeros(MEAS.size)
    out = np.empty((ticks, AIR.size))
    for tick in range(ticks):
        plant.measure(state, tick, noise[tick], k, y)
        out[tick] = state.air
        assert (y[MEAS.wind] == state.air[AIR.fuselage]).all()
    return out


def test_all_off_is_the_same_air_everywhere_that_does_not_turn(plant_config):
    air = rows_of(plant_config(), 30)
    assert (air[:, AIR.main] == air[:, AIR.fuselage]).all()
    assert (air[:, AIR.tail] == air[:, AIR.fuselage]).all()
    assert not air[:, AIR.rates].any()
    assert np.ptp(air[:, 0]) > 0.0


@pytest.mark.parametrize(("towards_deg", "sign"), [(180.0, 1), (0.0, -1)])
def test_a_gust_from_ahead_reaches_the_tail_later_and_one_from_behind_earlier(
    plant_config, towards_deg, sign
):
    """Level at 4 m/s, 1-cosine of 1 s at the c.g. from 1 s on; the arm over the wind speed."""
    config = plant_config(
        **STEADY | {"wind__towards_deg": towards_deg}, **PARTS, wind__turbulence=False,
        wind__gust__start_s=[1.0], wind__gust__duration_s=[1.0],
        wind__gust__amplitude_mps=[0.0, 3.0, 0.0],
    )  # fmt: skip
    air = rows_of(config, 300)
    t = 0.01 * np.arange(300)
    for place, late in ((AIR.main, 0.0), (AIR.tail, sign * ARM / 4.0)):
        phase = np.clip(t - 1.0 - late, 0.0, 1.0)
        expected = 1.5 * (1.0 - np.cos(2.0 * np.pi * phase))
        assert air[:, place][:, 1] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("towards_deg", "sign"), [(180.0, 1), (0.0, -1)])
def test_turbulence_reaches_the_tail_as_the_frozen_field_does(plant_config, towards_deg, sign):
    """A wind that passes the arm in 25 ticks: the tail's air is the hub's of 25 ticks ago."""
    speed = ARM / 0.25
    change = {"wind__towards_deg": towards_deg, "wind__profile_speed_mps": [speed]}
    air = rows_of(plant_config(**STEADY | change, **PARTS), 200)
    main, tail = air[:, AIR.main], air[:, AIR.tail]
    early, late = (main, tail) if sign > 0 else (tail, main)
    assert late[25:] == pytest.approx(early[:-25], abs=1e-9)
    assert np.abs(late - early).max() > 0.05


def test_across_the_wind_the_tail_meets_the_same_field(plant_config):
    air = rows_of(plant_config(**STEADY, **PARTS), 50, attitude=(0.0, 0.0, math.pi / 2.0))
    assert air[:, AIR.tail] == pytest.approx(air[:, AIR.main], abs=1e-12)


def test_each_part_has_a_switch_of_its_own(plant_config):
    base = rows_of(plant_config(**STEADY, wind__parts__main=True), 20)
    assert (base[:, AIR.tail] == base[:, AIR.fuselage]).all()
    for name in ("main", "tail", "fuselage"):
        profile = {"wind__profile": "log", "wind__w20_mps": 4.0}
        config = plant_config(**STEADY, **profile, **{f"wind__parts__{name}": True})
        air = rows_of(config, 20)
        places = {"main": AIR.main, "tail": AIR.tail, "fuselage": AIR.fuselage}
        of_part = air[:, places.pop(name)]
        one, other = (air[:, place] for place in places.values())
        assert (one == other).all() and (of_part != one).any()


def test_each_part_meets_the_mean_wind_of_its_height(plant_config, helicopter):
    """Pitched up by 90 deg: the tail hangs below, the hub lies behind; the log law by hand."""
    config = plant_config(
        **PARTS, wind__profile="log", wind__w20_mps=4.0, wind__turbulence=False,
        wind__towards_deg=0.0,
    )  # fmt: skip
    air = rows_of(config, 1, attitude=(0.0, math.pi / 2.0, 0.0))[0]

    def law(height):
        return 4.0 * math.log(height / 0.04572) / math.log(6.096 / 0.04572)

    assert air[AIR.main][0] == pytest.approx(law(10.0), abs=1e-12)
    assert air[AIR.tail][0] == pytest.approx(law(10.0 - ARM), abs=1e-12)
    half = helicopter.gear_half_length_m
    mean = (law(10.0 - half) + 4.0 * law(10.0) + law(10.0 + half)) / 6.0
    assert air[AIR.fuselage][0] == pytest.approx(mean, abs=1e-12)
    level = rows_of(config, 1)[0]
    assert level[AIR.main][0] == pytest.approx(law(10.0 + HUB), abs=1e-12)
    assert level[AIR.tail][0] == pytest.approx(law(10.0 + HEIGHT), abs=1e-12)


def field_behind(s, behind_m):
    """The field so many metres of path behind the newest row: a row FIELD (7,)."""
    row = np.full(s.field.shape[1], np.nan)
    air.field_behind(s, behind_m, row)
    return row


def test_field_is_linear_between_its_rows(plant_config):
    config = plant_config(**STEADY, **PARTS)
    s = initial_state(config, 5).turbulence
    newest, before = s.field[s.newest[0]], s.field[s.newest[0] - 1]
    step = newest[0] - before[0]
    assert step == pytest.approx(0.04)
    assert field_behind(s, 0.0) == pytest.approx(newest)
    assert field_behind(s, 0.25 * step) == pytest.approx(0.75 * newest + 0.25 * before)


def test_field_finds_its_rows_after_the_wind_has_changed(plant_config):
    """Wind that grows tenfold within the stored path: the bracket is found all the same."""
    config = plant_config(
        **STEADY | {"wind__profile_altitude_m": [10.0, 20.0],
                    "wind__profile_speed_mps": [1.0, 10.0]}, **PARTS,
    )  # fmt: skip
    s, k = initial_state(config, 5).turbulence, config.wind
    noise = NoiseStreams(7).rows(60)
    for i in range(60):
        air.step_air(s, 10.0 if i < 50 else 20.0, 0.01, noise[i], k)
    order = (s.newest[0] - np.arange(s.newest[1])) % s.field.shape[0]
    rows = s.field[order]
    for behind in np.linspace(0.0, 2.0 * k.parts.reach, 40):
        path = rows[0, 0] - behind
        expected = [np.interp(path, rows[::-1, 0], rows[::-1, i]) for i in range(7)]
        assert field_behind(s, behind) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("h", [1e-3, 0.03, 2.0])
def test_lag_is_exact_for_an_input_that_grows_linearly(h):
    """y' = u - y with u = a + (b - a) t / h: y = u - m + (y0 - a + m) exp(-t), m = (b - a) / h."""
    a, b, start = 0.7, -0.4, 0.2
    slope = (b - a) / h
    expected = b - slope + (start - a + slope) * math.exp(-h)
    assert air.lag_step(start, a, b, h) == pytest.approx(expected, abs=1e-11)


def test_rotation_at_the_tail_is_its_lever_arm(plant_config):
    """Nose into the wind: rates in wind axes are (-p, -q, r) of the body's; by hand at the tail."""
    config = plant_config(**STEADY, wind__rotation=True)
    air = rows_of(config, 40)
    p, q, r = air[:, AIR.rates].T
    assert np.abs(air[:, AIR.rates]).max(axis=0).min() > 0.01
    added = air[:, AIR.tail] - air[:, AIR.main]
    # body axes are north, east, down here: omega x (-arm, 0, .) without the part of p
    assert added == pytest.approx(np.column_stack([0.0 * p, -r * ARM, q * ARM]), abs=1e-12)
    # With air of its own the tail has that from the field; beside the wind p is left.
    both = plant_config(**STEADY, **PARTS, wind__rotation=True)
    level = rows_of(both, 40)
    without = rows_of(plant_config(**STEADY, **PARTS), 40)
    assert level[:, AIR.velocity] == pytest.approx(without[:, AIR.velocity], abs=1e-12)
    beside = rows_of(both, 40, attitude=(0.0, 0.0, math.pi / 2.0))
    swing = beside[:, AIR.tail] - beside[:, AIR.main]
    assert swing[:, 2] == pytest.approx(beside[:, AIR.rates][:, 1] * ARM, abs=1e-12)
    assert swing[:, :2] == pytest.approx(0.0, abs=1e-12)


def test_log_law_by_hand_and_where_it_ends():
    assert wind.log_law(6.096, 4.0, 0.04572) == pytest.approx(4.0)
    assert wind.log_law(0.04572, 4.0, 0.04572) == 0.0 == wind.log_law(-1.0, 4.0, 0.04572)
    assert wind.log_law(500.0, 4.0, 0.04572) == wind.log_law(304.8, 4.0, 0.04572)


def test_in_the_log_profile_w20_alone_scales_the_wind(plant_config):
    """Twice W20: twice mean, sigma and random gusts; nothing else changes."""
    log_profile = {"wind__profile": "log", "wind__random_gusts__rate_per_min": 6.0}
    weak, strong = (plant_config(**log_profile, wind__w20_mps=w20).wind for w20 in (4.0, 8.0))
    for height in (1.0, 6.096, 10.0, 20.0, 100.0):
        assert wind.mean_speed(height, strong) == pytest.approx(2 * wind.mean_speed(height, weak))
        sigmas = [wind.turbulence_sigmas(height, k) for k in (weak, strong)]
        assert sigmas[1] == pytest.approx((2 * sigmas[0][0], 2 * sigmas[0][1]))
    drawn = [gusts.draw_gusts(4, k.random, k.w20_mps, k.towards_rad) for k in (weak, strong)]
    assert drawn[0].shape == drawn[1].shape and drawn[0].shape[0] > 1
    assert drawn[1][:, 2:] == pytest.approx(2.0 * drawn[0][:, 2:])
    assert (drawn[1][:, :2] == drawn[0][:, :2]).all()


def test_random_gusts_change_nothing_but_themselves(plant_config):
    """Same turbulence with and without them, and each is a 1-cosine along its drawn direction."""
    changes = {"wind__random_gusts__rate_per_min": 60.0, "wind__w20_mps": 3.0}
    with_gusts, without = plant_config(**changes), plant_config(wind__w20_mps=3.0)
    drawn = initial_state(with_gusts, 3).turbulence.gusts
    assert not initial_state(without, 3).turbulence.gusts.size
    ticks = 1000
    added = (rows_of(with_gusts, ticks) - rows_of(without, ticks))[:, AIR.fuselage]
    t, expected = 0.01 * np.arange(ticks), np.zeros((ticks, 3))
    for start, length, *peak in drawn:
        phase = np.clip((t - start) / length, 0.0, 1.0)
        expected += 0.5 * np.outer(1.0 - np.cos(2.0 * np.pi * phase), peak)
    assert added == pytest.approx(expected, abs=1e-12)
    assert np.abs(added).max() > 0.1


def test_random_gusts_of_a_seed_are_always_the_same(plant_config):
    config = plant_config(wind__random_gusts__rate_per_min=4.0)
    one, again, other = (initial_state(config, seed).turbulence.gusts for seed in (1, 1, 2))
    assert one.tobytes() == again.tobytes() != other.tobytes()


def test_spectrum_of_both_standards_is_one_wind(plant_config):
    winds = [
        rows_of(plant_config(wind__spectrum=name, wind__rotation=True), 20)
        for name in ("mil_f_8785c", "mil_hdbk_1797")
    ]
    assert winds[0].tobytes() == winds[1].tobytes()


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"wind__profile": "log"}, "wind.w20_mps"),
        ({"wind__random_gusts__duration_s": [3.0, 1.0]}, "wind.random_gusts.duration_s"),
        ({"wind__random_gusts__amplitude_w20": [0.5, 0.2]}, "wind.random_gusts.amplitude_w20"),
    ],
)
def test_wind_that_does_not_fit_is_refused(plant_config, changes, key):
    with pytest.raises(PlantConfigError) as caught:
        plant_config(**changes)
    assert (caught.value.cause, caught.value.key) == (ParameterCause.CONFLICT, key)


def test_start_is_in_the_wind_of_the_log_profile(plant_config):
    """The trim's wind is the profile's at the start."""
    state = initial_state(plant_config(wind__profile="log", wind__w20_mps=4.0), 1)
    speed = 4.0 * math.log(10.0 / 0.04572) / math.log(6.096 / 0.04572)
    assert np.linalg.norm(state.air[AIR.fuselage]) == pytest.approx(speed)
    assert state.x[PLANT.down] == -10.0
