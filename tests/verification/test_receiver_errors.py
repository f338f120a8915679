# SPDX-License-Identifier: Apache-2.0
"""Errors of the GPS receiver beyond noise and drift: multipath, satellites, outages, jumps.

Each against the formula of its own theory: AR(1), stationary distributions of Markov chains.
Tolerances: 3.5 standard errors unless a test says otherwise.
"""

import numpy as np
import pytest
from scipy import stats

from heli_core.jit import njit
from heli_core.rows import MEAS
from heli_dynamics_sim.config import jump_share
from heli_dynamics_sim.noise import NOISE
from heli_dynamics_sim.plant import initial_state
from heli_dynamics_sim.sensors import step_gps_errors
from heli_flight.settings import resolve

STILL = {
    "wind__turbulence": False,
    "wind__profile_speed_mps": [0.0, 0.0, 0.0],
    "sensors__gps__white_m": 0.0,
    "sensors__gps__drift_m": 0.0,
    "sensors__gps__velocity_mps": 0.0,
}
SIGMAS = 3.5


@pytest.mark.parametrize("seconds", [4000, pytest.param(40_000, marks=pytest.mark.nightly)])
def test_multipath_has_its_correlation_time_and_size(plant_config, record, seconds):
    """Regression on the last fix and variance of an AR(1), as for the drift (`test_sensors`)."""
    tau = 20.0
    path = {"sensors__gps__multipath__sigma_m": 0.8, "sensors__gps__multipath__tau_s": tau}
    y = record(plant_config(**STILL, **path), seconds * 100, seed=8)
    fixes = y[y[:, MEAS.gps_valid] == 1.0, MEAS.gps_pos] - [0.0, 0.0, -10.0]
    scaled = fixes[1:] / (0.8 * np.array([1.0, 1.0, 1.5]))
    a = (scaled[1:] * scaled[:-1]).sum() / (scaled[:-1] ** 2).sum()
    expected = np.exp(-0.2 / tau)
    assert abs(a - expected) < SIGMAS * np.sqrt((1.0 - expected**2) / (3.0 * scaled.shape[0]))
    assert np.abs((scaled**2).mean(axis=0) - 1.0).max() < SIGMAS * np.sqrt(2.0 * tau / seconds)


@njit
def _run(state, rows, k, blocked, out, jump):
    for i in range(rows.shape[0]):
        step_gps_errors(state, rows[i], k)
        blocked[i], out[i], jump[i] = state.blocked[0], state.out[0], state.jump[0]


def run_gps(config, n, seed=3):
    """Blocked satellites, outage flag and jump north, fix by fix."""
    state = initial_state(config, seed).sensors.gps
    series = np.zeros((3, n))
    rows = np.zeros((n, NOISE.size))
    rows[:] = np.random.default_rng(seed).standard_normal(rows.shape)
    _run(state, rows, config.sensors.gps.errors, *series)
    return series


@pytest.mark.parametrize("mean", [2.0, 9.0])
def test_blocked_satellites_are_poisson(plant_config, mean):
    """Histogram against Poisson's, cut at all of them; time constant of the count; 5 standard
    errors of correlated samples."""
    gps = {"sensors__gps__satellites__open": 12, "sensors__gps__satellites__blocked": mean}
    config = plant_config(**STILL, **gps, sensors__gps__satellites__blocked_s=10.0)
    n = 200_000
    blocked, _, _ = run_gps(config, n)
    law = stats.poisson(mean).pmf(np.arange(13))
    law /= law.sum()
    frequencies = np.bincount(blocked.astype(int), minlength=13) / n
    independent = n / (2.0 * 10.0 / 0.2)
    assert (abs(frequencies - law) < 5.0 * np.sqrt(law * (1.0 - law) / independent) + 1e-3).all()
    if mean < 3.0:
        lag = round(10.0 / 0.2)
        centred = blocked - blocked.mean()
        decay = (centred[lag:] * centred[:-lag]).mean() / centred.var()
        assert decay == pytest.approx(np.exp(-1.0), abs=5.0 / np.sqrt(independent))


