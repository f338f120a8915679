# SPDX-License-Identifier: Apache-2.0
"""What a design is worth: norms, singular values and margins of the three loops, and what each
weight does to them.

The loops themselves are built in `loops`, the margins in `margins`. Disk margins are those of
python-control's `disk_margins`; that function needs slycot (a Fortran build) for more than one
channel, so the structured singular value is computed here and python-control checks it in the
tests.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import (
    Actuation,
    Linear,
    Loop,
    Model,
    ObserverInput,
    flown_loop,
    observer_loop,
    state_feedback_loop,
)
from heli_inner_hinf.margins import (
    ChannelMargin,
    DiskMargin,
    channel_margins,
    disk_margin,
    further_delay_s,
)
from heli_inner_hinf.regular_form import Matrix
from heli_inner_hinf.synthesis import gamma_star, synthesize
from heli_inner_hinf.system_norm import peak_gain
from heli_inner_hinf.weights import N_H, output_selector, weights


@dataclass(frozen=True)
class LoopReport:
    """Numbers of one loop.

    Attributes
    ----------
    name : str
    stability : float
        Largest real part of its modes, rad/s (sampled: of their logarithm over the tick).
    norm, norm_frequency : float
        ||T_hv||_inf from wind (m/s) to h, and where (rad/s).
    disk_input, disk_output : DiskMargin
        All channels at once.
    channels_input, channels_output : list of ChannelMargin
        One at a time: d_lat d_lon d_ped; the fed-back outputs.
    """

    name: str
    stability: float
    norm: float
    norm_frequency: float
    disk_input: DiskMargin
    disk_output: DiskMargin
    channels_input: list[ChannelMargin]
    channels_output: list[ChannelMargin]


@dataclass(frozen=True)
class Sensitivity:
    """What a weight does: relative changes per relative change of the weight (logarithmic slopes).

    Attributes
    ----------
    weight : str
        C11[i,j], C22[i,j] or D11[i,j].
    gamma_star : float
    disk_input, disk_output, further_delay : float
        Of the loop as flown, at the same ratio gamma / gamma*.
    """

    weight: str
    gamma_star: float
    disk_input: float
    disk_output: float
    further_delay: float


def model_of(config: AttitudeConfig, F: Matrix | None = None) -> Model:
    """The model of a judged design; F (3, 9) replaces its own state feedback if given."""
    own = config.lqr if config.controller == "lqr" else config.synthesis
    plant = (config.A, config.B, config.E, config.C, config.D)
    return Model(*plant, own.F if F is None else F, own.G, config.offset_free_radps)


def three_loops(
    model: Model,
    K: ArrayLike,
    prediction_s: float = 0.0,
    feed: ObserverInput | None = None,
    actuation: Actuation | None = None,
) -> tuple[Loop, Loop, Loop]:
    """State feedback; with the reduced-order observer; as flown."""
    return (
        state_feedback_loop(model),
        observer_loop(model, K),
        flown_loop(model, K, prediction_s, feed, actuation),
    )


def analyse(loop: Loop) -> LoopReport:
    """Norm and margins of a loop; an unstable one has norm inf and disk margins 0."""
    stability = loop.stability()
    norm, frequency = np.inf, 0.0
    if stability < 0.0:
        norm, frequency = peak_gain(wind_to_h(loop))
    return LoopReport(
        name=loop.name,
        stability=stability,
        norm=norm,
        norm_frequency=frequency,
        disk_input=disk_margin(loop, "input"),
        disk_output=disk_margin(loop, "output"),
        channels_input=channel_margins(loop, "input"),
        channels_output=channel_margins(loop, "output"),
    )


def wind_to_h(loop: Loop) -> Linear:
    """T_hv: wind u v w (m/s) to h (9)."""
    closed = loop.closed()
    return Linear(closed.A, closed.B, closed.C[:N_H], closed.D[:N_H], closed.dt)


def wind_to_u(loop: Loop) -> Linear:
    """T_uv: wind u v w (m/s) to the actuator positions d_lat d_lon d_ped."""
    closed = loop.closed()
    return Linear(closed.A, closed.B, closed.C[N_H:], closed.D[N_H:], closed.dt)


def singular_values(loop: Loop, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Singular values (m, 3) of T_hv and (m, 3) of T_uv at omega (m,), rad/s."""
    hv = np.linalg.svd(wind_to_h(loop).response(omega), compute_uv=False)
    uv = np.linalg.svd(wind_to_u(loop).response(omega), compute_uv=False)
    return hv, uv


def weight_sensitivity(
    parameters: Mapping[str, ArrayLike],
    K: ArrayLike,
    step: float = 0.05,
    feed: ObserverInput | None = None,
    actuation: Actuation | None = None,
) -> list[Sensitivity]:
    """Logarithmic slopes of gamma* and of the margins as flown, for each weight that is not zero.

    Parameters
    ----------
    parameters : mapping
        The inner loop's parameters, dotted name to value.
    K : (3, 6) array
        Observer gain; stays as it is.
    step : float
        Relative change of the weight, up and down.
    feed, actuation : optional
        As in `flown_loop`.
    """
    config = AttitudeConfig.from_parameters(parameters)
    ratio = config.gamma / config.synthesis.gamma_star.value
    blocks = {
        name: np.reshape(np.asarray(parameters[name], float), shape)
        for name, shape in (("C11", (4, 4)), ("C22", (2, 5)), ("D11", (3, 3)))
    }

    def measured(name: str, index: tuple[int, int], factor: float) -> np.ndarray:
        changed = {key: value.copy() for key, value in blocks.items()}
        changed[name][index] *= factor
        C, D = weights(**changed)
        plant = (config.A, config.B, config.E, C, D)
        infimum = gamma_star(*plant).value
        F = synthesize(*plant, ratio * infimum, output_selector()).F
        model = Model(*plant, F)
        loop = flown_loop(model, K, config.prediction_s, feed, actuation)
        delay = further_delay_s(model, np.asarray(K), config.prediction_s, feed, actuation, 0.3)
        margins = (disk_margin(loop, "input").alpha, disk_margin(loop, "output").alpha)
        return np.log([infimum, *margins, delay])

    rows = []
    for name, block in blocks.items():
        for i, j in np.argwhere(block != 0.0):
            at = (int(i), int(j))
            up, down = measured(name, at, 1.0 + step), measured(name, at, 1.0 - step)
            slopes = (up - down) / (np.log1p(step) - np.log1p(-step))
            rows.append(Sensitivity(f"{name}[{i},{j}]", *(float(s) for s in slopes)))
    return rows
