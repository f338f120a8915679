# SPDX-License-Identifier: Apache-2.0
"""One cost and one floor for every attitude controller with memory, and the search by them.

The cost of a controller is a sum of variances, in units of what is wanted of each: errors of roll,
pitch and heading and the actuators' steps, in gusts, under moments that the controller does not
know, with the navigation's errors, while commands are followed; the mean over the aircraft of a
set. The floor: disk and delay margins of the nominal aircraft, and a smaller disk margin of each of
the others. A family of controllers is a function of positive numbers, so that all are searched
alike.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli_core.central_controller import NoControllerError
from heli_core.errors import SynthesisError
from heli_core.linear import diagonal_observer_gain, held, stationary, with_servos
from heli_core.rows import ATTITUDE, INPUT_NAMES, MEASURED, NINE, STATE_NAMES, UNMEASURED
from heli_core.search import BETTER, STRIDES, search
from heli_core.ticks import TICK_S
from heli_inner_hinf.controller_state import (
    CONTROLLERS,
    INPUTS,
    N_V,
    OUTPUT_FEEDBACK,
    STATE_FEEDBACK,
    Actuation,
    ObserverInput,
    OutputLaw,
)
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import (
    COMMANDS,
    MEASURED_NAMES,
    N_Y,
    ChannelMargin,
    Loop,
    Model,
    channel_margins,
    closed,
    disk_margin,
    feedback_of_law,
    flown_loop,
    flown_plant,
    further_delay_s,
    linear_law_of,
    observer_loop,
    output_loop,
    sampled_controller,
    sampled_plant,
    sampled_response,
    state_feedback_loop,
)
from heli_inner_hinf.mu import DiskMargin, disk_margins, peak_gain, response, top
from heli_inner_hinf.regular_form import N_U, N_X, Matrix, checked

if TYPE_CHECKING:
    import control

# -------------------------------------------------------------------------------------------------
# Attitude search.
# -------------------------------------------------------------------------------------------------

# Closer where the lightly damped flapping makes margins narrow.
_OMEGA = np.unique(
    np.concatenate(
        [
            np.geomspace(0.1, 8.0, 60),
            np.geomspace(8.0, 30.0, 120),
            np.geomspace(30.0, 0.999 * np.pi / TICK_S, 40),
        ]
    )
)
_ANGLES = [INPUTS.index(name) for name in ("phi", "theta", "psi_error")]
_RATES = [INPUTS.index(name) for name in ("p", "q", "r")]
_COMMANDS = [INPUTS.index(name) for name in ("phi_ref", "theta_ref")]
_DECAY_RADPS = 1e-3
"""A loop whose slowest mode dies out more slowly is taken for unstable."""
_REFUSED = 1e6
"""Price of a controller that misses its floors, before what it misses them by."""
_NONE = 1e9
"""Price where the family has no controller."""


class Surroundings(NamedTuple):
    """What moves the loop: standard deviations, and correlation times of what drifts.

    Attributes
    ----------
    gust_mps, gust_s : (3,) array, float
        Wind u, v, w in body axes, behind two lags of this time.
    load, load_s : float
        Moments that the controller does not know, in place of each actuator.
    kick, kick_s : (3,) array, float
        Likewise of the main rotor's wake, which a gust blows off the stabiliser: still air does not
        show it.
    angle_rad, angle_s : (3,) array, float
        Error of the navigation's phi, theta, psi.
    rate_radps : float
        White noise of p, q, r.
    command_rad, command_s : float
        Commanded phi, theta.
    heading_radps05 : float
        Commanded heading, which wanders without end: every tick a step of it, rad per root of s.
    """

    gust_mps: tuple[float, float, float] = (1.4, 1.4, 1.4)
    gust_s: float = 0.15
    load: float = 2e-3
    load_s: float = 10.0
    kick: tuple[float, float, float] = (0.0, 4e-3, 0.0)
    kick_s: float = 0.05
    angle_rad: tuple[float, float, float] = (5e-4, 5e-4, 2e-3)
    angle_s: float = 1.0
    rate_radps: float = 5e-3
    command_rad: float = 1.5e-3
    command_s: float = 0.4
    heading_radps05: float = 0.007


class CostScales(NamedTuple):
    """Units of the cost and the nominal aircraft's floors.

    Attributes
    ----------
    angle_rad : (3,) array
        Standard deviations of the errors of phi, theta, psi.
    step : float
        Of the steps of each actuator's command from tick to tick.
    disk_margin : float
        At the plant's input and at what the controller reads.
    delay_ticks : int
        So many ticks of further delay the loop survives.
    """

    angle_rad: tuple[float, float, float] = (1e-3, 0.8e-3, 4e-3)
    step: float = 4e-3
    disk_margin: float = 0.65
    delay_ticks: int = 3


@dataclass(frozen=True)
class SampledAircraft:
    """One of the set.

    Attributes
    ----------
    name : str
    A, B, E : (9, 9), (9, 3), (9, 3) arrays
        Eq. (9), SI and rad.
    actuation : Actuation
    disk_margin : float
        Floor at the plant's input; the first of a set has those of `CostScales` instead.
    """

    name: str
    A: Matrix
    B: Matrix
    E: Matrix
    actuation: Actuation
    disk_margin: float = 0.0

    @cached_property
    def flown(self) -> tuple[Matrix, Matrix]:
        """A, B of `flown_plant`."""
        return flown_plant(self.A, self.B, self.actuation)

    def later(self, ticks: int) -> SampledAircraft:
        """The same with further delay."""
        delay_s = self.actuation.delay_s + ticks * TICK_S
        return replace(self, actuation=replace(self.actuation, delay_s=delay_s))

    @cached_property
    def disturbed(self) -> Matrix:
        """Effect (n, 6) of wind u, v, w (m/s) and of a load in each actuator's place, held."""
        actuation = self.actuation
        behind, _ = with_servos(self.A, self.B, actuation.servo_radps, actuation.servo_damping)
        acting = np.zeros((behind.shape[0], 2 * N_U))
        acting[:N_X] = np.hstack([self.E, self.B])
        effect = np.zeros((self.flown[0].shape[0], 2 * N_U))
        effect[: behind.shape[0]] = held(behind, acting, TICK_S)[1]
        return effect

    @cached_property
    def response(self) -> NDArray[np.complex128]:
        """Response (m, 6, 3) of the commands -> what a controller reads, at `_OMEGA`."""
        return sampled_response(*self.flown, _OMEGA)[:, list(MEASURED)]


