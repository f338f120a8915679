# SPDX-License-Identifier: Apache-2.0
"""An IMU whose samples are of the motion some time before their stamps: known to the observer.

The samples are those of the same path, flown so much later.
"""

import numpy as np
import pytest

from heli_core.errors import ParameterError
from heli_core.parameters import load
from heli_core.rows import IMU, MEAS, NAV
from heli_observer import layout as L
from heli_observer.buffers import motion_at
from heli_observer.dual_imu import NAMES, PAIR
from heli_observer.observer import ObserverConfig, ObserverConfigError
from heli_observer.parameters import NODE_NAME, TABLE
from support.synthetic_sensors import Path, fade_in, hover_path, synthesize

TICKS, DELAY_S = 1000, 0.005
MEAN = (29.0**2 + 30.0**2 + 31.0**2) / 3.0


def swinging():
    """A hover that rolls, pitches and yaws."""
    base = hover_path(climb_mps=2.5)

    def euler(t):
        swing = [0.15 * np.sin(3.0 * t), 0.1 * np.sin(4.0 * t), 0.3 * np.sin(1.5 * t)]
        return base.euler(t) + fade_in(t - 0.5, 2.0)[:, None] * np.column_stack(swing)

    return Path(base.position, euler)


def flown(parameters, delay_s):
    """The flight, and what its sensors say where the IMU's come late; ideal ones."""
    path = swinging()
    late = Path(lambda t: path.position(t - delay_s), lambda t: path.euler(t - delay_s))
    flight, delayed = (
        synthesize(one, parameters, 0.01 * TICKS, seed=0, noise=0.0) for one in (path, late)
    )
    rows = flight.y.copy()
    rows[:, MEAS.imu] = delayed.y[:, MEAS.imu]
    return flight, rows


def errors(flight, out):
    """Largest errors after the alignment has settled: position, velocity, attitude."""
    ticks = np.arange(200, len(out))
    pos = out[ticks, NAV.pos] - flight.pos[ticks]
    vel = out[ticks, NAV.vel] - flight.vel[ticks]
    attitude = flight.attitude_error(out, ticks)
    return tuple(float(np.abs(off).max()) for off in (pos, vel, attitude))


@pytest.mark.parametrize("delay_s", [0.005, 0.0125, 0.03])
def test_a_known_delay_costs_a_turning_attitude_little(parameters, run_observer, delay_s):
    """Unknown it costs about the rate, .45 rad/s, times the delay: here of half a tick to three."""
    flight, rows = flown(parameters, delay_s)
    plain = errors(flight, run_observer(parameters).fly(flight.y[:TICKS]).out)
    known = errors(
        flight, run_observer({**parameters, "ekf.imu.delay_s": delay_s}).fly(rows[:TICKS]).out
    )
    unknown = errors(flight, run_observer(parameters).fly(rows[:TICKS]).out)
    assert known[2] < plain[2] + 0.15 * 0.45 * delay_s
    assert unknown[2] > plain[2] + 0.7 * 0.45 * delay_s
    assert unknown[0] > known[0] and unknown[1] > known[1]


def test_the_motion_of_a_tick_is_on_the_line_between_two_samples(parameters):
    ring, row = np.zeros((40, L.RING.size)), np.zeros(L.RING.size)
    for tick in range(40):
        ring[tick, : IMU.size] = tick * tick
    for delay_s, tick, expected in (
        (0.0, 20, 400.0),
        (0.005, 20, 0.5 * (400.0 + 441.0)),
        (0.0225, 20, 0.75 * 22.0**2 + 0.25 * 23.0**2),
        (0.005, 31, 0.5 * (961.0 + MEAN)),
        (0.0225, 30, MEAN),
        (0.0225, 31, MEAN),
    ):
        config = ObserverConfig({**parameters, "ekf.imu.delay_s": delay_s})
        motion_at(ring, tick, 31, config.params.ekf, row)
        assert row[: IMU.size] == pytest.approx(expected)


def test_what_stands_in_for_a_sample_is_told_of_the_motion_too(parameters):
    ring, row = np.zeros((40, L.RING.size)), np.zeros(L.RING.size)
    ring[11, L.RING.replaced] = 1.0
    ekf = ObserverConfig({**parameters, "ekf.imu.delay_s": DELAY_S}).params.ekf
    for tick, replaced in ((9, 0.0), (10, 1.0), (11, 1.0), (12, 0.0)):
        motion_at(ring, tick, 30, ekf, row)
        assert row[L.RING.replaced] == replaced


def test_a_short_gap_is_bridged_before_it_is_read(parameters, run_observer):
    """The line over a gap of three ticks costs no more than where the IMU is not late."""
    worst = []
    for delay_s in (0.0, DELAY_S):
        flight, rows = flown(parameters, delay_s)
        rows[600:603, MEAS.imu] = np.nan
        run = run_observer({**parameters, "ekf.imu.delay_s": delay_s}).fly(rows[:TICKS])
        worst.append(np.abs(flight.attitude_error(run.out, np.arange(640, 900))).max())
    assert worst[1] < 1.2 * worst[0]


def test_a_second_imu_that_takes_over_is_late_by_the_same(parameters, run_observer):
    """What the two filters of the trial integrate, too, is the motion of its time."""
    delay_s = 0.03
    flight, rows = flown(parameters, delay_s)
    rng = np.random.default_rng(0)
    both = np.hstack([rows, np.zeros((len(rows), MEAS.size - rows.shape[1]))])
    for place in (MEAS.imu2, MEAS.imu):
        both[:, place] = rows[:, MEAS.imu] + 1e-6 * rng.standard_normal((len(both), IMU.size))
    both[500:, MEAS.imu.start] += 3.0
    told = {**parameters, "imu2.enabled": True, "ekf.imu.delay_s": delay_s}
    run = run_observer(told).fly(both[:TICKS])
    assert NAMES[run.state.pair.count[PAIR.left]] == "first"
    assert np.abs(flight.attitude_error(run.out, np.arange(450, TICKS))).max() < 2e-3


@pytest.mark.parametrize("value", [-0.001, 0.051, float("nan"), float("inf")])
def test_a_wrong_delay_is_refused_by_name(config_folder, tmp_path, value):
    path = tmp_path / "wrong.yaml"
    text = f"/**/observer:\n  ros__parameters:\n    ekf.imu.delay_s: {value}\n"
    path.write_text(text.replace(": nan", ": .nan").replace(": inf", ": .inf"))
    with pytest.raises(ParameterError) as refused:
        load(TABLE, [config_folder / "observer.yaml", path], NODE_NAME)
    assert refused.value.key == "ekf.imu.delay_s"


def test_a_delay_beyond_the_horizon_is_refused_by_name(parameters):
    short = {"schedule.gps_latency_ticks": 0, "ekf.horizon_ticks": 1}
    ObserverConfig(parameters | short | {"ekf.imu.delay_s": 0.01})
    with pytest.raises(ObserverConfigError, match="ekf.imu.delay_s"):
        ObserverConfig(parameters | short | {"ekf.imu.delay_s": 0.0101})
