# SPDX-License-Identifier: Apache-2.0
"""The search of attitude controllers: over which aircraft and families of controllers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from heli_core.rows import NINE
from heli_core.ticks import TICK_S
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_dynamics_sim.trim import (
    flap_back_in_hover,
    linearize,
    trim,
)
from heli_inner_hinf.controller_state import Actuation, OutputLaw
from heli_inner_hinf.design import AttitudeConfig, added_weights
from heli_inner_hinf.output_feedback import OutputWeights, central_law, generalised_plant
from heli_inner_hinf.tuning import (
    LawBenchmark,
    LawFamily,
    SampledAircraft,
)
from heli_studies.robust import with_values

# -------------------------------------------------------------------------------------------------
# What the attitude controllers are searched over: the aircraft of the set, and the families of
# controllers.
# -------------------------------------------------------------------------------------------------

_WORTH = 0.01
"""Share of the cost that moves a weight of the shipped controller."""


class Member(NamedTuple):
    """An aircraft of the set: factors of the nominal one's values, and ticks of delay.

    Of the corners of the box of +-30 % and 0 to 3 ticks those at which controllers come to an end
    first.
    """

    name: str
    inertia: tuple[float, float, float] = (1.0, 1.0, 1.0)
    rotor_stiffness: float = 1.0
    flapping: float = 1.0
    servo_speed: float = 1.0
    ticks: int | None = None
    disk_margin: float = 0.2
    mass: float = 1.0

    def stretched(self, by: float) -> Member:
        """As far beyond the box: its factors' distances to the nominal ones times `by`."""
        factors = ("rotor_stiffness", "flapping", "servo_speed", "mass")
        further = {key: 1.0 + by * (getattr(self, key) - 1.0) for key in factors}
        roll, pitch, yaw = (1.0 + by * (inertia - 1.0) for inertia in self.inertia)
        return self._replace(inertia=(roll, pitch, yaw), **further)


MEMBERS = (
    Member("flaps back", disk_margin=0.5),
    Member("slow", (1.3, 1.3, 1.3), 0.7, 1.3, 0.7, 2),
    Member("fast", (0.7, 0.7, 0.7), 1.3, 0.7, 0.7, 2),
    Member("stiff and late", (0.7, 0.7, 1.3), 1.3, 1.3, 0.7, 3),
    Member("stiff and light", (0.7, 0.7, 0.7), 1.3, 0.7, 1.3, 2),
    Member("limp and early", (1.3, 0.7, 0.7), 0.7, 1.3, 1.3, 0),
    # the flapping of roll and of pitch meet here
    Member("meeting, early", (1.3, 0.7, 0.7), 1.3, 1.3, 1.3, 0, 0.1),
    Member("meeting, slow", (1.3, 0.7, 0.7), 1.3, 1.3, 0.7, 1),
    Member("meeting, late", (1.3, 0.7, 0.7), 1.3, 1.3, 1.3, 3),
)

_BEYOND = 1.12
"""How far beyond the box `hinf_output` is held to be stable."""
EDGES = (
    *(Member("meeting, heavy", (1.3, 0.7, 0.7), 1.3, 1.3, 0.7, ticks, mass=1.3)
      for ticks in range(4)),
    Member("meeting, heavy, slow", (1.3, 0.7, 0.7), 1.3, 1.3, 0.8, 3, mass=1.3),
    *(Member("quick, heavy", (0.7, 0.7, 0.7), 1.3, 0.7, 1.3, ticks, mass=1.3) for ticks in (0, 1)),
    *(Member("late, heavy", (0.7, 0.7, 1.3), 1.3, 1.3, speed, 3, mass=1.3) for speed in (0.7, 0.8)),
)  # fmt: skip
"""Corners of the set of `heli robust` at which the family `hinf_output` ends first."""


