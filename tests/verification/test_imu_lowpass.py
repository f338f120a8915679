# SPDX-License-Identifier: Apache-2.0
"""The IMU's low-pass that delays the motion, against the analytic second-order Butterworth filter.

The ramp and the step response are closed forms; the sine's gain and phase are scipy's. Tolerance:
rounding, where the input is a straight line from tick to tick; by how much a sine is off it in a
tick, (omega T)^2 / 8, otherwise.
"""

import numpy as np
import pytest
from scipy import signal

from heli_core.rows import MEAS, PLANT
from heli_dynamics_sim.config import imu_delay_s
from heli_dynamics_sim.linear_plant import LinearPlant
from heli_dynamics_sim.noise import NOISE
from heli_dynamics_sim.plant import initial_state, measure
from heli_dynamics_sim.sensors import filter_motion
from heli_flight.settings import resolve

CUT_OFF_HZ = 44.8
OMEGA = 2.0 * np.pi * CUT_OFF_HZ
DAMPED = OMEGA / np.sqrt(2.0)
"""Real and imaginary part of the poles."""
LOWPASS = {"sensors__imu__lowpass_hz": CUT_OFF_HZ, "sensors__imu__lowpass_motion": True}
EXACT = {
    "wind__turbulence": False,
    "sensors__imu__gyro_noise_density": 0.0,
    "sensors__imu__gyro_bias_sigma_radps": 0.0,
    "sensors__imu__gyro_bias_walk": 0.0,
    "sensors__imu__accel_noise_density": 0.0,
    "sensors__imu__accel_bias_sigma_mps2": 0.0,
    "sensors__imu__accel_bias_walk": 0.0,
}


def filtered(config, inputs):
    """What the filter of a plant makes of inputs (n,), one a tick, on the third axis."""
    errors, motion = initial_state(config, 1).sensors.imu, np.zeros(6)
    out = []
    for tick, value in enumerate(inputs):
        motion[:] = 0.0
        motion[2] = value
        filter_motion(errors, tick, config.params.sensors.imu.errors.lowpass, motion)
        out.append(motion[2])
    return np.array(out)


@pytest.fixture(params=[100, 400])
def config(request, plant_config):
    return plant_config(rate_hz=request.param, **LOWPASS)


def test_the_delay_is_that_of_a_data_sheet():
    """Register map of the InvenSense MPU-9250, accelerometer: 44.8 Hz, 4.88 ms."""
    assert imu_delay_s(True, CUT_OFF_HZ) == pytest.approx(4.88e-3, rel=0.03)
    assert imu_delay_s(False, CUT_OFF_HZ) == imu_delay_s(True, 0.0) == 0.0


def test_a_ramp_comes_late_by_the_delay(config):
    """t - d + exp(-a t) (d cos(a t)), a = omega / sqrt(2), d = sqrt(2) / omega; then just t - d."""
    t = np.arange(60) * config.rate.tick_s
    d = imu_delay_s(True, CUT_OFF_HZ)
    expected = t - d + d * np.exp(-DAMPED * t) * np.cos(DAMPED * t)
    assert filtered(config, t) == pytest.approx(expected, abs=1e-14)
    assert expected[-1] == pytest.approx(t[-1] - d, abs=1e-12)


def test_a_step_rises_over_a_tick_and_overshoots(config):
    """A step between two ticks is a ramp over one: the difference of two ramps' answers."""
    tick_s, d = config.rate.tick_s, imu_delay_s(True, CUT_OFF_HZ)

    def ramp(t):
        t = np.maximum(t, 0.0)
        return t - d + d * np.exp(-DAMPED * t) * np.cos(DAMPED * t)

    t = np.arange(60) * tick_s
    expected = (ramp(t) - ramp(t - tick_s)) / tick_s
    assert filtered(config, np.sign(t)) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("frequency_hz", [0.5, 2.0, 5.0, 10.0])
