# SPDX-License-Identifier: Apache-2.0
"""Errors of sensors beyond noise and drift, each against the formula of its own theory.

References: sampling theorem (aliases), IEEE Std 952 (Allan deviation of a sine), Groves 2013, eq.
4.16 and 4.17 (scale, misalignment), frequency responses by scipy or by averaging, momentum theory.
Tolerances: 3.5 standard errors; rounding otherwise. Those of the receiver: `test_receiver_errors`.
"""

import numpy as np
import pytest
from scipy import signal

from heli_core.rotations import quat_to_R_nb
from heli_core.rows import MEAS, PLANT
from heli_dynamics_sim.noise import NoiseStreams
from heli_dynamics_sim.plant import initial_state, measure
from heli_dynamics_sim.sensors import filter_gain

STILL = {
    "wind__turbulence": False,
    "wind__profile_speed_mps": [0.0, 0.0, 0.0],
    **{
        f"sensors__imu__{kind}_{key}": 0.0
        for kind in ("gyro", "accel")
        for key in ("noise_density", "bias_walk")
    },
    "sensors__imu__gyro_bias_sigma_radps": 0.0,
    "sensors__imu__accel_bias_sigma_mps2": 0.0,
    "sensors__mag__white_t": 0.0,
    "sensors__baro__white_pa": 0.0,
    "sensors__baro__drift_pa": 0.0,
    "sensors__gps__white_m": 0.0,
    "sensors__gps__drift_m": 0.0,
    "sensors__gps__velocity_mps": 0.0,
}
SIGMAS = 3.5
ROTOR_HZ = 193.73 / (2.0 * np.pi)
TICK_HZ = 100.0


def alias_hz(frequency_hz):
    """Where a sine is seen that is sampled at 100 Hz."""
    return abs(frequency_hz - TICK_HZ * round(frequency_hz / TICK_HZ))


def line(samples, frequency_hz):
    """Amplitude of a line, and rms of what is not this line, by least squares."""
    phase = 2.0 * np.pi * frequency_hz * np.arange(samples.size) / TICK_HZ
    columns = np.column_stack([np.cos(phase), np.sin(phase), np.ones(samples.size)])
    fit = np.linalg.lstsq(columns, samples, rcond=None)[0]
    return np.hypot(*fit[:2]), (samples - columns @ fit).std()


# --- IMU -----------------------------------------------------------------------------------------


def test_rotor_of_two_blades_turns_at_30_8_hz(helicopter):
    """What the lines below stand on: 193.73 rad/s; 2/rev is seen at 38.3 Hz."""
    assert helicopter.main_speed_radps == pytest.approx(193.73)
    assert helicopter.main_blades == 2
    assert alias_hz(ROTOR_HZ) == pytest.approx(30.83, abs=0.005)
    assert alias_hz(2.0 * ROTOR_HZ) == pytest.approx(38.33, abs=0.005)


@pytest.mark.parametrize(("kind", "per_turn"), [("rev", 1), ("blade", 2)])
def test_vibration_is_a_line_at_its_alias(plant_config, record, kind, per_turn):
    """Amplitude and alias of each axis, nothing beside the line; 1e-9. Its rms is A / sqrt(2)."""
    force, rate = [0.7, 1.1, 1.9], [0.1, 0.2, 0.3]
    config = plant_config(
        **STILL,
        **{
            f"sensors__imu__vibration__{kind}_mps2": force,
            f"sensors__imu__vibration__{kind}_radps": rate,
        },
    )
    y = record(config, 6000)
    for axis, amplitude in enumerate([*force, *rate]):
        fitted, rest = line(y[:, axis], alias_hz(per_turn * ROTOR_HZ))
        assert fitted == pytest.approx(amplitude, rel=1e-9)
        assert rest < 1e-9
        rms = (y[:, axis] - y[:, axis].mean()).std()
        assert rms == pytest.approx(amplitude / np.sqrt(2.0), rel=1e-3)


