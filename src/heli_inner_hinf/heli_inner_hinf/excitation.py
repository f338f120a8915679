# SPDX-License-Identifier: Apache-2.0
"""Excitation of the actuators for identification: sines on top of the controller, with a way out.

Added after the attitude controller and the outer loop's collective, before the actuators' limits.
It fades out for the rest of the flight, and says why, when roll or pitch leaves its limit around
trim or an actuator has stood at its limit for too long.
"""

import enum
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from heli_core.errors import ShapeError
from heli_core.jit import by_reference, njit
from heli_core.parameters import Parameter
from heli_core.rows import ACTUATOR, NINE
from heli_core.signals import NOTHING, SWEEP, SweepParams, fade_in_and_out, sines_at
from heli_core.ticks import TICK_S
from heli_inner_hinf.controller_state import LAST_U, all_finite

# -------------------------------------------------------------------------------------------------
# Excitation.
# -------------------------------------------------------------------------------------------------

# Layout of the state array (N_EXCITATION_STATE,): where a part begins.
SENT = 0  # (4) what was added at the newest tick, an ActuatorRow
SATURATED_S = 4  # how long an actuator has stood at its limit, s
ENDED_S = 5  # flight time at which the excitation was given up, s
CAUSE = 6  # ExcitationStatus for which it was given up; SILENT: it was not
N_EXCITATION_STATE = 7


class ExcitationStatus(enum.IntEnum):
    """What the excitation does."""

    SILENT = 0
    EXCITING = 1
    ATTITUDE = 2
    SATURATED = 3
    NOT_FINITE = 4

    @property
    def sentence(self) -> str:
        """The status in words; for the last three it holds for the rest of the flight."""
        return (
            "no excitation",
            "the actuators are excited",
            "the excitation was given up: roll or pitch left excitation.attitude_limit_deg",
            "the excitation was given up: an actuator stood at its limit for longer than "
            "excitation.saturation_s",
            "the excitation was given up: the estimate is not finite",
        )[int(self)]


_SILENT, _EXCITING, _ATTITUDE, _SATURATED, _NOT_FINITE = (int(s) for s in ExcitationStatus)


@by_reference
class ExcitationParams(NamedTuple):
    """Numbers of the excitation.

    Attributes
    ----------
    on : bool
        False: nothing is configured, `excite` need not be called.
    frequency_hz : (n,) array
    amplitude, phase_rad : (n, 4) array
        Of d_lat, d_lon, d_ped, d_col.
    start_s, duration_s, fade_s : float
        Flight time of the start; length with both fades; length of a fade.
    trim_rad : (2,) array
        Roll and pitch that the limit is counted from.
    limit_rad : float
        Largest deviation of roll or pitch.
    saturation_s : float
        Time at an actuator's limit after which the excitation is given up.
    actuator_limit : float
        Actuators stay within plus and minus this.
    """

    on: bool
    frequency_hz: np.ndarray
    amplitude: np.ndarray
    phase_rad: np.ndarray
    start_s: float
    duration_s: float
    fade_s: float
    trim_rad: np.ndarray
    limit_rad: float
    saturation_s: float
    actuator_limit: float


def excitation_params(values: Mapping[str, Any]) -> ExcitationParams:
    """Kernel from the parameters of the node `inner_loop` (see `parameters.TABLE`).

    Raises
    ------
    ShapeError
        The lengths of the arrays do not fit, or the fades are longer than the excitation.
    """
    lines = np.array(values["excitation.frequency_hz"], float).ravel()
    tables = []
    for name in ("amplitude", "phase_rad"):
        table = np.array(values[f"excitation.{name}"], float).reshape(-1, ACTUATOR.size)
        if table.shape[0] != lines.size:
            raise ShapeError(
                f"excitation.{name}",
                f"excitation.{name} describes {table.shape[0]} lines; allowed: {lines.size}, "
                "4 numbers per excitation.frequency_hz",
            )
        tables.append(np.ascontiguousarray(table))
    duration, fade = values["excitation.duration_s"], values["excitation.fade_s"]
    if 2.0 * fade > duration:
        raise ShapeError(
            "excitation.fade_s",
            f"excitation.fade_s: two fades of {fade:g} s do not fit into "
            f"excitation.duration_s = {duration:g} s",
        )
    return ExcitationParams(
        on=bool(np.any(tables[0] != 0.0)),
        frequency_hz=lines,
        amplitude=tables[0],
        phase_rad=tables[1],
        start_s=values["excitation.start_s"],
        duration_s=duration,
        fade_s=fade,
        trim_rad=np.array(values["trim.x"], float).ravel()[[NINE.phi, NINE.theta]],
        limit_rad=math.radians(values["excitation.attitude_limit_deg"]),
        saturation_s=values["excitation.saturation_s"],
        actuator_limit=values["actuator_limit"],
    )


def initial_excitation_state() -> np.ndarray:
    """State (N_EXCITATION_STATE,) before the flight."""
    return np.zeros(N_EXCITATION_STATE)