class LawFamily(NamedTuple):
    """Controllers of one kind.

    Attributes
    ----------
    name : str
    law : callable
        Of positive numbers; raises SynthesisError or NoControllerError where there is none.
    starts : tuple of tuple of float
        Where searches begin.
    """

    name: str
    law: Callable[[Sequence[float]], OutputLaw]
    starts: tuple[tuple[float, ...], ...]


class Variances(NamedTuple):
    """Of one aircraft's loop: errors of phi, theta, psi (3,), rad2, steps of the commands (3,)."""

    angle: NDArray[np.float64]
    step: NDArray[np.float64]


class NoLawError(SynthesisError):
    """No controller of a family keeps the floors."""


@dataclass(frozen=True)
class LawBenchmark:
    """What every controller is measured by.

    Attributes
    ----------
    nominal : SampledAircraft
    others : tuple of SampledAircraft
    wanted : CostScales
    air : Surroundings
    held_stable : tuple of SampledAircraft
        Further ones, which count neither by their cost nor by their margins.
    """

    nominal: SampledAircraft
    others: tuple[SampledAircraft, ...]
    wanted: CostScales = CostScales()
    air: Surroundings = Surroundings()
    held_stable: tuple[SampledAircraft, ...] = ()

    @cached_property
    def _later(self) -> tuple[SampledAircraft, ...]:
        return tuple(self.nominal.later(1 + i) for i in range(self.wanted.delay_ticks))

    def cost(self, law: OutputLaw) -> float:
        """Mean over all aircraft of the variances in units of what is wanted; stable loops only."""
        wanted = self.wanted
        of_aircraft = [variances(law, one, self.air) for one in (self.nominal, *self.others)]
        in_units = [
            np.sum(v.angle / np.square(wanted.angle_rad)) + np.sum(v.step) / wanted.step**2
            for v in of_aircraft
        ]
        return float(np.mean(in_units))

    def shortfall(self, law: OutputLaw) -> float:
        """By how much floors are missed, all together; 0: none is.

        Unstable loops count by their growth, rad/s, and are far worse than small margins.
        """
        feedback, further = feedback_of_law(law), (*self._later, *self.held_stable)
        growths = [_growth_radps(closed(*one.flown, feedback))
                   for one in (self.nominal, *self.others, *further)]  # fmt: skip
        if max(growths) > -_DECAY_RADPS:
            return sum(10.0 + growth for growth in growths if growth > -_DECAY_RADPS)
        K = feedback.C @ sampled_response(feedback.A, feedback.B, _OMEGA) + feedback.D
        P = self.nominal.response
        floor = self.wanted.disk_margin
        margins = [(floor, -K @ P), (floor, -P @ K)]
        margins += [(one.disk_margin, -K @ one.response) for one in self.others]
        return sum(
            max(0.0, floor - float(np.min(disk_margins(L, exact=False)))) for floor, L in margins
        )

    def price(self, law: OutputLaw) -> float:
        """The cost of a controller that keeps its floors; of any other more, by its misses."""
        missed = self.shortfall(law)
        return _REFUSED * (1.0 + missed) if missed > 0.0 else self.cost(law)

    def best(
        self,
        family: LawFamily,
        strides: Sequence[int] = STRIDES,
        pairs: bool = True,
        better: float = BETTER,
    ) -> tuple[float, ...]:
        """The family's numbers that no neighbour betters, from the best of its starts.

        Parameters
        ----------
        family : LawFamily
        strides, pairs, better
            As of `search`.

        Raises
        ------
        NoLawError
            No start leads to a controller that keeps the floors.
        """

        def price(numbers: Sequence[float]) -> float:
            try:
                return self.price(family.law(numbers))
            except (SynthesisError, NoControllerError, np.linalg.LinAlgError):
                return _NONE

        ends = [search(start, price, strides, pairs, better) for start in family.starts]
        best_numbers = min(ends, key=price)
        if price(best_numbers) >= _REFUSED:
            raise NoLawError(
                f"{family.name}: no controller near the search's starts keeps the floors of "
                "disk and delay margin"
            )
        return best_numbers