def test_vibration_turns_with_the_rotor(plant_config, record):
    """An unequal blade's force turns as the rotor does: the lateral axis a quarter turn later."""
    config = plant_config(**STILL, sensors__imu__vibration__rev_mps2=[1.0, 1.0, 0.0])
    y = record(config, 2000)
    x, lateral = (y[:, i] - y[:, i].mean() for i in (0, 1))
    assert np.hypot(x, lateral) == pytest.approx(np.ones(2000), abs=3e-3)
    step = np.angle(np.exp(1j * np.diff(np.arctan2(lateral, x))))
    assert step.mean() == pytest.approx(2.0 * np.pi * ROTOR_HZ / TICK_HZ, abs=1e-4)


def test_vibration_follows_the_rotor_that_droops(plant_config, record):
    """With the term rotor_speed: at 170 rad/s the line stands at 27.06 Hz; 1e-6."""
    shaken = {"sensors__imu__vibration__rev_mps2": [1.0, 1.0, 1.0], "terms__rotor_speed": True}
    config = plant_config(**STILL, **shaken)
    state = initial_state(config, 1)
    state.x[PLANT.omega] = 170.0
    fitted, rest = line(record(config, 2000, state=state)[:, 0], 170.0 / (2.0 * np.pi))
    assert fitted == pytest.approx(1.0, rel=1e-6) and rest < 1e-6


def test_filters_of_the_imu_attenuate_before_sampling(plant_config):
    """Average: the mean of a finely sampled sine, 1e-4; low-pass: scipy's Butterworth, 1e-9."""
    average = plant_config(sensors__imu__average_s=0.01).sensors.imu.errors.vibration
    lowpass = plant_config(sensors__imu__lowpass_hz=44.8).sensors.imu.errors.vibration
    within = (np.arange(20_000) + 0.5) / 20_000 * 0.01
    for frequency in (ROTOR_HZ, 2.0 * ROTOR_HZ, 150.0):
        mean = abs(np.exp(2j * np.pi * frequency * within).mean())
        assert abs(filter_gain(frequency, average)) == pytest.approx(mean, rel=1e-4)
        turn = 2.0 * np.pi
        b, a = signal.butter(2, 44.8 * turn, analog=True)
        response = abs(signal.freqs(b, a, [frequency * turn])[1][0])
        assert filter_gain(frequency, lowpass) == pytest.approx(response, rel=1e-9)


@pytest.mark.parametrize(
    ("filter_", "of_rev", "of_blade"),
    [({"sensors__imu__average_s": 0.01}, 0.851, 0.482),
     ({"sensors__imu__lowpass_hz": 44.8}, 0.904, 0.467)],
)  # fmt: skip
def test_filtered_vibration_is_what_is_read(plant_config, record, filter_, of_rev, of_blade):
    """What the filters of the grades leave of 1/rev and of 2/rev, as their files and README say.

    By hand: sin(0.9686)/0.9686, sin(1.937)/1.937; 1/sqrt(1 + 0.688^4), 1/sqrt(1 + 1.376^4).
    """
    for kind, per_turn, left in (("rev", 1, of_rev), ("blade", 2, of_blade)):
        changes = {f"sensors__imu__vibration__{kind}_mps2": [1.0, 1.0, 1.0]}
        config = plant_config(**STILL, **changes, **filter_)
        fitted, _ = line(record(config, 4000)[:, 2], alias_hz(per_turn * ROTOR_HZ))
        assert fitted == pytest.approx(left, abs=5e-4)


@pytest.mark.parametrize("ticks", [1, 7, 50])
def test_allan_deviation_of_the_vibration(plant_config, record, ticks):
    """IEEE Std 952, C.1.7: A sin^2(pi f T) / (pi f T), for n samples n sin(pi f / 100 Hz); 3 %."""
    config = plant_config(**STILL, sensors__imu__vibration__blade_radps=[0.2, 0.2, 0.2])
    rate = record(config, 40_000)[:, 3]
    n = rate.size // ticks
    means = rate[: n * ticks].reshape(n, ticks).mean(axis=1)
    deviation = np.sqrt(0.5 * (np.diff(means) ** 2).mean())
    f = alias_hz(2.0 * ROTOR_HZ) / TICK_HZ
    expected = 0.2 * np.sin(np.pi * f * ticks) ** 2 / (ticks * np.sin(np.pi * f))
    assert deviation == pytest.approx(expected, rel=0.03)


