# SPDX-License-Identifier: Apache-2.0
"""Sensors and noise: what an ideal sensor reads, noise levels, schedule of the fixes."""

import math

import numpy as np
import pytest

from heli_core.rotations import quat_from_euler, quat_to_R_nb
from heli_core.rows import MEAS
from heli_dynamics_sim import noise
from heli_dynamics_sim.noise import NOISE, NoiseStreams
from heli_dynamics_sim.plant import initial_state, measure

CALM = {"wind__turbulence": False, "wind__profile_speed_mps": [0.0, 0.0, 0.0]}
PERFECT_IMU = {
    f"sensors__imu__{key}": 0.0
    for key in (
        "gyro_noise_density",
        "gyro_bias_walk",
        "gyro_bias_sigma_radps",
        "accel_noise_density",
        "accel_bias_walk",
        "accel_bias_sigma_mps2",
    )
}


def readings(config, ticks, seed=1, move=None, rows=None):
    """Measurements (ticks, 23) of an aircraft that is held, or put where move(tick, x) says."""
    state = initial_state(config, seed)
    rows = NoiseStreams(seed).rows(ticks) if rows is None else rows
    out = np.zeros((ticks, MEAS.size))
    for tick in range(ticks):
        if move is not None:
            move(tick, state.x)
        measure(state, tick, rows[tick], config.params, out[tick])
    return out, state


# --- noise streams -----------------------------------------------------------------------------


def test_rows_and_single_rows_are_the_same_numbers():
    streams, block = NoiseStreams(7), NoiseStreams(7).rows(50)
    assert block.shape == (50, NOISE.size)
    assert all((streams.row() == row).all() for row in block)
    again = NoiseStreams(7)
    assert (np.vstack([again.rows(20), again.rows(30)]) == block).all()


def test_streams_are_independent_white_and_differ_by_seed():
    rows = NoiseStreams(3).rows(40000)
    assert np.corrcoef(rows.T) == pytest.approx(np.eye(NOISE.size), abs=0.03)
    assert (rows[1:] * rows[:-1]).mean(axis=0) == pytest.approx(np.zeros(NOISE.size), abs=0.025)
    assert not (NoiseStreams(4).rows(1) == rows[0]).any()
    assert not (NoiseStreams(3).initial_rows(1) == rows[0]).any()


def test_a_new_source_changes_no_other(monkeypatch):
    before = NoiseStreams(3).rows(5), NoiseStreams(3).initial_rows(2)
    once = NoiseStreams(3).once(4)
    monkeypatch.setattr(noise, "_SOURCES", (*noise._SOURCES, noise.Source(2, 24, 25)))
    after = NoiseStreams(3).rows(5), NoiseStreams(3).initial_rows(2)
    for old, new in zip(before, after, strict=True):
        assert new.shape[1] == NOISE.size + 2
        assert (new[:, : NOISE.size] == old).all()
    assert (NoiseStreams(3).once(4) == once).all()


def test_children_of_the_seed_are_drawn_from_once():
    children = [child for source in noise._SOURCES for child in (source.stream, source.start)]
    once = [noise._GUSTS, noise._ONCE, noise._ONCE_IMU2]
    assert sorted([*children, *once]) == list(range(2 * len(noise._SOURCES) + 3))


def test_negative_seed_is_refused():
    with pytest.raises(ValueError, match="seed -1"):
        NoiseStreams(-1)


# --- IMU -----------------------------------------------------------------------------------------


def test_imu_in_trimmed_hover_reads_gravity_only(plant_config):
    y, state = readings(plant_config(**CALM, **PERFECT_IMU), 1)
    down = quat_to_R_nb(state.x[6:10])[2]
    assert y[0, 0:3] == pytest.approx(-9.781 * down, abs=1e-9)
    assert y[0, 2] == pytest.approx(-9.781, abs=0.02)
    assert (y[0, 3:6] == 0.0).all()


def test_biases_at_the_start_are_drawn_with_their_sigma(plant_config):
    config = plant_config(**CALM)
    sensors = [initial_state(config, seed).sensors for seed in range(60)]
    assert np.std([s.gyro_bias for s in sensors]) == pytest.approx(5e-4, rel=0.2)
    assert np.std([s.accel_bias for s in sensors]) == pytest.approx(0.02, rel=0.2)


# --- magnetometer and barometer ------------------------------------------------------------------


