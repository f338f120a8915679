# SPDX-License-Identifier: Apache-2.0
"""Layers of a flight's parameters.

Packaged < receiver < world < laws < scenario < the user's files.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import heli_dynamics_sim.parameter_table as plant_table
import heli_inner_hinf.parameter_table as inner_table
import heli_observer.parameter_table as observer_table
import heli_outer_pd.parameter_table as outer_table
from heli_bags import parameter_table as recorder_table
from heli_flight.loop import scenario as scenario_table
from heli_flight.loop import worlds
from heli_flight.loop.laws import LAWS, PACKAGED
from heli_flight.loop.worlds import Draw
from heli_parameters.common_table import with_common
from heli_parameters.locate import config_folder
from heli_parameters.parameters import Parameter, ParameterError, ParameterFile, load, opened
from heli_parameters.rcl_yaml import applicable

GPS_PRESETS = ("standalone", "rtk")
PACKAGE = "heli_flight"
PLANT = "plant"


@dataclass(frozen=True)
class NodeKind:
    """One node of the graph: where it comes from and what it can be told."""

    name: str
    package: str
    executable: str
    table: tuple[Parameter, ...]


NODES = (
    NodeKind(PLANT, "heli_dynamics_sim", "plant", with_common(plant_table.TABLE)),
    NodeKind("observer", "heli_observer", "observer", with_common(observer_table.TABLE)),
    NodeKind("inner_loop", "heli_inner_hinf", "inner_loop", with_common(inner_table.TABLE)),
    NodeKind("outer_loop", "heli_outer_pd", "outer_loop", with_common(outer_table.TABLE)),
)
TABLES: Mapping[str, tuple[Parameter, ...]] = {
    **{node.name: node.table for node in NODES},
    scenario_table.NODE_NAME: scenario_table.TABLE,
    worlds.NODE_NAME: worlds.TABLE,
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
    """Parameters by section (the nodes, `scenario`, `world`, `recorder`); the files, weakest first.

    Attributes
    ----------
    values : dict
    files : tuple of Path
    drawn : dict
        By parameter of the plant what the seed has drawn; without what stronger files say.
    """

    values: Mapping[str, dict[str, Any]]
    files: tuple[Path, ...]
    drawn: Mapping[str, Draw] = field(default_factory=dict)


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


def layered(
    read: Reader,
    scenario: str,
    gps: str,
    world: str = worlds.PAPER,
    user: Sequence[ParameterFile] = (),
    seed: int | None = None,
    laws: str = PACKAGED,
) -> Layered:
    """Read and check the layers.

    Parameters
    ----------
    read : Reader
    scenario, gps, world : str
        A packaged scenario, one of GPS_PRESETS, a packaged world or the path of one.
    user : sequence of ParameterFile
        Stronger than the packaged ones; a later one overrides an earlier one.
    seed : int, optional
        Draws what the world lets it draw; default: the plant's.
    laws : str
        Packaged laws, or the path of some.

    Raises
    ------
    ParameterError
    """
    over = [read(scenario_file(scenario)), *user]
    common = read(config_folder("heli_parameters") / "common.yaml")
    around = [read(path) for path in _world_files(world)]
    control = read(LAWS.file(laws))
    beside = {file.path for file in (*around, control)}
    values: dict[str, dict[str, Any]] = {}
    files: list[Path] = []

    def take(name: str, layers: Sequence[ParameterFile]) -> None:
        values[name] = load(TABLES[name], [*layers, *over], name)
        files.extend(layer.path for layer in layers if layer.path not in beside)

    take(scenario_table.NODE_NAME, [read(config_folder(PACKAGE) / "scenario.yaml")])
    take(worlds.NODE_NAME, around)
    # One file tells the plant and the observer.
    sensors = config_folder("heli_dynamics_sim")
    sensors /= f"sensors_{values[worlds.NODE_NAME][f'sensors.{gps}']}.yaml"
    drawn: dict[str, Draw] = {}
    for node in NODES:
        folder = config_folder(node.package)
        presets = [folder / f"gps_{gps}.yaml", sensors]
        own = [read(preset) for preset in presets if preset.is_file()]
        below = [common, read(folder / f"{node.name}.yaml"), *own, *around, control]
        take(node.name, below)
        if node.name == PLANT:
            centres = load(node.table, below, PLANT)
            drawn = _drawn(values, centres, over, seed)
    flown = list(files)
    recorder = recorder_table.NODE_NAME
    take(recorder, [common, read(config_folder("heli_bags") / f"{recorder}.yaml")])
    after = tuple(file.path for file in (*around, control, *over))
    return Layered(values, (*flown, *after), drawn)


def _world_files(world: str) -> list[Path]:
    """Files of a world, weakest first: what it does not say is as in the paper's."""
    names = dict.fromkeys((worlds.PAPER, world))
    return [worlds.WORLDS.file(name) for name in names]


def _drawn(
    values: Mapping[str, dict[str, Any]],
    centres: Mapping[str, Any],
    over: Sequence[ParameterFile],
    seed: int | None,
) -> dict[str, Draw]:
    """Let the seed draw what the world leaves open, around `centres`, and put it in.

    What a stronger file says is not drawn, unless it says what this seed draws: a flight's own
    params.yaml.
    """
    plant, drawn = values[PLANT], {}
    said = {entry.key for file in over for entry in applicable(file, PLANT)}
    for key, draw in worlds.draws(values[worlds.NODE_NAME], centres).items():
        value = draw.value(plant["seed"] if seed is None else seed)
        if key not in said or plant[key] == value:
            plant[key], drawn[key] = value, draw
    return drawn