def test_scale_and_misalignment(plant_config, record):
    """y = (I + E) x with the E of the flight; its entries have their sigmas over 200 flights."""
    config = plant_config(
        **STILL,
        sensors__imu__gyro_scale_sigma=0.01,
        sensors__imu__accel_scale_sigma=0.02,
        sensors__imu__gyro_misalignment_rad=0.005,
        sensors__imu__accel_misalignment_rad=0.003,
    )
    ideal, rate = plant_config(**STILL), np.array([0.3, -0.2, 0.5])
    readings = []
    for one in (ideal, config):
        state = initial_state(one, 7)
        state.x[PLANT.rate] = rate
        gain = state.sensors.imu.gain
        readings.append(record(one, 1, state=state)[0])
    assert readings[1][MEAS.force] == pytest.approx(gain[0] @ readings[0][MEAS.force], abs=1e-12)
    assert readings[1][MEAS.rate] == pytest.approx(gain[1] @ rate, abs=1e-12)
    drawn = [initial_state(config, seed).sensors.imu.gain - np.eye(3) for seed in range(200)]
    beside = ~np.eye(3, dtype=bool)
    for sensor, scale, misaligned in ((0, 0.02, 0.003), (1, 0.01, 0.005)):
        entries = np.array([e[sensor] for e in drawn])
        deviations = entries[:, ~beside].std(), entries[:, beside].std()
        for value, sigma, count in zip(deviations, (scale, misaligned), (600, 1200), strict=True):
            assert abs(value / sigma - 1.0) < SIGMAS / np.sqrt(2.0 * count)


def test_readings_stop_at_the_range(plant_config, record):
    """8 g and 500 deg/s: what lies beyond reads exactly the range, what lies within as it is."""
    shaken = {"sensors__imu__vibration__rev_mps2": [90.0, 5.0, 100.0]}
    turning = {"sensors__imu__vibration__rev_radps": [10.0, 1.0, 0.0]}
    limits = {"sensors__imu__accel_range_mps2": 78.5, "sensors__imu__gyro_range_radps": 8.73}
    free = record(plant_config(**STILL, **shaken, **turning), 3000)[:, MEAS.imu]
    cut = record(plant_config(**STILL, **shaken, **turning, **limits), 3000)[:, MEAS.imu]
    ranges = np.repeat([78.5, 8.73], 3)
    assert (cut == np.clip(free, -ranges, ranges)).all()
    assert (abs(cut).max(axis=0) == ranges).tolist() == [True, False, True, True, False, False]
    # A sine cut at c of its amplitude stays at either end for 2 arccos(c) / pi of the time.
    assert (abs(cut[:, 3]) == 8.73).mean() == pytest.approx(2 / np.pi * np.arccos(0.873), abs=0.01)


# --- clocks --------------------------------------------------------------------------------------


def test_jitter_of_the_imu_is_motion_times_time(plant_config):
    """Rates grow by 2 rad/s2: errors of sigma 2 rad/s2 times the jitter, white."""
    config = plant_config(**STILL, sensors__imu__clock_jitter_s=0.001)
    state, rows, y = initial_state(config, 1), NoiseStreams(4).rows(4000), np.zeros(MEAS.size)
    errors = np.zeros(4000)
    for tick in range(4000):
        state.x[PLANT.p] = 0.02 * tick
        measure(state, tick, rows[tick], config.params, y)
        errors[tick] = y[MEAS.rate][0] - 0.02 * tick
    assert errors[0] == 0.0  # nothing is known of the motion before
    assert abs(errors[1:].std() / 0.002 - 1.0) < SIGMAS / np.sqrt(2.0 * 4000)
    assert abs((errors[2:] * errors[1:-1]).mean()) < SIGMAS * 0.002**2 / np.sqrt(4000)