def test_too_few_satellites_give_no_fix(plant_config, record):
    """Three are left: nothing arrives. Six of 12: errors are sqrt(2) times larger."""
    white = {**STILL, "sensors__gps__white_m": 0.3, "sensors__gps__velocity_mps": 0.1}
    gps = {"sensors__gps__satellites__open": 12, "sensors__gps__satellites__blocked": 1e-9}
    config = plant_config(**white, **gps)
    for blocked, arrive in ((9.0, 0), (8.0, 199)):
        state = initial_state(config, 1)
        state.sensors.gps.blocked[0] = blocked
        held = config.params.sensors.gps.errors._replace(block=0.0, release=0.0)
        kernel = config.params._replace(
            sensors=config.sensors._replace(gps=config.sensors.gps._replace(errors=held))
        )
        y = record(config, 4000, state=state, kernel=kernel)[1:]
        assert y[:, MEAS.gps_valid].sum() == arrive
        lost = y[y[:, MEAS.gps_valid] == 0.0]
        assert not lost[:, MEAS.gps_pos].any() and not lost[:, MEAS.gps_tick].any()
    same = record(plant_config(**white), 4000, state=initial_state(plant_config(**white), 1))[1:]
    fix = y[:, MEAS.gps_valid] == 1.0
    middle = [0.0, 0.0, -10.0]
    wanted = np.sqrt(3.0) * (same[fix, MEAS.gps_pos] - middle)
    assert y[fix, MEAS.gps_pos] - middle == pytest.approx(wanted, abs=1e-12)
    wanted = np.sqrt(3.0) * same[fix, MEAS.gps_vel]
    assert y[fix, MEAS.gps_vel] == pytest.approx(wanted, abs=1e-12)


def test_outages_come_and_go(plant_config):
    """Two-state chain: share of the time, mean time between and mean length; exponential lengths.

    Lengths are seen once a period (0.2 s): a geometric law of the chain's own end.
    """
    outage = {"sensors__gps__outage__interval_s": 20.0, "sensors__gps__outage__duration_s": 4.0}
    n = 400_000
    _, out, _ = run_gps(plant_config(**STILL, **outage), n)
    edges = np.flatnonzero(np.diff(out)) + 1
    begins, ends = edges[out[edges] == 1.0], edges[out[edges] == 0.0]
    lengths = 0.2 * (ends[: begins.size] - begins[: ends.size])
    count = begins.size
    assert abs(out.mean() / (4.0 / 24.0) - 1.0) < SIGMAS * np.sqrt(2.0 / count)
    end = 4.0**-1 / (1 / 4 + 1 / 20) * -np.expm1(-0.2 * (1 / 4 + 1 / 20))
    assert lengths.mean() == pytest.approx(0.2 / end, rel=SIGMAS / np.sqrt(count))
    assert lengths.std() == pytest.approx(0.2 / end * np.sqrt(1 - end), rel=2 * SIGMAS / count**0.5)
    cycle = 0.2 * np.diff(begins).mean()
    assert cycle == pytest.approx(24.0, rel=SIGMAS / np.sqrt(count) + 0.2 / 24.0)


def test_an_outage_is_silence_and_begins_after_the_start(plant_config, record):
    """No fix arrives while it lasts; 40 flights all begin with one."""
    outage = {"sensors__gps__outage__interval_s": 3.0, "sensors__gps__outage__duration_s": 3.0}
    config = plant_config(**STILL, **outage)
    y = record(config, 6000)
    due = y[::20]
    share = due[:, MEAS.gps_valid].mean()
    assert 0.2 < share < 0.8
    assert not y[np.arange(6000) % 20 != 0, MEAS.gps_valid].any()
    assert not due[due[:, MEAS.gps_valid] == 0.0, MEAS.gps_pos].any()
    firsts = [record(config, 1, seed=seed)[0, MEAS.gps_valid] for seed in range(40)]
    assert firsts == [1.0] * 40


def test_a_receiver_that_is_lost_is_silent_from_then_on(plant_config, record):
    """The last fix is valid before that time and arrives 0.15 s later; all before is the same."""
    whole = record(plant_config(**STILL), 1000)
    lost = record(plant_config(**STILL, sensors__gps__outage__from_s=4.0), 1000)
    valid = lost[:, MEAS.gps_valid] == 1.0
    assert lost[valid, MEAS.gps_tick].max() == 385.0
    np.testing.assert_array_equal(lost[:401], whole[:401])
    assert not valid[401:].any() and whole[401:, MEAS.gps_valid].any()
    until = {"sensors__gps__outage__from_s": 4.0, "sensors__gps__outage__until_s": 6.0}
    back = record(plant_config(**STILL, **until), 1000)
    again = whole[:, MEAS.gps_tick] >= 600.0
    np.testing.assert_array_equal(back[again], whole[again])
    assert back[again, MEAS.gps_valid].sum() == whole[again, MEAS.gps_valid].sum() > 15.0
    assert not back[401:600, MEAS.gps_valid].any()


