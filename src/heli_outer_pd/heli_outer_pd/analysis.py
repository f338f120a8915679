# SPDX-License-Identifier: Apache-2.0
"""One axis of the position loop as it flies, linear and sampled: margins, and rms in its wind.

The attitude loop (or the collective's servo) and the body move in ticks of 10 ms; law (21) with its
lead and its disturbance observer, which reads the tilt beside position and speed, makes a step
every `period_ticks`. Lifted to the controller's period both are one linear system, exact between
the controller's steps. Driven by the Dryden spectrum and the
navigation's errors, the stationary covariance follows from one Lyapunov equation, so the rms of a
flight is predicted without flying. Plain matrices: the search for gains asks thousands of times.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.linear import stationary
from heli_core.rows import SETPOINT
from heli_core.search import search
from heli_core.ticks import TICK_S
from heli_outer_pd.disturbance import kept
from heli_outer_pd.state import OuterParams, thrust_for_collective

# -------------------------------------------------------------------------------------------------
# Axis analysis.
# -------------------------------------------------------------------------------------------------

Matrix = NDArray[np.float64]
_FREQUENCIES = 400
_LOWEST_RADPS = 1e-2
# Of the limit of performance: variance of what is read, m2 and m2/s2, price of the command, and of
# the one of position and speed that is not asked for.
_HEARD, _CHEAP, _BESIDE = 1e-10, 1e-8, 1e-4


class Sampled(NamedTuple):
    """x(n+1) = A x + B u, y = C x + D u, a step per tick.

    Of what actuates an axis the inputs are the commanded acceleration (m/s2) and the speed of the
    air past the aircraft (m/s), the outputs are the acceleration (m/s2) and, where there is a tilt
    to be measured, what that explains of it. Of a noise the input is white with unit variance.
    """

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix


@dataclass(frozen=True)
class Axis:
    """What one axis looks like to the outer loop.

    Attributes
    ----------
    actuation : Sampled
        The attitude loop as flown, or the collective's delay and servo, with the drag.
    modelled_lag_s, modelled_damping_per_s : float
        What the controller's own model knows of actuation and damping; lag 0: none.
    tilt_standing_s : float
        `disturbance.tilt_standing_s` where the tilt is measured; 0: it is not used.
    prediction_s : float
        Over which the controller predicts the speed that it feeds back; not without an observer.
    has_lead : bool
        Whether the controller leads its command.
    gusts : sequence of Sampled
        Speeds of the air along the axis, m/s; independent.
    position_error, speed_error : Sampled
        Of the navigation, m and m/s.
    period_ticks : int
        Of the controller.
    """

    actuation: Sampled
    modelled_lag_s: float
    modelled_damping_per_s: float
    gusts: tuple[Sampled, ...]
    position_error: Sampled
    speed_error: Sampled
    period_ticks: int
    tilt_standing_s: float = 0.0
    prediction_s: float = 0.0
    has_lead: bool = True

    @property
    def dt_s(self) -> float:
        """The controller's period."""
        return self.period_ticks * TICK_S

    @cached_property
    def lifted(self) -> tuple[Matrix, Matrix, Matrix, Matrix, Matrix]:
        """A, B, Q, M, Z over the controller's period: x+ = A x + B u + noise of covariance Q.

        M x is what the controller reads, position and speed with the navigation's errors, and what
        the tilt explains; Z x is true.
        """
        return _lifted(self)

    @cached_property
    def response(self) -> tuple[Matrix, NDArray[np.complex128]]:
        """Frequencies (m,), rad/s, and response (m, 3) of command -> the controller's inputs."""
        A, B, _, M, _ = self.lifted
        omega = np.geomspace(_LOWEST_RADPS, 0.999 * np.pi / self.dt_s, _FREQUENCIES)
        z = np.exp(1j * omega * self.dt_s)
        # Noise states are not driven by the command.
        return omega, np.stack([M @ np.linalg.solve(at * np.eye(len(A)) - A, B[:, 0]) for at in z])