def test_jitter_of_magnetometer_barometer_and_receiver(plant_config, record):
    """Turning at 1 rad/s, climbing and flying: |b x omega|, rho g v, v, times the jitter."""
    pure = {"sensors__mag__soft_iron": np.eye(3), "sensors__mag__hard_iron_t": np.zeros(3)}
    config = plant_config(
        **STILL,
        **pure,
        sensors__mag__clock_jitter_s=0.004,
        sensors__baro__clock_jitter_s=0.005,
        sensors__gps__latency_jitter_s=0.02,
    )
    ideal = plant_config(**STILL, **pure)
    states = initial_state(config, 1), initial_state(ideal, 1)
    for state in states:
        state.x[PLANT.rate], state.x[PLANT.vel] = [0.0, 0.0, 1.0], [10.0, 0.0, -3.0]
    y = record(config, 40_000, state=states[0])
    still = record(ideal, 1, state=states[1])[0]
    body = still[MEAS.mag]
    mag = (y[::2, MEAS.mag] - body).std(axis=0)
    error = SIGMAS / np.sqrt(2.0 * 20_000)
    assert mag[:2] == pytest.approx(0.004 * np.abs([body[1], body[0]]), rel=error)
    assert mag[2] == pytest.approx(0.0, abs=1e-18)
    up = -(quat_to_R_nb(states[0].x[PLANT.quat]) @ [10.0, 0.0, -3.0])[2]
    density_gravity = 1.2192 * 9.80665  # ISA at 60 m (ICAO Doc 7488 table, between 50 and 100 m)
    baro = (y[::5, MEAS.baro] - still[MEAS.baro]).std()
    assert baro == pytest.approx(0.005 * density_gravity * up, rel=SIGMAS / np.sqrt(16_000.0))
    fixes = y[y[:, MEAS.gps_valid] == 1.0][1:]
    velocity = quat_to_R_nb(states[0].x[PLANT.quat]) @ [10.0, 0.0, -3.0]
    late = (fixes[:, MEAS.gps_pos] - states[0].x[PLANT.pos]).std(axis=0)
    assert late == pytest.approx(
        0.02 * abs(velocity), rel=SIGMAS / np.sqrt(2.0 * len(fixes)), abs=1e-6
    )


# --- magnetometer and barometer ------------------------------------------------------------------


@pytest.mark.slow
def test_iron_of_the_flight(plant_config):
    """Over 300 flights: sigmas of offset and distortion, which is symmetric."""
    config = plant_config(sensors__mag__hard_iron_sigma_t=1e-6, sensors__mag__soft_iron_sigma=0.02)
    drawn = [initial_state(config, seed).sensors for seed in range(300)]
    hard = np.array([s.hard_iron_t for s in drawn]) - config.sensors.mag.hard_iron_t
    soft = np.array([s.soft_iron for s in drawn]) - config.sensors.mag.soft_iron
    assert abs(hard.std() / 1e-6 - 1.0) < SIGMAS / np.sqrt(2.0 * 900)
    assert abs(soft[:, *np.triu_indices(3)].std() / 0.02 - 1.0) < SIGMAS / np.sqrt(2.0 * 1800)
    assert (soft == soft.transpose(0, 2, 1)).all()


def test_field_of_the_power(plant_config, record, helicopter):
    """Hover in still air: ideal power of the disc, profile power, drag of the fuselage; 1 %."""
    field = np.array([2e-9, -1e-9, 3e-9])
    with_power = plant_config(**STILL, sensors__mag__power_field_t_per_w=field)
    added = record(with_power, 1)[0] - record(plant_config(**STILL), 1)[0]
    p, h = helicopter, 9.781
    disc = 2.0 * p.air_density_kgpm3 * np.pi * p.main_radius_m**2
    thrust = 1.01 * p.mass_kg * h  # it carries the download on the fuselage, too
    induced = thrust * np.sqrt(thrust / disc)
    tip = p.main_speed_radps * p.main_radius_m
    chord = p.main_drag_coefficient * p.main_blades * p.main_chord_m
    profile = p.air_density_kgpm3 * tip**3 * p.main_radius_m * chord / 8.0
    download = 0.5 * p.air_density_kgpm3 * p.drag_area_z_m2 * (thrust / disc) ** 1.5
    assert added[MEAS.mag] == pytest.approx((induced + profile + download) * field, rel=0.01)
    assert added[MEAS.mag] == pytest.approx(840.0 * field, rel=0.02)  # class of the paper's table 1