def variances(law: OutputLaw, one: SampledAircraft, air: Surroundings) -> Variances:
    """Stationary variances of a stable loop, by one Lyapunov equation.

    States: the plant's, wind, load, the navigation's slow errors and commands, the controller's.
    """
    plant, law_at = one.flown[0].shape[0], slice(-law.A.shape[0] or None, None)
    D, B_d, acting, read = shaped_noise(air)
    size = plant + len(D) + law.A.shape[0]
    here, there = slice(0, plant), slice(plant, plant + len(D))
    # v of the controller: what is measured, with slow errors, and the commands; white noise of the
    # rates
    v = np.zeros((N_V, size))
    v[: len(MEASURED), here], v[:, there] = np.eye(plant)[list(MEASURED)], read
    noise = air.rate_radps * np.eye(N_V)[:, _RATES]
    u, direct = law.D @ v, law.D @ noise
    white = slice(B_d.shape[1], B_d.shape[1] + N_U)
    A, B = np.zeros((size, size)), np.zeros((size, white.stop + 1))
    A[here, here], A[here, there] = one.flown[0], one.disturbed @ acting
    A[there, there], B[there, : white.start] = D, B_d
    # a new heading command is a heading error, which the controller's memory follows
    turned = air.heading_radps05 * np.sqrt(TICK_S)
    B[NINE.psi, -1] = turned
    if law.A.size:
        u[:, law_at] = law.C
        A[law_at], B[law_at, white], B[law_at, -1] = law.B @ v, law.B @ noise, turned * law.turn
        A[law_at, law_at] += law.A
    A[here] += one.flown[1] @ u
    B[here, white] = one.flown[1] @ direct
    P = stationary(A, B @ B.T)
    error = np.eye(size)[list(ATTITUDE)]
    error[: len(_COMMANDS)] -= v[_COMMANDS]
    # u(n+1) - u(n): by the state, by the noise that moved it, by that which is read directly
    stride, jump = u @ (A - np.eye(size)), u @ B
    jump[:, white] -= direct
    step = _diagonal(stride, P) + np.sum(jump**2, axis=1) + np.sum(direct**2, axis=1)
    return Variances(_diagonal(error, P), step)


