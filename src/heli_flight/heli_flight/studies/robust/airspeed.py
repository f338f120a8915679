# SPDX-License-Identifier: Apache-2.0
"""The attitude loop over the airspeed: one law from hover to forward flight.

The aircraft is trimmed and linearised in winds that to it are flight through still air; the law,
servos, delay and 100 Hz are those that fly. A quadratic bound that the loops of flight straight
ahead share says that airspeed and flap-back may change as quickly as they like (`common_bound`):
the law needs no schedule. What trim needs meanwhile, integral action and the disturbance estimate
find. With air from the side too each loop is judged by itself.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from heli_dynamics_sim.linearize import linearize
from heli_dynamics_sim.parameters import HelicopterParameters
from heli_dynamics_sim.trim import trim
from heli_flight.loop.settings import Settings
from heli_flight.studies.robust.loop import feedback_flown
from heli_inner_hinf.actuation import Actuation
from heli_inner_hinf.as_flown import Feedback, Judgement, closed_loop, judge
from heli_inner_hinf.design import AttitudeConfig
from heli_math.rows import NINE
from heli_robust.errors import RobustError
from heli_robust.shared_bound import CommonBound, common_bound, contraction_of
from heli_robust.uncertain import Matrix

SPEEDS_MPS = (0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0)
ACROSS_MPS = (-4.0, 0.0, 4.0)
FLAP_BACKS_RADPMPS = (0.0, 0.00075, 0.0015)
"""As the set of `heli robust` has it: none, nominal, that of the literature."""
_BETWEEN_MPS = tuple(0.5 * k for k in range(25))
_BETWEEN_RADPMPS = (0.0004, 0.0011)


class Point(NamedTuple):
    """An aircraft in steady flight.

    Attributes
    ----------
    ahead_mps, right_mps : float
        Velocity through the air.
    flap_back_radpmps : float
    """

    ahead_mps: float
    right_mps: float
    flap_back_radpmps: float


@dataclass(frozen=True, eq=False)
class AtPoint:
    """The aircraft there, and its loop.

    Attributes
    ----------
    point : Point
    attitude_rad : (2,) array
        Trim phi, theta.
    u : (4,) array
        Trim d_lat, d_lon, d_ped, d_col.
    loop : (n, n) array
        State matrix of the loop as flown, one step a tick.
    judgement : Judgement
    """

    point: Point
    attitude_rad: Matrix
    u: Matrix
    loop: Matrix
    judgement: Judgement


@dataclass(frozen=True, eq=False)
class OverAirspeed:
    """What is found.

    Attributes
    ----------
    points : sequence of AtPoint
        Ahead and to the sides.
    bound : CommonBound or str
        What all loops of flight straight ahead share; or why none was found.
    between : float
        Largest contraction, by the same bound, at speeds and flap-backs between those; NaN without.
    """

    points: Sequence[AtPoint]
    bound: CommonBound | str
    between: float


def over_airspeed(settings: Settings) -> OverAirspeed:
    """Trim, linearise, close and bound the loops of the settings' aircraft and law.

    Raises
    ------
    TrimError
        The aircraft cannot fly that fast.
    """
    law = feedback_flown(settings)
    aircraft = HelicopterParameters.from_yaml(settings.nodes["plant"]["aircraft_file"])
    actuation = AttitudeConfig.from_parameters(settings.nodes["inner_loop"]).actuation
    points = [
        at(aircraft, law, actuation, Point(ahead, right, flap_back))
        for ahead in SPEEDS_MPS
        for right in ACROSS_MPS
        for flap_back in FLAP_BACKS_RADPMPS
    ]
    try:
        bound = common_bound([found.loop for found in points if found.point.right_mps == 0.0])
    except RobustError as error:
        return OverAirspeed(points, str(error), math.nan)
    between = (
        at(aircraft, law, actuation, Point(ahead, 0.0, flap_back)).loop
        for ahead in _BETWEEN_MPS
        for flap_back in _BETWEEN_RADPMPS
    )
    return OverAirspeed(points, bound, max(contraction_of(A, bound.P) for A in between))


def at(
    aircraft: HelicopterParameters, law: Feedback, actuation: Actuation, point: Point
) -> AtPoint:
    """One of them."""
    flapping = replace(aircraft, flap_back_radpmps=point.flap_back_radpmps)
    balance = trim(flapping, [-point.ahead_mps, -point.right_mps, 0.0], 0.0)
    model = linearize(flapping, balance)
    return AtPoint(
        point,
        model.x_trim[[NINE.phi, NINE.theta]],
        balance.u,
        closed_loop(model.A, model.B, law, actuation),
        judge(model.A, model.B, law, actuation),
    )
