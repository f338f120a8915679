# SPDX-License-Identifier: Apache-2.0
"""The whole loop as it flies, linear: attitude, collective and position of all axes at once.

The three axes of the position loop are designed one by one; here they meet through the aircraft:
the attitude loop's cross-coupling, the yaw that a collective makes, the speed that the rotors meet.
"""

from dataclasses import dataclass
from functools import cached_property

import control
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from heli_dynamics_sim.linearize import MovingModel, reduced_state
from heli_dynamics_sim.trim import Trim
from heli_inner_hinf.actuation import Actuation
from heli_inner_hinf.as_flown import flown_plant
from heli_inner_hinf.disk_margin import DiskMargin, smallest
from heli_inner_hinf.loops import COMMANDS, Loop
from heli_math.rotations import quat_to_R_nb
from heli_math.rows import NINE, PLANT, SETPOINT
from heli_math.state_names import INPUT_NAMES, MEASURED
from heli_outer_pd.axis_analysis import Axis, Gains, Matrix, law
from heli_outer_pd.position_law import OuterKernel, tilt_for
from heli_outer_pd.thrust_map import collective_for_thrust

_AXES, _N, _N_U = 3, len(NINE), len(INPUT_NAMES)
_SPEED, _POSITION = slice(_N, _N + _AXES), slice(_N + _AXES, _N + 2 * _AXES)
_LOWEST_RADPS, _FREQUENCIES = 1e-2, 400


@dataclass(frozen=True)
class CoupledPlant:
    """x+ = A x + B a over the position law's period, M x = position and speed of each axis in turn.

    a (3,) are the commanded accelerations forward, right, down, m/s2; positions m, speeds m/s.
    """

    A: Matrix
    B: Matrix
    M: Matrix
    dt_s: float

    @cached_property
    def response(self) -> tuple[Matrix, NDArray[np.complex128]]:
        """Frequencies (m,), rad/s, and the response (m, 6, 3) of a -> what is held."""
        omega = np.geomspace(_LOWEST_RADPS, 0.999 * np.pi / self.dt_s, _FREQUENCIES)
        z = np.exp(1j * omega * self.dt_s)
        return omega, np.stack([self.M @ _resolved(self.A, self.B, at) for at in z])


def coupled_plant(
    moving: MovingModel,
    at: Trim,
    attitude: Loop,
    actuation: Actuation,
    kernel: OuterKernel,
    period_ticks: int,
) -> CoupledPlant:
    """Aircraft in its mean wind, servos, delay and attitude law, from commands to what is held.

    Parameters
    ----------
    moving, at
        The aircraft about its trim.
    attitude : Loop
        As flown; of it the controller is used, with its errors turned by the trim's bank if it
        turns them.
    actuation : Actuation
        Of the collective, too.
    kernel : OuterKernel
        Its thrust map turns an acceleration down into a collective.
    period_ticks : int
    """
    n = _N + 2 * _AXES
    A, B = np.zeros((n, n)), np.zeros((n, moving.B.shape[1]))
    A[: _SPEED.stop, :_N], B[: _SPEED.stop] = moving.A, moving.B
    A[: _SPEED.stop, _SPEED] = -moving.E @ quat_to_R_nb(at.x[PLANT.quat]).T
    A[_POSITION, _SPEED] = np.eye(_AXES)
    Ad, Bd = flown_plant(A, B, actuation)
    nine = reduced_state(at.x)
    tilt = nine[[NINE.phi, NINE.theta]]
    hang = kernel.trim[[SETPOINT.phi, SETPOINT.theta]]
    law_, y = attitude.controller, np.eye(len(Ad))[list(MEASURED)]
    if attitude.turned:
        law_ = _turned(law_, float(tilt[0] - hang[0]))
    to_law, from_law = np.split(law_.B, [len(MEASURED)], axis=1), Bd[:, :_N_U]
    direct = np.split(law_.D, [len(MEASURED)], axis=1)
    commands = np.zeros((len(COMMANDS), _AXES))
    against = kernel.g * np.tan((tilt - hang) * [1.0, -1.0])[::-1]
    per_mps2 = _tilt_per_mps2(against, kernel)
    commands[COMMANDS.index("theta_ref"), 0] = -per_mps2[0]
    commands[COMMANDS.index("phi_ref"), 1] = per_mps2[1]
    per_weight = _collective_per_weight(kernel)
    lift = np.cos(tilt[0]) * np.cos(tilt[1])
    collective = np.outer(Bd[:, _N_U], [0.0, 0.0, -per_weight / (kernel.g * lift)])
    one = np.block(
        [[Ad + from_law @ direct[0] @ y, from_law @ law_.C], [to_law[0] @ y, law_.A]],
    )
    enters = np.vstack([from_law @ direct[1] @ commands + collective, to_law[1] @ commands])
    enters = np.hstack([enters, np.vstack([Bd[:, _N_U:], np.zeros((len(law_.A), 1))])])
    power, held = np.eye(len(one)), np.zeros_like(enters)
    for _ in range(period_ticks):
        held, power = one @ held + enters, one @ power
    held, held_collective = held[:, :_AXES], held[:, _AXES]
    eye = np.eye(len(one))
    compensated = per_weight / lift * (np.tan(tilt) @ eye[[NINE.phi, NINE.theta]])
    power += np.outer(held_collective, compensated)
    M = np.concatenate([eye[[_POSITION.start + i, _SPEED.start + i]] for i in range(_AXES)])
    # What is held against the wind turns as the nose does.
    power += held @ np.outer([against[1], -against[0], 0.0], eye[NINE.psi])
    return CoupledPlant(power, held, M, period_ticks * attitude.dt)


