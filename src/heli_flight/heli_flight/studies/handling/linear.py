# SPDX-License-Identifier: Apache-2.0
"""Responses of the attitude loop by its linear model: the second way to what sweeps give."""

import numpy as np

from heli_flight.loop.settings import Settings
from heli_handling.boundaries import AXES
from heli_handling.response import FrequencyResponse
from heli_inner_hinf.actuation import ObserverInput
from heli_inner_hinf.analysis import loops_of
from heli_inner_hinf.attitude_responses import to_command, to_disturbance
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import N_Y, N_Z
from heli_math.ticks import TICK_S
from heli_parameters.parameters import ParameterError


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

    def to_command(self, omega: np.ndarray, axis: str) -> FrequencyResponse:
        """Attitude's response to its command at omega (m,), rad/s, below Nyquist's."""
        k = AXES.index(axis)
        found = to_command(self._loop, omega)[:, k, k]
        return FrequencyResponse(omega, found, np.ones(omega.size))

    def to_disturbance(self, omega: np.ndarray, axis: str) -> FrequencyResponse:
        """The disturbed attitude's response to a disturbance of the measured attitude."""
        k = AXES.index(axis)
        found = to_disturbance(self._loop, omega)[:, k, k]
        return FrequencyResponse(omega, found, np.ones(omega.size))


def grid_radps(points: int = 2000) -> np.ndarray:
    """Frequencies (m,), rad/s, from far below an attitude loop's to Nyquist's."""
    return np.geomspace(0.05, 0.999 * np.pi / TICK_S, points)
