# SPDX-License-Identifier: Apache-2.0
"""The attitude loop as it flies as plants for `fixed_structure`: what comes in, what goes out.

Sampled at 100 Hz, exactly, with servos and transport delay; y is what every output feedback reads,
`controller_state.INPUTS`. Groups of inputs: wind (m/s), load (in an actuator's place), command
(roll and pitch, rad), and additions to u and to y, at which margins are broken; groups of outputs:
attitude errors (rad), u, and u and y with half of what is added, whose response is S - I/2.
`surroundings_plant` is moved by white noise through all that `LawBenchmark` knows; its H2 norm is
the root of that cost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np

from heli_core.central_controller import System
from heli_core.rows import ATTITUDE, MEASURED, NINE
from heli_core.ticks import TICK_S
from heli_inner_hinf.controller_state import INPUTS, N_V, ObserverInput, OutputLaw, output_law
from heli_inner_hinf.fixed_structure import (
    LawStructure,
    StructuredPlant,
    Vector,
    affine,
    output_feedback,
)
from heli_inner_hinf.loops import (
    Model,
    as_output_law,
    pid_as_output_law,
    sampled_controller,
)
from heli_inner_hinf.regular_form import N_H, N_U, N_X, Matrix
from heli_inner_hinf.tuning import CostScales, SampledAircraft, Surroundings, shaped_noise

_COMMANDS = [INPUTS.index(name) for name in ("phi_ref", "theta_ref")]
_RATES = [INPUTS.index(name) for name in ("p", "q", "r")]
_N_Y = len(MEASURED)
_UNWINDING_S = 0.2

INPUT_GROUPS: Mapping[str, int] = MappingProxyType(
    {"wind": N_U, "load": N_U, "command": len(_COMMANDS), "added_u": N_U, "added_y": _N_Y}
)
OUTPUT_GROUPS: Mapping[str, int] = MappingProxyType(
    {"attitude": N_U, "u": N_U, "half_u": N_U, "half_y": _N_Y}
)
SURROUNDINGS, COST = "surroundings", "cost"
"""The input and the output of `surroundings_plant`."""
DISK_MARGIN_AT: Mapping[str, tuple[str, str]] = MappingProxyType(
    {"input": ("added_u", "half_u"), "output": ("added_y", "half_y")}
)


def _places(groups: Mapping[str, int]) -> dict[str, slice]:
    ends = np.cumsum([0, *groups.values()])
    return {name: slice(int(ends[i]), int(ends[i + 1])) for i, name in enumerate(groups)}


def loop_plant(one: SampledAircraft, come: Sequence[str], go: Sequence[str]) -> StructuredPlant:
    """From groups of `INPUT_GROUPS` to groups of `OUTPUT_GROUPS`.

    Errors of attitude are to the command of roll and pitch; the heading is commanded nothing.
    """
    A, B = one.flown
    n = A.shape[0]
    w, z = _places(INPUT_GROUPS), _places(OUTPUT_GROUPS)
    n_w, n_z = sum(INPUT_GROUPS.values()), sum(OUTPUT_GROUPS.values())
    B1, D11, D12 = np.zeros((n, n_w)), np.zeros((n_z, n_w)), np.zeros((n_z, N_U))
    C1, C2, D21 = np.zeros((n_z, n)), np.zeros((N_V, n)), np.zeros((N_V, n_w))
    C2[:_N_Y] = np.eye(n)[list(MEASURED)]
    B1[:, w["wind"]], B1[:, w["load"]] = one.disturbed[:, :N_U], one.disturbed[:, N_U:]
    B1[:, w["added_u"]] = B
    D21[_COMMANDS, w["command"]] = np.eye(len(_COMMANDS))
    D21[:_N_Y, w["added_y"]] = np.eye(_N_Y)
    C1[z["attitude"]] = np.eye(n)[list(ATTITUDE)]
    D11[z["attitude"], w["command"]] = -np.eye(N_U, len(_COMMANDS))
    D12[z["u"]] = D12[z["half_u"]] = np.eye(N_U)
    D11[z["half_u"], w["added_u"]] = 0.5 * np.eye(N_U)
    C1[z["half_y"]] = C2[:_N_Y]
    D11[z["half_y"], w["added_y"]] = 0.5 * np.eye(_N_Y)
    columns = np.concatenate([np.arange(n_w)[w[name]] for name in come])
    rows = np.concatenate([np.arange(n_z)[z[name]] for name in go])
    return StructuredPlant(
        A, B1[:, columns], B, C1[rows], C2, D11[np.ix_(rows, columns)], D12[rows],
        D21[:, columns], TICK_S,
    )  # fmt: skip


def margin_plant(one: SampledAircraft, at: str) -> StructuredPlant:
    """Whose w -> z is S - I/2 with the loop broken at the plant's "input" or "output"."""
    come, go = DISK_MARGIN_AT[at]
    return loop_plant(one, [come], [go])