@njit
def _watch(time_s, x9, u4, k, state):
    """Give the excitation up if it has become unsafe; u4 is what was flown."""
    cause = _SILENT
    at_limit = False
    for i in range(ACTUATOR.size):
        at_limit = at_limit or abs(u4[i]) >= k.actuator_limit
    state[SATURATED_S] = state[SATURATED_S] + TICK_S if at_limit else 0.0
    if state[SATURATED_S] > k.saturation_s:
        cause = _SATURATED
    roll, pitch = x9[NINE.phi] - k.trim_rad[0], x9[NINE.theta] - k.trim_rad[1]
    if abs(roll) > k.limit_rad or abs(pitch) > k.limit_rad:
        cause = _ATTITUDE
    if cause != _SILENT:
        state[ENDED_S] = time_s
        state[CAUSE] = cause


@njit
def excite(time_s, x9, k, state, law_state, u4):
    """Add the excitation of one tick to the actuators.

    Parameters
    ----------
    time_s : float
        Flight time.
    x9 : (9,) array
        Absolute states that the controller has acted on; not finite: the excitation is given up at
        once.
    k : ExcitationParams
    state : (N_EXCITATION_STATE,) array
        Changed in place.
    law_state : (N_LAW_STATE,) array
        State of the attitude controller: its last output becomes what is really flown.
    u4 : (4,) array
        Commands of controller and outer loop; changed in place.

    Returns
    -------
    int
        `ExcitationStatus`.
    """
    sent = state[SENT : SENT + ACTUATOR.size]
    for i in range(ACTUATOR.size):
        sent[i] = 0.0
    share = fade_in_and_out(time_s - k.start_s, k.duration_s, k.fade_s)
    if not all_finite(x9):
        if share > 0.0 and state[CAUSE] == _SILENT:
            state[ENDED_S] = time_s - k.fade_s
            state[CAUSE] = _NOT_FINITE
        return int(state[CAUSE])
    if state[CAUSE] != _SILENT:
        gone = (time_s - state[ENDED_S]) / max(k.fade_s, TICK_S)
        share *= 0.0 if gone >= 1.0 else 0.5 + 0.5 * math.cos(math.pi * gone)
    if share == 0.0:
        return int(state[CAUSE])
    sines_at(time_s - k.start_s, k.frequency_hz, k.amplitude, k.phase_rad, sent)
    for i in range(ACTUATOR.size):
        total = u4[i] + share * sent[i]
        total = min(max(total, -k.actuator_limit), k.actuator_limit)
        sent[i] = total - u4[i]
        u4[i] = total
    for i in range(3):
        law_state[LAST_U + i] = u4[i]
    if state[CAUSE] == _SILENT:
        _watch(time_s, x9, u4, k, state)
    return _EXCITING if state[CAUSE] == _SILENT else int(state[CAUSE])


# -------------------------------------------------------------------------------------------------
# A sweep added to the measured attitude that the controller reads: how it rejects disturbances.
#
# The controller answers the sum of true and added attitude, of which `heli score --response
# --disturbance`
# takes the response to what was added: bandwidth and peak of disturbance rejection (Blanken,
# Tischler
# et al.). Nothing else than the controller hears of it.
# -------------------------------------------------------------------------------------------------

AXES = ("roll", "pitch", "yaw")
PLACES = (NINE.phi, NINE.theta, NINE.psi)
"""Of the angles among the nine states."""

DISTURBANCE_ROWS: tuple[Parameter, ...] = (
    Parameter("disturbance.axis", "string", "Measured angle that a sweep is added to before the "
              "controller reads it", choices=AXES, read_only=True),
    Parameter("disturbance.amplitude_deg", "double", "Its amplitude; 0: none", "deg", lower=0.0,
              upper=10.0, read_only=True),
    Parameter("disturbance.from_hz", "double", "Frequency at which it begins", "Hz", lower=0.005,
              upper=10.0, read_only=True),
    Parameter("disturbance.to_hz", "double", "Frequency at which it ends", "Hz", lower=0.005,
              upper=10.0, read_only=True),
    Parameter("disturbance.start_s", "double", "Flight time at which it begins", "s", lower=0.0,
              upper=86400.0, read_only=True),
    Parameter("disturbance.duration_s", "double", "Its length", "s", lower=1.0, upper=3600.0,
              read_only=True),
)  # fmt: skip
"""Rows of the `inner_loop` node."""


def disturbance_params(p: Mapping[str, Any]) -> SweepParams:
    """Numbers of the rows `DISTURBANCE_ROWS`, for an array of the nine states."""
    amplitude = math.radians(p["disturbance.amplitude_deg"])
    return SweepParams(
        SWEEP if amplitude > 0.0 else NOTHING,
        PLACES[AXES.index(p["disturbance.axis"])],
        amplitude,
        2.0 * math.pi * p["disturbance.from_hz"],
        math.log(p["disturbance.to_hz"] / p["disturbance.from_hz"]),
        p["disturbance.start_s"],
        p["disturbance.duration_s"],
    )
