# SPDX-License-Identifier: Apache-2.0
"""How an attitude loop answers commands, disturbances of its attitude, and itself.

For analysis: whatever flies does not import this module, as python-control takes seconds to import.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heli_inner_hinf.frequency import response, top
from heli_inner_hinf.loops import COMMANDS, MEASURED_NAMES, N_U, N_Y, Loop
from heli_math.state_names import ATTITUDE, STATE_NAMES

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
