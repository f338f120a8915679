# SPDX-License-Identifier: Apache-2.0
"""The gain K of the reduced-order observer (19) and the prediction time, chosen by the loop as
flown.

A fast observer turns servo lag and transport delay into phase lag on the flapping mode near 27
rad/s; a slow one leaves the estimate to the model. Both are told by the margins of the sampled
loop, not by the speed of the observer's error.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import control
import numpy as np
from numpy.typing import ArrayLike

from heli_inner_hinf.actuation import Actuation, ObserverInput
from heli_inner_hinf.frequency import peak_gain
from heli_inner_hinf.loops import Model, flown_loop, sampled_controller
from heli_inner_hinf.margins import disk_margin, further_delay_s
from heli_inner_hinf.regular_form import Matrix
from heli_inner_hinf.weights import checked
from heli_math.linear_systems import diagonal_observer_gain
from heli_math.state_names import INPUT_NAMES, MEASURED, UNMEASURED

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
    noisy = controller[list(INPUT_NAMES), ["p", "q", "r"]]
    if np.max(np.abs(noisy.poles())) >= 1.0:
        return np.inf
    spread = control.dlyap(noisy.A, noisy.B @ noisy.B.T)
    power = noisy.C @ spread @ noisy.C.T + noisy.D @ noisy.D.T
    return float(np.sqrt(np.max(np.diag(power))))