def shaped_noise(air: Surroundings) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """What moves the loop, driven by white noise of unit variance, one step a tick.

    Returns
    -------
    A, B : (17, 17), (17, 14) arrays
        States: gusts behind one lag, loads, kicks, errors of the angles, commands, gusts behind
        two lags.
    acting : (6, 17) array
        Of its states as wind and loads.
    read : (8, 17) array
        Of its states what a controller reads besides the aircraft.
    """
    drifts = (
        (np.ones(N_U), air.gust_s),
        (np.full(N_U, air.load), air.load_s),
        (np.asarray(air.kick), air.kick_s),
        (np.asarray(air.angle_rad), air.angle_s),
        (np.full(len(_COMMANDS), air.command_rad), air.command_s),
    )
    sigma = np.concatenate([sigmas for sigmas, _ in drifts])
    keep = np.concatenate(
        [np.full(len(sigmas), np.exp(-TICK_S / time_s)) for sigmas, time_s in drifts]
    )
    gust, load, kick, angle, command, lagged = _places(
        [*(len(sigmas) for sigmas, _ in drifts), N_U]
    )
    A = np.diag(np.append(keep, keep[gust]))
    A[lagged, gust] = np.eye(N_U) - np.diag(keep[gust])
    B = np.vstack([np.diag(sigma * np.sqrt(1.0 - keep**2)), np.zeros((N_U, len(keep)))])
    settled = np.diag(stationary(A, B @ B.T))[lagged]
    acting, read = np.zeros((2 * N_U, len(A))), np.zeros((N_V, len(A)))
    acting[:N_U, lagged] = np.diag(np.asarray(air.gust_mps) / np.sqrt(settled))
    acting[N_U:, load] = acting[N_U:, kick] = np.eye(N_U)
    read[_ANGLES, angle], read[_COMMANDS, command] = np.eye(N_U), np.eye(len(_COMMANDS))
    return A, B, acting, read


def _places(sizes: Sequence[int]) -> list[slice]:
    ends = np.cumsum([0, *sizes])
    return [slice(int(ends[i]), int(ends[i + 1])) for i in range(len(sizes))]


def _diagonal(rows: Matrix, P: Matrix) -> Matrix:
    """Diagonal of rows P rows'."""
    return np.sum((rows @ P) * rows, axis=1)


def _growth_radps(A: Matrix) -> float:
    """Of the least stable mode."""
    return float(np.log(np.max(np.abs(np.linalg.eigvals(A)))) / TICK_S)


# -------------------------------------------------------------------------------------------------
# How an attitude loop answers commands, disturbances of its attitude, and itself.
#
# For analysis: whatever flies does not import this module, as python-control takes seconds to
# import.
# -------------------------------------------------------------------------------------------------

_PLACES = tuple(MEASURED_NAMES.index(STATE_NAMES[i]) for i in ATTITUDE)
"""Of roll, pitch and yaw among what is measured."""
_LOWEST_RADPS, _POINTS = 0.05, 2000
_Complex = np.ndarray


@dataclass(frozen=True)
class AttitudeResponses:
    """Responses (m,) of each axis, roll, pitch, yaw, the others closed.

    Attributes
    ----------
    omega_radps : (m,) array
    to_command : tuple of (m,) complex array
        Attitude to its command.
    to_disturbance : tuple of (m,) complex array
        Attitude with a disturbance of the measured attitude, to that disturbance: the sensitivity.
    broken : tuple of (m,) complex array
        Open loop at the actuators: lateral, longitudinal, pedal, one at a time.
    """

    omega_radps: NDArray[np.float64]
    to_command: tuple[_Complex, ...]
    to_disturbance: tuple[_Complex, ...]
    broken: tuple[_Complex, ...]


