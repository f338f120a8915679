# SPDX-License-Identifier: Apache-2.0
"""From the actuators of PX4's helicopter to those of ours, and PX4's parameters for it.

PX4 mixes `servo_i = collective + pitch L_i cos(a_i) - roll L_i sin(a_i)` with the angle a_i of a
servo (clockwise from the nose) and the length L_i of its arm; a servo of the tail takes yaw.
Source: PX4-Autopilot, src/modules/control_allocator (ActuatorEffectivenessHelicopter). What is sent
goes from -1 to 1: src/modules/simulation/pwm_out_sim. As pulses of 1500 + 500 of it us, the numbers
here are those that `heli_flight.ardupilot` undoes its own mix by: the compiled step is the same.
"""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from heli_core.rows import ACTUATOR
from heli_core.ticks import TICK_S
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_dynamics_sim.trim import trim
from heli_flight.ardupilot.servos import ServoNumbers, parameters

ANGLES_DEG = (0.0, 120.0, 240.0)
"""Of the swashplate's servos, clockwise from the nose."""
ARM = 0.5
"""Length of their arms: all of a cyclic and all of the collective together are a servo's travel."""
_COLLECTIVE = 0.5
TAIL, SWASH, USED = 1, slice(2, 5), slice(0, 5)
"""Places in HIL_ACTUATOR_CONTROLS: tail servo, the swashplate's; all, the main motor's first."""
_SWASH_PULSES, _TAIL_PULSE = slice(0, len(ANGLES_DEG)), len(ANGLES_DEG)
_MIDDLE_US, _HALF_US = 1500.0, 500.0
_DEGREE = math.pi / 180.0
_CURVE = 5


def _blades_rad(helicopter: HelicopterParameters) -> tuple[float, float]:
    """The blades' pitch at the ends of PX4's collective."""
    shared = parameters(helicopter)
    return shared["H_COL_ANG_MIN"] * _DEGREE, shared["H_COL_ANG_MAX"] * _DEGREE


def servo_numbers(helicopter: HelicopterParameters) -> ServoNumbers:
    """The way back from pulses of PX4's servos, for its parameters as `px4_parameters` has them."""
    least, most = _blades_rad(helicopter)
    half = _HALF_US / 1000.0
    mix = [
        (-half * ARM * math.sin(a), half * ARM * math.cos(a), half)
        for a in np.radians(ANGLES_DEG).tolist()
    ]
    ends = [_MIDDLE_US + side * _HALF_US for side in (-1.0, 0.0, 1.0)]
    return ServoNumbers(
        np.linalg.inv(np.array(mix)),
        np.full(3, (_MIDDLE_US - 1000.0) / 1000.0),
        -_COLLECTIVE,
        least,
        (most - least) / (2.0 * _COLLECTIVE),
        helicopter.collective_offset_rad,
        helicopter.collective_gain_rad,
        np.array(ends),
    )


def pulses_of(servos: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Pulses (4,), us, swashplate and tail, of HIL_ACTUATOR_CONTROLS' places (16,) in -1..1."""
    out[_SWASH_PULSES] = _MIDDLE_US + _HALF_US * servos[SWASH]
    out[_TAIL_PULSE] = _MIDDLE_US + _HALF_US * servos[TAIL]


def px4_parameters(
    helicopter: HelicopterParameters, rate_hz: int, gps_latency_ticks: int
) -> dict[str, float]:
    """PX4's parameters for an aircraft; whole numbers are ints.

    Feed-forward and damping of the rates are those of `heli_flight.ardupilot`, of which ArduPilot's
    were flown. PX4's have not been.

    Parameters
    ----------
    helicopter : HelicopterParameters
    rate_hz : int
        HIL_SENSOR a second.
    gps_latency_ticks : int
        Age of a fix when it comes, in 10 ms.

    Raises
    ------
    TrimError
        The aircraft does not hover in still air.
    """
    shared = parameters(helicopter)
    least, most = _blades_rad(helicopter)
    col = float(trim(helicopter).u[ACTUATOR.col])
    blades = helicopter.collective_gain_rad * col + helicopter.collective_offset_rad
    curve = np.linspace(-_COLLECTIVE, _COLLECTIVE, _CURVE).tolist()
    swash: dict[str, float] = {"CA_SP0_COUNT": len(ANGLES_DEG)}
    for i, angle in enumerate(ANGLES_DEG):
        swash |= {f"CA_SP0_ANG{i}": angle, f"CA_SP0_ARM_L{i}": ARM}
    functions = (101, 201, 202, 203, 204)
    outputs = {f"PWM_MAIN_FUNC{i}": function for i, function in enumerate(functions, 1)}
    return {
        "MAV_TYPE": 4,
        "CA_AIRFRAME": 11,
        **swash,
        **{f"CA_HELI_PITCH_C{i}": value for i, value in enumerate(curve)},
        **{f"CA_HELI_THR_C{i}": 1.0 for i in range(_CURVE)},
        "CA_HELI_YAW_CCW": 0,
        "CA_HELI_YAW_CP_S": 0.0,
        "CA_HELI_YAW_CP_O": 0.0,
        "CA_HELI_YAW_TH_S": 0.0,
        "COM_SPOOLUP_TIME": 5.0,
        **outputs,
        "IMU_GYRO_RATEMAX": rate_hz,
        "MPC_THR_HOVER": round((blades - least) / (most - least), 3),
        "EKF2_GPS_DELAY": round(1000.0 * TICK_S * gps_latency_ticks, 1),
        "MC_ROLLRATE_FF": shared["ATC_RAT_RLL_FF"],
        "MC_PITCHRATE_FF": shared["ATC_RAT_PIT_FF"],
        "MC_ROLLRATE_D": shared["ATC_RAT_RLL_D"],
        "MC_PITCHRATE_D": shared["ATC_RAT_PIT_D"],
        "MC_ROLLRATE_P": 0.0,
        "MC_PITCHRATE_P": 0.0,
    }


_INT32, _REAL32 = 6, 9
"""MAV_PARAM_TYPE of https://mavlink.io/en/messages/common.html."""


def file_text(values: Mapping[str, float], about: str) -> str:
    """A file that QGroundControl loads (https://docs.qgroundcontrol.com): a parameter a line,
    between tabs vehicle, component, name, value and type."""
    lines = [f"# {about}"]
    for name, value in values.items():
        kind = _INT32 if isinstance(value, int) else _REAL32
        lines.append(f"1\t1\t{name}\t{value:.9g}\t{kind}")
    return "\n".join(lines) + "\n"
