# SPDX-License-Identifier: Apache-2.0
"""The attitude loop three times: state feedback, with observer (19), and sampled as it is flown.

Every loop is a plant u -> y and a controller y -> u, deviations from trim, SI and rad. As flown
means: at tick n the estimate of tick n is read, the command u_n is worked out at once and acts from
n+1 to n+2 (transport delay), servos of second order on all three inputs (that of d_ped drives the
yaw gyro), everything discretised exactly.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from heli_inner_hinf.regular_form import Matrix
from heli_inner_hinf.weights import MEASURED, N_U, N_X, OUTPUTS, UNMEASURED, checked
from heli_math.linear_systems import (
    Observer,
    held,
    held_and_linear,
    held_late,
    reduced_order_observer,
    with_servos,
)

TICK_S = 0.01
N_Y, N_Z = len(MEASURED), len(UNMEASURED)


@dataclass(frozen=True)
class Actuation:
    """What lies between command and rotor.

    Attributes
    ----------
    servo_radps, servo_damping : float
        Natural frequency (rad/s) and damping of each servo.
    delay_s : float
        Transport delay from the computation within tick n, s (0.01: acts from tick n+1).
    """

    servo_radps: float = 38.0
    servo_damping: float = 0.51
    delay_s: float = TICK_S


@dataclass(frozen=True)
class ObserverInput:
    """How u enters the reduced-order observer.

    Attributes
    ----------
    u_delay_ticks : int
        Over [n, n+1] the observer uses the command u_(n - u_delay_ticks); 1 is true to a delay of
        one tick.
    servo_radps, servo_damping : float
        Servo model (exact ZOH) between that command and the observer; servo_radps = 0: none.
    """

    u_delay_ticks: int = 1
    servo_radps: float = 38.0
    servo_damping: float = 0.51


@dataclass(frozen=True)
class Linear:
    """State space A, B, C, D; dt = 0 continuous, otherwise sampled every dt s."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    dt: float = 0.0

    def response(self, omega: np.ndarray) -> np.ndarray:
        """Frequency response (m, n_y, n_u), complex, at omega (m,), rad/s."""
        z = np.exp(1j * omega * self.dt) if self.dt else 1j * omega
        n = self.A.shape[0]
        if n == 0:
            return np.broadcast_to(self.D.astype(complex), (omega.size, *self.D.shape)).copy()
        resolvent = z[:, None, None] * np.eye(n) - self.A
        right = np.broadcast_to(self.B.astype(complex), (omega.size, *self.B.shape))
        return self.C @ np.linalg.solve(resolvent, right) + self.D


@dataclass(frozen=True)
class Loop:
    """One of the three loops.

    Attributes
    ----------
    name : str
    plant : Linear
        Inputs: d_lat, d_lon, d_ped, then wind u, v, w. Outputs: y (`n_y`), then h (9), then the
        three actuator positions.
    controller : Linear
        y -> u.
    n_y : int
        Number of fed-back outputs.
    """

    name: str
    plant: Linear
    controller: Linear
    n_y: int

    @property
    def dt(self) -> float:
        """Sampling time, s; 0 for a continuous loop."""
        return self.plant.dt

    def closed(self) -> Linear:
        """Wind (3) -> h (9), actuator positions (3)."""
        p, k = self.plant, self.controller
        By, Bw = p.B[:, :N_U], p.B[:, N_U:]
        Cy, Ch = p.C[: self.n_y], p.C[self.n_y :]
        Dh = p.D[self.n_y :, :N_U]
        A = np.block([[p.A + By @ k.D @ Cy, By @ k.C], [k.B @ Cy, k.A]])
        B = np.vstack([Bw, np.zeros((k.A.shape[0], Bw.shape[1]))])
        C = np.hstack([Ch + Dh @ k.D @ Cy, Dh @ k.C])
        return Linear(A, B, C, np.zeros((C.shape[0], B.shape[1])), p.dt)

    def stability(self) -> float:
        """Spectral abscissa (rad/s) if continuous, log of the spectral radius over dt if sampled; <
        0 is stable."""
        modes = np.linalg.eigvals(self.closed().A)
        if self.dt:
            return float(np.log(np.max(np.abs(modes))) / self.dt)
        return float(np.max(modes.real))

    def at_input(self, omega: np.ndarray) -> np.ndarray:
        """Open loop (m, 3, 3) broken at the plant input, sign such that stability is about 1 +
        L."""
        return -self.controller.response(omega) @ self._u_to_y(omega)

    def at_output(self, omega: np.ndarray) -> np.ndarray:
        """Open loop (m, n_y, n_y) broken at the plant output."""
        return -self._u_to_y(omega) @ self.controller.response(omega)

    def _u_to_y(self, omega: np.ndarray) -> np.ndarray:
        p = self.plant
        part = Linear(p.A, p.B[:, :N_U], p.C[: self.n_y], p.D[: self.n_y, :N_U], p.dt)
        return part.response(omega)


