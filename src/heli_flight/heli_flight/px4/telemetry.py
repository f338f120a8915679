# SPDX-License-Identifier: Apache-2.0
"""What PX4 is told: HIL_SENSOR, HIL_GPS and HIL_STATE_QUATERNION, in their units.

HIL_SENSOR's time is PX4's clock; the bits of `fields_updated` say what is new in it. Sensors read
as ours do, with noise, bias, latency and faults; HIL_STATE_QUATERNION is the truth, for PX4's log
alone. Sources: https://mavlink.io/en/messages/common.html, and PX4-Autopilot,
src/modules/simulation/simulator_mavlink, for how PX4 reads them (`eph` and `epv` are cm there).
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from heli_core.atmosphere import LAPSE_RATE_K_PER_M, SEA_LEVEL_TEMPERATURE_K, altitude_m
from heli_core.rows import MEAS
from heli_core.ticks import Rate, stamp_at
from heli_dynamics_sim.config import message_variances
from heli_flight.ardupilot.physics import Physics
from heli_flight.ardupilot.protocol import REPLY
from heli_flight.mavlink.link import common
from heli_flight.settings import Settings
from heli_msgs_bridge.frames import datum, ned_to_geodetic

ACCEL, GYRO, MAG = 0b111, 0b111 << 3, 0b111 << 6
BARO = 1 << 9 | 1 << 11 | 1 << 12
"""Bits of `fields_updated`: pressure, its altitude, and temperature."""
_GAUSS_PER_T, _PA_PER_HPA = 1e4, 100.0
_ZERO_C_K, _G_MPS2 = 273.15, 9.80665
_LARGEST = 32767
_LARGEST_CM = 65534


class SensorTelemetry:
    """Messages of a flight's present tick.

    Parameters
    ----------
    settings : Settings
    physics : Physics
        Told what is; its sensors' row is what is sent.
    """

    def __init__(self, settings: Settings, physics: Physics) -> None:
        values: Mapping[str, Any] = settings.nodes["plant"]
        self._physics = physics
        self._datum = datum(
            values["origin.latitude_deg"],
            values["origin.longitude_deg"],
            values["origin.altitude_m"],
        )
        self._begun_us = stamp_at(values["start_time_s"]) // 1000
        self._home = physics.home_ned_m
        variances = message_variances(values)
        level = np.sqrt(variances["gps"][0])
        self._eph_cm = min(max(round(100.0 * float(level[0])), 1), _LARGEST_CM)
        self._epv_cm = min(max(round(100.0 * float(level[2])), 1), _LARGEST_CM)
        self._satellites = min(int(values["sensors.gps.satellites.open"]), 254)
        rtk = settings.gps == "rtk"
        self._fix = common.GPS_FIX_TYPE_RTK_FIXED if rtk else common.GPS_FIX_TYPE_3D_FIX
        self._last = np.zeros(MEAS.imu.stop)
        self._last[MEAS.force] = physics.told[REPLY.force]

    @property
    def _rate(self) -> Rate:
        return self._physics.rate

    def time_us(self) -> int:
        """PX4's clock at this tick: never 0, which says "never" there."""
        return self._rate.time_ns(self._physics.tick + 1) // 1000

    @property
    def first_us(self) -> int:
        """And at the first tick."""
        return self._rate.time_ns(1) // 1000

    def sensor(self) -> Any:
        """HIL_SENSOR (107): m/s2 and rad/s of the body (FRD), gauss, hPa, m, deg C."""
        y, updated = self._physics.y, 0
        for place, bits in ((MEAS.force, ACCEL), (MEAS.rate, GYRO)):
            if np.isfinite(y[place]).all():  # a sample that is lost leaves the last one
                self._last[place] = y[place]
                updated |= bits
        mag, pressure_pa = np.zeros(3), 0.0
        if y[MEAS.mag_valid] > 0.5 and np.isfinite(y[MEAS.mag]).all():
            mag = _GAUSS_PER_T * y[MEAS.mag]
            updated |= MAG
        height_m, temperature_c = 0.0, 0.0
        if y[MEAS.baro_valid] > 0.5 and y[MEAS.baro] > 0.0:
            pressure_pa = float(y[MEAS.baro])
            height_m = float(altitude_m(pressure_pa))
            temperature_c = SEA_LEVEL_TEMPERATURE_K - LAPSE_RATE_K_PER_M * height_m - _ZERO_C_K
            updated |= BARO
        return common.MAVLink_hil_sensor_message(
            self.time_us(), *self._last[MEAS.force].tolist(), *self._last[MEAS.rate].tolist(),
            *mag.tolist(), pressure_pa / _PA_PER_HPA, 0.0, height_m, temperature_c, updated,
        )  # fmt: skip

    def fix(self) -> Any | None:
        """HIL_GPS (113): 1e-7 deg, mm, cm, cm/s, cdeg; None if no fix has come at this tick."""
        y = self._physics.y
        if y[MEAS.gps_valid] < 0.5:
            return None
        pos, vel = y[MEAS.gps_pos], y[MEAS.gps_vel]
        if not (np.isfinite(pos).all() and np.isfinite(vel).all()):
            return None
        north, east, down = (_short(100.0 * v) for v in vel.tolist())
        speed_cmps = min(round(100.0 * math.hypot(vel[0], vel[1])), _LARGEST_CM)
        course_cdeg = round(100.0 * math.degrees(math.atan2(vel[1], vel[0]))) % 36000
        valid_us = self._begun_us + self._rate.time_ns(int(y[MEAS.gps_tick])) // 1000
        return common.MAVLink_hil_gps_message(
            valid_us, self._fix, *self._geodetic(pos), self._eph_cm, self._epv_cm, speed_cmps,
            north, east, down, course_cdeg, self._satellites,
        )  # fmt: skip

    def truth(self) -> Any:
        """HIL_STATE_QUATERNION (115): w, x, y, z, rad/s, 1e-7 deg, mm, cm/s, mg."""
        told = self._physics.told
        rates, vel = told[REPLY.gyro].tolist(), told[REPLY.vel].tolist()
        force = [_short(1000.0 * f / _G_MPS2) for f in told[REPLY.force].tolist()]
        air_cmps = min(round(100.0 * float(told[REPLY.airspeed])), _LARGEST_CM)
        return common.MAVLink_hil_state_quaternion_message(
            self.time_us(), told[REPLY.quat].tolist(), *rates,
            *self._geodetic(told[REPLY.pos] + self._home), *(_short(100.0 * v) for v in vel),
            air_cmps, air_cmps, *force,
        )  # fmt: skip

    def _geodetic(self, pos_ned_m: np.ndarray) -> tuple[int, int, int]:
        out = np.empty(3)
        ned_to_geodetic(np.ascontiguousarray(pos_ned_m), self._datum, out)
        return round(out[0] * 1e7), round(out[1] * 1e7), round(out[2] * 1e3)


def _short(value: float) -> int:
    """Within 16 bits."""
    return min(max(round(value), -_LARGEST), _LARGEST)
