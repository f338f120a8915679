# SPDX-License-Identifier: Apache-2.0
"""Configuration of the plant: from the node's parameters to the kernels' numbers."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_dynamics_sim.config_error import PlantConfigError
from heli_dynamics_sim.fault_table import Fault, fault_kernel, faults_of
from heli_dynamics_sim.faults import FaultKernel
from heli_dynamics_sim.ground import plane_of
from heli_dynamics_sim.parameters import HelicopterKernel, HelicopterParameters
from heli_dynamics_sim.scales import scaled
from heli_dynamics_sim.sensor_config import sensor_kernel
from heli_dynamics_sim.sensors import SensorKernel
from heli_dynamics_sim.standing import spooling
from heli_dynamics_sim.state import STEP_S
from heli_dynamics_sim.terms import Terms
from heli_dynamics_sim.wind import WindKernel
from heli_dynamics_sim.wind_config import wind_kernel
from heli_math.ticks import OF_100_HZ, Rate


class LimitKernel(NamedTuple):
    """Where a flight counts as lost."""

    start_ned_m: np.ndarray  # (3,)
    distance_m: float  # from the start
    cos_tilt: float  # of the largest tilt


class PlantKernel(NamedTuple):
    """Everything that `measure`, `advance` and `status` read."""

    aircraft: HelicopterKernel
    spooling: HelicopterKernel  # the same while its rotor comes up to speed
    wind: WindKernel
    sensors: SensorKernel
    faults: FaultKernel
    limits: LimitKernel
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
    wind : WindKernel
    sensors : SensorKernel
    faults : tuple of Fault
        Of sensors and actuators, and gusts.
    limits : LimitKernel
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
    wind: WindKernel
    sensors: SensorKernel
    faults: tuple[Fault, ...]
    limits: LimitKernel
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
    def from_parameters(cls, values: Mapping[str, Any]) -> "PlantConfig":
        """Build from the parameters of the node `plant` (see `parameter_table`).

        Raises
        ------
        PlantConfigError
            Names the key whose length or order does not fit.
        AircraftError
            If the aircraft file cannot be used.
        """
        position, rate = np.array(values["initial.pos_ned_m"], float), Rate.of_parameters(values)
        helicopter = replace(
            scaled(HelicopterParameters.from_yaml(values["aircraft_file"]), values),
            terms=Terms(*(bool(values[f"terms.{name}"]) for name in Terms._fields)),
        )
        if values["start.on_ground"]:
            position[2] = -helicopter.gear_height_m
        if position[2] > -helicopter.gear_height_m:
            raise PlantConfigError(
                f"initial.pos_ned_m: down {position[2]:g} m is in the ground; allowed: at most "
                f"{-helicopter.gear_height_m:g} (the c.g. with the skids on the ground)"
            )
        sensors = sensor_kernel(values, helicopter, rate)
        return cls(
            helicopter=helicopter,
            pos_ned_m=position,
            psi=math.radians(values["initial.psi_deg"]),
            wind=wind_kernel(values, helicopter),
            sensors=sensors,
            faults=_faults(values, sensors, rate),
            limits=LimitKernel(
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
        return replace(self, wind=wind_kernel(values, self.helicopter), faults=faults)

    @cached_property
    def kernel(self) -> PlantKernel:
        """The values as the compiled kernels take them."""
        aircraft = self.helicopter.kernel
        aircraft = aircraft._replace(
            ground=aircraft.ground._replace(
                origin=self.pos_ned_m[:2].copy(), plane=plane_of(self.slope)
            )
        )
        tick_s = self.rate.tick_s
        up_in_s = max(self.spool_ticks, 1) * tick_s
        substeps = math.ceil(tick_s / STEP_S)
        return PlantKernel(
            aircraft,
            spooling(aircraft, aircraft.engine.speed / up_in_s),
            self.wind,
            self.sensors,
            fault_kernel(self.faults, self.sensors, self.rate),
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


def _faults(values: Mapping[str, Any], sensors: SensorKernel, rate: Rate) -> tuple[Fault, ...]:
    """The faults, each of which these sensors can have."""
    faults = faults_of(values["faults"])
    engine = any(fault.kind == "stop" for fault in faults)
    if engine and not values["terms.rotor_speed"]:
        raise PlantConfigError(
            "faults: what: engine is not allowed while terms.rotor_speed is off: without it there "
            "is no engine"
        )
    fault_kernel(faults, sensors, rate)
    return faults


def _spool_ticks(values: Mapping[str, Any], rate: Rate) -> int:
    time_s = values["start.spool_up_s"]
    if time_s > 0.0 and not values["start.on_ground"]:
        raise PlantConfigError(
            f"start.spool_up_s: {time_s:g} is not allowed while start.on_ground is false: "
            "in the air the rotor turns"
        )
    return rate.ticks_in(time_s)


def _fail_tick(values: Mapping[str, Any], rate: Rate) -> int:
    time_s = values["engine.fail_time_s"]
    if time_s >= 0.0 and not values["terms.rotor_speed"]:
        raise PlantConfigError(
            f"engine.fail_time_s: {time_s:g} is not allowed while terms.rotor_speed is off: "
            "without it there is no engine"
        )
    return rate.ticks_in(time_s) if time_s >= 0.0 else -1
