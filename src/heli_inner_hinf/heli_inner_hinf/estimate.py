# SPDX-License-Identifier: Apache-2.0
"""The nine states of now, from an estimate that may be late or missing.

Messages carry stamps, so the age of an estimate is known, and this node knows what it has commanded
since. Over that age the linear model of eq. (9) is integrated, one tick after another, with the
commands behind transport delay and servos (`actuation`):

    x(t+1) = x_trim + Phi (x(t) - x_trim) + Gamma (servo(t) - u_trim)

An estimate of this very tick is flown to the last bit. One that is older than `timeout_ticks` is
none: the controller then repeats its last command, which the model has brought near to that of a
level attitude by then.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from heli_core.inbox import NOTHING, has_come
from heli_core.jit import by_reference, copy, copy_part, fill, njit, scratch
from heli_core.linear import held
from heli_core.rotations import wrap_pi
from heli_core.rows import ACTUATOR, NINE, ROTOR, SETPOINT, UNMEASURED
from heli_core.ticks import Rate
from heli_inner_hinf.controller_state import all_finite, nine_states
from heli_inner_hinf.design import shaped
from heli_msgs_bridge import topics
from heli_msgs_bridge.lockstep import AHEAD_TICKS

_N = len(NINE)
_NEVER = -(2**62)
_WITH_TICKS = 1
"""Rotor states of so many ticks away belong to an estimate, too: they are sent behind it."""


@by_reference
class EstimateParams(NamedTuple):
    """Numbers of the model between two ticks; states of eq. (9), commands in (-1, 1).

    Attributes
    ----------
    Phi, Gamma : (9, 9), (9, 3) arrays
    x_trim, u_trim : (9,), (3,) arrays
    servo, drive : (2, 2), (2,) arrays
        A servo's position and speed a tick later, by what they were and by the command.
    delay_ticks : int
        From a command to its servo.
    timeout_ticks : int
        Age of an estimate that is none any more.
    setpoint_timeout_ticks : int
        Age of an attitude setpoint that is none any more.
    ahead_ticks : int
        By so much a setpoint's stamp may be ahead of now.
    """

    Phi: np.ndarray
    Gamma: np.ndarray
    x_trim: np.ndarray
    u_trim: np.ndarray
    servo: np.ndarray
    drive: np.ndarray
    delay_ticks: int
    timeout_ticks: int
    setpoint_timeout_ticks: int
    ahead_ticks: int


@by_reference
class EstimateState(NamedTuple):
    """The newest estimate, and where the servos have been since; changed in place."""

    x: np.ndarray  # (9,) NaN before the first
    tick: np.ndarray  # (2,) int64: of it; of the last position in `moved`
    moved: np.ndarray  # (slots, 3) mean position of each servo from a tick to the next
    servos: np.ndarray  # (3, 2) their positions and speeds, deviations from trim


def estimate_params(parameters: Mapping[str, Any]) -> EstimateParams:
    """Numbers of the inner loop's parameters."""
    p, rate = parameters, Rate.of_parameters(parameters)
    A, B = shaped("model.A", p["model.A"], (9, 9)), shaped("model.B", p["model.B"], (9, 3))
    Phi, Gamma = held(A, B, rate.tick_s)
    w, zeta = p["servo.frequency_radps"], p["servo.damping"]
    servo, drive = held(
        np.array([[0.0, 1.0], [-w * w, -2.0 * zeta * w]]), np.array([[0.0], [w * w]]), rate.tick_s
    )
    return EstimateParams(
        np.ascontiguousarray(Phi),
        np.ascontiguousarray(Gamma),
        shaped("trim.x", p["trim.x"], (9,)),
        shaped("trim.u", p["trim.u"], (4,))[ACTUATOR.attitude].copy(),
        np.ascontiguousarray(servo),
        drive.ravel().copy(),
        rate.of(int(p["delay_ticks"])),
        max(1, rate.ticks_in(p["estimate_timeout_s"])),
        int(p["setpoint_timeout_s"] * rate.hz),
        rate.of(AHEAD_TICKS),
    )


def initial_estimate(k: EstimateParams) -> EstimateState:
    """Nothing has been heard; the trim has been flown so far."""
    slots = k.timeout_ticks + k.delay_ticks + 2
    return EstimateState(
        np.full(_N, np.nan),
        np.full(2, _NEVER, np.int64),
        np.zeros((slots, len(k.u_trim))),
        np.zeros((len(k.u_trim), 2)),
    )


@njit
def _step(x, moved, k):
    """x (9,), deviations from trim, one tick later, in place."""
    after = scratch(_N)
    for i in range(_N):
        total = 0.0
        for j in range(_N):
            total += k.Phi[i, j] * x[j]
        for j in range(moved.shape[0]):
            total += k.Gamma[i, j] * moved[j]
        after[i] = total
    copy(x, after)


@njit
def _carried(state, tick, k, x9):
    """The newest estimate carried to a tick, into x9 (9,)."""
    copy(x9, state.x)
    age = tick - state.tick[0]
    if age <= 0:
        return
    for i in range(_N):
        x9[i] -= k.x_trim[i]
    slots = state.moved.shape[0]
    for t in range(state.tick[0], tick):
        _step(x9, state.moved[t % slots], k)
    for i in range(_N):
        x9[i] += k.x_trim[i]
    x9[NINE.psi] = wrap_pi(x9[NINE.psi])


