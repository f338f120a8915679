# SPDX-License-Identifier: Apache-2.0
"""From the pulses of ArduPilot's helicopter to the actuators of ours, and the parameters for it.

ArduPilot mixes roll, pitch and collective into three swashplate servos, `s = 0.45 (roll, pitch) +
collective` with the factors of the swashplate's type, sent as 1000 + 1000 s us; the tail's servo
has its own ends. Here the mix is undone. The collective's range is that of the blades' angle,
`H_COL_ANG_MIN` to `H_COL_ANG_MAX` over `H_COL_MIN` to `H_COL_MAX`. Source: ArduPilot, "Traditional
Helicopters, Swashplate Setup" and the parameters' own descriptions (ardupilot.org/copter/docs).

The same parameters are written for ArduPilot to load (`parameters`) and read back (`read_file`), so
that both sides mean the same.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.errors import ParameterCause
from heli_core.foreign_files import FileError, read_text
from heli_core.jit import by_reference, njit
from heli_core.rcl_yaml import ParameterError, file_refusal
from heli_core.rows import ACTUATOR, PLANT
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_dynamics_sim.trim import trim

# -------------------------------------------------------------------------------------------------
# Swashplates.
# -------------------------------------------------------------------------------------------------

_CYCLIC = 0.45
_SIDE = _CYCLIC * math.cos(math.radians(30.0))


class Swashplate(NamedTuple):
    """A type of swashplate.

    Attributes
    ----------
    number : int
        Of ArduPilot's `H_SW_TYPE`.
    mix : tuple of tuple
        For each servo what it takes of roll, pitch and collective.
    middle : tuple
        And what each servo has besides.
    """

    number: int
    mix: tuple[tuple[float, float, float], ...]
    middle: tuple[float, float, float]


SWASHPLATES = {
    "H3_120": Swashplate(
        3,
        ((_SIDE, 0.5 * _CYCLIC, 1.0), (-_SIDE, 0.5 * _CYCLIC, 1.0), (0.0, -_CYCLIC, 1.0)),
        (0.0, 0.0, 0.0),
    ),
    "H3_140": Swashplate(
        2,
        ((_CYCLIC, _CYCLIC, 1.0), (-_CYCLIC, _CYCLIC, 1.0), (0.0, -_CYCLIC, 1.0)),
        (0.0, 0.0, 0.0),
    ),
    "H1": Swashplate(
        1, ((_CYCLIC, 0.0, 0.0), (0.0, _CYCLIC, 0.0), (0.0, 0.0, 1.0)), (0.5, 0.5, 0.0)
    ),
}
"""By name: three servos at 120 deg; at 140 deg; without mixing, roll, pitch, collective."""
_BY_NUMBER = {plate.number: name for name, plate in SWASHPLATES.items()}

# -------------------------------------------------------------------------------------------------
# The parameters that both sides share.
# -------------------------------------------------------------------------------------------------

ROTOR_CHANNEL, TAIL_CHANNEL = 8, 4
"""Channels, from 1: rotor speed; tail. The swashplate has 1 to 3."""
_DEGREE = math.pi / 180.0
# What ArduPilot allows for the angles at the collective's ends, deg.
_LEAST_DEG, _MOST_DEG = (-20.0, 0.0), (5.0, 20.0)
# Share of the feed-forward, s, that has damped the bar's mode in flight: .004 and .008 of .386.
_DAMPING_S = (0.0104, 0.0207)

_SHARED = (
    "H_SW_TYPE", "H_COL_MIN", "H_COL_MAX", "H_COL_ANG_MIN", "H_COL_ANG_MAX",
    "SERVO4_MIN", "SERVO4_TRIM", "SERVO4_MAX",
)  # fmt: skip
_ZERO = ("H_SW_COL_DIR", *(f"SERVO{n}_REVERSED" for n in range(1, 5)))
"""What changes the signs or the mix: 0 here."""


def parameters(helicopter: HelicopterParameters, swashplate: str = "H3_120") -> dict[str, float]:
    """ArduPilot's parameters for an aircraft, those that differ from its own among them.

    Feed-forward is one over the rate that a unit of cyclic gives in the steady state, the rate of
    the disc's following: tau over the cyclic's gain. Damping is in proportion to it.

    Parameters
    ----------
    helicopter : HelicopterParameters
    swashplate : str
        Name in `SWASHPLATES`.

    Raises
    ------
    TrimError
        The aircraft does not hover in still air.
    """
    hover = trim(helicopter)
    qw, qx, qy, qz = hover.x[PLANT.quat]
    roll = math.atan2(2.0 * (qw * qx + qy * qz), 1.0 - 2.0 * (qx * qx + qy * qy))
    ends = sorted(
        (helicopter.collective_offset_rad + side * helicopter.collective_gain_rad) / _DEGREE
        for side in (-helicopter.servo_travel, helicopter.servo_travel)
    )
    least, most = (
        min(max(end, low), high)
        for end, (low, high) in zip(ends, (_LEAST_DEG, _MOST_DEG), strict=True)
    )
    tau_s = helicopter.flap_time_constant_s
    forward = [
        tau_s / gain
        for gain in (helicopter.flap_lat_from_lat_rad, helicopter.flap_lon_from_lon_rad)
    ]
    servos = {
        f"SERVO{n}_{key}": value
        for n in range(1, TAIL_CHANNEL + 1)
        for key, value in (
            ("FUNCTION", 32 + n), ("MIN", 1000), ("TRIM", 1500), ("MAX", 2000), ("REVERSED", 0),
        )
    }  # fmt: skip
    return {
        "FRAME_CLASS": 6,
        "H_SW_TYPE": SWASHPLATES[swashplate].number,
        "H_SW_COL_DIR": 0,
        "H_COL_MIN": 1250,
        "H_COL_MAX": 1750,
        "H_COL_ANG_MIN": math.ceil(10.0 * least) / 10.0,
        "H_COL_ANG_MAX": math.floor(10.0 * most) / 10.0,
        "H_CYC_MAX": 2500,
        "H_RSC_MODE": 2,
        "H_RSC_SETPOINT": 66,
        "H_RSC_RAMP_TIME": 1,
        "H_RSC_RUNUP_TIME": 5,
        "RC8_OPTION": 32,
        f"SERVO{ROTOR_CHANNEL}_FUNCTION": 31,
        **servos,
        "ATC_RAT_RLL_FF": round(forward[0], 3),
        "ATC_RAT_PIT_FF": round(forward[1], 3),
        "ATC_RAT_RLL_D": round(_DAMPING_S[0] * forward[0], 4),
        "ATC_RAT_PIT_D": round(_DAMPING_S[1] * forward[1], 4),
        "ATC_HOVR_ROL_TRM": round(100.0 * roll / _DEGREE),
        "ARMING_CHECK": 0,
    }


def file_text(values: Mapping[str, float], about: str) -> str:
    """A .parm file: a line for each, after one that says what it is for."""
    lines = [f"# {about}", *(f"{name} {value:g}" for name, value in values.items())]
    return "\n".join(lines) + "\n"


def read_file(path: Path) -> dict[str, float]:
    """The parameters of a .parm file: a name and a number in each line, blank or comma between.

    Raises
    ------
    ParameterError
        The file cannot be read, or a line is none; one sentence with its number.
    """
    try:
        text = read_text(path)
    except FileError as error:
        raise file_refusal(error, path, "ArduPilot's parameters") from None
    values = {}
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            name, value = words[0], float(words[1])
        except (IndexError, ValueError):
            value = math.nan
        if not math.isfinite(value):
            raise ParameterError(
                "expected a name and a number", ParameterCause.SYNTAX, where=f"{path}:{number}"
            )
        values[name] = value
    return values


# -------------------------------------------------------------------------------------------------
# The way back, compiled.
# -------------------------------------------------------------------------------------------------


_TAIL = TAIL_CHANNEL - 1


@by_reference
class ServoNumbers(NamedTuple):
    """Numbers of `deflections`."""

    unmix: np.ndarray  # (3, 3): roll, pitch, collective of what the servos have beside `middle`
    middle: np.ndarray  # (3,)
    col_min: float  # collective at its lower end, as `unmix` gives it
    pitch_min: float  # and the blades' pitch there, rad
    pitch_per_col: float  # rad
    pitch_offset: float  # theta_col0, rad
    pitch_gain: float  # K_col, rad
    tail: np.ndarray  # (3,): pulses of the tail's servo at -1, 0, 1, us


def servo_numbers(values: Mapping[str, float], helicopter: HelicopterParameters) -> ServoNumbers:
    """The way back from pulses for ArduPilot's parameters; those not given are `parameters`'.

    Raises
    ------
    ParameterError
        What is asked for is not flown here: another swashplate, reversed servos, an empty range.
    """
    given = {**parameters(helicopter), **values}
    for name in _ZERO:
        if given[name] != 0:
            raise ParameterError(f"{name}: {given[name]:g} is not allowed; allowed: 0")
    plate = _BY_NUMBER.get(int(given["H_SW_TYPE"]))
    if plate is None:
        known = ", ".join(f"{p.number} ({name})" for name, p in SWASHPLATES.items())
        raise ParameterError(f"H_SW_TYPE: {given['H_SW_TYPE']:g} is not allowed; allowed: {known}")
    for lower, upper in (
        ("H_COL_MIN", "H_COL_MAX"), ("H_COL_ANG_MIN", "H_COL_ANG_MAX"),
        ("SERVO4_MIN", "SERVO4_TRIM"), ("SERVO4_TRIM", "SERVO4_MAX"),
    ):  # fmt: skip
        if not given[lower] < given[upper]:
            raise ParameterError(
                f"{lower}: {given[lower]:g} is not allowed; allowed: below {upper}, "
                f"{given[upper]:g}"
            )
    low, high = ((given[name] - 1000.0) / 1000.0 for name in ("H_COL_MIN", "H_COL_MAX"))
    least, most = (given[name] * _DEGREE for name in ("H_COL_ANG_MIN", "H_COL_ANG_MAX"))
    chosen = SWASHPLATES[plate]
    return ServoNumbers(
        np.linalg.inv(np.array(chosen.mix)),
        np.array(chosen.middle),
        low,
        least,
        (most - least) / (high - low),
        helicopter.collective_offset_rad,
        helicopter.collective_gain_rad,
        np.array([given[f"SERVO4_{end}"] for end in ("MIN", "TRIM", "MAX")], float),
    )


@njit
def deflections(pulse_us, k, out):
    """Actuators (4,) in -1..1 of the pulses (4,) of swashplate and tail, us.

    Lateral is roll to the right, longitudinal nose up; the pedal turns the nose to the left, the
    collective by the aircraft's own map of the blades' pitch.
    """
    roll, pitch, col = 0.0, 0.0, 0.0
    for i in range(3):
        s = (pulse_us[i] - 1000.0) / 1000.0 - k.middle[i]
        roll += k.unmix[0, i] * s
        pitch += k.unmix[1, i] * s
        col += k.unmix[2, i] * s
    blades = k.pitch_min + k.pitch_per_col * (col - k.col_min)
    away = pulse_us[_TAIL] - k.tail[1]
    end = k.tail[2] - k.tail[1] if away > 0.0 else k.tail[1] - k.tail[0]
    out[ACTUATOR.lat], out[ACTUATOR.lon] = roll, pitch
    out[ACTUATOR.ped] = -away / end
    out[ACTUATOR.col] = (blades - k.pitch_offset) / k.pitch_gain
    for i in range(ACTUATOR.size):
        out[i] = min(max(out[i], -1.0), 1.0)


def pulses(u: NDArray[np.float64], k: ServoNumbers) -> NDArray[np.float64]:
    """Pulses (4,), us, that `deflections` makes actuators (4,) of, where the servos reach them."""
    blades = k.pitch_gain * u[ACTUATOR.col] + k.pitch_offset
    col = k.col_min + (blades - k.pitch_min) / k.pitch_per_col
    mixed = np.array([u[ACTUATOR.lat], u[ACTUATOR.lon], col])
    swash = 1000.0 + 1000.0 * (np.linalg.inv(k.unmix) @ mixed + k.middle)
    yaw = -u[ACTUATOR.ped]
    end = k.tail[2] - k.tail[1] if yaw > 0.0 else k.tail[1] - k.tail[0]
    return np.append(swash, k.tail[1] + yaw * end)