@dataclass(frozen=True)
class Gains:
    """Of one axis.

    Attributes
    ----------
    K_P, K_D : float
        1/s2, 1/s.
    l1, l2 : float
        Of the disturbance observer, 1/s, 1/s2; l2 = 0: there is none.
    lead_s, lead_filter_s : float
        Of the lead; lead_s = 0: none.
    """

    K_P: float
    K_D: float
    l1: float
    l2: float
    lead_s: float = 0.0
    lead_filter_s: float = 0.1

    @classmethod
    def of(cls, kernel: OuterParams, axis: int) -> "Gains":
        """As flown on an axis: 0 forward, 1 right, 2 down."""
        on = float(kernel.wind_compensation > 0.5)
        l1, l2 = on * kernel.observer_l1[axis], on * kernel.observer_l2[axis]
        lead_s = float(kernel.attitude_lead[axis]) if axis < len(kernel.attitude_lead) else 0.0
        gains = float(kernel.K_P[axis]), float(kernel.K_D[axis])
        return cls(*gains, float(l1), float(l2), lead_s, kernel.lead_filter_s)


@dataclass(frozen=True)
class AxisReport:
    """What the gains of one axis are worth.

    Attributes
    ----------
    stable : bool
    crossover_radps : float
        Highest frequency at which the loop's gain is one.
    gain_margin_db, phase_margin_deg : float
        Smallest of either sign; inf where there is none.
    disk_margin : float
        2 / max |S - T|; 0 if unstable.
    position_rms_m, speed_rms_mps : float
        In the axis' gusts and with the navigation's errors; inf if unstable.
    position_limit_m, speed_limit_mps : float
        The same of the best linear controller that reads the same, with perfect actuators.
    """

    stable: bool
    crossover_radps: float
    gain_margin_db: float
    phase_margin_deg: float
    disk_margin: float
    position_rms_m: float
    speed_rms_mps: float
    position_limit_m: float
    speed_limit_mps: float


def modelled_heave_damping_per_s(kernel: OuterParams) -> float:
    """Acceleration per vertical speed, 1/s, that the controller's thrust map knows of, at trim."""
    k, step = kernel, 1e-3
    d_col = k.trim[SETPOINT.col]
    up, down = (
        thrust_for_collective(d_col, sign * step, k.mass * k.g, d_col, k.rotor)
        for sign in (-1.0, 1.0)
    )
    return float((down - up) / (2.0 * step * k.mass))


def drifting(sigma: float, time_s: float) -> Sampled:
    """First-order Gauss-Markov noise; with time_s = L / V MIL-F-8785C's H_u."""
    keep = np.exp(-TICK_S / time_s)
    one = np.eye(1)
    return Sampled(keep * one, sigma * np.sqrt(1.0 - keep**2) * one, one, 0.0 * one)


def dryden_across(sigma_mps: float, time_s: float) -> Sampled:
    """MIL-F-8785C's H_v, H_w; time_s = L / V. Both states of the filter, exactly sampled."""
    keep, h = np.exp(-TICK_S / time_s), TICK_S / time_s
    A = keep * np.array([[1.0, 0.0], [h, 1.0]])
    stationary = np.array([[0.5, 0.25], [0.25, 0.25]])
    B = np.linalg.cholesky(stationary - A @ stationary @ A.T)
    # (1 + sqrt(3) T s) / (1 + T s)^2: x1 behind one lag, x2 behind two.
    C = sigma_mps * np.array([[np.sqrt(3.0), 1.0 - np.sqrt(3.0)]])
    return Sampled(A, B, C, np.zeros((1, 2)))


