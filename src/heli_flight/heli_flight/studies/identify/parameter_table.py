# SPDX-License-Identifier: Apache-2.0
"""What `heli identify` takes as given; values stand in config/identify/<aircraft>.yaml."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from heli_math.ticks import TICK_S, TICKS_PER_S
from heli_parameters.locate import config_folder
from heli_parameters.parameters import Parameter, ParameterError, load

NODE_NAME = "identify"


def _row(name: str, description: str, unit: str, upper: float) -> Parameter:
    return Parameter(name, "double", description, unit, lower=0.0, upper=upper, lower_open=True)


TABLE: tuple[Parameter, ...] = (
    _row("mass", "Mass", "kg", 1e3),
    _row("gravity", "Local gravity", "m/s2", 20.0),
    _row("rotor.rho", "Air density", "kg/m3", 3.0),
    _row("rotor.omega", "Rotor speed", "rad/s", 1e3),
    _row("rotor.radius", "Rotor radius", "m", 20.0),
    Parameter("rotor.blades", "int", "Number of blades", lower=1, upper=12),
    _row("rotor.chord", "Blade chord", "m", 2.0),
    _row("rotor.lift_slope", "Lift slope of a blade section", "1/rad", 10.0),
    _row("period_s", "Period of the excitation", "s", 600.0),
    Parameter("periods", "int", "Periods that are evaluated", lower=4, upper=1000),
    Parameter("start_s", "double", "Flight time of the first of them", "s", lower=0.0, upper=1e5),
)
MEASURED = tuple(row.name for row in TABLE if row.name.startswith(("mass", "gravity", "rotor.")))
"""Names of the constants that are measured on the ground."""


@dataclass(frozen=True)
class Given:
    """Constants from the ground, and how the experiments are to be read.

    Attributes
    ----------
    ground : mapping
        mass, gravity, rotor.* by name, SI.
    period_s, start_s : float
    periods : int
    source : str
        File, for people.
    """

    ground: Mapping[str, Any]
    period_s: float
    start_s: float
    periods: int
    source: str

    @property
    def end_s(self) -> float:
        """Flight time of the end of the last evaluated period."""
        return self.start_s + self.periods * self.period_s


def read_given(aircraft: str, params: Sequence[Path]) -> Given:
    """The packaged values of an aircraft under the user's files.

    Parameters
    ----------
    aircraft : str
        Aircraft file or bare name; one that has no packaged values takes those of helion, and the
        user's files must then say what differs.
    params : sequence of path
        rcl parameter files; sections of other nodes are passed over.

    Raises
    ------
    ParameterError
    """
    folder = config_folder("heli_flight") / "identify"
    file = folder / f"{Path(aircraft).stem}.yaml"
    if not file.is_file():
        file = folder / "helion.yaml"
    values = load(TABLE, [file, *params], NODE_NAME)
    ticks = values["period_s"] * TICKS_PER_S
    if abs(ticks - round(ticks)) > 1e-6:
        raise ParameterError(
            f"identify: period_s: {values['period_s']:g} is not allowed; allowed: a multiple of "
            f"{TICK_S:g} s, the tick"
        )
    ground = {name: values[name] for name in MEASURED}
    return Given(ground, values["period_s"], values["start_s"], values["periods"], file.name)
