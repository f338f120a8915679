# SPDX-License-Identifier: Apache-2.0
"""What a flight knows as MAVLink messages (https://mavlink.io/en/messages/common.html).

Attitude and position are what the observer estimates, as of a real vehicle; never the truth.
GPS_RAW_INT is the receiver's newest fix. What is not known is sent as the protocol's "unknown", or
not at all.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_core.rotations import euler_from_quat
from heli_core.rows import ACTUATOR, MEAS, NAV
from heli_core.ticks import NS_PER_S, stamp_at
from heli_core.version import version
from heli_flight.mavlink.link import common
from heli_flight.mavlink.names import mode_of
from heli_flight.stepping import SteppedFlight
from heli_msgs_bridge.frames import Datum, datum, ned_to_geodetic
from heli_outer_pd.disturbance import flyable
from heli_outer_pd.modes import LANDING, TAKING_OFF, Phase

Message = Any
UNKNOWN_16 = 0xFFFF
_FIX_LASTS_NS = 2 * NS_PER_S
_PULSES = (1500.0, 500.0)
"""Middle and half range of a servo's pulse, us."""
_SENSORS = (
    common.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | common.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | common.MAV_SYS_STATUS_SENSOR_3D_MAG
    | common.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | common.MAV_SYS_STATUS_SENSOR_GPS
    | common.MAV_SYS_STATUS_SENSOR_ATTITUDE_STABILIZATION
    | common.MAV_SYS_STATUS_SENSOR_Z_ALTITUDE_CONTROL
    | common.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
    | common.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    | common.MAV_SYS_STATUS_AHRS
    | common.MAV_SYS_STATUS_GEOFENCE
    | common.MAV_SYS_STATUS_PREARM_CHECK
)
_NEED_POSITION = (
    common.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL | common.MAV_SYS_STATUS_PREARM_CHECK
)
CAPABILITIES = (
    common.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | common.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | common.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | common.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
)


@dataclass
class Fix:
    """The receiver's newest fix: NED, m and m/s, and when it came; below zero: never."""

    pos_ned_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    vel_ned_mps: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    at_ns: int = -1


