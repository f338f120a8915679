# SPDX-License-Identifier: Apache-2.0
"""Responses of the attitude loop by its linear model: the second way to what sweeps give."""

import numpy as np

from heli_flight.loop.settings import Settings
from heli_handling.boundaries import AXES
from heli_handling.response import FrequencyResponse
from heli_inner_hinf.actuation import ObserverInput
from heli_inner_hinf.analysis import loops_of
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.frequency import response
from heli_inner_hinf.loops import COMMANDS, MEASURED_NAMES, N_U, N_Y, N_Z
from heli_math.state_names import ATTITUDE, STATE_NAMES
from heli_math.ticks import TICK_S
from heli_parameters.parameters import ParameterError

_PLACES = tuple(MEASURED_NAMES.index(STATE_NAMES[i]) for i in ATTITUDE)
"""Of roll, pitch and yaw among what is measured."""


class LinearLoop:
    """The attitude loop as flown, about hover, with ideal navigation.

    Parameters
    ----------
    settings : Settings
        Laws and observer are those of the nodes.

    Raises
    ------
    ParameterError
        The law is not linear.
    """

    def __init__(self, settings: Settings) -> None:
        config = AttitudeConfig.from_parameters(settings.nodes["inner_loop"])
        observer = settings.nodes["observer"]
        K = np.reshape(observer["K"], (N_Z, N_Y))
        feed = ObserverInput.from_parameters(observer)
        loops = loops_of(config, K, feed, config.actuation)
        if not loops:
            raise ParameterError(f"controller {config.controller}: is not linear")
        self._loop = loops[-1]

    def _parts(self, omega: np.ndarray) -> tuple[np.ndarray, ...]:
        """Plant u -> y, controller y -> u, controller commands -> u."""
        plant, law = self._loop.plant, response(self._loop.controller, omega)
        measured = plant.noutputs - len(COMMANDS) - N_Y
        P = response(plant, omega)[:, measured : measured + N_Y, -N_U:]
        return P, law[:, :, :N_Y], law[:, :, N_Y:]

    def to_command(self, omega: np.ndarray, axis: str) -> FrequencyResponse:
        """Attitude's response to its command at omega (m,), rad/s, below Nyquist's."""
        P, K, K_r = self._parts(omega)
        T = np.linalg.solve(np.eye(N_Y) - P @ K, P @ K_r)
        k = AXES.index(axis)
        return FrequencyResponse(omega, T[:, _PLACES[k], k], np.ones(omega.size))

    def to_disturbance(self, omega: np.ndarray, axis: str) -> FrequencyResponse:
        """The disturbed attitude's response to a disturbance of the measured attitude."""
        P, K, _ = self._parts(omega)
        S = np.linalg.inv(np.eye(N_Y) - P @ K)
        k = _PLACES[AXES.index(axis)]
        return FrequencyResponse(omega, S[:, k, k], np.ones(omega.size))


def grid_radps(points: int = 2000) -> np.ndarray:
    """Frequencies (m,), rad/s, from far below an attitude loop's to Nyquist's."""
    return np.geomspace(0.05, 0.999 * np.pi / TICK_S, points)
