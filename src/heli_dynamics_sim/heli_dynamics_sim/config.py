# SPDX-License-Identifier: Apache-2.0
"""Configuration of the plant: from the node's parameters to the kernels' numbers."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.errors import ParameterCause, ParameterError, PlantConfigError
from heli_core.faults import Fault, faults_of
from heli_core.jit import by_reference
from heli_core.linear import held_and_linear
from heli_core.sensors import PLAIN, SENSORS
from heli_core.ticks import OF_100_HZ, TICK_S, Rate
from heli_dynamics_sim.aircraft import HelicopterParameters, HelicopterParams, ModelOptions, scaled
from heli_dynamics_sim.airframe import STEP_S, LeverArm
from heli_dynamics_sim.faults import FaultParams, fault_params
from heli_dynamics_sim.ground import plane_of
from heli_dynamics_sim.sensors import (
    BaroParams,
    GpsErrorParams,
    GpsParams,
    ImuErrorParams,
    ImuParams,
    LowpassParams,
    MagParams,
    PlainParams,
    PortParams,
    PowerFieldParams,
    SensorParams,
    VibrationParams,
)
from heli_dynamics_sim.trim import spooling
from heli_dynamics_sim.wind import (
    PLACE,
    W20_ALTITUDE_M,
    PartsParams,
    RandomGusts,
    SinesParams,
    WindParams,
    mean_speed,
)

# -------------------------------------------------------------------------------------------------
# The sensors' kernels from the node's parameters `sensors.*`.
# -------------------------------------------------------------------------------------------------

_Get = Callable[[str], Any]
_NEVER = 2**62


def sensor_params(
    values: Mapping[str, Any], helicopter: HelicopterParameters, rate: Rate
) -> SensorParams:
    """Build the kernels of all sensors.

    Parameters
    ----------
    values : mapping
        Parameters of the node `plant`.
    helicopter : HelicopterParameters
        Its rotor shakes the IMU and blows on the static port.
    rate : Rate
        Of the ticks, at each of which the IMU is read.

    Raises
    ------
    PlantConfigError
        Satellites come and go too often for the period of the fixes.
    """

    def get(name: str) -> Any:
        return values[f"sensors.{name}"]

    mag = MagParams(
        np.array(get("mag.field_ned_t"), dtype=np.float64),
        np.array(get("mag.soft_iron"), dtype=np.float64).reshape(3, 3),
        np.array(get("mag.hard_iron_t"), dtype=np.float64),
        get("mag.white_t"),
        rate.of(get("mag.period_ticks")),
        get("mag.clock_jitter_s"),
        get("mag.soft_iron_sigma"),
        get("mag.hard_iron_sigma_t"),
        _power_field(get),
    )
    baro = BaroParams(
        values["origin.altitude_m"],
        get("baro.white_pa"),
        get("baro.drift_pa"),
        math.exp(-get("baro.period_ticks") * TICK_S / get("baro.drift_tau_s")),
        rate.of(get("baro.period_ticks")),
        get("baro.clock_jitter_s"),
        _port(get, helicopter),
    )
    plain = PlainParams(
        np.array([get(f"{row.name}.white_{row.suffix}") for row in PLAIN], dtype=np.float64),
        np.array([get(f"{row.name}.step_{row.suffix}") for row in PLAIN], dtype=np.float64),
        np.array([rate.of(get(f"{row.name}.period_ticks")) for row in PLAIN], dtype=np.int64),
    )
    imu, imu2 = _imu(get, helicopter, rate.tick_s), bool(get("imu2.enabled"))
    return SensorParams(imu, mag, baro, _gps(get, rate), plain, imu2)


def _imu(get: _Get, helicopter: HelicopterParameters, tick_s: float) -> ImuParams:
    root_rate, root_tick = math.sqrt(1.0 / tick_s), math.sqrt(tick_s)
    return ImuParams(
        gyro_white=get("imu.gyro_noise_density") * root_rate,
        accel_white=get("imu.accel_noise_density") * root_rate,
        gyro_walk=get("imu.gyro_bias_walk") * root_tick,
        accel_walk=get("imu.accel_bias_walk") * root_tick,
        gyro_bias=get("imu.gyro_bias_sigma_radps"),
        accel_bias=get("imu.accel_bias_sigma_mps2"),
        errors=_imu_errors(get, helicopter, tick_s),
        arm=_lever_arm(get("imu.lever_arm_m")),
    )


def _lever_arm(arm_m: Any) -> LeverArm:
    x, y, z = map(float, arm_m)
    return LeverArm(any((x, y, z)), x, y, z)


def _imu_errors(get: _Get, helicopter: HelicopterParameters, tick_s: float) -> ImuErrorParams:
    def six(name: str) -> Any:
        force, rate = get(f"imu.vibration.{name}_mps2"), get(f"imu.vibration.{name}_radps")
        return np.concatenate([np.asarray(force, float), np.asarray(rate, float)])

    rev, blade = six("rev"), six("blade")
    vibration = VibrationParams(
        bool(rev.any() or blade.any()),
        rev,
        blade,
        float(helicopter.main_blades),
        get("imu.average_s"),
        get("imu.lowpass_hz"),
    )
    kinds = ("accel", "gyro")
    gain_sigma = np.empty((2, 3, 3))
    for sensor, kind in enumerate(kinds):
        gain_sigma[sensor] = get(f"imu.{kind}_misalignment_rad")
        np.fill_diagonal(gain_sigma[sensor], get(f"imu.{kind}_scale_sigma"))
    limits = np.array([get("imu.accel_range_mps2"), get("imu.gyro_range_radps")])
    ranges = np.repeat(np.where(limits > 0.0, limits, np.inf), 3)
    clock_s = get("imu.clock_jitter_s")
    lowpass = _lowpass(get("imu.lowpass_motion"), get("imu.lowpass_hz"), tick_s)
    on = vibration.on or clock_s > 0.0 or gain_sigma.any() or (limits > 0.0).any() or lowpass.on
    return ImuErrorParams(bool(on), vibration, clock_s, ranges, gain_sigma, tick_s, lowpass)


LONGEST_IMU_DELAY_S = 0.05
"""Longer than any setting of the InvenSense register maps has: 33.5 ms at 5 Hz."""


def imu_delay_s(lowpass_motion: bool, lowpass_hz: float) -> float:
    """How late an IMU reads slow motion: the group delay of its low-pass at 0 Hz; 0.0: not."""
    if not lowpass_motion or lowpass_hz == 0.0:
        return 0.0
    return math.sqrt(2.0) / (2.0 * math.pi * lowpass_hz)


def _lowpass(on: bool, lowpass_hz: float, tick_s: float) -> LowpassParams:
    if not on:
        return LowpassParams(False, np.zeros((2, 2)), np.zeros(2), np.zeros(2))
    least_hz = math.sqrt(2.0) / (2.0 * math.pi * LONGEST_IMU_DELAY_S)
    if lowpass_hz < least_hz:
        raise PlantConfigError(
            f"{lowpass_hz:g} is not allowed with sensors.imu.lowpass_motion; allowed: at least "
            f"{least_hz:.3g}, which is {LONGEST_IMU_DELAY_S:g} s late",
            ParameterCause.CONFLICT,
            key="sensors.imu.lowpass_hz",
        )
    w = 2.0 * math.pi * lowpass_hz
    A, B = np.array([[0.0, 1.0], [-w * w, -math.sqrt(2.0) * w]]), np.array([[0.0], [w * w]])
    Phi, _, g0, g1 = held_and_linear(A, np.zeros((2, 0)), B, tick_s)
    return LowpassParams(True, Phi, g0[:, 0].copy(), g1[:, 0].copy())


def _power_field(get: _Get) -> PowerFieldParams:
    field = np.array(get("mag.power_field_t_per_w"), dtype=np.float64)
    return PowerFieldParams(bool(field.any()), field)


def _port(get: _Get, helicopter: HelicopterParameters) -> PortParams:
    wind = np.array(get("baro.wind_coefficients"), dtype=np.float64)
    wash = get("baro.wash_coefficient")
    on = bool(wind.any() or wash != 0.0)
    return PortParams(on, wind, wash, 0.5 * helicopter.air_density_kgpm3)


def _gps(get: _Get, rate: Rate) -> GpsParams:
    axes = np.array([1.0, 1.0, get("gps.vertical_factor")])
    lost_s, found_s = get("gps.outage.from_s"), get("gps.outage.until_s")
    return GpsParams(
        get("gps.white_m") * axes,
        get("gps.drift_m") * axes,
        math.exp(-get("gps.period_ticks") * TICK_S / get("gps.drift_tau_s")),
        get("gps.velocity_mps"),
        rate.of(get("gps.period_ticks")),
        rate.of(get("gps.latency_ticks")),
        rate.of(round(lost_s / TICK_S)) if lost_s >= 0.0 else _NEVER,
        rate.of(round(found_s / TICK_S)) if found_s >= 0.0 else _NEVER,
        _gps_errors(get, axes),
        _lever_arm(get("gps.lever_arm_m")),
    )


def _gps_errors(get: _Get, axes: Any) -> GpsErrorParams:
    period_s = get("gps.period_ticks") * TICK_S
    multipath, jump = get("gps.multipath.sigma_m"), get("gps.jump.sigma_m")
    satellites, blocked = get("gps.satellites.open"), get("gps.satellites.blocked")
    blocked_s, latency_s = get("gps.satellites.blocked_s"), get("gps.latency_jitter_s")
    # All may be blocked: what comes and goes in a period must still be a probability.
    least_s = (satellites + blocked) * period_s
    if blocked > 0.0 and blocked_s < least_s:
        raise PlantConfigError(
            f"{blocked_s:g} is not allowed; allowed: at least "
            f"{least_s:g}, (open + blocked) times the period of the fixes",
            ParameterCause.BOUNDS,
            key="sensors.gps.satellites.blocked_s",
        )
    between_s, out_s = get("gps.outage.interval_s"), get("gps.outage.duration_s")
    begin, end = _chain(between_s, out_s, period_s) if between_s > 0.0 else (0.0, 0.0)
    jump_s, lasting_s = get("gps.jump.interval_s"), get("gps.jump.duration_s")
    jumps, jump_ends, jumped = -math.expm1(-period_s / jump_s), 0.0, 1.0
    if lasting_s > 0.0:
        jumps, jump_ends = _chain(jump_s, lasting_s, period_s)
        jumped = jump_share(jump_s, lasting_s)
    on = multipath > 0.0 or jump > 0.0 or blocked > 0.0 or between_s > 0.0 or latency_s > 0.0
    return GpsErrorParams(
        on,
        multipath * axes,
        math.exp(-period_s / get("gps.multipath.tau_s")),
        satellites,
        blocked,
        blocked / blocked_s * period_s,
        period_s / blocked_s if blocked > 0.0 else 0.0,
        begin,
        end,
        jumps if jump > 0.0 else 0.0,
        jump_ends,
        jumped,
        jump * axes,
        latency_s,
    )


def _chain(between_s: float, lasting_s: float, period_s: float) -> tuple[float, float]:
    """Probabilities a period that what comes and goes at constant rates begins, and that it ends.

    A chain of two states in continuous time, sampled once a period.
    """
    rates = 1.0 / between_s + 1.0 / lasting_s
    moved = -math.expm1(-rates * period_s) / rates
    return moved / between_s, moved / lasting_s


def jump_share(interval_s: float, duration_s: float) -> float:
    """Part of the time for which a jump of the GPS lasts; all of it where it ends with the next."""
    return duration_s / (interval_s + duration_s) if duration_s > 0.0 else 1.0


def message_variances(v: Mapping[str, Any]) -> dict[str, tuple[Any, ...]]:
    """What the sensors' messages say of their errors: per group of numbers, SI^2.

    Parameters
    ----------
    v : mapping
        Parameters of the plant.

    Returns
    -------
    dict of tuple
        Of `imu`, `gps`, `gps_velocity` and each of `SENSORS`, by name; a group with three variances
        has one per axis.
    """
    tick_s = Rate.of_parameters(v).tick_s
    gyro, accel = v["sensors.imu.gyro_noise_density"], v["sensors.imu.accel_noise_density"]
    level = v["sensors.gps.white_m"] ** 2 + v["sensors.gps.drift_m"] ** 2
    if v["sensors.gps.covariance"] == "honest":
        share = jump_share(v["sensors.gps.jump.interval_s"], v["sensors.gps.jump.duration_s"])
        level += v["sensors.gps.multipath.sigma_m"] ** 2
        level += share * v["sensors.gps.jump.sigma_m"] ** 2
    return {
        "imu": (gyro**2 / tick_s, accel**2 / tick_s),
        "gps": ((level, level, level * v["sensors.gps.vertical_factor"] ** 2),),
        "gps_velocity": (v["sensors.gps.velocity_mps"] ** 2,),
        **{row.name: (v[f"sensors.{row.name}.white_{row.suffix}"] ** 2,) for row in SENSORS},
    }


# -------------------------------------------------------------------------------------------------
# Configuration of the wind: from the plant's parameters to the kernels' numbers.
# -------------------------------------------------------------------------------------------------


def wind_params(values: Mapping[str, Any], aircraft: HelicopterParameters) -> WindParams:
    """The wind that a plant's parameters describe, for an aircraft's size.

    Raises
    ------
    PlantConfigError
        Names the key whose length, order or value does not fit.
    """
    altitudes = np.array(values["wind.profile_altitude_m"], dtype=np.float64)
    speeds = np.array(values["wind.profile_speed_mps"], dtype=np.float64)
    if altitudes.size == 0 or (np.diff(altitudes) <= 0.0).any():
        raise PlantConfigError(
            f"{altitudes.tolist()} is not allowed; allowed: at least one "
            "altitude, each above the one before",
            ParameterCause.CONFLICT,
            key="wind.profile_altitude_m",
        )
    if speeds.size != altitudes.size:
        raise PlantConfigError(
            f"has {speeds.size} values; allowed: {altitudes.size}, one per wind.profile_altitude_m",
            ParameterCause.LENGTH,
            key="wind.profile_speed_mps",
        )
    starts = np.array(values["wind.gust.start_s"], dtype=np.float64)
    durations = np.array(values["wind.gust.duration_s"], dtype=np.float64)
    amplitudes = np.array(values["wind.gust.amplitude_mps"], dtype=np.float64).reshape(-1, 3)
    for key, count in (("duration_s", durations.size), ("amplitude_mps", amplitudes.shape[0])):
        if count != starts.size:
            raise PlantConfigError(
                f"describes {count} gusts; allowed: {starts.size}, as wind.gust.start_s",
                ParameterCause.LENGTH,
                key=f"wind.gust.{key}",
            )
    towards_rad = math.radians(values["wind.towards_deg"])
    kernel = WindParams(
        altitudes,
        speeds,
        towards_rad,
        bool(values["wind.turbulence"]),
        0.0,
        values["wind.airspeed_floor_mps"],
        starts,
        durations,
        amplitudes,
        values["wind.gust.frame"] == "body",
        _sines_params(values),
        values["wind.profile"] == "log",
        values["wind.roughness_m"],
        bool(values["wind.rotation"]),
        2.0 * aircraft.main_radius_m,
        _parts_params(values, aircraft),
        _random_gusts(values),
        (math.cos(towards_rad), math.sin(towards_rad)),
    )
    return kernel._replace(w20_mps=_w20_mps(values["wind.w20_mps"], kernel))


def _w20_mps(w20_mps: float, kernel: WindParams) -> float:
    if w20_mps >= 0.0:
        return w20_mps
    if kernel.log_profile:
        raise PlantConfigError(
            f"{w20_mps:g} is not allowed with wind.profile log, which it scales; "
            "allowed: the wind at 20 ft, at least 0",
            ParameterCause.CONFLICT,
            key="wind.w20_mps",
        )
    return float(mean_speed(W20_ALTITUDE_M, kernel))


def _parts_params(values: Mapping[str, Any], aircraft: HelicopterParameters) -> PartsParams:
    main, tail, fuselage = (
        bool(values[f"wind.parts.{name}"]) for name in ("main", "tail", "fuselage")
    )
    places, half = np.zeros((len(PLACE), 3)), aircraft.gear_half_length_m
    places[PLACE.main] = 0.0, 0.0, -aircraft.hub_height_m
    places[PLACE.tail] = -aircraft.tail_arm_m, 0.0, -aircraft.tail_height_m
    places[[PLACE.front, PLACE.rear], 0] = half, -half
    needed = np.array([True, main, tail, fuselage, fuselage])
    reach = float(np.linalg.norm(places[needed], axis=1).max())
    return PartsParams(main, tail, fuselage, main or tail or fuselage, places, needed, reach)


def _random_gusts(values: Mapping[str, Any]) -> RandomGusts:
    def ordered(key: str) -> tuple[float, float]:
        low, high = values[f"wind.random_gusts.{key}"]
        if low > high:
            raise PlantConfigError(
                f"[{low:g}, {high:g}] is not allowed; allowed: the smaller number first",
                ParameterCause.CONFLICT,
                key=f"wind.random_gusts.{key}",
            )
        return low, high

    least_share, most_share = ordered("amplitude_w20")
    least_s, most_s = ordered("duration_s")
    return RandomGusts(
        values["wind.random_gusts.rate_per_min"],
        least_share,
        most_share,
        least_s,
        most_s,
        math.radians(values["wind.random_gusts.spread_deg"]),
        values["duration_s"],
    )


def _sines_params(values: Mapping[str, Any]) -> SinesParams:
    lines = np.array(values["wind.sines.frequency_hz"], dtype=np.float64)
    tables = []
    for key in ("amplitude_mps", "phase_rad"):
        table = np.array(values[f"wind.sines.{key}"], dtype=np.float64).reshape(-1, 3)
        if table.shape[0] != lines.size:
            raise PlantConfigError(
                f"describes {table.shape[0]} lines; allowed: {lines.size}, "
                "3 numbers per wind.sines.frequency_hz",
                ParameterCause.LENGTH,
                key=f"wind.sines.{key}",
            )
        tables.append(table)
    duration, fade = values["wind.sines.duration_s"], values["wind.sines.fade_s"]
    if 2.0 * fade > duration:
        raise PlantConfigError(
            f"{fade:g} is not allowed; allowed: at most {0.5 * duration:g}, "
            "half of wind.sines.duration_s",
            ParameterCause.BOUNDS,
            key="wind.sines.fade_s",
        )
    return SinesParams(
        bool((tables[0] != 0.0).any()),
        lines,
        tables[0],
        tables[1],
        values["wind.sines.start_s"],
        duration,
        fade,
        values["wind.sines.frame"] == "body",
    )


# -------------------------------------------------------------------------------------------------
# Config.
# -------------------------------------------------------------------------------------------------


@by_reference
class LimitParams(NamedTuple):
    """Where a flight counts as lost."""

    start_ned_m: np.ndarray  # (3,)
    distance_m: float  # from the start
    cos_tilt: float  # of the largest tilt


@by_reference
class PlantParams(NamedTuple):
    """Everything that `measure`, `advance` and `status` read."""

    aircraft: HelicopterParams
    spooling: HelicopterParams  # the same while its rotor comes up to speed
    wind: WindParams
    sensors: SensorParams
    faults: FaultParams
    limits: LimitParams
    delay_ticks: int
    fail_tick: int  # when the engine fails; negative: never
    onset_s: float  # over which the air begins to move
    pilot_ticks: int  # during which the controls rest in the trim of the start
    spool_ticks: int  # over which the rotor comes up to speed; 0: it turns at the start
    tick_s: float
    substeps: int  # integration steps per tick
    step_s: float  # length of one


@dataclass(frozen=True)
class PlantConfig:
    """A plant that is ready to fly.

    Attributes
    ----------
    helicopter : HelicopterParameters
        That flies: of the file, times the parameters `scale.*`.
    pos_ned_m : (3,) array
        Where it starts.
    psi : float
        Heading at the start, rad.
    wind : WindParams
    sensors : SensorParams
    faults : tuple of Fault
        Of sensors and actuators, and gusts.
    limits : LimitParams
    delay_ticks : int
        Transport delay of the commands.
    fail_tick : int
        Tick at which the engine fails; negative: it does not.
    trimmed_in_wind : bool
        Whether the start is in equilibrium in the mean wind, else in still air.
    onset_s : float
        Time over which the air begins to move, s.
    pilot_ticks : int
        So long the controls rest in the trim of the start.
    on_ground : bool
        Whether it starts on its skids; the altitude of `pos_ned_m` is then that of the unloaded
        gear.
    spool_ticks : int
        Over which the rotor then comes up to speed; 0: it turns at the start.
    idle_collective : float
        Collective at which it then stands.
    slope : (2,) floats
        Rise of the ground per metre to north and east; at the start the ground is at altitude 0.
    rate : Rate
        Of the plant's ticks, which all of the above are counted in.
    """

    helicopter: HelicopterParameters
    pos_ned_m: NDArray[np.float64]
    psi: float
    wind: WindParams
    sensors: SensorParams
    faults: tuple[Fault, ...]
    limits: LimitParams
    delay_ticks: int
    fail_tick: int = -1
    trimmed_in_wind: bool = True
    onset_s: float = 0.0
    pilot_ticks: int = 0
    on_ground: bool = False
    spool_ticks: int = 0
    idle_collective: float = 0.0
    slope: tuple[float, float] = (0.0, 0.0)
    rate: Rate = OF_100_HZ

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], rate: Rate | None = None) -> "PlantConfig":
        """Build from the parameters of the node `plant` (see `parameters.TABLE`).

        Parameters
        ----------
        values : mapping
        rate : Rate, optional
            Of the plant's ticks, for a plant that is flown by others; default: `rate_hz`.

        Raises
        ------
        PlantConfigError
            Names the key whose length or order does not fit.
        AircraftError
            If the aircraft file cannot be used.
        """
        if values["linear_model"]:
            raise PlantConfigError(
                f"{values['linear_model']}: a linear aircraft is flown in one process alone "
                "(heli hover --one-process, heli.fly); allowed here: none",
                ParameterCause.CONFLICT,
                key="linear_model",
            )
        position = np.array(values["initial.pos_ned_m"], float)
        rate = rate or Rate.of_parameters(values)
        helicopter = replace(
            scaled(HelicopterParameters.from_yaml(values["aircraft_file"]), values),
            terms=ModelOptions(*(bool(values[f"terms.{name}"]) for name in ModelOptions._fields)),
        )
        if values["start.on_ground"]:
            position[2] = -helicopter.gear_height_m
        if position[2] > -helicopter.gear_height_m:
            raise PlantConfigError(
                f"down {position[2]:g} m is in the ground; allowed: at most "
                f"{-helicopter.gear_height_m:g} (the c.g. with the skids on the ground)",
                ParameterCause.BOUNDS,
                key="initial.pos_ned_m",
            )
        sensors = sensor_params(values, helicopter, rate)
        return cls(
            helicopter=helicopter,
            pos_ned_m=position,
            psi=math.radians(values["initial.psi_deg"]),
            wind=wind_params(values, helicopter),
            sensors=sensors,
            faults=_faults(values, sensors, rate),
            limits=LimitParams(
                position,
                values["limits.distance_m"],
                math.cos(math.radians(values["limits.tilt_deg"])),
            ),
            delay_ticks=rate.of(values["delay_ticks"]),
            fail_tick=_fail_tick(values, rate),
            trimmed_in_wind=values["initial.trim"] == "mean_wind",
            onset_s=values["initial.wind_onset_s"],
            pilot_ticks=rate.of(values["initial.pilot_ticks"]),
            on_ground=values["start.on_ground"],
            spool_ticks=_spool_ticks(values, rate),
            idle_collective=values["ground.idle_collective"],
            slope=tuple(values["ground.slope"]),
            rate=rate,
        )

    def in_flight(self, values: Mapping[str, Any]) -> "PlantConfig":
        """The same plant in another wind, with other faults, from the node's parameters.

        Raises
        ------
        PlantConfigError
        """
        faults = _faults(values, self.sensors, self.rate)
        return replace(self, wind=wind_params(values, self.helicopter), faults=faults)

    @cached_property
    def params(self) -> PlantParams:
        """The values as the compiled kernels take them."""
        aircraft = self.helicopter.params
        aircraft = aircraft._replace(
            ground=aircraft.ground._replace(
                origin=self.pos_ned_m[:2].copy(), plane=plane_of(self.slope)
            )
        )
        tick_s = self.rate.tick_s
        up_in_s = max(self.spool_ticks, 1) * tick_s
        substeps = math.ceil(tick_s / STEP_S)
        return PlantParams(
            aircraft,
            spooling(aircraft, aircraft.engine.speed / up_in_s),
            self.wind,
            self.sensors,
            fault_params(self.faults, self.sensors, self.rate),
            self.limits,
            self.delay_ticks,
            self.fail_tick,
            self.onset_s,
            self.pilot_ticks,
            self.spool_ticks,
            tick_s,
            substeps,
            tick_s / substeps,
        )


def _faults(values: Mapping[str, Any], sensors: SensorParams, rate: Rate) -> tuple[Fault, ...]:
    """The faults, each of which these sensors can have."""
    try:
        faults = faults_of(values["faults"])
    except ParameterError as error:
        raise PlantConfigError.like(error) from None
    engine = any(fault.kind == "stop" for fault in faults)
    if engine and not values["terms.rotor_speed"]:
        raise PlantConfigError(
            "engine is not allowed while terms.rotor_speed is off: without it there is no engine",
            ParameterCause.CONFLICT,
            key="faults: what",
        )
    fault_params(faults, sensors, rate)
    return faults


def _spool_ticks(values: Mapping[str, Any], rate: Rate) -> int:
    time_s = values["start.spool_up_s"]
    if time_s > 0.0 and not values["start.on_ground"]:
        raise PlantConfigError(
            f"{time_s:g} is not allowed while start.on_ground is false: in the air the rotor turns",
            ParameterCause.CONFLICT,
            key="start.spool_up_s",
        )
    return rate.ticks_in(time_s)


def _fail_tick(values: Mapping[str, Any], rate: Rate) -> int:
    time_s = values["engine.fail_time_s"]
    if time_s >= 0.0 and not values["terms.rotor_speed"]:
        raise PlantConfigError(
            f"{time_s:g} is not allowed while terms.rotor_speed is off: "
            "without it there is no engine",
            ParameterCause.CONFLICT,
            key="engine.fail_time_s",
        )
    return rate.ticks_in(time_s) if time_s >= 0.0 else -1
