# SPDX-License-Identifier: Apache-2.0
"""A fleet as a YAML file has it: aircraft of different types and places, for one launch.

    fleet:
      - namespace: red
        pos_ned_m: [0.0, -5.0, -10.0]
      - namespace: blue
        type: xcell60
        pos_ned_m: [0.0, 5.0, -12.0]
        heading_deg: 90.0
        params_file: blue.yaml
        seed: 7

Only `namespace` must be there. What is not said is as the launch has it for all.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from heli_core.command_line import config_folder
from heli_core.foreign_files import FileError, read_yaml
from heli_core.parameters import Parameter, ParameterCause, ParameterError, unknown
from heli_core.rcl_yaml import file_refusal
from heli_flight.settings import MOST_AIRCRAFT

SECTION = "fleet"
HELION = "helion"
"""The type whose values are the packaged ones."""
# As ROS has names: https://design.ros2.org/articles/topic_and_service_names.html
_NAMESPACE = re.compile(r"[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*")


def types() -> tuple[str, ...]:
    """The aircraft that have a packaged design: names of `config/designs`, and HeLion."""
    designs = (config_folder("heli_flight") / "designs").glob("*.yaml")
    return (HELION, *sorted(path.stem for path in designs))


def design_file(aircraft: str | None) -> list[Path]:
    """The parameter file of a packaged aircraft with its design; none for the packaged values.

    Raises
    ------
    ParameterError
        There is no such one.
    """
    if aircraft is None or aircraft == HELION:
        return []
    if aircraft not in types():
        raise ParameterError(
            f"aircraft {aircraft!r}: unknown; known: {', '.join(types())}; another one by params"
        )
    return [config_folder("heli_flight") / "designs" / f"{aircraft}.yaml"]


def table() -> tuple[Parameter, ...]:
    """What may be said of an aircraft."""
    return (
        Parameter("namespace", "string", "Prefix of its names"),
        Parameter("type", "string", "Aircraft, as it is designed for", choices=types()),
        Parameter("params_file", "string", "Its parameters, over those of its type and of all"),
        Parameter("pos_ned_m", "double[]", "Where it starts", "m", -1e5, 1e5, (3,)),
        Parameter("heading_deg", "double", "Whereto its nose points then", "deg", -360.0, 360.0),
        Parameter("seed", "int", "Seed of its wind and sensors", "", 0, 2**31 - 1),
    )


@dataclass(frozen=True)
class FleetAircraft:
    """One aircraft of a fleet.

    Attributes
    ----------
    namespace : str
        Without slashes around it.
    design : Path or None
        Parameter file of its type; None for the packaged values.
    params_file : Path or None
        Its own, which is stronger.
    pos_ned_m : ndarray (3,) or None
        Where it starts, NED, m; None for where the scenario starts.
    heading_deg : float or None
    seed : int or None
    """

    namespace: str
    design: Path | None
    params_file: Path | None
    pos_ned_m: np.ndarray | None
    heading_deg: float | None
    seed: int | None

    def overrides(self) -> dict[str, dict[str, Any]]:
        """Parameters by node that follow from its place."""
        scenario: dict[str, Any] = {}
        plant: dict[str, Any] = {}
        if self.pos_ned_m is not None:
            place = [float(value) for value in self.pos_ned_m]
            scenario["start_pos_ned_m"] = plant["initial.pos_ned_m"] = place
        if self.heading_deg is not None:
            scenario["heading_deg"] = plant["initial.psi_deg"] = self.heading_deg
        return {"scenario": scenario, "plant": plant}


def read_fleet(path: str | Path) -> list[FleetAircraft]:
    """Read and check a file; parameter files are named relative to it.

    Raises
    ------
    ParameterError
        Names file, aircraft (by its number from 1) and key.
    """
    path = Path(path)
    try:
        content = read_yaml(path)
    except FileError as error:
        raise file_refusal(error, path, "fleet") from None
    entries = content.get(SECTION) if isinstance(content, dict) else None
    if not isinstance(entries, list) or set(content) != {SECTION}:
        problem = "is to be a list of aircraft, under this one key"
        raise ParameterError(problem, ParameterCause.SYNTAX, where=str(path), key=SECTION)
    if not 1 <= len(entries) <= MOST_AIRCRAFT:
        problem = f"{len(entries)} aircraft; allowed: 1 to {MOST_AIRCRAFT}"
        raise ParameterError(problem, ParameterCause.LENGTH, where=str(path), key=SECTION)
    rows = {row.name: row for row in table()}
    fleet: list[FleetAircraft] = []
    for number, entry in enumerate(entries, 1):
        where = f"{path}: aircraft {number}"
        if not isinstance(entry, dict):
            problem = "is missing; write the aircraft as a mapping that has it"
            raise ParameterError(problem, ParameterCause.SYNTAX, where=where, key="namespace")
        fleet.append(_aircraft(where, path.parent, rows, entry))
        if fleet[-1].namespace in (one.namespace for one in fleet[:-1]):
            problem = f"{fleet[-1].namespace} is there twice; name each once"
            raise ParameterError(problem, ParameterCause.TWICE, where=where, key="namespace")
    return fleet


def _aircraft(
    where: str, folder: Path, rows: Mapping[str, Parameter], entry: Mapping[Any, Any]
) -> FleetAircraft:
    values: dict[str, Any] = {}
    for key, value in entry.items():
        if key not in rows:
            raise unknown(rows, str(key), where)
        try:
            values[key] = rows[key].check(value)
        except ParameterError as error:
            raise error.placed(where, key) from None
    namespace = values.get("namespace", "").strip("/")
    if not _NAMESPACE.fullmatch(namespace):
        problem = f"{namespace!r} is no ROS name" if namespace else "is missing"
        problem += "; write one such as heli1"
        raise ParameterError(problem, ParameterCause.MISSING, where=where, key="namespace")
    own = folder / values["params_file"] if "params_file" in values else None
    if own is not None and not own.is_file():
        problem = f"{own} is not a file"
        raise ParameterError(problem, ParameterCause.UNREADABLE, where=where, key="params_file")
    kind = values.get("type", HELION)
    design = next(iter(design_file(kind)), None)
    place, heading, seed = (values.get(key) for key in ("pos_ned_m", "heading_deg", "seed"))
    return FleetAircraft(namespace, design, own, place, heading, seed)
