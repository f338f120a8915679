# SPDX-License-Identifier: Apache-2.0
"""Layers of a flight's parameters: packaged defaults < receiver < scenario < the user's files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import heli_dynamics_sim.parameter_table as plant_table
import heli_inner_hinf.parameter_table as inner_table
import heli_observer.parameter_table as observer_table
import heli_outer_pd.parameter_table as outer_table
from heli_bags import parameter_table as recorder_table
from heli_flight.loop import scenario as scenario_table
from heli_parameters.common_table import with_common
from heli_parameters.locate import config_folder
from heli_parameters.parameters import Parameter, ParameterError, ParameterFile, load, opened

GPS_PRESETS = ("standalone", "rtk")
PACKAGE = "heli_flight"


@dataclass(frozen=True)
class NodeKind:
    """One node of the graph: where it comes from and what it can be told."""

    name: str
    package: str
    executable: str
    table: tuple[Parameter, ...]


NODES = (
    NodeKind("plant", "heli_dynamics_sim", "plant", with_common(plant_table.TABLE)),
    NodeKind("observer", "heli_observer", "observer", with_common(observer_table.TABLE)),
    NodeKind("inner_loop", "heli_inner_hinf", "inner_loop", with_common(inner_table.TABLE)),
    NodeKind("outer_loop", "heli_outer_pd", "outer_loop", with_common(outer_table.TABLE)),
)
TABLES: Mapping[str, tuple[Parameter, ...]] = {
    **{node.name: node.table for node in NODES},
    scenario_table.NODE_NAME: scenario_table.TABLE,
    recorder_table.NODE_NAME: with_common(recorder_table.TABLE),
}
"""Per section of a flight's parameters what may stand there."""


class Reader:
    """Parameter files by path, each read once."""

    def __init__(self) -> None:
        self._files: dict[Path, ParameterFile] = {}

    def __call__(self, path: str | Path) -> ParameterFile:
        """The file's content; raises ParameterError."""
        path = Path(path)
        if path not in self._files:
            self._files[path] = opened(path)
        return self._files[path]


@dataclass(frozen=True)
class Layered:
    """Parameters by section (the nodes, `scenario`, `recorder`); the files, weakest first."""

    values: Mapping[str, dict[str, Any]]
    files: tuple[Path, ...]


def scenario_names() -> list[str]:
    """Names of the packaged scenarios."""
    return sorted(path.stem for path in (config_folder(PACKAGE) / "scenarios").glob("*.yaml"))


def scenario_file(name: str, where: str = "--scenario") -> Path:
    """File of a packaged scenario.

    Raises
    ------
    ParameterError
        There is none of this name; `where` says who named it.
    """
    path = config_folder(PACKAGE) / "scenarios" / f"{name}.yaml"
    if not path.is_file():
        raise ParameterError(
            f"{where} {name}: unknown scenario; known: {', '.join(scenario_names())}"
        )
    return path


def layered(read: Reader, scenario: str, gps: str, user: Sequence[ParameterFile] = ()) -> Layered:
    """Read and check the layers.

    Parameters
    ----------
    read : Reader
    scenario, gps : str
        A packaged scenario, one of GPS_PRESETS.
    user : sequence of ParameterFile
        Stronger than the packaged ones; a later one overrides an earlier one.

    Raises
    ------
    ParameterError
    """
    over = [read(scenario_file(scenario)), *user]
    common = read(config_folder("heli_parameters") / "common.yaml")
    values: dict[str, dict[str, Any]] = {}
    files: list[Path] = []

    def take(name: str, layers: Sequence[ParameterFile]) -> None:
        values[name] = load(TABLES[name], [*layers, *over], name)
        files.extend(layer.path for layer in layers)

    take(scenario_table.NODE_NAME, ())
    for node in NODES:
        folder = config_folder(node.package)
        layers = [common, read(folder / f"{node.name}.yaml")]
        preset = folder / f"gps_{gps}.yaml"
        if preset.is_file():
            layers.append(read(preset))
        take(node.name, layers)
    flown = list(files)
    recorder = recorder_table.NODE_NAME
    take(recorder, [common, read(config_folder("heli_bags") / f"{recorder}.yaml")])
    return Layered(values, (*flown, *(file.path for file in over)))