class Telemetry:
    """Builds messages of the present tick of a flight.

    Parameters
    ----------
    flight : SteppedFlight
    autopilot : int
        MAV_AUTOPILOT of the heartbeat.

    Attributes
    ----------
    armed, offboard : bool
        As the vehicle is; written by it.
    datum : Datum
        Where the NED origin lies.
    """

    def __init__(self, flight: SteppedFlight, autopilot: int) -> None:
        self._flight, self._autopilot = flight, autopilot
        plant = flight.settings.nodes["plant"]
        self.datum: Datum = datum(
            plant["origin.latitude_deg"], plant["origin.longitude_deg"], plant["origin.altitude_m"]
        )
        self._begun_ns = stamp_at(plant["start_time_s"])
        self.armed = self.offboard = False
        self._fix = Fix()
        self._fixed = common.GPS_FIX_TYPE_3D_FIX
        if flight.settings.gps == "rtk":
            self._fixed = common.GPS_FIX_TYPE_RTK_FIXED

    # ---------------------------------------------------------------------------------------------

    @property
    def now_ns(self) -> int:
        """Flight time, ns: MAVLink's time since boot."""
        return self._flight.tick * self._flight.rate.tick_ns

    @property
    def _boot_ms(self) -> int:
        return self.now_ns // 1_000_000 & 0xFFFFFFFF

    @property
    def nav(self) -> NDArray[np.float64]:
        """The observer's row of this tick."""
        return self._flight.loop.rows.nav

    @property
    def phase(self) -> Phase:
        """Of the flight."""
        return self._flight.phases.phase

    def knows(self) -> bool:
        """Whether attitude and position are estimated."""
        return bool(flyable(self.nav))

    def home_ned_m(self) -> NDArray[np.float64] | None:
        """Where it stood first, NED; None while that is not known."""
        return (
            self._flight.phases.home_ned_m if self._flight.phases.trajectory is not None else None
        )

    def sense(self) -> None:
        """Keep what has come from the receiver at this tick."""
        y = self._flight.loop.rows.y
        if y[MEAS.gps_valid] > 0.5:
            self._fix = Fix(y[MEAS.gps_pos].copy(), y[MEAS.gps_vel].copy(), self.now_ns)

    def geodetic(self, pos_ned_m: NDArray[np.float64]) -> tuple[int, int, int]:
        """Latitude and longitude, 1e-7 deg, and height, mm, of a place."""
        out = np.empty(3)
        ned_to_geodetic(np.ascontiguousarray(pos_ned_m), self.datum, out)
        return round(out[0] * 1e7), round(out[1] * 1e7), round(out[2] * 1e3)

    # ---------------------------------------------------------------------------------------------

    def heartbeat(self) -> Message:
        """HEARTBEAT (0): a helicopter, its mode, whether it is armed."""
        base = common.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | common.MAV_MODE_FLAG_STABILIZE_ENABLED
        base |= common.MAV_MODE_FLAG_GUIDED_ENABLED
        base |= common.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        state = common.MAV_STATE_STANDBY
        if self._flight.sentence or self._flight.phases.gone:
            state = common.MAV_STATE_EMERGENCY
        elif self._flight.phases.lost and not self.phase.on_ground:
            state = common.MAV_STATE_CRITICAL
        elif self.armed:
            state = common.MAV_STATE_ACTIVE
        mode = mode_of(self.phase, self.offboard)
        return common.MAVLink_heartbeat_message(
            common.MAV_TYPE_HELICOPTER, self._autopilot, base, mode.custom, state, 3
        )

    def sys_status(self) -> Message:
        """SYS_STATUS (1): what is well; there is no battery."""
        well = _SENSORS if self.knows() else 0
        if self._flight.phases.lost:
            well &= ~_NEED_POSITION
        if self._flight.phases.fence_distance_m > 0.0:
            well &= ~common.MAV_SYS_STATUS_GEOFENCE
        if not self._has_fix():
            well &= ~common.MAV_SYS_STATUS_SENSOR_GPS
        return common.MAVLink_sys_status_message(
            _SENSORS, _SENSORS, well, 0, UNKNOWN_16, -1, -1, 0, 0, 0, 0, 0, 0
        )

    def system_time(self) -> Message:
        """SYSTEM_TIME (2)."""
        return common.MAVLink_system_time_message(
            (self._begun_ns + self.now_ns) // 1000, self._boot_ms
        )

    def attitude(self) -> Message | None:
        """ATTITUDE (30): FRD to NED, rad, rad/s."""
        if not self.knows():
            return None
        phi, theta, psi = euler_from_quat(self.nav[NAV.quat])
        return common.MAVLink_attitude_message(
            self._boot_ms, phi, theta, psi, *map(float, self.nav[NAV.rate])
        )

    def attitude_quaternion(self) -> Message | None:
        """ATTITUDE_QUATERNION (31): w, x, y, z."""
        if not self.knows():
            return None
        q, rate = self.nav[NAV.quat], self.nav[NAV.rate]
        return common.MAVLink_attitude_quaternion_message(
            self._boot_ms, *map(float, q), *map(float, rate)
        )

    def local_position(self) -> Message | None:
        """LOCAL_POSITION_NED (32): m, m/s."""
        if not self.knows():
            return None
        return common.MAVLink_local_position_ned_message(
            self._boot_ms, *map(float, self.nav[NAV.pos]), *map(float, self.nav[NAV.vel])
        )

    def global_position(self) -> Message | None:
        """GLOBAL_POSITION_INT (33): heights above the ellipsoid and above home."""
        home = self.home_ned_m()
        if not self.knows() or home is None:
            return None
        pos, vel = self.nav[NAV.pos], self.nav[NAV.vel]
        above_mm = round((home[2] - pos[2]) * 1e3)
        course = round(math.degrees(euler_from_quat(self.nav[NAV.quat])[2]) * 100.0) % 36000
        return common.MAVLink_global_position_int_message(
            self._boot_ms, *self.geodetic(pos), above_mm, *_cmps(vel), course
        )

    def gps_raw(self) -> Message:
        """GPS_RAW_INT (24): the newest fix."""
        fix, kind = self._fix, self._fixed if self._has_fix() else common.GPS_FIX_TYPE_NO_FIX
        lat, lon, alt = self.geodetic(fix.pos_ned_m) if fix.at_ns >= 0 else (0, 0, 0)
        north, east = fix.vel_ned_mps[:2].tolist()
        speed = math.hypot(north, east)
        course = round(math.degrees(math.atan2(east, north)) * 100.0) % 36000
        return common.MAVLink_gps_raw_int_message(
            (self._begun_ns + max(fix.at_ns, 0)) // 1000, kind, lat, lon, alt, UNKNOWN_16,
            UNKNOWN_16, min(round(speed * 100.0), UNKNOWN_16), course, 255,
        )  # fmt: skip

    def _has_fix(self) -> bool:
        return self._fix.at_ns >= 0 and self.now_ns - self._fix.at_ns <= _FIX_LASTS_NS

    def servo_output(self) -> Message:
        """SERVO_OUTPUT_RAW (36): lateral, longitudinal, pedal, collective; 1000 to 2000 us."""
        middle, half = _PULSES
        pulses = [round(middle + half * float(u)) for u in self._flight.u[: ACTUATOR.size]]
        return common.MAVLink_servo_output_raw_message(
            self.now_ns // 1000 & 0xFFFFFFFF, 0, *pulses, *([0] * 4)
        )

    def extended_state(self) -> Message:
        """EXTENDED_SYS_STATE (245): on the ground, in the air, or between."""
        phase, landed = self.phase, common.MAV_LANDED_STATE_IN_AIR
        if phase == Phase.STANDING:
            landed = common.MAV_LANDED_STATE_ON_GROUND
        elif phase in TAKING_OFF:
            landed = common.MAV_LANDED_STATE_TAKEOFF
        elif phase in LANDING:
            landed = common.MAV_LANDED_STATE_LANDING
        return common.MAVLink_extended_sys_state_message(common.MAV_VTOL_STATE_UNDEFINED, landed)

    def home_position(self) -> Message | None:
        """HOME_POSITION (242): where it stood first."""
        home = self.home_ned_m()
        if home is None:
            return None
        nan = math.nan
        return common.MAVLink_home_position_message(
            *self.geodetic(home), *map(float, home), [1.0, 0.0, 0.0, 0.0], nan, nan, nan,
            (self._begun_ns + self.now_ns) // 1000,
        )  # fmt: skip

    def origin(self) -> Message:
        """GPS_GLOBAL_ORIGIN (49): of the local frame."""
        where = self.datum
        return common.MAVLink_gps_global_origin_message(
            round(where.lat_deg * 1e7), round(where.lon_deg * 1e7), round(where.alt_m * 1e3),
            (self._begun_ns + self.now_ns) // 1000,
        )  # fmt: skip

    def autopilot_version(self) -> Message:
        """AUTOPILOT_VERSION (148)."""
        major, minor, patch = (int(part) for part in version().split("."))
        # 255: MAVLink's FIRMWARE_VERSION_TYPE_OFFICIAL.
        software = major << 24 | minor << 16 | patch << 8 | 255
        nothing = [0] * 8
        return common.MAVLink_autopilot_version_message(
            CAPABILITIES, software, 0, 0, 0, nothing, nothing, nothing, 0, 0, 0
        )


