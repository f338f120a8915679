# SPDX-License-Identifier: Apache-2.0
"""The attitude loop: state feedback, with observer (19), and, for every controller, as it is flown.

Each is a generalised plant and a controller, python-control systems with named signals, deviations
from trim, SI and rad. The plant's inputs are the wind, the commanded attitude and the actuators;
its outputs are h of eq. (11), the actuators' positions, and what the controller reads: y and the
commanded attitude. As flown means: at tick n the estimate of tick n is read, the command u_n is
worked out at once and acts from n+1 to n+2 (transport delay), servos of second order on all three
inputs (that of d_ped drives the yaw gyro), everything discretised exactly.

For analysis: python-control takes seconds to import, so it is imported where a system is made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from heli_core.linear import (
    WIND,
    ReducedOrderMatrices,
    held,
    held_and_linear,
    held_late,
    reduced_order_observer,
    with_delay_line,
    with_servos,
)
from heli_core.rows import ATTITUDE, INPUT_NAMES, MEASURED, STATE_NAMES, UNMEASURED
from heli_core.ticks import TICK_S
from heli_inner_hinf.controller_state import (
    INPUTS,
    N_V,
    OUTPUT_FEEDBACK,
    PID,
    STATE_FEEDBACK,
    Actuation,
    AttitudeParams,
    ObserverInput,
    OutputLaw,
    output_law,
    predicting_gains,
)
from heli_inner_hinf.mu import DiskMargin, grid, logarithms, modes, response, smallest, top
from heli_inner_hinf.regular_form import N_H, N_U, N_X, Matrix, checked

if TYPE_CHECKING:
    import control

# -------------------------------------------------------------------------------------------------
# The loop as flown, in plain arrays: what a controller is judged by before it may fly.
#
# Whatever flies imports this; `loops` makes python-control's systems of the same arrays.
# -------------------------------------------------------------------------------------------------

_AXES = (("phi", "p", "phi_ref"), ("theta", "q", "theta_ref"), ("psi_error", "r", ""))
_TOP = 0.9999 * np.pi  # rad per tick


class OutputFeedback(NamedTuple):
    """x+ = A x + B y, u = C x + D y, without commands; `measured`: places of y among the nine."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    measured: tuple[int, ...]


class Assessment(NamedTuple):
    """Margins of the loop as flown with a controller; of state feedback without the observer.

    Attributes
    ----------
    radius : float
        Largest modulus of its eigenvalues, per tick; stable below one.
    disk_input, disk_output : float
        Disk margins (`DiskMargin.alpha`), all channels at once, at the plant's input and at what
        the controller reads; 0 if the loop is not stable.
    """

    radius: float
    disk_input: float
    disk_output: float

    @property
    def stable(self) -> bool:
        """Whether every mode dies out; an eigenvalue of one is a heading that nobody holds."""
        return self.radius < 1.0 - 1e-9


def flown_plant(A: Matrix, B: Matrix, actuation: Actuation) -> tuple[Matrix, Matrix]:
    """A, B of x' = A x + B u behind servos and delay, one step a tick; exact.

    States: x, the servos' positions and rates, then u_(n-1), u_(n-2), ... as far back as the delay
    needs.
    """
    behind = with_servos(A, B, actuation.servo_radps, actuation.servo_damping)
    return with_delay_line(held_late(*behind, actuation.tick_s, actuation.delay_s))


def pid_as_output_law(
    K_P: ArrayLike, K_I: ArrayLike, K_D: ArrayLike, tick_s: float = TICK_S
) -> OutputLaw:
    """The PID of three axes away from the limits, states: its integrators; gains as in the YAML."""
    p, i, d = (np.diag(np.asarray(gain, float)) for gain in (K_P, K_I, K_D))
    error, rate = np.zeros((N_U, N_V)), np.zeros((N_U, N_V))
    for axis, (angle, turning, reference) in enumerate(_AXES):
        error[axis, INPUTS.index(angle)] = -1.0
        rate[axis, INPUTS.index(turning)] = 1.0
        if reference:
            error[axis, INPUTS.index(reference)] = 1.0
    step = tick_s * i @ error
    return output_law(np.eye(N_U), step, np.eye(N_U), p @ error - d @ rate + step)