def crossover_radps(omega: NDArray[np.float64], broken: _Complex) -> float | None:
    """Highest of omega (m,), rad/s, at which an open loop (m,) falls through one; None: nowhere."""
    gain = np.abs(broken)
    falls = np.flatnonzero((gain[:-1] >= 1.0) & (gain[1:] < 1.0))
    if not falls.size:
        return None
    at = slice(int(falls[-1]), int(falls[-1]) + 2)
    return float(np.exp(np.interp(0.0, np.log(gain[at])[::-1], np.log(omega[at])[::-1])))


def to_command(loop: Loop, omega: NDArray[np.float64]) -> _Complex:
    """Attitude's response (m, 3, 3) to its commands, roll, pitch, yaw, at omega (m,), rad/s."""
    return _commanded(*_parts(loop, omega))


def to_disturbance(loop: Loop, omega: NDArray[np.float64]) -> _Complex:
    """The disturbed attitude's response (m, 3, 3) to disturbances of the measured attitude."""
    P, K, _ = _parts(loop, omega)
    return _disturbed(P, K)


def attitude_responses(loop: Loop) -> AttitudeResponses:
    """Of a stable loop that reads the six measured states."""
    omega = np.geomspace(_LOWEST_RADPS, min(top(loop.plant, 1e3), 1e3), _POINTS)
    # Each once: they are what takes long.
    P, K, K_r = _parts(loop, omega)
    inside = np.linalg.inv(np.eye(N_U) - K @ P)
    T, S = _commanded(P, K, K_r), _disturbed(P, K)
    return AttitudeResponses(
        omega,
        tuple(T[:, i, i] for i in range(N_U)),
        tuple(S[:, i, i] for i in range(N_U)),
        tuple(1.0 / inside[:, i, i] - 1.0 for i in range(N_U)),
    )


def _commanded(P: _Complex, K: _Complex, K_r: _Complex) -> _Complex:
    T = np.linalg.solve(np.eye(N_Y) - P @ K, P @ K_r)
    return T[:, _PLACES, :]


def _disturbed(P: _Complex, K: _Complex) -> _Complex:
    S = np.linalg.inv(np.eye(N_Y) - P @ K)
    return S[:, _PLACES, :][:, :, _PLACES]


def _parts(loop: Loop, omega: NDArray[np.float64]) -> tuple[_Complex, _Complex, _Complex]:
    """Plant u -> y, controller y -> u, controller commands -> u."""
    plant, law = loop.plant, response(loop.controller, omega)
    measured = plant.noutputs - len(COMMANDS) - N_Y
    P = response(plant, omega)[:, measured : measured + N_Y, -N_U:]
    return P, law[:, :, :N_Y], law[:, :, N_Y:]


# -------------------------------------------------------------------------------------------------
# The gain K of the reduced-order observer (19) and the prediction time, chosen by the loop as
#
# flown.
#
# A fast observer turns servo lag and transport delay into phase lag on the flapping mode near 27
# rad/s; a slow one leaves the estimate to the model. Both are told by the margins of the sampled
# loop, not by the speed of the observer's error.
# -------------------------------------------------------------------------------------------------

ROTOR_POLES = (3.0, 6.0, 10.0, 15.0, 20.0, 30.0, 40.0)
GYRO_POLES = (5.0, 10.0, 20.0)


@dataclass(frozen=True)
class Candidate:
    """One observer and its price.

    Attributes
    ----------
    poles : tuple of three floats
        Poles of the error of a_s, b_s, d_int, rad/s.
    K : (3, 6) array
    prediction_s : float
    disk_input, disk_output : float
        Disk margin of the loop as flown, all channels at once.
    further_delay_s : float
        Further delay that it survives, s.
    norm : float
        ||T_hw||_inf of the loop as flown.
    noise_gain : float
        RMS of the largest actuator command per RMS of white p, q, r noise (1/(rad/s)), loop open.
    """

    poles: tuple[float, float, float]
    K: Matrix
    prediction_s: float
    disk_input: float
    disk_output: float
    further_delay_s: float
    norm: float
    noise_gain: float

    @property
    def worst_disk(self) -> float:
        """The smaller of the two disk margins."""
        return min(self.disk_input, self.disk_output)


