# SPDX-License-Identifier: Apache-2.0
"""Attitude and position loop together, as plants and a structure for `heli tune`.

The aircraft about its trim in the world's mean wind, behind servos and delay, one step a tick. The
position controller makes a step every few ticks; here it makes one every tick, and its command
comes half of its period later, which is what holding it delays it by, rounded up. y is what an
attitude controller reads (`INPUTS`, commands among it), then of each axis position, speed and the
acceleration that the tilt explains; u are the three actuators, then the commanded accelerations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from heli_core.central_controller import System
from heli_core.linear import held, with_servos
from heli_core.rows import INPUT_NAMES, MEASURED, NINE
from heli_core.ticks import TICK_S
from heli_dynamics_sim.trim import MovingModel, TrimPoint
from heli_flight.position_axes import position_axes
from heli_inner_hinf.attitude_goals import pid_structure
from heli_inner_hinf.controller_state import INPUTS, N_V, Actuation
from heli_inner_hinf.fixed_structure import (
    LawStructure,
    StructuredPlant,
    Vector,
    affine,
    side_by_side,
)
from heli_inner_hinf.loops import COMMANDS, Model, output_loop, pid_as_output_law
from heli_inner_hinf.regular_form import N_H, N_X, Matrix
from heli_inner_hinf.tuning import CostScales, Surroundings, shaped_noise
from heli_outer_pd.analysis import Axis, Gains, law
from heli_outer_pd.state import OuterParams
from heli_studies.design.position_search import (
    POSITION,
    SPEED,
    WANTED,
    CommandedAircraft,
    commanded_aircraft,
    gusts_along,
    moving_system,
)

_AXES, _N_U, _N_Y = 3, len(INPUT_NAMES), len(MEASURED)
_READ = 3
"""Of an axis: position, speed, what the tilt explains."""
_TURN_RATES = [INPUTS.index(name) for name in ("p", "q", "r")]
STEPS, PLACE = "steps", "position"
COSTS = (PLACE, STEPS)
"""Errors of position and speed; steps of the actuators' commands, in units of what is wanted."""
MARGINS_AT = ("input", "output", "command")