def test_magnetometer_has_no_lag(plant_config):
    """Turning at 2 rad/s: each reading belongs to the heading of its own tick; 1e-12 rad.

    Nose to the right puts north to the left.
    """
    config = plant_config(
        **CALM,
        sensors__mag__white_t=0.0,
        sensors__mag__hard_iron_t=[0.0, 0.0, 0.0],
        sensors__mag__soft_iron=np.eye(3),
        sensors__mag__field_ned_t=[3e-5, 0.0, 4e-5],
    )

    def turn(tick, x):
        x[6:10] = quat_from_euler(0.0, 0.0, 0.02 * tick)

    y, _ = readings(config, 41, move=turn)
    ticks = np.flatnonzero(y[:, 16])
    assert ticks.tolist() == list(range(0, 41, 2))
    assert not y[1::2, 6:9].any()
    assert np.arctan2(-y[ticks, 7], y[ticks, 6]) == pytest.approx(0.02 * ticks, abs=1e-12)


def test_hard_and_soft_iron_enter_linearly(plant_config):
    soft = np.array([[1.1, 0.02, 0.0], [0.03, 0.9, 0.0], [0.0, 0.0, 1.0]])
    field, hard = np.array([3e-5, 1e-6, 4e-5]), np.array([1e-6, -2e-6, 3e-6])
    config = plant_config(
        **CALM,
        sensors__mag__white_t=0.0,
        sensors__mag__hard_iron_t=hard,
        sensors__mag__soft_iron=soft,
        sensors__mag__field_ned_t=field,
    )
    y, state = readings(config, 1)
    body = quat_to_R_nb(state.x[6:10]).T @ field
    assert y[0, 6:9] == pytest.approx(soft @ body + hard, abs=1e-18)


def test_barometer_drifts_and_is_noisy(plant_config):
    config = plant_config(
        **CALM, sensors__baro__drift_tau_s=0.1, sensors__baro__drift_pa=5.0,
        sensors__baro__white_pa=1.5,
    )  # fmt: skip
    y, _ = readings(config, 12000)
    samples = y[::5, 9] - y[::5, 9].mean()
    assert samples.var() == pytest.approx(25.0 + 2.25, rel=0.15)
    lag = 2  # one time constant
    assert (samples[lag:] * samples[:-lag]).mean() == pytest.approx(25.0 / np.e, rel=0.3)


# --- GPS -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("period", "latency"), [(20, 0), (20, 20), (10, 35), (1, 3)])
def test_any_latency_is_served(plant_config, period, latency):
    config = plant_config(
        **CALM,
        sensors__gps__white_m=0.0,
        sensors__gps__drift_m=0.0,
        sensors__gps__velocity_mps=0.0,
        sensors__gps__period_ticks=period,
        sensors__gps__latency_ticks=latency,
    )

    def move(tick, x):
        x[0] = float(tick)
        x[3:6] = quat_to_R_nb(x[6:10]).T @ [0.0, float(tick), 0.0]

    y, _ = readings(config, 120, move=move)
    for tick in np.flatnonzero(y[:, 18]):
        assert tick % period == 0
        assert y[tick, 19] == tick - latency
        assert y[tick, 10] == max(tick - latency, 0.0)
        assert y[tick, 14] == pytest.approx(max(tick - latency, 0.0))


def test_fix_errors_beside_the_drift_are_white(plant_config):
    """Standard deviation over 4000 fixes; the drift is judged in tests/verification."""
    config = plant_config(**CALM, sensors__gps__drift_m=0.0, sensors__gps__period_ticks=1)
    y, state = readings(config, 4000)
    error = y[:, 10:13] - state.x[0:3]
    assert error.std(axis=0) == pytest.approx([0.3, 0.3, 0.45], rel=0.05)
    assert (error[1:] * error[:-1]).mean(axis=0) == pytest.approx([0.0] * 3, abs=0.01)
    assert y[:, 13:16].std(axis=0) == pytest.approx([0.1] * 3, rel=0.05)


def test_first_fix_is_drawn_with_the_full_error(plant_config):
    config = plant_config(**CALM)
    first = np.array([initial_state(config, seed).sensors.gps_queue[0] for seed in range(80)])
    assert first[:, :2].std() == pytest.approx(np.hypot(0.3, 1.0), rel=0.2)
    assert (first[:, 6] == -15).all()


# --- Rotor speed ---------------------------------------------------------------------------------


def test_the_rotor_speed_is_that_of_the_rotor_in_whole_turns_per_minute(plant_config):
    """Every second tick, its noise as it should be: 500 samples, 5 sigma of their deviation."""
    config = plant_config(sensors__rotor_speed__white_radps=2.0)
    y, _ = readings(config, 1000)
    came = y[:, MEAS.rotor_valid] == 1.0
    np.testing.assert_array_equal(np.flatnonzero(came), np.arange(0, 1000, 2))
    assert not y[~came, MEAS.rotor].any()
    speed, measured = config.params.aircraft.main.speed, y[came, MEAS.rotor]
    turns = measured * 60.0 / (2.0 * math.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)
    assert np.std(measured - speed) == pytest.approx(2.0, rel=5.0 / math.sqrt(1000.0))
    assert np.mean(measured - speed) == pytest.approx(0.0, abs=5.0 * 2.0 / math.sqrt(500.0))