def linear_law_of(k: AttitudeParams) -> OutputLaw | None:
    """Output feedback, or the PID's equal away from the limits; None for other controllers."""
    if k.controller == PID:
        return pid_as_output_law(k.K_P, k.K_I, k.K_D, k.tick_s)
    return k.law if k.controller == OUTPUT_FEEDBACK else None


def feedback_of(k: AttitudeParams) -> OutputFeedback | None:
    """Linear feedback of a kernel away from the limits; None for a kind that is not known here.

    State feedback is taken with every state measured: what the observer costs, `loops` tells.
    """
    if k.controller == STATE_FEEDBACK:
        return _state_feedback(k)
    law = linear_law_of(k)
    return None if law is None else feedback_of_law(law)


def feedback_of_law(law: OutputLaw) -> OutputFeedback:
    """A controller without commands."""
    n_y = len(MEASURED)
    return OutputFeedback(law.A, law.B[:, :n_y], law.C, law.D[:, :n_y], MEASURED)


def _state_feedback(k: AttitudeParams) -> OutputFeedback:
    """u = F x + H u_last + G s, s the shift of the offset-free target; states u_last, s."""
    everything = tuple(range(len(STATE_NAMES)))
    if k.shift_rate == 0.0:
        return OutputFeedback(k.H, k.F, k.H, k.F, everything)
    eye, none = np.eye(N_U), np.zeros((N_U, N_U))
    attitude = np.eye(len(STATE_NAMES))[list(ATTITUDE)]
    A = np.block([[k.H, k.G], [none, eye]])
    B = np.vstack([k.F, -k.tick_s * k.shift_rate * attitude])
    return OutputFeedback(A, B, np.hstack([k.H, k.G]), k.F, everything)


def closed_loop(A: Matrix, B: Matrix, feedback: OutputFeedback, actuation: Actuation) -> Matrix:
    """State matrix of the loop of A (9, 9), B (9, 3) as flown; states of plant, then controller."""
    return closed(*flown_plant(A, B, actuation), feedback)


def closed(Ad: Matrix, Bd: Matrix, feedback: OutputFeedback) -> Matrix:
    """The same of `flown_plant`."""
    y = np.eye(Ad.shape[0])[list(feedback.measured)]
    return np.block(
        [[Ad + Bd @ feedback.D @ y, Bd @ feedback.C], [feedback.B @ y, feedback.A]],
    )


def judge(A: Matrix, B: Matrix, feedback: OutputFeedback, actuation: Actuation) -> Assessment:
    """Stability and disk margins of the loop as flown with A (9, 9), B (9, 3) of eq. (9)."""
    poles = np.linalg.eigvals(closed_loop(A, B, feedback, actuation))
    judgement = Assessment(float(np.max(np.abs(poles))), 0.0, 0.0)
    if not judgement.stable:
        return judgement
    tick_s = actuation.tick_s
    omega = grid(logarithms(poles, tick_s), 1e-2, _TOP / tick_s, 200, near=9)
    Ad, Bd = flown_plant(A, B, actuation)
    P = sampled_response(Ad, Bd, omega, tick_s)[:, list(feedback.measured)]
    K = feedback.C @ sampled_response(feedback.A, feedback.B, omega, tick_s) + feedback.D
    return judgement._replace(
        disk_input=smallest(-K @ P, omega).alpha, disk_output=smallest(-P @ K, omega).alpha
    )


def sampled_response(A: Matrix, B: Matrix, omega: Matrix, tick_s: float = TICK_S) -> np.ndarray:
    """(z I - A)^-1 B, (m, n, k), on the unit circle at omega (m,), rad/s."""
    z = np.exp(1j * omega * tick_s)[:, None, None]
    right = np.broadcast_to(B.astype(complex), (omega.size, *B.shape))
    return np.linalg.solve(z * np.eye(A.shape[0]) - A, right)


# -------------------------------------------------------------------------------------------------
# Loops.
# -------------------------------------------------------------------------------------------------

N_Y, N_Z = len(MEASURED), len(UNMEASURED)
MEASURED_NAMES = tuple(STATE_NAMES[i] for i in MEASURED)
COMMANDS = tuple(f"{STATE_NAMES[i]}_ref" for i in ATTITUDE)
"""Commanded attitude, deviation from trim, rad."""
H = tuple(f"h{i + 1}" for i in range(N_H))
"""The weighted output h of eq. (11)."""
POSITIONS = tuple(f"{name}_position" for name in INPUT_NAMES)
"""Positions of the actuators, behind their servos."""