def common_disk_margin(
    plant: CoupledPlant, axes: tuple[Axis, ...], gains: tuple[Gains, ...]
) -> DiskMargin:
    """Of the loop broken at all three commands at once; 0 if it is not stable."""
    laws = [law(own, axis) for own, axis in zip(gains, axes, strict=True)]
    A, B, C, D = (block_diag(*(one[part] for one in laws)) for part in range(4))
    closed = np.block([[plant.A + plant.B @ D @ plant.M, plant.B @ C], [B @ plant.M, A]])
    if np.max(np.abs(np.linalg.eigvals(closed))) >= 1.0:
        return DiskMargin(0.0, 0.0)
    omega, moved = plant.response
    commanded = np.stack([C @ _resolved(A, B, at) + D for at in np.exp(1j * omega * plant.dt_s)])
    return smallest(-commanded @ moved, omega)


def _turned(law_: control.StateSpace, bank_rad: float) -> control.StateSpace:
    """The law behind `output_law.read_inputs` at a lasting bank beyond trim."""
    pitch, heading = (MEASURED.index(i) for i in (NINE.theta, NINE.psi))
    wanted = len(MEASURED) + COMMANDS.index("theta_ref")
    turn = np.eye(law_.ninputs)
    c, s = np.cos(bank_rad), np.sin(bank_rad)
    turn[np.ix_([pitch, heading], [pitch, heading, wanted])] = [[c, s, 1.0 - c], [-s, c, s]]
    return control.ss(law_.A, law_.B @ turn, law_.C, law_.D @ turn, law_.dt)


def _resolved(A: Matrix, B: Matrix, z: complex) -> np.ndarray:
    return np.linalg.solve(z * np.eye(len(A)) - A, B)


def _tilt_per_mps2(acceleration: Matrix, kernel: OuterKernel) -> Matrix:
    """Slope of (21), rad s2/m, about the accelerations (2,) that are held, m/s2."""
    step = 1e-4
    return np.array(
        [
            (tilt_for(a + step, kernel) - tilt_for(a - step, kernel)) / (2.0 * step)
            for a in acceleration
        ]
    )


def _collective_per_weight(kernel: OuterKernel) -> float:
    """What the law's thrust map makes of a thrust, in units of the weight, at trim."""
    k, step = kernel, 1e-4
    weight, tilt = k.mass * k.g, np.cos(k.trim[SETPOINT.phi]) * np.cos(k.trim[SETPOINT.theta])
    d_col = k.trim[SETPOINT.col]
    more, less = (
        collective_for_thrust(
            weight / tilt + sign * step * weight, 0.0, weight / tilt, d_col, k.rotor
        )
        for sign in (1.0, -1.0)
    )
    return float((more - less) / (2.0 * step))