@dataclass(frozen=True)
class Model:
    """What the loops are made of: A (9, 9), B, E (9, 3), C (9, 9), D (9, 3), F (3, 9).

    With an offset-free target, also G (3, 3) and its rate shift_rate (rad/s); the loop as flown
    has it.
    """

    A: Matrix
    B: Matrix
    E: Matrix
    C: Matrix
    D: Matrix
    F: Matrix
    G: Matrix | None = None
    shift_rate: float = 0.0


def observer_of(A: ArrayLike, B: ArrayLike, K: ArrayLike) -> Observer:
    """The reduced-order observer (19) of A (9, 9), B (9, 3) with the gain K (3, 6)."""
    A, B, K = checked("A", A, (9, 9)), checked("B", B, (9, 3)), checked("K", K, (3, 6))
    return reduced_order_observer(A, B, K, MEASURED, UNMEASURED)


def state_feedback_loop(model: Model) -> Loop:
    """u = F x with every state measured."""
    plant = _continuous_plant(model, np.eye(N_X))
    return Loop("state feedback", plant, _gain(model.F), N_X)


def observer_loop(model: Model, K: ArrayLike) -> Loop:
    """Continuous loop with the reduced-order observer (19)."""
    K = checked("K", K, (N_Z, N_Y))
    Az, By, Hu = observer_of(model.A, model.B, K)
    Fm, Fu = model.F[:, MEASURED], model.F[:, UNMEASURED]
    Dk = Fm + Fu @ K
    controller = Linear(Az + Hu @ Fu, By + Hu @ Dk, Fu, Dk)
    return Loop(
        "with observer", _continuous_plant(model, np.eye(N_X)[list(MEASURED)]), controller, N_Y
    )


def flown_loop(
    model: Model,
    K: ArrayLike,
    prediction_s: float = 0.0,
    feed: ObserverInput | None = None,
    actuation: Actuation | None = None,
) -> Loop:
    """Sampled loop as flown: observer, prediction, servos, transport delay, 100 Hz."""
    plant = sampled_plant(model, actuation or Actuation())
    gain = checked("K", K, (N_Z, N_Y))
    controller = sampled_controller(model, gain, prediction_s, feed or ObserverInput())
    return Loop("as flown", plant, controller, N_Y)


def sampled_plant(model: Model, actuation: Actuation) -> Linear:
    """Plant, servos and transport delay, exactly discretised; commands and wind held over a
    tick."""
    n = N_X
    A, B = with_servos(model.A, model.B, actuation.servo_radps, actuation.servo_damping)
    E = np.vstack([model.E, np.zeros((2 * N_U, N_U))])
    Phi, Gamma_w = held(A, E, TICK_S)
    late = held_late(A, B, TICK_S, actuation.delay_s)
    whole, split = late.ticks, bool(np.any(late.older))
    # delay line u_(n-1) .. u_(n-depth); over [n, n+1] first u_(n-whole-1), then u_(n-whole)
    depth = whole + (1 if split else 0)
    N = A.shape[0]
    size = N + N_U * depth
    Ad, Bd = np.zeros((size, size)), np.zeros((size, 2 * N_U))
    Ad[:N, :N] = Phi
    Bd[:N, N_U:] = Gamma_w
    for lag, gain in ((whole, late.newer), (whole + 1, late.older)):
        if lag == 0:
            Bd[:N, :N_U] = gain
        elif lag <= depth:
            Ad[:N, N + N_U * (lag - 1) : N + N_U * lag] = gain
    if depth:
        Bd[N : N + N_U, :N_U] = np.eye(N_U)
        Ad[N + N_U :, N : N + N_U * (depth - 1)] = np.eye(N_U * (depth - 1))
    position = np.zeros((N_U, size))
    position[:, n : n + N_U] = np.eye(N_U)
    x = np.eye(n, size)
    C = np.vstack([x[list(MEASURED)], model.C @ x + model.D @ position, position])
    return Linear(Ad, Bd, C, np.zeros((C.shape[0], 2 * N_U)), TICK_S)