def law(gains: Gains, axis: Axis) -> Sampled:
    """Law (21) with lead and observer: what is read -> commanded acceleration.

    A step per period of the controller. Read are position, speed and the acceleration that the tilt
    explains. States: estimated speed and disturbance, the last command, the same behind the
    modelled lag, the wanted acceleration behind the lead's filter, and what tilt leaves standing.
    """
    n = 6
    v_hat, d_hat, last, lagged, led, stands, position, speed, tilt = np.eye(n + 3)
    dt, g = axis.dt_s, gains
    keep, stay = kept(dt, axis.modelled_lag_s), kept(dt, axis.tilt_standing_s)
    lagged = keep * lagged + (1.0 - keep) * last
    stands = stay * stands + (1.0 - stay) * (lagged - tilt)
    innovation = speed - v_hat
    modelled = tilt + stands - axis.modelled_damping_per_s * speed
    if g.l2 > 0.0:
        v_hat = v_hat + dt * (modelled + d_hat + g.l1 * innovation)
        d_hat = d_hat + dt * g.l2 * innovation
    else:
        v_hat, d_hat = 0.0 * v_hat, 0.0 * d_hat
    ahead = speed + (axis.prediction_s * (modelled + d_hat) if g.l2 > 0.0 else 0.0)
    wanted = -g.K_P * position - g.K_D * ahead - d_hat
    command = wanted + g.lead_s / g.lead_filter_s * (wanted - led)
    held = np.exp(-dt / g.lead_filter_s)
    led = held * led + (1.0 - held) * wanted
    rows = np.array([v_hat, d_hat, command, lagged, led, stands, command])
    return Sampled(rows[:n, :n], rows[:n, n:], rows[n:, :n], rows[n:, n:])


def plant(axis: Axis) -> tuple[Matrix, Matrix, Matrix, Matrix, Matrix]:
    """One tick: x+ = A x + B u + W n; M x is read (3), Z x are position and speed.

    States: position, speed, then those of actuation, gusts and the navigation's errors.
    """
    act = axis.actuation
    noises = [*axis.gusts, axis.position_error, axis.speed_error]
    sizes = np.cumsum([2, len(act.A), *(len(noise.A) for noise in noises)])
    n, inputs = sizes[-1], np.cumsum([0, *(noise.B.shape[1] for noise in noises)])
    A, B, W = np.zeros((n, n)), np.zeros((n, 1)), np.zeros((n, inputs[-1]))
    output = np.zeros((len(noises), n))
    for i, noise in enumerate(noises):
        block = slice(sizes[i + 1], sizes[i + 2])
        A[block, block], W[block, inputs[i] : inputs[i + 1]] = noise.A, noise.B
        output[i, block] = noise.C
    Z = np.eye(2, n)
    position_speed = np.array([0.5 * TICK_S**2, TICK_S])
    past = output[: len(axis.gusts)].sum(axis=0) - Z[1]
    block = slice(2, sizes[1])
    A[block, block] = act.A
    A[block] += np.outer(act.B[:, 1], past)
    B[block, 0] = act.B[:, 0]
    acceleration = act.D[0, 1] * past
    acceleration[block] += act.C[0]
    A[:2] = Z + np.outer([TICK_S, 0.0], Z[1]) + np.outer(position_speed, acceleration)
    B[:2, 0] = position_speed * act.D[0, 0]
    tilt = np.zeros((1, n))
    tilt[:, block] = act.C[1:].sum(axis=0)  # without a tilt nothing is explained
    return A, B, W, np.vstack([Z + output[-2:], tilt]), Z


def analyse(axis: Axis, gains: Gains) -> AxisReport:
    """Margins of the axis' loop, broken at the commanded acceleration, and rms in its gusts."""
    limit = limits_of_performance(axis)
    rms = deviations(axis, gains)
    if rms is None:
        return AxisReport(False, np.nan, np.nan, np.nan, 0.0, np.inf, np.inf, *limit)
    omega, loop = open_loop(axis, gains)
    margins = _stability_margins(omega, loop)
    return AxisReport(True, *margins, disk_margin(loop), rms.position_m, rms.speed_mps, *limit)