def test_field_of_an_engine(plant_config, record):
    """With the term rotor_speed the engine's power: that of the main rotor and 5 to 20 % behind
    (tail rotor; Prouty, Helicopter Performance, Stability, and Control, ch. 4); none if failed."""
    field = {"sensors__mag__power_field_t_per_w": [1e-9, 0.0, 0.0], "terms__rotor_speed": True}
    config = plant_config(**STILL, **field)
    without = record(plant_config(**STILL, terms__rotor_speed=True), 1)[0, MEAS.mag]
    state = initial_state(config, 1)
    power = (record(config, 1, state=state)[0, MEAS.mag] - without)[0] / 1e-9
    assert 1.0 < power / 840.0 < 1.25
    state.x[PLANT.engine_out] = 1.0
    assert (record(config, 1, state=state)[0, MEAS.mag] == without).all()


@pytest.mark.parametrize(
    ("towards", "place", "air_mps"),
    [(180.0, 0, (5.0, 0.0)), (0.0, 1, (-5.0, 0.0)), (270.0, 2, (0.0, 5.0)), (90.0, 3, (0.0, -5.0))],
)
def test_wind_on_the_static_port(plant_config, record, helicopter, towards, place, air_mps):
    """Each direction has its own part of the dynamic pressure; 1e-9 Pa."""
    wind = {"wind__profile_speed_mps": [5.0, 5.0, 5.0], "wind__towards_deg": towards}
    coefficients = np.zeros(5)
    coefficients[place] = -0.3
    calm = {key: value for key, value in STILL.items() if not key.startswith("wind__profile")}
    port = {"sensors__baro__wind_coefficients": coefficients}
    config = plant_config(**calm, **wind, **port)
    state = initial_state(config, 1)
    flow = quat_to_R_nb(state.x[PLANT.quat]).T @ [*air_mps, 0.0]
    error = record(config, 1, state=state)[0] - record(plant_config(**calm, **wind), 1)[0]
    expected = -0.3 * 0.5 * helicopter.air_density_kgpm3 * flow[place // 2] ** 2
    assert error[MEAS.baro] == pytest.approx(expected, abs=1e-9)
    assert expected == pytest.approx(-0.3 * 16.1, rel=0.05)


def test_wash_on_the_static_port(plant_config, record, helicopter):
    """With the coefficient 3 of momentum theory: 3/4 of the disc loading of the hover; 2 %."""
    added = record(plant_config(**STILL, sensors__baro__wash_coefficient=3.0), 1)[0]
    added -= record(plant_config(**STILL), 1)[0]
    loading = 1.01 * helicopter.mass_kg * 9.781 / (np.pi * helicopter.main_radius_m**2)
    assert added[MEAS.baro] == pytest.approx(0.75 * loading, rel=0.02)


# --- off -----------------------------------------------------------------------------------------


def test_streams_of_before_are_what_they_were():
    """The first ten children of the seed, in their order: wind, IMU, magnetometer, baro, GPS."""
    children = np.random.SeedSequence(11).spawn(10)
    sizes = (5, 12, 3, 2, 9)
    for first, rows in ((0, NoiseStreams(11).rows(3)), (5, NoiseStreams(11).initial_rows(3))):
        drawn = [
            np.random.default_rng(children[first + i]).standard_normal((3, size))
            for i, size in enumerate(sizes)
        ]
        assert (rows[:, :31] == np.hstack(drawn)).all()


def test_off_is_off(plant_config, record):
    """Everything switched on, but of no size: the readings of today, bit for bit."""
    config = plant_config(wind__turbulence=True)
    sensors = config.sensors
    assert not (
        sensors.imu.errors.on
        or sensors.imu.errors.vibration.on
        or sensors.mag.power.on
        or sensors.baro.port.on
        or sensors.gps.errors.on
    )
    vibration = sensors.imu.errors.vibration._replace(on=True)
    on = sensors._replace(
        imu=sensors.imu._replace(errors=sensors.imu.errors._replace(on=True, vibration=vibration)),
        mag=sensors.mag._replace(power=sensors.mag.power._replace(on=True)),
        baro=sensors.baro._replace(port=sensors.baro.port._replace(on=True)),
        gps=sensors.gps._replace(errors=sensors.gps.errors._replace(on=True)),
    )
    kernel = config.params._replace(sensors=on)
    assert (record(config, 400) == record(config, 400, kernel=kernel)).all()