def yardstick(helicopter: HelicopterParameters, actuation: Actuation) -> LawBenchmark:
    """The nominal aircraft, then `MEMBERS`, all of which flap back.

    Inertias divide their rows, so they need not be those of one rigid body.

    Raises
    ------
    TrimError
    """
    linear = linearize(helicopter, trim(helicopter))
    nominal = SampledAircraft("nominal", linear.A, linear.B, linear.E, actuation)
    others = tuple(_aircraft(one, helicopter, actuation) for one in MEMBERS)
    return LawBenchmark(nominal, others)


def beyond_the_box(
    measure: LawBenchmark, helicopter: HelicopterParameters, actuation: Actuation
) -> LawBenchmark:
    """The same with a floor of `hinf_output` alone: stable with `EDGES`, 12 % beyond the box.

    So that the controller of default is proved with some room; others are not held to it. Raises as
    `yardstick`.
    """
    stretched = (one.stretched(_BEYOND) for one in EDGES)
    held = tuple(_aircraft(one, helicopter, actuation) for one in stretched)
    return replace(measure, held_stable=held)


def _aircraft(
    one: Member, helicopter: HelicopterParameters, actuation: Actuation
) -> SampledAircraft:
    values = {
        "mass": one.mass,
        "rotor_stiffness": one.rotor_stiffness,
        "flapping": one.flapping,
        "flap_back": flap_back_in_hover(helicopter),
    }
    changed = with_values(helicopter, values)
    linear = linearize(changed, trim(changed))
    rows = np.ones((len(NINE), 1))
    rows[[NINE.p, NINE.q, NINE.r], 0] = one.inertia
    delay_s = actuation.delay_s if one.ticks is None else one.ticks * TICK_S
    member_actuation = Actuation(
        one.servo_speed * actuation.servo_radps, actuation.servo_damping, delay_s
    )
    plant = (linear.A / rows, linear.B / rows, linear.E / rows)
    return SampledAircraft(one.name, *plant, member_actuation, one.disk_margin)


def searched_output(inner: Mapping[str, Any], measure: LawBenchmark) -> dict[str, Any]:
    """`output` of the inner loop's parameters, moved until no step of a number saves `_WORTH`.

    gamma stays, and `command_effort`, which the feedback does not know: how fast the position loop
    wants its commands followed the cost does not see. The valley of the cost is flat: from far
    starts other numbers cost as little.

    Raises
    ------
    NoLawError
        No controller near the present one keeps the floors.
    """
    numbers = measure.best(output_family(inner), (1,), pairs=False, better=_WORTH)
    weights = output_weights(numbers, float(inner["output.command_effort"]))._asdict()
    return {f"output.{name}": np.asarray(value).tolist() for name, value in weights.items()}


def output_family(inner: Mapping[str, Any]) -> LawFamily:
    """`hinf_output` of the inner loop's parameters as a function of the weights `output` adds."""
    config = AttitudeConfig.from_parameters({**inner, "controller": "pid"})
    model = config.A, config.B, config.E, config.C, config.D
    gamma, command_effort = (float(inner[f"output.{key}"]) for key in ("gamma", "command_effort"))

    def law(numbers: Sequence[float]) -> OutputLaw:
        weights = output_weights(numbers, command_effort)
        plant = generalised_plant(*model, weights, config.actuation)
        return central_law(plant, weights, gamma)[0]

    return LawFamily("hinf_output", law, (numbers_of(added_weights(inner)),))


_SHARED = np.array([2, 2, 1, 1])
"""How many of `MEASURED` each of the four numbers of the noise is for: angles, p q, r, psi."""


def output_weights(numbers: Sequence[float], command_effort: float) -> OutputWeights:
    """Weights of `output_family`'s numbers: roll and pitch share their noise."""
    effort, integral, load, noise = np.split(np.asarray(numbers, float), (3, 6, 9))
    return OutputWeights(effort, integral, load, np.repeat(noise, _SHARED), command_effort)


def numbers_of(weights: OutputWeights) -> tuple[float, ...]:
    """The numbers of weights."""
    w = weights
    first_of_each = np.cumsum(_SHARED) - _SHARED
    numbers = (*w.effort, *w.integral, *w.load, *w.noise[first_of_each])
    return tuple(float(number) for number in numbers)
