# SPDX-License-Identifier: Apache-2.0
"""Modes and parameters by the names and numbers that MAVLink has for them.

The numbers of modes are PX4's (main mode << 16 | sub mode << 24, `px4_custom_mode.h`,
https://docs.px4.io/main/en/flight_modes/): MAVSDK reads those, whatever autopilot it is told of,
and pymavlink and MAVProxy know their names where the autopilot is PX4.

Parameters have names of at most 16 characters. All are sent as REAL32, so that no station has to
know how whole numbers are encoded (https://mavlink.io/en/services/parameter.html). None can be set:
the controllers were built from them when the flight began.
"""

from collections.abc import Mapping
from enum import Enum
from typing import Any

from heli_outer_pd.modes import LANDING, TAKING_OFF, Phase

_AUTO = 4


class VehicleMode(Enum):
    """A mode; the value is main and sub mode."""

    TAKEOFF = (4, 2)
    LOITER = (4, 3)
    LAND = (4, 6)
    OFFBOARD = (6, 0)
    STABILIZED = (7, 0)

    @property
    def custom(self) -> int:
        """`custom_mode` of a HEARTBEAT."""
        main, sub = self.value
        return main << 16 | sub << 24


OFFERED = (VehicleMode.TAKEOFF, VehicleMode.LOITER, VehicleMode.LAND, VehicleMode.OFFBOARD)
"""Those that may be asked for."""


def mode_of(phase: Phase, offboard: bool) -> VehicleMode:
    """The mode of a phase; offboard: set-points are followed."""
    if phase in TAKING_OFF:
        return VehicleMode.TAKEOFF
    if phase in LANDING:
        return VehicleMode.LAND
    if phase in (Phase.ATTITUDE, Phase.MANUAL):
        return VehicleMode.STABILIZED
    return VehicleMode.OFFBOARD if offboard else VehicleMode.LOITER


def mode_asked(main: int, sub: int) -> VehicleMode | None:
    """The mode of PX4's numbers, if it is offered; only AUTO has sub modes."""
    wanted = main, sub if main == _AUTO else 0
    return next((mode for mode in OFFERED if mode.value == wanted), None)


OUTER_LOOP = {
    "TKO_HEIGHT_M": "takeoff.height_m",
    "TKO_CLIMB_MPS": "takeoff.climb_mps",
    "TKO_SPOOL_UP_S": "takeoff.spool_up_s",
    "LND_DESCENT_MPS": "land.descent_mps",
    "LND_TOUCH_MPS": "land.touch_down_mps",
    "LND_SLOW_BELOW_M": "land.slow_below_m",
    "GOTO_SPEED_MPS": "goto.speed_mps",
    "GOTO_CLIMB_MPS": "goto.climb_mps",
    "GOTO_ACC_MPS2": "goto.acceleration_mps2",
    "GOTO_JERK_MPS3": "goto.jerk_mps3",
    "GOTO_YAW_DEGPS": "goto.yaw_rate_degps",
    "FENCE_RADIUS_M": "fence.radius_m",
    "FENCE_CEILING_M": "fence.ceiling_m",
    "FENCE_MARGIN_M": "fence.margin_m",
    "REF_ALT_MIN_M": "reference_limits.altitude_min_m",
    "REF_ALT_MAX_M": "reference_limits.altitude_max_m",
    "REF_DISTANCE_M": "reference_limits.distance_m",
    "CMD_TIMEOUT_S": "command.timeout_s",
    "FS_LAND_AFTER_S": "failsafe.land_after_s",
    "FS_LAND_ASTRAY_M": "failsafe.land_astray_m",
    "FS_ROTOR_SHARE": "failsafe.rotor_slow_share",
}
"""Name for MAVLink to the outer loop's parameter."""
SYSTEM_ID = "MAV_SYS_ID"


def parameters(outer_loop: Mapping[str, Any], system: int) -> dict[str, float]:
    """Every parameter that can be read, in the order of its index.

    Parameters
    ----------
    outer_loop : mapping
        Parameters of the outer loop of a flight.
    system : int
        Its system id.
    """
    values = {name: float(outer_loop[key]) for name, key in OUTER_LOOP.items()}
    return dict(sorted({SYSTEM_ID: float(system), **values}.items()))