def test_gain_and_phase_of_a_sine(config, frequency_hz):
    tick_s, w = config.rate.tick_s, 2.0 * np.pi * frequency_hz
    t = np.arange(int(4.0 / tick_s)) * tick_s
    out = filtered(config, np.sin(w * t))
    late = t > 2.0
    columns = np.column_stack([np.sin(w * t), np.cos(w * t)])[late]
    real, imaginary = np.linalg.lstsq(columns, out[late], rcond=None)[0]
    b, a = signal.butter(2, OMEGA, analog=True)
    expected = signal.freqs(b, a, [w])[1][0]
    found, off = real + 1j * imaginary, (w * tick_s) ** 2 / 8.0
    assert abs(found) == pytest.approx(abs(expected), abs=off)
    assert np.angle(found) == pytest.approx(np.angle(expected), abs=off)


def turned(measured, state, n, radps=0.3):
    """Rows of an aircraft held in place whose rates grow by radps a tick, n ticks."""
    rows = np.zeros((n, MEAS.size))
    for tick in range(n):
        state[PLANT.rate] = radps * tick * np.array([1.0, -2.0, 0.5])
        measured(tick, rows[tick])
    return rows


def test_both_imus_of_both_plants_read_late(plant_config):
    """Gyros by the ramp's delay; the accelerometers, whose force is no ramp, of neither stay."""
    changes = {**EXACT, **LOWPASS, "sensors__imu2__enabled": True}
    config = plant_config(**changes)
    state = initial_state(config, 1)
    noise = np.zeros(NOISE.size)

    def aircraft(tick, row):
        measure(state, tick, noise, config.params, row)

    plain = {key.replace("__", "."): value for key, value in changes.items()}
    over = {"plant": plain, "observer": {"imu2.enabled": True}}
    nodes = resolve("hover", "rtk", 1, 2.0, overrides=over).nodes
    linear = LinearPlant("heli600")
    linear.reset(np.random.default_rng(1), 0.01, nodes)

    def model(tick, row):
        linear.measure(tick, row, np.zeros(19))

    for measured, x in ((aircraft, state.x), (model, linear.state)):
        rows, late_ticks = turned(measured, x, 40), imu_delay_s(True, CUT_OFF_HZ) / 0.01
        expected = 0.3 * (39 - late_ticks) * np.array([1.0, -2.0, 0.5])
        assert rows[-1, MEAS.rate] == pytest.approx(expected, rel=1e-9)
        assert (rows[:, MEAS.imu2] == rows[:, MEAS.imu]).all()


def test_the_accelerometers_read_the_filtered_force(plant_config):
    """Of an aircraft whose rates, so whose drag and rotor, change: scipy's filter, 1e-9."""
    plain, late = plant_config(**EXACT), plant_config(**EXACT, **LOWPASS)
    force = []
    for config in (plain, late):
        state = initial_state(config, 1)

        def aircraft(tick, row, state=state, config=config):
            measure(state, tick, np.zeros(NOISE.size), config.params, row)

        force.append(turned(aircraft, state.x, 60, 0.05)[:, MEAS.force])
    t = np.arange(60) * 0.01
    b, a = signal.butter(2, OMEGA, analog=True)
    for i in range(3):
        start = force[0][0, i]
        _, expected, _ = signal.lsim((b, a), force[0][:, i] - start, t)
        assert force[1][:, i] == pytest.approx(start + expected, abs=1e-9)
    assert np.abs(force[1] - force[0]).max() > 1e-3


def test_the_low_pass_moves_nothing_else_and_by_default_nothing(plant_config):
    """To the last bit."""
    assert not plant_config().params.sensors.imu.errors.lowpass.on
    rows = []
    for changes in ({}, {"sensors__imu__lowpass_hz": CUT_OFF_HZ}, LOWPASS):
        config = plant_config(**changes)
        state = initial_state(config, 1)

        def aircraft(tick, row, state=state, config=config):
            measure(state, tick, np.ones(NOISE.size), config.params, row)

        rows.append(turned(aircraft, state.x, 20))
    assert (rows[1] == rows[0]).all()
    changed = set(np.flatnonzero((rows[2] != rows[0]).any(axis=0)))
    assert changed == {*range(MEAS.size)[MEAS.imu]}