@dataclass(frozen=True)
class CascadeAircraft:
    """The plant's aircraft in a world, and the position controller's part of the loop.

    Attributes
    ----------
    name : str
    moving, at
        The aircraft about its trim in the mean wind.
    actuation : Actuation
    kernel : OuterParams
        Of the position controller: all that is not tuned.
    axes : tuple of Axis
        Forward, right, down: gusts, navigation's errors, what the controller's own model knows.
    """

    name: str
    moving: MovingModel
    at: TrimPoint
    actuation: Actuation
    kernel: OuterParams
    axes: tuple[Axis, ...]

    def later(self, ticks: int) -> CascadeAircraft:
        """The same with further delay."""
        delay_s = self.actuation.delay_s + ticks * TICK_S
        return replace(self, actuation=replace(self.actuation, delay_s=delay_s))

    @cached_property
    def flown(self) -> CommandedAircraft:
        """Aircraft, servos and delay."""
        return commanded_aircraft(self.moving, self.at, self.actuation, self.kernel)

    @property
    def _late_ticks(self) -> int:
        return max(self.axes[0].period_ticks // 2, 1)

    @cached_property
    def loop(self) -> tuple[Matrix, Matrix, Matrix]:
        """A, B, C of u -> y: the aircraft, then the commanded accelerations on their way."""
        one, n, line = self.flown, len(self.flown.A), _AXES * self._late_ticks
        size, first, last = n + line, slice(n, n + _AXES), slice(n + line - _AXES, n + line)
        A, B = np.zeros((size, size)), np.zeros((size, _N_U + _AXES))
        A[:n, :n], B[:n, :_N_U], B[first, _N_U:] = one.A, one.B[:, :_N_U], np.eye(_AXES)
        A[n + _AXES :, n : n + line - _AXES] = np.eye(line - _AXES)
        comes = np.zeros((_AXES, size))
        comes[:, last], comes[:, NINE.psi] = np.eye(_AXES), one.turned
        collective = one.collective @ comes
        collective[:n] += one.compensated
        A[:n] += np.outer(one.B[:, _N_U], collective)
        C = np.zeros((N_V + _AXES * _READ, size))
        C[:_N_Y] = np.eye(size)[list(MEASURED)]
        for name in INPUTS[_N_Y:]:
            C[INPUTS.index(name)] = one.commands[COMMANDS.index(name)] @ comes
        for axis in range(_AXES):
            rows = C[N_V + _READ * axis : N_V + _READ * (axis + 1)]
            rows[0, POSITION.start + axis] = rows[1, SPEED.start + axis] = 1.0
            rows[2, :n] = one.explained[axis]
        return A, B, C

    def margin_plant(self, where: str) -> StructuredPlant:
        """Whose w -> z is S - I/2 with the loop broken at one of `MARGINS_AT`."""
        A, B, C = self.loop
        if where == "output":
            D21 = np.eye(len(C), _N_Y)
            return StructuredPlant(
                A, np.zeros((len(A), _N_Y)), B, C[:_N_Y], C, 0.5 * np.eye(_N_Y),
                np.zeros((_N_Y, B.shape[1])), D21, TICK_S,
            )  # fmt: skip
        columns = slice(0, _N_U) if where == "input" else slice(_N_U, None)
        half, broken = 0.5 * np.eye(_AXES), np.eye(B.shape[1])[columns]
        return StructuredPlant(
            A, B[:, columns], B, np.zeros((_AXES, len(A))), C, half, broken,
            np.zeros((len(C), _AXES)), TICK_S,
        )  # fmt: skip

    def surroundings_plant(self, cost: str) -> StructuredPlant:
        """From white noise to one of `COSTS`, in units of what is wanted.

        Gusts about the body, loads and the navigation's errors of attitude are those of the
        attitude loop's cost, turbulence along the axes and errors of position those of
        `position_axes`. States: `loop`, those of what moves it, the actuators' commands before.
        """
        A, B, C = self.loop
        air = Surroundings(command_rad=0.0)
        N, N_in, acting, read = shaped_noise(air)
        filters = [gust for axis in self.axes for gust in axis.gusts]
        errors = [e for axis in self.axes for e in (axis.position_error, axis.speed_error)]
        noise = [N, *(one.A for one in (*filters, *errors))]
        driven = [N_in, *(one.B for one in (*filters, *errors))]
        ends = np.cumsum([len(A), *(len(one) for one in noise), _N_U])
        blocks = [slice(ends[i], ends[i + 1]) for i in range(len(ends) - 1)]
        size, before = int(ends[-1]), blocks[-1]
        rates = sum(one.shape[1] for one in driven)
        heading, n_w = rates + _N_U, rates + _N_U + 1
        a, b1 = np.zeros((size, size)), np.zeros((size, n_w))
        moved = slice(len(A), before.start)
        a[: len(A), : len(A)], a[moved, moved] = A, block_diag(*noise)
        b1[moved, :rates] = block_diag(*driven)
        b1[NINE.psi, heading] = air.heading_radps05 * np.sqrt(TICK_S)
        disturbed, along = self._disturbed
        a[: len(A), blocks[0]] = disturbed @ acting
        axis_of = [i for i, axis in enumerate(self.axes) for _ in axis.gusts]
        for i, one, block in zip(axis_of, filters, blocks[1 : 1 + len(filters)], strict=True):
            a[: len(A), block] = np.outer(along[:, i], one.C)
        c2, d21 = np.zeros((len(C), size)), np.zeros((len(C), n_w))
        c2[:, : len(A)], c2[:N_V, blocks[0]] = C, read
        for i, (one, block) in enumerate(zip(errors, blocks[1 + len(filters) : -1], strict=True)):
            c2[N_V + _READ * (i // 2) + i % 2, block] = one.C[0]
        d21[_TURN_RATES, rates:heading] = air.rate_radps * np.eye(_N_U)
        b2 = np.vstack([B, np.zeros((size - len(A), B.shape[1]))])
        b2[before, :_N_U] = np.eye(_N_U)
        if cost == STEPS:
            step_now = np.eye(_N_U, B.shape[1])
            c1, d12 = -np.eye(size)[before] / CostScales().step, step_now / CostScales().step
        else:
            eye, of = np.eye(size), [(one.position_m, one.speed_mps) for one in WANTED]
            position_m, speed_mps = np.array(of).T
            c1 = np.vstack([eye[POSITION] / position_m[:, None], eye[SPEED] / speed_mps[:, None]])
            d12 = np.zeros((2 * _AXES, B.shape[1]))
        return StructuredPlant(a, b1, b2, c1, c2, np.zeros((len(c1), n_w)), d12, d21, TICK_S)

    @property
    def _disturbed(self) -> tuple[Matrix, Matrix]:
        """Held effects on `loop`: (n, 6) of wind in body axes and loads, (n, 3) along the axes."""
        A, B, E = moving_system(self.moving, self.at)
        servo = self.actuation.servo_radps, self.actuation.servo_damping
        behind, _ = with_servos(A, B, *servo)
        acting = np.zeros((len(behind), 3 * _AXES))
        # an axis' air is the body's own speed the other way round
        acting[: len(A)] = np.hstack([E, B[:, :_N_U], -A[:, SPEED]])
        acting[POSITION, 2 * _AXES :] = 0.0
        effect = np.zeros((len(self.loop[0]), 3 * _AXES))
        effect[: len(behind)] = held(behind, acting, TICK_S)[1]
        return effect[:, : 2 * _AXES], effect[:, 2 * _AXES :]

    @property
    def structure(self) -> LawStructure:
        """The PID's nine gains, then K_P and K_D of the position controller's three axes."""

        def position(numbers: Vector) -> System:
            K_P, K_D = np.split(numbers, 2)
            of_axis = [
                law(replace(Gains.of(self.kernel, i), K_P=K_P[i], K_D=K_D[i]), axis)
                for i, axis in enumerate(self.axes_each_tick)
            ]
            return System(*(block_diag(*(one[part] for one in of_axis)) for part in range(4)))

        return side_by_side(pid_structure(), affine(position, 2 * _AXES))

    @property
    def axes_each_tick(self) -> tuple[Axis, ...]:
        """The axes with a step of the controller every tick."""
        return tuple(replace(axis, period_ticks=1) for axis in self.axes)


def cascade_aircraft(
    name: str,
    plant: Mapping[str, Any],
    outer: Mapping[str, Any],
    attitude: tuple[Matrix, Matrix, Matrix],
    gains: Vector,
    actuation: Actuation,
) -> CascadeAircraft:
    """The aircraft of the plant's parameters, with the position controller of the outer loop's.

    Parameters
    ----------
    name : str
    plant, outer : mapping
        Parameters of the nodes.
    attitude : (9, 9), (9, 3), (9, 3) arrays
        A, B, E that the attitude controller is made for.
    gains : (9,) array
        Of the PID that the position loop is looked at around.
    actuation : Actuation

    Raises
    ------
    PlantConfigError, TrimError
    """
    nothing = np.zeros((N_H, N_X)), np.zeros((N_H, _N_U))
    model = Model(*attitude, *nothing, np.zeros((_N_U, N_X)), np.zeros((_N_U, _N_U)))
    loop = output_loop(model, pid_as_output_law(*gains.reshape(3, _N_U)), actuation)
    around = position_axes(plant, outer, loop, model)
    lags_s = (*around.params.attitude_lag, around.params.collective_lag_s)
    axes = tuple(
        replace(axis, modelled_lag_s=float(lag_s))
        for axis, lag_s in zip(
            around.axes(actuation, gusts_along(around.config)), lags_s, strict=True
        )
    )
    return CascadeAircraft(name, around.moving, around.at, actuation, around.params, axes)