def diagonal_gain(A: ArrayLike, poles: Sequence[float]) -> Matrix:
    """K (3, 6) for which A' of eq. (19) is diag(poles), of least norm.

    Parameters
    ----------
    A : (9, 9) array
    poles : three floats
        Of the errors of a_s, b_s, d_int; rad/s, negative.
    """
    A = checked("A", A, (9, 9))
    return diagonal_observer_gain(A, tuple(poles), MEASURED, UNMEASURED)


def assess(
    model: Model,
    poles: tuple[float, float, float],
    prediction_s: float,
    feed: ObserverInput | None = None,
    actuation: Actuation | None = None,
) -> Candidate:
    """Margins, norm and noise of the loop as flown with the observer that has these poles."""
    K = diagonal_gain(model.A, poles)
    loop = flown_loop(model, K, prediction_s, feed, actuation)
    omega = np.unique(np.concatenate([np.geomspace(0.1, 300.0, 80), np.linspace(10.0, 60.0, 60)]))
    stable = loop.stability() < 0.0
    return Candidate(
        poles=poles,
        K=K,
        prediction_s=prediction_s,
        disk_input=disk_margin(loop, "input", omega).alpha,
        disk_output=disk_margin(loop, "output", omega).alpha,
        further_delay_s=further_delay_s(loop, model, actuation),
        norm=peak_gain(loop.wind_to_h)[0] if stable else np.inf,
        noise_gain=_noise_gain(sampled_controller(model, K, prediction_s, feed or ObserverInput())),
    )


def choose_observer_gain(
    model: Model,
    prediction_s: float | None = None,
    actuation: Actuation | None = None,
    feed: ObserverInput | None = None,
    wanted_disk: float = 0.5,
    wanted_delay_s: float = 0.02,
) -> tuple[Candidate, list[Candidate]]:
    """K by the margins of the loop as flown.

    Among a grid of pole sets: of those that reach `wanted_disk` at input and output and survive
    `wanted_delay_s`, and whose worse disk margin is not below 90 % of the best, the one that passes
    least noise; if none reaches them, the one with the largest disk margin.

    Parameters
    ----------
    model : Model
    prediction_s : float, optional
        Prediction time; default: the lag that is known (`Actuation.known_lag_s`).
    actuation, feed : optional
        Servo and delay; how u enters the observer.
    wanted_disk, wanted_delay_s : float
        Targets.

    Returns
    -------
    best : Candidate
    tried : list of Candidate
        The trade-off.
    """
    actuation = actuation or Actuation()
    prediction_s = actuation.known_lag_s if prediction_s is None else prediction_s
    tried = [
        assess(model, (-rotor, -rotor, -gyro), prediction_s, feed, actuation)
        for rotor in ROTOR_POLES
        for gyro in GYRO_POLES
    ]
    good = [c for c in tried if c.worst_disk >= wanted_disk and c.further_delay_s >= wanted_delay_s]
    if not good:
        return max(tried, key=lambda c: c.worst_disk), tried
    top = max(c.worst_disk for c in good)
    return min((c for c in good if c.worst_disk >= 0.9 * top), key=lambda c: c.noise_gain), tried


def _noise_gain(controller: control.StateSpace) -> float:
    """Largest actuator RMS per RMS of white noise on p, q, r; inf if the controller is unstable."""
    import control

    noisy = controller[list(INPUT_NAMES), ["p", "q", "r"]]
    if np.max(np.abs(noisy.poles())) >= 1.0:
        return np.inf
    spread = control.dlyap(noisy.A, noisy.B @ noisy.B.T)
    power = noisy.C @ spread @ noisy.C.T + noisy.D @ noisy.D.T
    return float(np.sqrt(np.max(np.diag(power))))


# -------------------------------------------------------------------------------------------------
# Gains of a PID from the linear model alone, by a rule: the most integral gain at a given
#
# robustness. What is packaged for the default aircraft is searched for (`attitude_search`).
#
# For each axis the loop as flown is taken (servo, transport delay, 100 Hz; angle for P and I, body
# rate for D). At a crossover w_c and a phase margin the complex equation L(w_c) = exp(j (margin -
# pi)) has one pair K_P, K_D, with K_I = K_P w_c times a share of 0.1 to 0.5 (at 0.2 the integrator
# costs 11 degrees at crossover). Over a grid of all three, the one with the most integral gain
# whose
# sensitivity peak max |S| stays below `PEAK` wins: the rule of Astrom, Panagopoulos, Hagglund
# (Automatica 34(5), 1998: load disturbance rejection at a given robustness).
# -------------------------------------------------------------------------------------------------

