# SPDX-License-Identifier: Apache-2.0
"""One cost and one floor for every attitude law with memory, and the search by them.

The cost of a law is a sum of variances, in units of what is wanted of each: errors of roll, pitch
and heading and the actuators' steps, in gusts, under moments that the law does not know, with the
navigation's errors, while commands are followed; the mean over the aircraft of a set. The floor:
disk and delay margins of the nominal aircraft, and a smaller disk margin of each of the others.
A family of laws is a function of positive numbers, so that all are searched alike.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_inner_hinf.actuation import Actuation
from heli_inner_hinf.as_flown import closed, feedback_of_law, flown_plant, sampled_response
from heli_inner_hinf.disk_margin import disk_margins
from heli_inner_hinf.errors import SynthesisError
from heli_inner_hinf.output_law import INPUTS, N_U, N_V, OutputLaw
from heli_inner_hinf.regular_form import Matrix
from heli_inner_hinf.weights import N_X
from heli_math.central_controller import NoControllerError
from heli_math.grid_search import BETTER, STRIDES, search
from heli_math.linear_systems import held, stationary, with_servos
from heli_math.rows import NINE
from heli_math.state_names import ATTITUDE, MEASURED
from heli_math.ticks import TICK_S

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
"""Price of a law that misses its floors, before what it misses them by."""
_NONE = 1e9
"""Price where the family has no law."""


class Surroundings(NamedTuple):
    """What moves the loop: standard deviations, and correlation times of what drifts.

    Attributes
    ----------
    gust_mps, gust_s : (3,) array, float
        Wind u, v, w in body axes, behind two lags of this time.
    load, load_s : float
        Moments that the law does not know, in the place of each actuator.
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


class Wanted(NamedTuple):
    """Units of the cost and the nominal aircraft's floors.

    Attributes
    ----------
    angle_rad : (3,) array
        Standard deviations of the errors of phi, theta, psi.
    step : float
        Of the steps of each actuator's command from tick to tick.
    disk_margin : float
        At the plant's input and at what the law reads.
    delay_ticks : int
        So many ticks of further delay the loop survives.
    """

    angle_rad: tuple[float, float, float] = (1e-3, 0.8e-3, 4e-3)
    step: float = 4e-3
    disk_margin: float = 0.65
    delay_ticks: int = 3


@dataclass(frozen=True)
class Aircraft:
    """One of the set.

    Attributes
    ----------
    name : str
    A, B, E : (9, 9), (9, 3), (9, 3) arrays
        Eq. (9), SI and rad.
    actuation : Actuation
    disk_margin : float
        Floor at the plant's input; the first of a set has those of `Wanted` instead.
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

    def later(self, ticks: int) -> "Aircraft":
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
        """Response (m, 6, 3) of the commands -> what a law reads, at `_OMEGA`."""
        return sampled_response(*self.flown, _OMEGA)[:, list(MEASURED)]


class Family(NamedTuple):
    """Laws of one kind.

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
    """No law of a family keeps the floors."""