@dataclass(frozen=True)
class Loop:
    """One of the three loops.

    Attributes
    ----------
    name : str
    plant : control.StateSpace
        Inputs `WIND`, `COMMANDS`, then d_lat d_lon d_ped; outputs `H`, `POSITIONS`, then y and
        `COMMANDS`.
    controller : control.StateSpace
        Inputs y and `COMMANDS`; outputs d_lat d_lon d_ped.
    turned : bool
        Whether in flight the controller turns its errors by the bank beyond trim (`output_law`).
    """

    name: str
    plant: control.StateSpace
    controller: control.StateSpace
    turned: bool = False

    @property
    def dt(self) -> float:
        """Sampling time, s; 0 for a continuous loop."""
        return float(self.plant.dt)

    @cached_property
    def closed(self) -> control.StateSpace:
        """`WIND`, `COMMANDS` -> `H`, `POSITIONS`; states of the plant, then of the controller."""
        import control

        joined = self.plant.lft(self.controller)
        law = [f"law_{i}" for i in range(self.controller.nstates)]
        signals = {"inputs": [*WIND, *COMMANDS], "outputs": [*H, *POSITIONS]}
        return control.ss(joined, states=[*self.plant.state_labels, *law], **signals)

    @property
    def wind_to_h(self) -> control.StateSpace:
        """T_hv: wind u v w (m/s) to h (9)."""
        return self.closed[list(H), list(WIND)]

    @property
    def wind_to_u(self) -> control.StateSpace:
        """T_uv: wind u v w (m/s) to the actuators' positions."""
        return self.closed[list(POSITIONS), list(WIND)]

    def stability(self) -> float:
        """Largest real part of the closed loop's modes, rad/s; below 0 it is stable."""
        return float(np.max(modes(self.closed).real))

    def at_input(self, omega: np.ndarray) -> np.ndarray:
        """Open loop (m, 3, 3) at omega (m,), rad/s, broken at the plant input.

        Its sign is such that stability is about 1 + L.
        """
        P, K = self._open(omega)
        return -K @ P

    def at_output(self, omega: np.ndarray) -> np.ndarray:
        """Open loop (m, n_y, n_y) broken at the plant output."""
        P, K = self._open(omega)
        return -P @ K

    def _open(self, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Responses of the plant u -> y and of the controller y -> u."""
        n_y = self.controller.ninputs - len(COMMANDS)
        first = len(H) + len(POSITIONS)
        plant = response(self.plant, omega)[:, first : first + n_y, -N_U:]
        return plant, response(self.controller, omega)[:, :, :n_y]


@dataclass(frozen=True)
class Model:
    """What the loops are made of: A (9, 9), B, E (9, 3), C (9, 9), D (9, 3), F (3, 9), G (3, 3).

    shift_rate (rad/s) is that of the offset-free target; the loop as flown has it.
    """

    A: Matrix
    B: Matrix
    E: Matrix
    C: Matrix
    D: Matrix
    F: Matrix
    G: Matrix
    shift_rate: float = 0.0


class DiscreteController(NamedTuple):
    """x+ = A x + B y + B_r r, u = C x + D y + D_r r."""

    A: Matrix
    B: Matrix
    B_r: Matrix
    C: Matrix
    D: Matrix
    D_r: Matrix


def observer_of(A: ArrayLike, B: ArrayLike, K: ArrayLike) -> ReducedOrderMatrices:
    """The reduced-order observer (19) of A (9, 9), B (9, 3) with the gain K (3, 6)."""
    A, B, K = checked("A", A, (9, 9)), checked("B", B, (9, 3)), checked("K", K, (3, 6))
    return reduced_order_observer(A, B, K, MEASURED, UNMEASURED)


def state_feedback_loop(model: Model) -> Loop:
    """u = F x + G r with every state measured."""
    plant = _continuous_plant(model, range(N_X))
    none = np.zeros((0, 0)), np.zeros((0, N_X)), np.zeros((0, N_U)), np.zeros((N_U, 0))
    law = DiscreteController(*none, model.F, model.G)
    return Loop("state feedback", plant, _controller(STATE_NAMES, law, 0.0))


def observer_loop(model: Model, K: ArrayLike) -> Loop:
    """Continuous loop with the reduced-order observer (19)."""
    gain = checked("K", K, (N_Z, N_Y))
    Az, By, Hu = observer_of(model.A, model.B, gain)
    Fm, Fu = model.F[:, MEASURED], model.F[:, UNMEASURED]
    D = Fm + Fu @ gain
    law = DiscreteController(Az + Hu @ Fu, By + Hu @ D, Hu @ model.G, Fu, D, model.G)
    plant = _continuous_plant(model, MEASURED)
    return Loop("with observer", plant, _controller(MEASURED_NAMES, law, 0.0))


def flown_loop(
    model: Model,
    K: ArrayLike,
    prediction_s: float = 0.0,
    feed: ObserverInput | None = None,
    actuation: Actuation | None = None,
) -> Loop:
    """Sampled loop as flown: observer, prediction, servos, transport delay."""
    plant = sampled_plant(model, actuation or Actuation())
    gain = checked("K", K, (N_Z, N_Y))
    controller = sampled_controller(model, gain, prediction_s, feed or ObserverInput())
    return Loop("as flown", plant, controller)


def output_loop(model: Model, law: OutputLaw, actuation: Actuation | None = None) -> Loop:
    """Sampled loop as flown with output feedback: servos, transport delay.

    F and G of the model do not matter. The controller's state is taken at a fixed heading (x + turn
    psi_ref), so that a new psi_ref is an input like the others.
    """
    n_y, turn = len(MEASURED), law.turn[:, None]
    psi = INPUTS.index("psi_error")
    B_psi = turn - law.A @ turn - law.B[:, psi : psi + 1]
    D_psi = -law.C @ turn - law.D[:, psi : psi + 1]
    controller = DiscreteController(
        law.A,
        law.B[:, :n_y],
        np.hstack([law.B[:, n_y:], B_psi]),
        law.C,
        law.D[:, :n_y],
        np.hstack([law.D[:, n_y:], D_psi]),
    )
    actuation = actuation or Actuation()
    plant = sampled_plant(model, actuation)
    return Loop("as flown", plant, _controller(MEASURED_NAMES, controller, actuation.tick_s))


def sampled_plant(model: Model, actuation: Actuation) -> control.StateSpace:
    """Plant, servos and transport delay, exactly discretised.

    Commands and wind are held over a tick. States: the nine, the servos' positions and rates, then
    u_(n-1), u_(n-2), ... as far back as the delay needs.
    """
    n = N_X
    Ad, Bd = flown_plant(model.A, model.B, actuation)
    size, N = Ad.shape[0], n + 2 * N_U
    Bw = np.zeros((size, N_U))
    Bw[:n] = held(model.A, model.E, actuation.tick_s)[1]
    position = np.zeros((N_U, size))
    position[:, n : n + N_U] = np.eye(N_U)
    x = np.eye(n, size)
    nothing = np.zeros((N_H, N_U)), np.zeros((N_U, N_U))
    states = [*STATE_NAMES, *POSITIONS, *(f"{name}_rate" for name in INPUT_NAMES)]
    states += [f"{name}_{lag + 1}" for lag in range((size - N) // N_U) for name in INPUT_NAMES]
    h = model.C @ x + model.D @ position
    return _plant(Ad, Bw, Bd, (h, position), nothing, MEASURED, states, actuation.tick_s)


def sampled_controller(
    model: Model, K: Matrix, prediction_s: float, feed: ObserverInput
) -> control.StateSpace:
    """Observer (19) and controller: u_n = F (Phi x_n + Gamma u_(n-1)), over `prediction_s`.

    The observer is discretised exactly for u held and y linear over a tick. States: z (and its
    servo model) less what y_n adds, then u_(n-1), u_(n-2), ... as far back as needed.
    """
    Ac, By, Bu = observer_with_servo(model, K, feed)
    Phi, Gu, G0, G1 = held_and_linear(Ac, Bu, By, feed.tick_s)
    F, H_u = predicting_gains(model.A, model.B, model.F, prediction_s)
    n = Ac.shape[0]
    lift = np.vstack([K, np.zeros((n - N_Z, N_Y))]) + G1
    Fz = np.zeros((N_U, n))
    Fz[:, :N_Z] = F[:, UNMEASURED]
    Dk = F[:, MEASURED] + Fz @ lift
    depth = max(feed.u_delay_ticks, 1)
    size = n + N_U * depth
    Cu = np.hstack([Fz, H_u, np.zeros((N_U, N_U * (depth - 1)))])
    Ad, Bd, through_u = np.zeros((size, size)), np.zeros((size, N_Y)), np.zeros((size, N_U))
    Ad[:n, :n] = Phi
    Bd[:n] = Phi @ G1 + G0
    if feed.u_delay_ticks == 0:
        Ad[:n] += Gu @ Cu
        Bd[:n] += Gu @ Dk
        through_u[:n] = Gu
    else:
        Ad[:n, n + N_U * (depth - 1) :] = Gu
    through_u[n : n + N_U] = np.eye(N_U)
    Ad[n : n + N_U] = Cu
    Bd[n : n + N_U] = Dk
    Ad[n + N_U :, n : n + N_U * (depth - 1)] = np.eye(N_U * (depth - 1))
    law = DiscreteController(Ad, Bd, through_u @ model.G, Cu, Dk, model.G)
    if model.shift_rate > 0.0:
        law = _with_shift(law, model.shift_rate * feed.tick_s)
    return _controller(MEASURED_NAMES, law, feed.tick_s)


def as_output_law(model: Model, K: Matrix, prediction_s: float, feed: ObserverInput) -> OutputLaw:
    """`sampled_controller`, away from the limits, in heading errors.

    `turn`: psi and psi_ref move together, and u stays.
    """
    import control

    A, B, C, D = control.ssdata(sampled_controller(model, K, prediction_s, feed))
    both = [INPUTS.index("psi_error"), N_Y + COMMANDS.index("psi_ref")]
    held_u = np.vstack([np.eye(A.shape[0]) - A, C])
    turn = np.linalg.lstsq(held_u, np.concatenate([B[:, both].sum(1), -D[:, both].sum(1)]))[0]
    return output_law(A, B[:, :N_V], C, D[:, :N_V], turn=turn)


def _with_shift(law: DiscreteController, step: float) -> DiscreteController:
    """The controller with its offset-free target: s(n+1) = s(n) + step (r - (phi theta psi)(n)).

    s is added to the command r.
    """
    attitude = np.eye(N_X)[np.ix_(ATTITUDE, MEASURED)]
    eye, n = np.eye(N_U), law.A.shape[0]
    return law._replace(
        A=np.block([[law.A, law.B_r], [np.zeros((N_U, n)), eye]]),
        B=np.vstack([law.B, -step * attitude]),
        B_r=np.vstack([law.B_r, step * eye]),
        C=np.hstack([law.C, law.D_r]),
    )


def observer_with_servo(
    model: Model, K: Matrix, feed: ObserverInput
) -> tuple[Matrix, Matrix, Matrix]:
    """A, B_y, B_u of (19), continuous, behind the servo model of `feed` if it has one."""
    Az, By, Hu = observer_of(model.A, model.B, K)
    if feed.servo_radps == 0.0:
        return Az, By, Hu
    A, B = with_servos(Az, Hu, feed.servo_radps, feed.servo_damping)
    return A, np.vstack([By, np.zeros((2 * N_U, N_Y))]), B


def _continuous_plant(model: Model, measured: tuple[int, ...] | range) -> control.StateSpace:
    outputs = model.C, np.zeros((N_U, N_X))
    direct = model.D, np.eye(N_U)
    return _plant(model.A, model.E, model.B, outputs, direct, measured, STATE_NAMES, 0.0)


def _plant(
    A: Matrix,
    B_wind: Matrix,
    B_u: Matrix,
    outputs: tuple[Matrix, Matrix],
    direct: tuple[Matrix, Matrix],
    measured: tuple[int, ...] | range,
    states: Sequence[str],
    dt: float,
) -> control.StateSpace:
    """The generalised plant; `outputs` and `direct`: h and positions from states and from u."""
    import control

    n, commands = A.shape[0], len(COMMANDS)
    names = [STATE_NAMES[i] for i in measured]
    nothing = np.zeros((len(names) + commands, N_U))
    to_u = np.vstack([*direct, nothing])
    to_commands = np.vstack([np.zeros((to_u.shape[0] - commands, commands)), np.eye(commands)])
    return control.ss(
        A,
        np.hstack([B_wind, np.zeros((n, commands)), B_u]),
        np.vstack([*outputs, np.eye(n)[list(measured)], np.zeros((commands, n))]),
        np.hstack([np.zeros((to_u.shape[0], len(WIND))), to_commands, to_u]),
        dt,
        states=list(states),
        inputs=[*WIND, *COMMANDS, *INPUT_NAMES],
        outputs=[*H, *POSITIONS, *names, *COMMANDS],
    )


def _controller(names: tuple[str, ...], law: DiscreteController, dt: float) -> control.StateSpace:
    import control

    return control.ss(
        law.A,
        np.hstack([law.B, law.B_r]),
        law.C,
        np.hstack([law.D, law.D_r]),
        dt,
        inputs=[*names, *COMMANDS],
        outputs=list(INPUT_NAMES),
    )


# -------------------------------------------------------------------------------------------------
# Stability margins of a loop: with all channels at once, one at a time, and of delay.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ChannelMargin:
    """Classical margins of one channel, the others closed.

    Attributes
    ----------
    gain_up_db, gain_down_db : float
        Largest and smallest (negative) gain change, dB; inf if none destabilises.
    phase_deg : float
        Smallest phase lag, deg; inf if the loop gain never crosses one.
    delay_s : float
        Smallest additional delay, s.
    """

    gain_up_db: float
    gain_down_db: float
    phase_deg: float
    delay_s: float


def frequency_grid(loop: Loop) -> np.ndarray:
    """Frequencies (m,), rad/s: 0.01 to 1000 or Nyquist's, denser at the loop's modes."""
    return grid(modes(loop.closed), 1e-2, top(loop.closed, 1e3), 400)


def disk_margin(loop: Loop, where: str, omega: np.ndarray | None = None) -> DiskMargin:
    """Multi-channel disk margin at `where` = "input" (3 channels) or "output" of the plant."""
    if loop.stability() >= 0.0:
        return DiskMargin(0.0, 0.0)
    omega = frequency_grid(loop) if omega is None else omega
    return smallest(loop.at_input(omega) if where == "input" else loop.at_output(omega), omega)


def channel_margins(loop: Loop) -> list[ChannelMargin]:
    """Margins of each actuator's channel, one at a time, the others closed."""
    omega = frequency_grid(loop)
    L = loop.at_input(omega)
    S = np.linalg.inv(np.eye(L.shape[1]) + L)
    return [channel_margin(1.0 / S[:, i, i] - 1.0, omega) for i in range(L.shape[1])]


