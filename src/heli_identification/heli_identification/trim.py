# SPDX-License-Identifier: Apache-2.0
"""Trim of hover from the mean of a flight, and the collective's gain."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from heli_identification.actuators import IdentifiedAB
from heli_identification.experiment import Array, Experiment
from heli_identification.places import ROTOR
from heli_math.rows import ACTUATOR, NINE

_ATTITUDE = slice(NINE.phi, NINE.p)  # roll and pitch
_CYCLIC = slice(ACTUATOR.lat, ACTUATOR.ped)
_FLAPPING = slice(NINE.a_s, NINE.r)


@dataclass(frozen=True)
class IdentifiedTrim:
    """Trim of eq. (10).

    Attributes
    ----------
    x : (9,) array
        phi theta p q a_s b_s r d_int psi, rad and rad/s. psi is 0 by choice; so is d_int, as an
        integrator's zero is a convention that observer and law share.
    u : (4,) array
        d_lat, d_lon, d_ped, d_col.
    x_sigma, u_sigma : arrays of the same shapes
        Scatter of the means over periods, over the square root of their number, with the price of
        their correlation: wind that lasts longer than a period does not average out.
    """

    x: Array
    u: Array
    x_sigma: Array
    u_sigma: Array


def trim_of(experiments: Experiment | Sequence[Experiment], model: IdentifiedAB) -> IdentifiedTrim:
    """Trim from the evaluated periods of one or more hovering flights.

    Attitude and actuators are means over whole periods, so the excitation drops out. The flapping
    angles follow from the rotor's own equilibrium: 0 = M [a_s b_s] + N [d_lat d_lon], as the disc
    is level when the cyclic is zero. Steady wind during the flights is in the result.

    Raises
    ------
    IdentificationError
        As `Experiment.steady`.
    """
    flights = [experiments] if isinstance(experiments, Experiment) else list(experiments)
    attitude: list[Array] = []
    command: list[Array] = []
    for flight in flights:
        steady = flight.steady()
        shape = (steady.periods, steady.period_ticks, -1)
        attitude.append(steady.attitude_rad[:, _ATTITUDE].reshape(shape).mean(axis=1))
        command.append(steady.u.reshape(shape).mean(axis=1))
    angles, u = np.vstack(attitude), np.vstack(command)
    x, x_sigma = np.zeros(len(NINE)), np.zeros(len(NINE))
    x[_ATTITUDE] = angles.mean(axis=0)
    x_sigma[_ATTITUDE] = _sigma_of_mean(attitude)
    gain = -np.linalg.solve(model.fast.A[ROTOR, ROTOR], model.fast.B[ROTOR, _CYCLIC])
    u_mean, u_sigma = u.mean(axis=0), _sigma_of_mean(command)
    x[_FLAPPING] = gain @ u_mean[_CYCLIC]
    x_sigma[_FLAPPING] = np.sqrt(gain**2 @ u_sigma[_CYCLIC] ** 2)
    return IdentifiedTrim(x, u_mean, x_sigma, u_sigma)


def _sigma_of_mean(flights: list[Array]) -> Array:
    """Standard deviation of the mean of period means (n, c) per flight.

    Within a flight a first-order autoregression, its coefficient a from neighbouring periods, makes
    n periods worth n (1 - a) / (1 + a) independent ones, at least one.
    """
    everything = np.vstack(flights)
    centred = [flight - everything.mean(axis=0) for flight in flights]
    power = sum(np.sum(x**2, axis=0) for x in centred)
    product = sum(np.sum(x[1:] * x[:-1], axis=0) for x in centred)
    a = np.clip(product / np.maximum(power, 1e-300), 0.0, 0.95)
    independent = np.maximum(everything.shape[0] * (1.0 - a) / (1.0 + a), 1.0)
    return np.asarray(everything.std(axis=0, ddof=1) / np.sqrt(independent))