def surroundings_plant(
    one: SampledAircraft, wanted: CostScales, air: Surroundings
) -> StructuredPlant:
    """From white noise to attitude errors and steps of the commands, in units of what is wanted.

    States: the plant's, those of what moves it, u of the tick before.
    """
    A, B = one.flown
    n = A.shape[0]
    N, B_noise, acting, read = shaped_noise(air)
    here, moved, before = slice(0, n), slice(n, n + len(N)), slice(n + len(N), n + len(N) + N_U)
    size, driven = before.stop, B_noise.shape[1]
    rates, heading = slice(driven, driven + N_U), driven + N_U
    n_w = heading + 1
    a, b1, b2 = np.zeros((size, size)), np.zeros((size, n_w)), np.zeros((size, N_U))
    a[here, here], a[here, moved], a[moved, moved] = A, one.disturbed @ acting, N
    b1[moved, :driven] = B_noise
    b1[NINE.psi, heading] = air.heading_radps05 * np.sqrt(TICK_S)
    b2[here], b2[before] = B, np.eye(N_U)
    c2, d21 = np.zeros((N_V, size)), np.zeros((N_V, n_w))
    c2[:_N_Y, here], c2[:, moved] = np.eye(n)[list(MEASURED)], read
    d21[_RATES, rates] = air.rate_radps * np.eye(N_U)
    error, step = np.eye(size)[list(ATTITUDE)], np.zeros((N_U, size))
    error[: len(_COMMANDS)] -= c2[_COMMANDS]
    step[:, before] = -np.eye(N_U)
    c1 = np.vstack([error / np.asarray(wanted.angle_rad)[:, None], step / wanted.step])
    d12 = np.vstack([np.zeros((N_U, N_U)), np.eye(N_U) / wanted.step])
    return StructuredPlant(a, b1, b2, c1, c2, np.zeros((2 * N_U, n_w)), d12, d21, TICK_S)


# -------------------------------------------------------------------------------------------------
# Structures of attitude controllers.
# -------------------------------------------------------------------------------------------------


def _system(law: OutputLaw) -> System:
    return System(law.A, law.B, law.C, law.D)


def pid_structure() -> LawStructure:
    """K_P, K_I, K_D of roll, pitch, yaw, nine numbers: the packaged PID away from its limits."""
    return affine(lambda gains: _system(pid_as_output_law(*gains.reshape(3, N_U))), 3 * N_U)


