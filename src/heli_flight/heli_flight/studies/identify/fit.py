# SPDX-License-Identifier: Apache-2.0
"""From two experiments to a design: fits, then observer and laws from identified numbers only.

No aircraft file is read here. What comes from elsewhere than flight are the constants of `Given`,
measured on the ground, and the weights and gamma that the user chooses.
"""

from collections.abc import Callable
from dataclasses import dataclass

from heli_flight.loop.settings import Settings
from heli_flight.studies.design.make import Basis, Design, design_of
from heli_flight.studies.identify.parameter_table import Given
from heli_identification.actuators import IdentifiedAB, fit_actuators, refit_actuators
from heli_identification.collective import (
    IdentifiedCollective,
    RotorGeometry,
    fit_collective,
    relative_air_w,
)
from heli_identification.experiment import Experiment
from heli_identification.gusts import IdentifiedE, fit_gusts
from heli_identification.places import AIR
from heli_identification.system import identified_system
from heli_identification.trim import IdentifiedTrim, trim_of
from heli_inner_hinf.actuation import Actuation
from heli_math.rows import NINE
from heli_math.ticks import TICK_S


@dataclass(frozen=True)
class Identification:
    """What the experiments tell, and the design made from it.

    Attributes
    ----------
    actuators, gusts : Experiment
    ab, wind, trim, collective : IdentifiedAB, IdentifiedE, IdentifiedTrim, IdentifiedCollective
    given : Given
    design : Design
    """

    actuators: Experiment
    gusts: Experiment
    ab: IdentifiedAB
    wind: IdentifiedE
    trim: IdentifiedTrim
    collective: IdentifiedCollective
    given: Given
    design: Design


def identify(
    actuators: Experiment,
    gusts: Experiment,
    given: Given,
    settings: Settings,
    gamma_factor: float | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Identification:
    """Fit A, B, servos and delay, then E, trim and collective; design from them.

    Parameters
    ----------
    actuators, gusts : Experiment
    given : Given
        Constants from the ground.
    settings : Settings
        Weights and gamma of the inner loop; its model and trims are not used.
    gamma_factor : float, optional
        gamma as a multiple of gamma*, instead.
    progress : callable
        Told what comes next, a few words.

    Raises
    ------
    IdentificationError
        A fit is refused; its sentence says why.
    SynthesisError
        No law exists for the identified model and gamma.
    """
    progress("A, B, servos, delay")
    ab = fit_actuators(actuators)
    ground = given.ground
    rotor = RotorGeometry(
        **{name: ground[f"rotor.{name}"] for name in RotorGeometry.__annotations__}
    )
    progress("collective")
    collective = fit_collective(actuators, ab, ground["mass"], ground["gravity"], rotor)
    progress("E")
    air_w_mps = relative_air_w(gusts, ab, collective)
    wind = fit_gusts(gusts, ab, air_w_mps=air_w_mps)
    mean = wind.E.copy()
    mean[NINE.r, AIR.w] = wind.E_rw["mean"]
    ab = refit_actuators(actuators, ab, mean)
    trim = trim_of([actuators, gusts], ab)
    wind = fit_gusts(gusts, ab, air_w_mps=air_w_mps)
    progress("design")
    basis = basis_of(ab, wind, trim, collective, given)
    design = design_of(basis, settings, gamma_factor=gamma_factor)
    return Identification(actuators, gusts, ab, wind, trim, collective, given, design)


def basis_of(
    ab: IdentifiedAB,
    wind: IdentifiedE,
    trim: IdentifiedTrim,
    collective: IdentifiedCollective,
    given: Given,
) -> Basis:
    """What `design_of` starts from, in identified numbers."""
    return Basis(
        source="identified in flight",
        system=identified_system(ab, wind),
        x_trim=trim.x,
        u_trim=trim.u,
        actuation=Actuation(ab.servo_radps, ab.servo_damping, ab.delay_ticks * TICK_S),
        outer={**given.ground, "rotor.K_col": collective.K_col},
        plant={},
        residual=float("nan"),
    )