@njit
def hear(state, stamp, x9, rotor_stamp, k):
    """Take an estimate, if it is newer than the last one.

    Parameters
    ----------
    state : EstimateState
        In place.
    stamp : int
        Its tick.
    x9 : (9,) array
        Absolute, rad and rad/s, places of `NINE`; NaN where the rotor's states are not known.
    rotor_stamp : int
        Tick of the rotor's states; of another time than the rest, those of the model are taken.
    k : EstimateParams
    """
    if stamp <= state.tick[0]:
        return
    taken = abs(stamp - rotor_stamp) <= _WITH_TICKS
    for i in UNMEASURED:
        taken = taken and np.isfinite(x9[i])
    if not taken:
        known = scratch(_N)
        if stamp - state.tick[0] <= k.timeout_ticks:
            _carried(state, stamp, k, known)
        else:
            copy(known, k.x_trim)
        for i in UNMEASURED:
            x9[i] = known[i]
    if all_finite(x9):
        copy(state.x, x9)
        state.tick[0] = stamp


@njit
def estimate(state, tick, k, x9):
    """The states of a tick into x9 (9,); NaN if nothing is known of them."""
    age = tick - state.tick[0]
    if not 0 <= age <= k.timeout_ticks:
        fill(x9, np.nan)
        return
    _carried(state, tick, k, x9)


@njit
def commanded(state, tick, u3, k):
    """Remember a command (3,), absolute, sent at a tick; one that was skipped is taken for it."""
    slots, until = state.moved.shape[0], tick + k.delay_ticks
    first = max(state.tick[1] + 1, until - slots + 1)
    for t in range(first if state.tick[1] != _NEVER else until, until + 1):
        for i in range(u3.shape[0]):
            before = state.servos[i, 0]
            speed = state.servos[i, 1]
            u = u3[i] - k.u_trim[i]
            state.servos[i, 0] = k.servo[0, 0] * before + k.servo[0, 1] * speed + k.drive[0] * u
            state.servos[i, 1] = k.servo[1, 0] * before + k.servo[1, 1] * speed + k.drive[1] * u
            state.moved[t % slots, i] = 0.5 * (before + state.servos[i, 0])
    state.tick[1] = until


# -------------------------------------------------------------------------------------------------
# What the inner loop knows at a tick, from what has come: its states, and what it is to hold.
# -------------------------------------------------------------------------------------------------

INPUTS = (topics.ODOM, topics.ROTOR_STATE, topics.ATTITUDE_SETPOINT, topics.COLLECTIVE)
"""What the inner loop hears, in the order of its inbox."""
_ODOM, _ROTOR, _ATTITUDE, _COLLECTIVE = range(len(INPUTS))
_N_ROTOR = ROTOR.size


class CommandRow(NamedTuple):
    """Places of `HeardCommand.row`: a SetpointRow, and behind it a pilot's deflections."""

    setpoint: slice = slice(0, 4)
    attitude: slice = slice(0, 3)
    psi: int = 2
    col: int = 3
    manual: slice = slice(4, 7)  # about trim; NaN while the controller flies
    size: int = 7


COMMAND = CommandRow()
_N_ATTITUDE, _N_HANDED = COMMAND.col, COMMAND.size - COMMAND.col


@by_reference
class HeardCommand(NamedTuple):
    """The outer loop's last command, held until the next one; changed in place."""

    row: np.ndarray  # (7,) places of `COMMAND`
    tick: np.ndarray  # (1,) int64, of the attitude setpoint's stamp; NOTHING before the first


def no_command(k: EstimateParams, collective: float) -> HeardCommand:
    """Before the first one: the trim attitude, the heading that will be found, a collective."""
    row = np.full(COMMAND.size, np.nan)
    row[COMMAND.attitude] = k.x_trim[[NINE.phi, NINE.theta, NINE.psi]]
    row[COMMAND.psi], row[COMMAND.col] = np.nan, collective
    return HeardCommand(row, np.full(1, NOTHING, np.int64))


@njit
def listen(state, command, inbox, tick, k, x9, aim):
    """Take what has come for a tick; what the controller is to fly, and from where.

    Parameters
    ----------
    state : EstimateState
    command : HeardCommand
        Both in place.
    inbox : Inbox
        Places of `INPUTS`.
    tick : int
    k : EstimateParams
    x9 : (9,) array
        Out: the states of now, by what has come or by the model; NaN if nothing is known.
    aim : (7,) array
        Out: places of `COMMAND`. Of a setpoint that is too old the trim attitude and the heading.

    Returns
    -------
    bool
        Whether the setpoint is too old, or of another time than now.
    """
    rows, stamps, row = inbox.rows, inbox.stamps, command.row
    if has_come(inbox, _ODOM):
        rotor = scratch(_N_ROTOR)
        if has_come(inbox, _ROTOR):
            copy_part(rotor, 0, rows[_ROTOR], 0, _N_ROTOR)
        else:
            fill(rotor, np.nan)
        nine_states(rows[_ODOM], rotor, x9)
        hear(state, stamps[_ODOM], x9, stamps[_ROTOR], k)
    estimate(state, tick, k, x9)
    if np.isnan(row[COMMAND.psi]):
        row[COMMAND.psi] = x9[NINE.psi]
    if has_come(inbox, _ATTITUDE):
        copy_part(row, COMMAND.attitude.start, rows[_ATTITUDE], 0, _N_ATTITUDE)
        command.tick[0] = stamps[_ATTITUDE]
    if has_come(inbox, _COLLECTIVE):
        copy_part(row, COMMAND.col, rows[_COLLECTIVE], 0, _N_HANDED)
    age = tick - command.tick[0]
    stale = command.tick[0] != NOTHING and not -k.ahead_ticks <= age <= k.setpoint_timeout_ticks
    if stale:
        fill(row[COMMAND.manual], np.nan)
    copy(aim, row)
    if stale:
        aim[SETPOINT.phi], aim[SETPOINT.theta] = k.x_trim[NINE.phi], k.x_trim[NINE.theta]
    return stale