def limits_of_performance(
    axis: Axis, at_once: bool = True, gusts_known: bool = False
) -> tuple[float, float]:
    """Smallest standard deviation of position (m) and, by another controller, of speed (m/s).

    Of all linear controllers that read the same at the same period: LQG with next to no price on
    the command. What is left is what cannot be known in time.

    Parameters
    ----------
    axis : Axis
    at_once : bool
        As if the command were the acceleration at once; else behind the axis' own actuation.
    gusts_known : bool
        As if the air's present speed were read beside, without error.
    """
    from scipy.linalg import solve_discrete_are

    if at_once:
        drag = axis.actuation.D[0, 1]
        perfect = np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), np.array([[1.0, drag]])
        axis = replace(axis, actuation=Sampled(*perfect))
    A, B, Q, M, Z = axis.lifted
    if gusts_known:
        first = len(Z) + len(axis.actuation.A)
        speed = np.concatenate([gust.C[0] for gust in axis.gusts])
        M = np.vstack([M, np.pad(speed, (first, len(A) - first - len(speed)))])
    heard = _HEARD * np.eye(len(M))
    P = solve_discrete_are(A.T, M.T, Q, heard)
    gain = P @ M.T @ np.linalg.inv(M @ P @ M.T + heard)
    deviations_m = []
    for z in Z:
        weight = np.outer(z, z) + _BESIDE * Z.T @ Z
        X = solve_discrete_are(A, B, weight, _CHEAP * np.eye(1))
        F = np.linalg.solve(B.T @ X @ B + _CHEAP, B.T @ X @ A)
        # State: truth and prediction; the command is worked out from the updated estimate.
        estimate = np.eye(len(A)) - gain @ M
        closed = np.block(
            [
                [A - B @ F @ gain @ M, -B @ F @ estimate],
                [(A - B @ F) @ gain @ M, (A - B @ F) @ estimate],
            ]
        )
        noise = np.zeros_like(closed)
        noise[: len(A), : len(A)] = Q
        covariance = stationary(closed, noise)[: len(A), : len(A)]
        deviations_m.append(float(np.sqrt(z @ covariance @ z)))
    return deviations_m[0], deviations_m[1]


class Deviations(NamedTuple):
    """Standard deviations of a closed axis."""

    position_m: float
    speed_mps: float
    step_mps2: float
    """Of the commanded acceleration, from one step of the controller to the next."""


def deviations(axis: Axis, gains: Gains) -> Deviations | None:
    """Standard deviations in wind and with the navigation's errors, None if it is unstable."""
    A, B, Q, M, Z = axis.lifted
    k = law(gains, axis)
    closed = np.block([[A + B @ k.D @ M, B @ k.C], [k.B @ M, k.A]])
    noise = np.zeros_like(closed)
    noise[: len(A), : len(A)] = Q
    if np.max(np.abs(np.linalg.eigvals(closed))) >= 1.0:
        return None
    covariance = stationary(closed, noise)
    position_m, speed_mps = np.sqrt(np.diag(Z @ covariance[: len(A), : len(A)] @ Z.T))
    command = np.hstack([k.D @ M, k.C])
    change = command @ closed - command
    step = change @ covariance @ change.T + command @ noise @ command.T
    return Deviations(float(position_m), float(speed_mps), float(np.sqrt(step[0, 0])))


def open_loop(axis: Axis, gains: Gains) -> tuple[Matrix, NDArray[np.complex128]]:
    """Frequencies (m,), rad/s, and the open loop (m,); stability is about -1."""
    omega, moved = axis.response
    k = law(gains, axis)
    z = np.exp(1j * omega * axis.dt_s)[:, None, None]
    inner = np.linalg.solve(
        z * np.eye(len(k.A)) - k.A, np.broadcast_to(k.B, (omega.size, *k.B.shape))
    )
    return omega, -np.einsum("mi,mi->m", (k.C @ inner + k.D)[:, 0], moved)


def disk_margin(loop: NDArray[np.complex128]) -> float:
    """Balanced disk margin 2 / max |S - T| of a stable scalar loop (m,)."""
    return float(2.0 / np.max(np.abs((1.0 - loop) / (1.0 + loop))))


def _stability_margins(omega: Matrix, loop: NDArray[np.complex128]) -> tuple[float, float, float]:
    """Crossover, rad/s, smallest gain margin, dB, and phase margin, deg, of either sign."""
    import control  # takes seconds to import

    measured = control.frd(loop, omega, smooth=True)
    gain, phase_deg, _, _, crossover, _ = control.stability_margins(measured, returnall=True)
    return (
        float(np.max(crossover, initial=0.0)),
        float(np.min(np.abs(20.0 * np.log10(gain)), initial=np.inf)),
        float(np.min(np.abs(phase_deg), initial=np.inf)),
    )


def _lifted(axis: Axis) -> tuple[Matrix, Matrix, Matrix, Matrix, Matrix]:
    A, B, W, M, Z = plant(axis)
    power, held, noise = np.eye(len(A)), np.zeros_like(B), np.zeros_like(A)
    for _ in range(axis.period_ticks):
        held, noise, power = A @ held + B, A @ noise @ A.T + W @ W.T, A @ power
    return power, held, noise, M, Z