def _cmps(vel_ned_mps: NDArray[np.float64]) -> tuple[int, ...]:
    """Velocity, cm/s, within 16 bits."""
    return tuple(min(max(round(float(v) * 100.0), -32767), 32767) for v in vel_ned_mps)


BUILDERS: dict[int, Callable[[Telemetry], Message | None]] = {
    common.MAVLINK_MSG_ID_HEARTBEAT: Telemetry.heartbeat,
    common.MAVLINK_MSG_ID_SYS_STATUS: Telemetry.sys_status,
    common.MAVLINK_MSG_ID_SYSTEM_TIME: Telemetry.system_time,
    common.MAVLINK_MSG_ID_GPS_RAW_INT: Telemetry.gps_raw,
    common.MAVLINK_MSG_ID_ATTITUDE: Telemetry.attitude,
    common.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: Telemetry.attitude_quaternion,
    common.MAVLINK_MSG_ID_LOCAL_POSITION_NED: Telemetry.local_position,
    common.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: Telemetry.global_position,
    common.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: Telemetry.servo_output,
    common.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: Telemetry.origin,
    common.MAVLINK_MSG_ID_AUTOPILOT_VERSION: Telemetry.autopilot_version,
    common.MAVLINK_MSG_ID_HOME_POSITION: Telemetry.home_position,
    common.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: Telemetry.extended_state,
}
"""By message id; all can be asked for by MAV_CMD_REQUEST_MESSAGE."""
INTERVALS_NS = {
    common.MAVLINK_MSG_ID_HEARTBEAT: NS_PER_S,
    common.MAVLINK_MSG_ID_SYS_STATUS: NS_PER_S,
    common.MAVLINK_MSG_ID_SYSTEM_TIME: NS_PER_S,
    common.MAVLINK_MSG_ID_GPS_RAW_INT: NS_PER_S // 5,
    common.MAVLINK_MSG_ID_ATTITUDE: NS_PER_S // 25,
    common.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: NS_PER_S // 25,
    common.MAVLINK_MSG_ID_LOCAL_POSITION_NED: NS_PER_S // 25,
    common.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: NS_PER_S // 5,
    common.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: NS_PER_S // 5,
    common.MAVLINK_MSG_ID_HOME_POSITION: 2 * NS_PER_S,
    common.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: NS_PER_S // 2,
}
"""How often each is sent unless MAV_CMD_SET_MESSAGE_INTERVAL says otherwise, ns of flight time."""