PEAK = 1.7
"""Largest |S| of each axis: a modulus margin of 0.59."""
AXES = ("roll", "pitch", "yaw")
_ANGLE = ("phi", "theta", "psi")
_RATE = ("p", "q", "r")
_INTEGRAL_SHARES = (0.1, 0.15, 0.2, 0.3, 0.4, 0.5)


@dataclass(frozen=True)
class AxisGains:
    """Gains of one axis: K_P 1/rad, K_I 1/(rad s), K_D s/rad; crossover rad/s, margin deg, max
    |S|."""

    axis: str
    K_P: float
    K_I: float
    K_D: float
    crossover_radps: float
    phase_margin_deg: float
    peak: float


def tune_pid(
    model: Model, actuation: Actuation | None = None, peak: float = PEAK
) -> tuple[AxisGains, AxisGains, AxisGains]:
    """Gains of roll, pitch, yaw by the module's rule.

    Parameters
    ----------
    model : Model
        Its F, G, C, D do not matter.
    actuation : Actuation, optional
    peak : float
        Bound on max |S| of each axis.

    Raises
    ------
    ValueError
        No pair on the grid reaches the bound; names the axis.
    """
    plant = sampled_plant(model, actuation or Actuation())
    roll, pitch, yaw = (_tune_axis(plant, axis, peak) for axis in range(N_U))
    return roll, pitch, yaw


def gains_of(axes: tuple[AxisGains, ...]) -> dict[str, np.ndarray]:
    """K_P, K_I, K_D (3,) by name, as the YAML holds them."""
    return {
        "K_P": np.array([a.K_P for a in axes]),
        "K_I": np.array([a.K_I for a in axes]),
        "K_D": np.array([a.K_D for a in axes]),
    }


def _tune_axis(plant: control.StateSpace, axis: int, peak: float) -> AxisGains:
    single = plant[[_ANGLE[axis], _RATE[axis]], [INPUT_NAMES[axis]]]
    grid = np.geomspace(0.05, 0.999 * np.pi / TICK_S, 1500)
    over_grid = response(single, grid)[:, :, 0]
    best: AxisGains | None = None
    for crossover in np.geomspace(0.3, 30.0, 140):
        at = response(single, np.array([crossover]))[0, :, 0]
        trials = product(np.arange(35.0, 86.0, 5.0), _INTEGRAL_SHARES)
        for margin, share in trials:
            gains = _pair(at, crossover, margin, share)
            if gains is None or (best is not None and abs(gains[1]) <= abs(best.K_I)):
                continue
            L = _open_loop(over_grid, grid, *gains)
            top = float(np.max(1.0 / np.abs(1.0 + L)))
            if top <= peak and _stable(single, *gains):
                best = AxisGains(AXES[axis], *gains, float(crossover), float(margin), top)
    if best is None:
        raise ValueError(f"no PID of the {AXES[axis]} axis keeps max |S| below {peak:g}")
    return best


def _pair(
    at: np.ndarray, crossover: float, margin_deg: float, share: float
) -> tuple[float, float, float] | None:
    """K_P, K_I, K_D for which L(crossover) has gain one and the phase margin; None for K_D against
    K_P."""
    step = TICK_S / (1.0 - cmath.exp(-1j * crossover * TICK_S))
    angle, rate = complex(at[0] * (1.0 + share * crossover * step)), complex(at[1])
    target = cmath.exp(1j * (math.radians(margin_deg) - math.pi))
    # Cramer's rule for K_P angle + K_D rate = target, real and imaginary part
    determinant = angle.real * rate.imag - angle.imag * rate.real
    if determinant == 0.0:
        return None
    K_P = (target.real * rate.imag - target.imag * rate.real) / determinant
    K_D = (angle.real * target.imag - angle.imag * target.real) / determinant
    if K_P * K_D < 0.0:
        return None
    return float(K_P), float(share * crossover * K_P), float(K_D)