def channel_margin(single: np.ndarray, omega: np.ndarray) -> ChannelMargin:
    """Margins of a scalar open loop (m,) at omega (m,), rad/s, by python-control."""
    import control

    measured = control.frd(single, omega, smooth=True)
    gain, phase_deg, _, _, crossover, _ = control.stability_margins(measured, returnall=True)
    up, down = gain[gain > 1.0], gain[gain < 1.0]
    lag_rad = np.radians(np.mod(phase_deg, 360.0))
    return ChannelMargin(
        gain_up_db=float(20.0 * np.log10(np.min(up, initial=np.inf))),
        gain_down_db=float(20.0 * np.log10(np.max(down))) if down.size else -np.inf,
        phase_deg=float(np.min(np.abs(phase_deg), initial=np.inf)),
        delay_s=float(np.min(lag_rad / crossover, initial=np.inf)),
    )


def further_delay_s(
    loop: Loop, model: Model, actuation: Actuation | None = None, longest_s: float = 0.08
) -> float:
    """Further transport delay (s), in all channels at once, up to which a loop as flown is stable.

    Exact discretisation for every delay; first crossing on a 2 ms grid, then bisected to 0.05 ms.
    `model` and `actuation` are those of the loop.
    """
    actuation = actuation or Actuation()

    def stable(extra: float) -> bool:
        later = replace(actuation, delay_s=actuation.delay_s + extra)
        return replace(loop, plant=sampled_plant(model, later)).stability() < 0.0

    if not stable(0.0):
        return 0.0
    good, step = 0.0, 0.2 * TICK_S
    while good < longest_s and stable(good + step):
        good += step
    if good >= longest_s:
        return longest_s
    bad = good + step
    while bad - good > 5e-5:
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if stable(middle) else (good, middle)
    return good
