# SPDX-License-Identifier: Apache-2.0
"""What a design is worth: norms, singular values and margins of the three loops.

The loops are python-control's systems (`loops`), and so is the analysis, but for what the library
has not without slycot, a Fortran build: the norm with its frequency (`frequency`), disk margins of
several channels at once (`disk_margin`), and the delay that the loop as flown survives (`margins`).
"""

from dataclasses import dataclass, replace

import control
import numpy as np
from numpy.typing import ArrayLike

from heli_inner_hinf.actuation import Actuation, ObserverInput
from heli_inner_hinf.as_flown import linear_law_of
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.disk_margin import DiskMargin
from heli_inner_hinf.frequency import peak_gain
from heli_inner_hinf.law_state import CONTROLLERS, OUTPUT_FEEDBACK, STATE_FEEDBACK
from heli_inner_hinf.loops import (
    Loop,
    Model,
    flown_loop,
    observer_loop,
    output_loop,
    state_feedback_loop,
)
from heli_inner_hinf.margins import ChannelMargin, channel_margins, disk_margin


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
    channels_input : list of ChannelMargin
        One at a time: d_lat d_lon d_ped.
    """

    name: str
    stability: float
    norm: float
    norm_frequency: float
    disk_input: DiskMargin
    disk_output: DiskMargin
    channels_input: list[ChannelMargin]


def model_of(config: AttitudeConfig) -> Model:
    """The model of a judged design, with its law's gains."""
    own = config.lqr if config.controller == "lqr" else config.synthesis
    plant = (config.A, config.B, config.E, config.C, config.D)
    return Model(*plant, own.F, own.G, config.offset_free_radps)


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


def loops_of(
    config: AttitudeConfig, K: ArrayLike, feed: ObserverInput, actuation: Actuation
) -> tuple[Loop, ...]:
    """The loops of a judged design: three of state feedback, that as flown of any other law."""
    model = model_of(config)
    if CONTROLLERS[config.controller] == STATE_FEEDBACK:
        return three_loops(model, K, config.prediction_s, feed, actuation)
    law = linear_law_of(config.kernel)
    if law is None:
        return ()
    turned = CONTROLLERS[config.controller] == OUTPUT_FEEDBACK
    return (replace(output_loop(model, law, actuation), turned=turned),)


def analyse(loop: Loop) -> LoopReport:
    """Norm and margins of a loop; an unstable one has norm inf and disk margins 0."""
    stability = loop.stability()
    norm, frequency = np.inf, 0.0
    if stability < 0.0:
        norm, frequency = peak_gain(loop.wind_to_h)
    return LoopReport(
        name=loop.name,
        stability=stability,
        norm=norm,
        norm_frequency=frequency,
        disk_input=disk_margin(loop, "input"),
        disk_output=disk_margin(loop, "output"),
        channels_input=channel_margins(loop),
    )


def singular_values(loop: Loop, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Singular values (m, 3) of T_hv and (m, 3) of T_uv at omega (m,), rad/s."""
    systems = loop.wind_to_h, loop.wind_to_u
    hv, uv = (control.singular_values_response(s, omega).magnitude[:, 0].T for s in systems)
    return hv, uv