@dataclass(frozen=True)
class Yardstick:
    """What every law is measured by.

    Attributes
    ----------
    nominal : Aircraft
    others : tuple of Aircraft
    wanted : Wanted
    air : Surroundings
    held_stable : tuple of Aircraft
        Further ones, which count neither by their cost nor by their margins.
    """

    nominal: Aircraft
    others: tuple[Aircraft, ...]
    wanted: Wanted = Wanted()
    air: Surroundings = Surroundings()
    held_stable: tuple[Aircraft, ...] = ()

    @cached_property
    def _later(self) -> tuple[Aircraft, ...]:
        return tuple(self.nominal.later(1 + i) for i in range(self.wanted.delay_ticks))

    def cost(self, law: OutputLaw) -> float:
        """Mean over all aircraft of the variances in units of what is wanted; stable loops only."""
        wanted = self.wanted
        found = [variances(law, one, self.air) for one in (self.nominal, *self.others)]
        in_units = [
            np.sum(v.angle / np.square(wanted.angle_rad)) + np.sum(v.step) / wanted.step**2
            for v in found
        ]
        return float(np.mean(in_units))

    def shortfall(self, law: OutputLaw) -> float:
        """By how much floors are missed, all together; 0: none is.

        Unstable loops count by their growth, rad/s, and are far worse than small margins.
        """
        own, further = feedback_of_law(law), (*self._later, *self.held_stable)
        growths = [_growth_radps(closed(*one.flown, own))
                   for one in (self.nominal, *self.others, *further)]  # fmt: skip
        if max(growths) > -_DECAY_RADPS:
            return sum(10.0 + growth for growth in growths if growth > -_DECAY_RADPS)
        K = own.C @ sampled_response(own.A, own.B, _OMEGA) + own.D
        P = self.nominal.response
        floor = self.wanted.disk_margin
        margins = [(floor, -K @ P), (floor, -P @ K)]
        margins += [(one.disk_margin, -K @ one.response) for one in self.others]
        return sum(
            max(0.0, floor - float(np.min(disk_margins(L, exact=False)))) for floor, L in margins
        )

    def price(self, law: OutputLaw) -> float:
        """The cost of a law that keeps its floors; of any other more, the more it misses them."""
        missed = self.shortfall(law)
        return _REFUSED * (1.0 + missed) if missed > 0.0 else self.cost(law)

    def best(
        self,
        family: Family,
        strides: Sequence[int] = STRIDES,
        pairs: bool = True,
        better: float = BETTER,
    ) -> tuple[float, ...]:
        """The family's numbers that no neighbour betters, from the best of its starts.

        Parameters
        ----------
        family : Family
        strides, pairs, better
            As of `search`.

        Raises
        ------
        NoLawError
            No start leads to a law that keeps the floors.
        """

        def price(numbers: Sequence[float]) -> float:
            try:
                return self.price(family.law(numbers))
            except (SynthesisError, NoControllerError, np.linalg.LinAlgError):
                return _NONE

        ends = [search(start, price, strides, pairs, better) for start in family.starts]
        found = min(ends, key=price)
        if price(found) >= _REFUSED:
            raise NoLawError(
                f"{family.name}: no law near those that the search begins with keeps the floors of "
                "disk and delay margin"
            )
        return found


def variances(law: OutputLaw, one: Aircraft, air: Surroundings) -> Variances:
    """Stationary variances of a stable loop, by one Lyapunov equation.

    States: the plant's, wind, load, the navigation's slow errors and commands, the law's.
    """
    plant, law_at = one.flown[0].shape[0], slice(-law.A.shape[0] or None, None)
    D, B_d, acting, read = _surrounding(air)
    size = plant + len(D) + law.A.shape[0]
    here, there = slice(0, plant), slice(plant, plant + len(D))
    # v of the law: what is measured, with slow errors, and the commands; white noise of the rates
    v = np.zeros((N_V, size))
    v[: len(MEASURED), here], v[:, there] = np.eye(plant)[list(MEASURED)], read
    noise = air.rate_radps * np.eye(N_V)[:, _RATES]
    u, direct = law.D @ v, law.D @ noise
    white = slice(B_d.shape[1], B_d.shape[1] + N_U)
    A, B = np.zeros((size, size)), np.zeros((size, white.stop + 1))
    A[here, here], A[here, there] = one.flown[0], one.disturbed @ acting
    A[there, there], B[there, : white.start] = D, B_d
    # a new heading command is a heading error, which the law's memory follows
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


def _surrounding(air: Surroundings) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """What moves the loop, driven by white noise of unit variance, one step a tick.

    Returns
    -------
    A, B : (17, 17), (17, 14) arrays
        States: gusts behind one lag, loads, kicks, errors of the angles, commands, gusts behind
        two lags.
    acting : (6, 17) array
        Of its states as wind and loads.
    read : (8, 17) array
        Of its states what a law reads besides the aircraft.
    """
    drifts = (
        (np.ones(N_U), air.gust_s),
        (np.full(N_U, air.load), air.load_s),
        (np.asarray(air.kick), air.kick_s),
        (np.asarray(air.angle_rad), air.angle_s),
        (np.full(len(_COMMANDS), air.command_rad), air.command_s),
    )
    sigma = np.concatenate([own for own, _ in drifts])
    keep = np.concatenate([np.full(len(own), np.exp(-TICK_S / time_s)) for own, time_s in drifts])
    gust, load, kick, angle, command, lagged = _places([*(len(own) for own, _ in drifts), N_U])
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
