# SPDX-License-Identifier: Apache-2.0
"""The norm wind -> h of the attitude loop as flown, between its samples as well.

The wind blows and h of eq. (11) is counted at every instant, the law acts a hundred times a second.
"""

from dataclasses import replace

import numpy as np

from heli_inner_hinf.actuation import Actuation, ObserverInput
from heli_inner_hinf.loops import (
    N_Y,
    Loop,
    Model,
    flown_loop,
    observer_loop,
    state_feedback_loop,
)
from heli_inner_hinf.regular_form import Matrix
from heli_inner_hinf.system_norm import hinf_norm
from heli_inner_hinf.weights import N_H, N_U, N_X
from heli_math.linear_systems import with_servos
from heli_math.state_names import MEASURED
from heli_math.ticks import TICK_S
from heli_robust.errors import RobustError
from heli_robust.lifting import HeldPlant, SampledLaw, SampledNorm, sampled_norm

_FAST_SERVO = Actuation(1000.0, 1.0, 0.0)
"""Servos that cost nothing, and no transport delay."""


def norm_between_samples(model: Model, actuation: Actuation, flown: Loop) -> SampledNorm:
    """The norm from wind u v w (m/s) to h (9), enclosed; the law is that of the loop as flown.

    Raises
    ------
    RobustError
        The loop is not stable.
    """
    A, B = with_servos(model.A, model.B, actuation.servo_radps, actuation.servo_damping)
    n, rates = A.shape[0], np.zeros((N_H, N_U))
    plant = HeldPlant(
        A=A,
        B=B,
        E=np.vstack([model.E, np.zeros((n - N_X, N_U))]),
        C=np.hstack([model.C, model.D, rates]),
        C_y=np.eye(n)[list(MEASURED)],
        tick_s=TICK_S,
        delay_s=actuation.delay_s,
    )
    law = flown.controller
    return sampled_norm(plant, SampledLaw(law.A, law.B[:, :N_Y], law.C, law.D[:, :N_Y]))


def norms_on_the_way(
    model: Model, K: Matrix, prediction_s: float, feed: ObserverInput, actuation: Actuation
) -> list[tuple[str, float]]:
    """Norm wind -> h from what is proved to what is flown, one cause more at each step.

    Of state feedback (hinf, lqr), observer included. Output feedback has no such way: it is made
    on the plant as flown, and its norm is `norm_between_samples`.

    Returns
    -------
    list of (cause, norm)
        inf where the loop is not stable.
    """
    found = []
    for name, loop in (
        ("state feedback", state_feedback_loop(model)),
        ("with the observer", observer_loop(model, K)),
    ):
        T = loop.wind_to_h
        stable = loop.stability() < 0.0
        found.append((name, hinf_norm(T.A, T.B, T.C)[0] if stable else np.inf))
    late = replace(actuation, delay_s=0.0)
    no_delay = replace(feed, u_delay_ticks=0)
    for name, prediction, told, lag in (
        ("at 100 Hz", 0.0, replace(no_delay, servo_radps=0.0), _FAST_SERVO),
        ("with servos", 0.0, no_delay, late),
        ("with transport delay", 0.0, feed, actuation),
        ("with prediction", prediction_s, feed, actuation),
    ):
        flown = flown_loop(model, K, prediction, told, lag)
        try:
            found.append((name, norm_between_samples(model, lag, flown).upper))
        except RobustError:
            found.append((name, np.inf))
    return found