def sampled_controller(model: Model, K: Matrix, prediction_s: float, feed: ObserverInput) -> Linear:
    """Observer (19) and law: u_n = F (Phi x_n + Gamma u_(n-1)), Phi, Gamma over `prediction_s`.

    The observer is discretised exactly for u held and y linear over a tick. States: z (and its
    servo model) less what y_n adds, then u_(n-1), u_(n-2), ... as far back as needed.
    """
    Ac, By, Bu = observer_with_servo(model, K, feed)
    Phi, Gu, G0, G1 = held_and_linear(Ac, Bu, By, TICK_S)
    F, H = predicting_gains(model.A, model.B, model.F, prediction_s)
    n = Ac.shape[0]
    lift = np.vstack([K, np.zeros((n - N_Z, N_Y))]) + G1
    Fz = np.zeros((N_U, n))
    Fz[:, :N_Z] = F[:, UNMEASURED]
    Dk = F[:, MEASURED] + Fz @ lift
    depth = max(feed.u_delay_ticks, 1)
    size = n + N_U * depth
    Cu = np.hstack([Fz, H, np.zeros((N_U, N_U * (depth - 1)))])
    Ad, Bd = np.zeros((size, size)), np.zeros((size, N_Y))
    Ad[:n, :n] = Phi
    Bd[:n] = Phi @ G1 + G0
    if feed.u_delay_ticks == 0:
        Ad[:n] += Gu @ Cu
        Bd[:n] += Gu @ Dk
    else:
        Ad[:n, n + N_U * (depth - 1) :] = Gu
    Ad[n : n + N_U] = Cu
    Bd[n : n + N_U] = Dk
    Ad[n + N_U :, n : n + N_U * (depth - 1)] = np.eye(N_U * (depth - 1))
    law = Linear(Ad, Bd, Cu, Dk, TICK_S)
    if model.shift_rate == 0.0 or model.G is None:
        return law
    through_u = np.zeros((size, N_U))
    through_u[:n] = Gu if feed.u_delay_ticks == 0 else 0.0
    through_u[n : n + N_U] = np.eye(N_U)
    return _with_shift(law, through_u @ model.G, model.G, model.shift_rate)


def _with_shift(law: Linear, B_shift: Matrix, D_shift: Matrix, rate: float) -> Linear:
    """The law with its offset-free target: s(n+1) = s(n) - T rate (phi theta psi)(n), r = 0.

    s enters states and command of the law by B_shift, D_shift.
    """
    outputs = np.zeros((N_U, N_Y))
    outputs[range(N_U), [MEASURED.index(i) for i in OUTPUTS]] = 1.0
    A = np.block([[law.A, B_shift], [np.zeros((N_U, law.A.shape[0])), np.eye(N_U)]])
    B = np.vstack([law.B, -law.dt * rate * outputs])
    return Linear(A, B, np.hstack([law.C, D_shift]), law.D, law.dt)


def predicting_gains(A: Matrix, B: Matrix, F: Matrix, prediction_s: float) -> tuple[Matrix, Matrix]:
    """F Phi (3, 9) and F Gamma (3, 3) over `prediction_s`, with u held: u_n = F Phi x_n + F Gamma
    u_(n-1).

    At rest Phi x + Gamma u = x, so that the feedforward G of eq. (15) stays as it is.
    """
    if prediction_s == 0.0:
        return F.copy(), np.zeros((F.shape[0], B.shape[1]))
    Phi, Gamma = held(A, B, prediction_s)
    return F @ Phi, F @ Gamma


def observer_with_servo(
    model: Model, K: Matrix, feed: ObserverInput
) -> tuple[Matrix, Matrix, Matrix]:
    """A, B_y, B_u of (19), continuous, behind the servo model of `feed` if it has one."""
    Az, By, Hu = observer_of(model.A, model.B, K)
    if feed.servo_radps == 0.0:
        return Az, By, Hu
    A, B = with_servos(Az, Hu, feed.servo_radps, feed.servo_damping)
    return A, np.vstack([By, np.zeros((2 * N_U, N_Y))]), B


def _continuous_plant(model: Model, selector: Matrix) -> Linear:
    C = np.vstack([selector, model.C, np.zeros((N_U, N_X))])
    D = np.zeros((C.shape[0], 2 * N_U))
    ny = selector.shape[0]
    D[ny : ny + model.D.shape[0], :N_U] = model.D
    D[-N_U:, :N_U] = np.eye(N_U)
    return Linear(model.A, np.hstack([model.B, model.E]), C, D)


def _gain(F: Matrix) -> Linear:
    return Linear(np.zeros((0, 0)), np.zeros((0, F.shape[1])), np.zeros((F.shape[0], 0)), F)