def _open_loop(at: np.ndarray, omega: np.ndarray, K_P: float, K_I: float, K_D: float) -> np.ndarray:
    step = TICK_S / (1.0 - np.exp(-1j * omega * TICK_S))
    return at[:, 0] * (K_P + K_I * step) + at[:, 1] * K_D


def _stable(single: control.StateSpace, K_P: float, K_I: float, K_D: float) -> bool:
    """Whether the axis is stable with this PID, apart from modes that it does not reach."""
    row = (K_P + TICK_S * K_I) * single.C[0] + K_D * single.C[1]
    n = single.A.shape[0]
    A = np.zeros((n + 1, n + 1))
    A[:n, :n] = single.A - np.outer(single.B[:, 0], row)
    A[:n, n] = single.B[:, 0]
    A[n, :n] = -TICK_S * K_I * single.C[0]
    A[n, n] = 1.0
    return bool(np.max(np.abs(np.linalg.eigvals(A))) <= 1.0 + 1e-7)


# -------------------------------------------------------------------------------------------------
# What a design is worth: norms, singular values and margins of the three loops.
#
# The loops are python-control's systems (`loops`), and so is the analysis, but for what the
# library
# has not without slycot, a Fortran build: the norm with its frequency (`frequency`), disk margins
# of
# several channels at once (`disk_margin`), and the delay that the loop as flown survives
# (`margins`).
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class LoopReport:
    """Numbers of one loop.

    Attributes
    ----------
    name : str
    stability : float
        Largest real part of its modes, rad/s (sampled: of their logarithm over the tick).
    norm, norm_frequency : float
        ||T_hv||_inf from wind (m/s) to h, and where (rad/s).
    disk_input, disk_output : DiskMargin
        All channels at once.
    channels_input : list of ChannelMargin
        One at a time: d_lat d_lon d_ped.
    """

    name: str
    stability: float
    norm: float
    norm_frequency: float
    disk_input: DiskMargin
    disk_output: DiskMargin
    channels_input: list[ChannelMargin]


def model_of(config: AttitudeConfig) -> Model:
    """The model of a judged design, with its controller's gains."""
    gains = config.lqr if config.controller == "lqr" else config.synthesis
    plant = (config.A, config.B, config.E, config.C, config.D)
    return Model(*plant, gains.F, gains.G, config.offset_free_radps)


def three_loops(
    model: Model,
    K: ArrayLike,
    prediction_s: float = 0.0,
    feed: ObserverInput | None = None,
    actuation: Actuation | None = None,
) -> tuple[Loop, Loop, Loop]:
    """State feedback; with the reduced-order observer; as flown."""
    return (
        state_feedback_loop(model),
        observer_loop(model, K),
        flown_loop(model, K, prediction_s, feed, actuation),
    )


def loops_of(
    config: AttitudeConfig, K: ArrayLike, feed: ObserverInput, actuation: Actuation
) -> tuple[Loop, ...]:
    """Loops of a checked design: three of state feedback, the one as flown of any other."""
    model = model_of(config)
    if CONTROLLERS[config.controller] == STATE_FEEDBACK:
        return three_loops(model, K, config.prediction_s, feed, actuation)
    law = linear_law_of(config.params)
    if law is None:
        return ()
    turned = CONTROLLERS[config.controller] == OUTPUT_FEEDBACK
    return (replace(output_loop(model, law, actuation), turned=turned),)


def analyse(loop: Loop) -> LoopReport:
    """Norm and margins of a loop; an unstable one has norm inf and disk margins 0."""
    stability = loop.stability()
    norm, frequency = np.inf, 0.0
    if stability < 0.0:
        norm, frequency = peak_gain(loop.wind_to_h)
    return LoopReport(
        name=loop.name,
        stability=stability,
        norm=norm,
        norm_frequency=frequency,
        disk_input=disk_margin(loop, "input"),
        disk_output=disk_margin(loop, "output"),
        channels_input=channel_margins(loop),
    )


def singular_values(loop: Loop, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Singular values (m, 3) of T_hv and (m, 3) of T_uv at omega (m,), rad/s."""
    import control

    systems = loop.wind_to_h, loop.wind_to_u
    hv, uv = (control.singular_values_response(s, omega).magnitude[:, 0].T for s in systems)
    return hv, uv