@dataclass(frozen=True)
class StateFeedbackLaw:
    """F and G of eq. (17) behind the prediction and the observer (19), which stay as they are.

    Its numbers (27,) are F (3, 9) row by row. G follows from F by eq. (15), in which it is affine
    where A and B are the model's: attitude comes to rest at its command whatever F is.

    Attributes
    ----------
    model : SampledAircraft
        What prediction and observer know of the aircraft.
    K : (3, 6) array
    prediction_s : float
    feed : ObserverInput
    """

    model: SampledAircraft
    K: Matrix
    prediction_s: float
    feed: ObserverInput

    @cached_property
    def _at_rest(self) -> tuple[Matrix, Matrix]:
        """x (9, 3) and u (3, 3) at rest per command."""
        eye, A, B = np.eye(N_X)[list(ATTITUDE)], self.model.A, self.model.B
        rest = np.block([[A, B], [eye, np.zeros((N_U, N_U))]])
        of_r = np.linalg.solve(rest, np.vstack([np.zeros((N_X, N_U)), np.eye(N_U)]))
        return of_r[:N_X], of_r[N_X:]

    def gains(self, numbers: Vector) -> tuple[Matrix, Matrix]:
        """F (3, 9) and G (3, 3): u = F x + G r."""
        x_of_r, u_of_r = self._at_rest
        F = np.asarray(numbers, float).reshape(N_U, N_X)
        return F, u_of_r - F @ x_of_r

    @property
    def structure(self) -> LawStructure:
        """For `loop_plant` and `surroundings_plant`."""
        return affine(lambda numbers: _system(self._law(*self.gains(numbers))), N_U * N_X)

    @property
    def scale(self) -> Vector:
        """Sizes of the numbers: rates count a tenth of angles."""
        of_x = np.full(N_X, 0.3)
        of_x[[NINE.p, NINE.q, NINE.r]] = 0.03
        return np.tile(of_x, N_U)

    def flyable(self, numbers: Vector) -> OutputLaw:
        """As the kernel flies it: of what an actuator's limit cuts off the observer hears."""
        law = self._law(*self.gains(numbers))
        only_G = self._model(np.zeros((N_U, N_X)), np.eye(N_U))
        heard = sampled_controller(only_G, self.K, self.prediction_s, self.feed).B[:, _N_Y:]
        return output_law(law.A, law.B, law.C, law.D, heard)

    def _law(self, F: Matrix, G: Matrix) -> OutputLaw:
        return as_output_law(self._model(F, G), self.K, self.prediction_s, self.feed)

    def _model(self, F: Matrix, G: Matrix) -> Model:
        one, of_h = self.model, (np.zeros((N_H, N_X)), np.zeros((N_H, N_U)))
        return Model(one.A, one.B, one.E, *of_h, F, G)


def output_structure(order: int) -> LawStructure:
    """All matrices of a controller of that order that reads `INPUTS`, row by row."""
    return output_feedback(order, N_U, N_V)


def output_start(pid: Vector, order: int, damping_radps: float = 5.0) -> Vector:
    """Parameters of `output_structure` that are the PID of nine gains, and further states.

    The PID's integrators take the first three states, as far as there are so many; further states
    forget at `damping_radps` and are heard, but not listened to.
    """
    law = pid_as_output_law(*np.asarray(pid, float).reshape(3, N_U))
    kept = min(order, N_U)
    forgets = np.exp(-damping_radps * TICK_S)
    A = np.diag([1.0 - 1e-3] * kept + [forgets] * (order - kept))
    B, C = np.zeros((order, N_V)), np.zeros((N_U, order))
    B[:kept], C[:, :kept] = law.B[:kept], law.C[:, :kept]
    for i in range(kept, order):
        B[i, (i - kept) % _N_Y] = 1.0 - forgets
    return np.block([[A, B], [C, law.D]]).ravel()


def output_scale(order: int) -> Vector:
    """Sizes of the parameters of `output_structure`: rates count a tenth of angles, memory slow."""
    of_v = np.full(N_V, 0.3)
    of_v[_RATES] = 0.03
    A, C = np.full((order, order), 0.02), np.full((N_U, order), 0.3)
    B, D = np.tile(0.05 * of_v, (order, 1)), np.tile(of_v, (N_U, 1))
    return np.block([[A, B], [C, D]]).ravel()


def flyable(law: System) -> OutputLaw:
    """The controller as the kernel flies it; its memory rests where an actuator is cut off.

    L sends the part that is cut off back to the states along the least-squares inverse of C, so
    slowly that what the states ask for beyond the limits fades within `_UNWINDING_S`.
    """
    A, B, C, D = law
    L = np.linalg.pinv(C) * (TICK_S / _UNWINDING_S) if A.size else None
    return output_law(A, B, C, D, L=L)