def test_jumps_are_a_poisson_process(plant_config):
    """Number of jumps, size, and constancy between them."""
    jump = {"sensors__gps__jump__sigma_m": 0.5, "sensors__gps__jump__interval_s": 10.0}
    n = 100_000
    _, _, north = run_gps(plant_config(**STILL, **jump), n)
    changed = np.flatnonzero(np.diff(north))
    expected = n * -np.expm1(-0.2 / 10.0)
    assert abs(changed.size - expected) < SIGMAS * np.sqrt(expected)
    sizes = north[changed]
    assert abs(sizes.std() / 0.5 - 1.0) < SIGMAS / np.sqrt(2.0 * sizes.size)
    lag = 50  # the mean time: 1/e of them have not jumped
    kept = (north[lag:] == north[:-lag]).mean()
    assert kept == pytest.approx(np.exp(-1.0), abs=0.03)


def test_jumps_that_end_are_rare_events_with_a_rate_and_a_length(plant_config):
    """Two-state chain, as the outages': share of the time, lengths, and a size that stays."""
    jump = {"sensors__gps__jump__sigma_m": 0.1, "sensors__gps__jump__interval_s": 40.0,
            "sensors__gps__jump__duration_s": 8.0}  # fmt: skip
    n = 400_000
    _, _, north = run_gps(plant_config(**STILL, **jump), n)
    wrong = north != 0.0
    edges = np.flatnonzero(np.diff(wrong)) + 1
    begins, ends = edges[wrong[edges]], edges[~wrong[edges]]
    lengths = (
        0.2 * (ends[1:] - begins[: ends.size - 1])
        if wrong[0]
        else 0.2 * (ends - begins[: ends.size])
    )
    count = begins.size
    assert abs(wrong.mean() / (8.0 / 48.0) - 1.0) < SIGMAS * np.sqrt(2.0 / count)
    assert lengths.mean() == pytest.approx(8.0, rel=SIGMAS / np.sqrt(count) + 0.03)
    assert np.diff(north[wrong]).astype(bool).sum() <= count
    sizes = north[begins]
    assert abs(sizes.std() / 0.1 - 1.0) < SIGMAS / np.sqrt(2.0 * sizes.size)


@pytest.mark.slow
def test_a_flight_begins_with_a_wrong_fix_as_often_as_one_is_there(plant_config):
    """800 flights with a share of a sixth; without an end each begins with one."""
    ending = {"sensors__gps__jump__sigma_m": 0.1, "sensors__gps__jump__interval_s": 40.0,
              "sensors__gps__jump__duration_s": 8.0}  # fmt: skip
    config = plant_config(**STILL, **ending)
    began = [initial_state(config, seed).sensors.gps.jump.any() for seed in range(800)]
    share = 8.0 / 48.0
    assert abs(np.mean(began) - share) < SIGMAS * np.sqrt(share * (1.0 - share) / 800)
    staying = plant_config(**STILL, **(ending | {"sensors__gps__jump__duration_s": 0.0}))
    assert all(initial_state(staying, seed).sensors.gps.jump.any() for seed in range(10))


def test_the_rtk_grade_has_the_error_of_its_data_sheet():
    """Fixed solution: 0.01 m CEP is 0.0085 m each axis, 0.01 m R50 is 0.0148 m; wrong fixes are
    there for less than a hundredth of the time."""
    plant = resolve("hover", "rtk", world="honest").nodes["plant"]
    gps = {key: plant[f"sensors.gps.{key}"] for key in (
        "white_m", "drift_m", "multipath.sigma_m", "vertical_factor", "jump.interval_s",
        "jump.duration_s",
    )}  # fmt: skip
    level = np.linalg.norm([gps["white_m"], gps["drift_m"], gps["multipath.sigma_m"]])
    assert level == pytest.approx(0.01 / np.sqrt(2.0 * np.log(2.0)), rel=0.03)
    vertical = level * gps["vertical_factor"]
    assert vertical == pytest.approx(0.01 / stats.norm.ppf(0.75), rel=0.03)
    assert 0.0 < jump_share(gps["jump.interval_s"], gps["jump.duration_s"]) < 0.01
    alone = resolve("hover", "rtk", world="paper").nodes["plant"]
    both = np.hypot(alone["sensors.gps.white_m"], alone["sensors.gps.drift_m"])
    assert both == pytest.approx(0.01 / np.sqrt(2.0 * np.log(2.0)), rel=0.03)