# -------------------------------------------------------------------------------------------------
# Gains of one axis of the position loop, searched: least error under a floor on the margins.
#
# The cost is the sum of the squares of position's and speed's standard deviation in units of what
# is
# wanted of each, over the axis as modelled and its `others` (later, lighter, less damped). Every
# one
# of them must keep its margin's floor, and the command must not shake: the valley of the cost is
# flat, and gains that pass the navigation's noise on cost hardly less. The search is that of
# `heli_core.search`, which ends at the same gains on every machine.
# -------------------------------------------------------------------------------------------------

# K_P, K_D, bandwidth of the observer, lead: what parameters allow, and where the search begins.
_BOUNDS = (20.0, 40.0, 15.0, 1.0)
_STARTS_LED = ((0.43, 1.1, 0.3, 0.3), (1.0, 2.2, 1.0, 0.3))
_STARTS = ((3.0, 4.7, 1.6, 0.0), (6.2, 6.2, 3.0, 0.0), (8.2, 15.0, 6.2, 0.0))


class NoGainsError(ValueError):
    """No gains of the grid keep the margins; the message says of which axis and by how much."""


@dataclass(frozen=True)
class AxisRequirements:
    """What the gains of an axis are chosen for.

    Attributes
    ----------
    position_m, speed_mps : float
        Units of the cost.
    disk_margin : float
        Floor of the axis as modelled.
    disk_margin_of_others : float
        Floor of each of the others.
    step_mps2 : float
        Most that the command may change by from step to step, as a standard deviation.
    """

    position_m: float
    speed_mps: float
    step_mps2: float
    disk_margin: float
    disk_margin_of_others: float


def gains_at(values: Sequence[float], damping: float, lead_filter_s: float) -> Gains:
    """Gains of K_P, K_D, the observer's bandwidth and the lead."""
    K_P, K_D, bandwidth, lead_s = values
    return Gains(K_P, K_D, 2.0 * damping * bandwidth, bandwidth**2, lead_s, lead_filter_s)


def cost(gains: Gains, axis: Axis, others: Sequence[Axis], wanted: AxisRequirements) -> float:
    """Of the gains, inf where a margin is below its floor or a loop unstable."""
    floors = [wanted.disk_margin] + [wanted.disk_margin_of_others] * len(others)
    total = 0.0
    for one, floor in zip((axis, *others), floors, strict=True):
        if not disk_margin(open_loop(one, gains)[1]) >= floor:
            return np.inf
        rms = deviations(one, gains)
        if rms is None or (one is axis and rms.step_mps2 > wanted.step_mps2):
            return np.inf
        total += (rms.position_m / wanted.position_m) ** 2 + (rms.speed_mps / wanted.speed_mps) ** 2
    return float(total / len(floors))


def best_gains(
    name: str,
    axis: Axis,
    others: Sequence[Axis],
    wanted: AxisRequirements,
    damping: float,
    lead_filter_s: float,
) -> tuple[float, ...]:
    """K_P, K_D, the observer's bandwidth and the lead (0 where there is none) of an axis.

    Parameters
    ----------
    name : str
        Of the axis, for the error.
    axis, others, wanted
        As of `cost`.
    damping, lead_filter_s : float
        Of the disturbance observer; time constant of the lead's filter.

    Raises
    ------
    NoGainsError
        None of the gains that the search begins with keeps the margins.
    """

    def price(values: Sequence[float]) -> float:
        if any(value > bound for value, bound in zip(values, _BOUNDS, strict=True)):
            return np.inf
        return cost(gains_at(values, damping, lead_filter_s), axis, others, wanted)

    optima = [search(start, price) for start in (_STARTS_LED if axis.has_lead else _STARTS)]
    best = min(optima, key=price)
    if not np.isfinite(price(best)):
        floors = f"{wanted.disk_margin:g} (others {wanted.disk_margin_of_others:g})"
        raise NoGainsError(
            f"position loop, {name}: no gains near those that the search begins with keep a disk "
            f"margin of {floors}: the attitude loop is too slow, or unstable"
        )
    return best
