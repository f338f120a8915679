# SPDX-License-Identifier: Apache-2.0
"""The attitude loop: state feedback, with observer (19), and, for every law, as it is flown.

Each is a generalised plant and a controller, python-control systems with named signals, deviations
from trim, SI and rad. The plant's inputs are the wind, the commanded attitude and the actuators;
its outputs are h of eq. (11), the actuators' positions, and what the controller reads: y and the
commanded attitude. As flown means: at tick n the estimate of tick n is read, the command u_n is
worked out at once and acts from n+1 to n+2 (transport delay), servos of second order on all three
inputs (that of d_ped drives the yaw gyro), everything discretised exactly.

For analysis: whatever flies does not import this module, as python-control takes seconds to import.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import control
import numpy as np
from numpy.typing import ArrayLike

from heli_inner_hinf.actuation import Actuation, ObserverInput, predicting_gains
from heli_inner_hinf.as_flown import flown_plant
from heli_inner_hinf.frequency import modes, response
from heli_inner_hinf.output_law import INPUTS, N_V, OutputLaw, output_law
from heli_inner_hinf.regular_form import Matrix
from heli_inner_hinf.weights import N_H, N_U, N_X, checked
from heli_math.linear_systems import (
    Observer,
    held,
    held_and_linear,
    reduced_order_observer,
    with_servos,
)
from heli_math.state_names import ATTITUDE, INPUT_NAMES, MEASURED, STATE_NAMES, UNMEASURED
from heli_math.state_space import WIND

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
        Whether in flight the law turns its errors by the bank beyond trim (`output_law`).
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
        """`WIND`, `COMMANDS` -> `H`, `POSITIONS`; states of the plant, then of the law."""
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


class Law(NamedTuple):
    """x+ = A x + B y + B_r r, u = C x + D y + D_r r."""

    A: Matrix
    B: Matrix
    B_r: Matrix
    C: Matrix
    D: Matrix
    D_r: Matrix


def observer_of(A: ArrayLike, B: ArrayLike, K: ArrayLike) -> Observer:
    """The reduced-order observer (19) of A (9, 9), B (9, 3) with the gain K (3, 6)."""
    A, B, K = checked("A", A, (9, 9)), checked("B", B, (9, 3)), checked("K", K, (3, 6))
    return reduced_order_observer(A, B, K, MEASURED, UNMEASURED)


def state_feedback_loop(model: Model) -> Loop:
    """u = F x + G r with every state measured."""
    plant = _continuous_plant(model, range(N_X))
    none = np.zeros((0, 0)), np.zeros((0, N_X)), np.zeros((0, N_U)), np.zeros((N_U, 0))
    law = Law(*none, model.F, model.G)
    return Loop("state feedback", plant, _controller(STATE_NAMES, law, 0.0))


def observer_loop(model: Model, K: ArrayLike) -> Loop:
    """Continuous loop with the reduced-order observer (19)."""
    gain = checked("K", K, (N_Z, N_Y))
    Az, By, Hu = observer_of(model.A, model.B, gain)
    Fm, Fu = model.F[:, MEASURED], model.F[:, UNMEASURED]
    D = Fm + Fu @ gain
    law = Law(Az + Hu @ Fu, By + Hu @ D, Hu @ model.G, Fu, D, model.G)
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

    F and G of the model do not matter. The law's state is taken at a fixed heading (x + turn
    psi_ref), so that a new psi_ref is an input like the others.
    """
    n_y, turn = len(MEASURED), law.turn[:, None]
    psi = INPUTS.index("psi_error")
    B_psi = turn - law.A @ turn - law.B[:, psi : psi + 1]
    D_psi = -law.C @ turn - law.D[:, psi : psi + 1]
    own = Law(
        law.A,
        law.B[:, :n_y],
        np.hstack([law.B[:, n_y:], B_psi]),
        law.C,
        law.D[:, :n_y],
        np.hstack([law.D[:, n_y:], D_psi]),
    )
    actuation = actuation or Actuation()
    plant = sampled_plant(model, actuation)
    return Loop("as flown", plant, _controller(MEASURED_NAMES, own, actuation.tick_s))


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
    """Observer (19) and law: u_n = F (Phi x_n + Gamma u_(n-1)), Phi, Gamma over `prediction_s`.

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
    law = Law(Ad, Bd, through_u @ model.G, Cu, Dk, model.G)
    if model.shift_rate > 0.0:
        law = _with_shift(law, model.shift_rate * feed.tick_s)
    return _controller(MEASURED_NAMES, law, feed.tick_s)


def as_output_law(model: Model, K: Matrix, prediction_s: float, feed: ObserverInput) -> OutputLaw:
    """`sampled_controller`, away from the limits, in heading errors.

    `turn`: psi and psi_ref move together, and u stays.
    """
    A, B, C, D = control.ssdata(sampled_controller(model, K, prediction_s, feed))
    both = [INPUTS.index("psi_error"), N_Y + COMMANDS.index("psi_ref")]
    held_u = np.vstack([np.eye(A.shape[0]) - A, C])
    turn = np.linalg.lstsq(held_u, np.concatenate([B[:, both].sum(1), -D[:, both].sum(1)]))[0]
    return output_law(A, B[:, :N_V], C, D[:, :N_V], turn=turn)


def _with_shift(law: Law, step: float) -> Law:
    """The law with its offset-free target: s(n+1) = s(n) + step (r - (phi theta psi)(n)).

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


def _controller(names: tuple[str, ...], law: Law, dt: float) -> control.StateSpace:
    return control.ss(
        law.A,
        np.hstack([law.B, law.B_r]),
        law.C,
        np.hstack([law.D, law.D_r]),
        dt,
        inputs=[*names, *COMMANDS],
        outputs=list(INPUT_NAMES),
    )
