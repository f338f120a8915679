# SPDX-License-Identifier: Apache-2.0
"""Layers of a flight's parameters, weakest first, and the section `flight` of a parameter file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

import heli_dynamics_sim.parameters as plant_table
import heli_inner_hinf.parameters as inner_table
import heli_observer.parameters as observer_table
import heli_outer_pd.parameters as outer_table
from heli_bags import parameters as recorder_table
from heli_core.command_line import config_folder
from heli_core.parameters import (
    Parameter,
    is_of_ros,
    load,
    stated,
    suggestion,
    unknown,
    with_common,
)
from heli_core.rcl_yaml import (
    Entry,
    ParameterError,
    ParameterFile,
    applicable,
    opened,
)
from heli_flight import scenario as scenario_table
from heli_flight.worlds import (
    HOVER_TEST_WORLD,
    LAWS,
    PACKAGED,
    PAPER,
    WORLD_SECTION,
    WORLD_TABLE,
    WORLDS,
    Draw,
    draws,
)

# -------------------------------------------------------------------------------------------------
# Layers of a flight's parameters.
#
# Packaged < receiver < world < controllers < scenario < the user's files.
# -------------------------------------------------------------------------------------------------

GPS_PRESETS = ("standalone", "rtk")
PACKAGE = "heli_flight"
PLANT = "plant"
PAPERS_AIRCRAFT = "helion.yaml"
"""The aircraft that the packages fly and the paper's figures are compared with."""


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
    WORLD_SECTION: WORLD_TABLE,
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
    world: str = PAPER,
    user: Sequence[ParameterFile] = (),
    seed: int | None = None,
    laws: str = PACKAGED,
    overrides: Mapping[str, Any] | None = None,
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
        A packaged control preset, or the path of one.
    overrides : mapping, optional
        Of the section `world`, stronger than all files: what is drawn and which sensors fly follow
        from that section.

    Raises
    ------
    ParameterError
    """
    over = [read(scenario_file(scenario)), *user]
    common = read(config_folder("heli_core") / "common.yaml")
    around = [read(path) for path in _world_files(world)]
    control = read(LAWS.file(laws))
    beside = {file.path for file in (*around, control)}
    values: dict[str, dict[str, Any]] = {}
    files: list[Path] = []

    def take(name: str, layers: Sequence[ParameterFile]) -> None:
        values[name] = load(TABLES[name], [*layers, *over], name)
        files.extend(layer.path for layer in layers if layer.path not in beside)

    take(scenario_table.NODE_NAME, [read(config_folder(PACKAGE) / "scenario.yaml")])
    take(WORLD_SECTION, around)
    override_section(WORLD_SECTION, values[WORLD_SECTION], overrides or {})
    # One file tells the plant and the observer.
    sensors = config_folder("heli_dynamics_sim")
    sensors /= f"sensors_{values[WORLD_SECTION][f'sensors.{gps}']}.yaml"
    drawn: dict[str, Draw] = {}
    for node in NODES:
        folder = config_folder(node.package)
        presets = [folder / f"gps_{gps}.yaml", sensors]
        preset_files = [read(preset) for preset in presets if preset.is_file()]
        below = [common, read(folder / f"{node.name}.yaml"), *preset_files, *around, control]
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
    names = dict.fromkeys((PAPER, world))
    return [WORLDS.file(name) for name in names]


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
    stated_keys = {entry.key for file in over for entry in applicable(file, PLANT)}
    for key, draw in draws(values[WORLD_SECTION], centres).items():
        value = draw.value(plant["seed"] if seed is None else seed)
        if key not in stated_keys or plant[key] == value:
            plant[key], drawn[key] = value, draw
    return drawn


# -------------------------------------------------------------------------------------------------
# The section `flight` of a parameter file: scenario, receiver, world, control preset, mode, seed,
#
# controller, duration.
#
# It makes a parameter file a flight. A file that was written by one flight and is taken for
# another
# (`heli hover --scenario attitude --params flights/x/params.yaml`) brings along what its user had
# changed, and leaves behind what its own scenario, receiver, world and control preset had packaged,
# and its own
# seed drawn.
# -------------------------------------------------------------------------------------------------

FLIGHT_SECTION = "flight"
LOCKSTEP, REAL_TIME, ONE_PROCESS = "lockstep", "real time", "one process"
ARDUPILOT, PX4 = "ardupilot", "px4"
AUTOPILOTS: Mapping[str, str] = {ARDUPILOT: "ArduPilot", PX4: "PX4"}
"""Modes in which somebody else's autopilot flies the plant alone, and its name."""
MODES = (LOCKSTEP, REAL_TIME, ONE_PROCESS, *AUTOPILOTS)
"""Through the graph as fast as it goes; through the graph by the wall clock; without the graph;
by another autopilot."""

SHORT_FOR: Mapping[str, tuple[str, str]] = {
    "seed": ("plant", "seed"),
    "controller": ("inner_loop", "controller"),
    "duration_s": (scenario_table.NODE_NAME, "duration_s"),
}
"""Names of the section that stand for a parameter of another one."""
OPTION_OF = {
    "seed": "--seed",
    "controller": "--attitude-controller",
    "duration_s": "--duration",
}
"""By such a name the option of the command line."""


def _same_as(name: str) -> Parameter:
    section, key = SHORT_FOR[name]
    return replace(next(row for row in TABLES[section] if row.name == key), name=name)


FLIGHT_TABLE: tuple[Parameter, ...] = (
    Parameter("scenario", "string", "Packaged scenario"),
    Parameter("gps", "string", "Receiver", choices=GPS_PRESETS),
    Parameter("world", "string", "Packaged world, or the path of one"),
    Parameter("laws", "string", "A packaged control preset, or the path of one"),
    Parameter("mode", "string", "How it is flown", choices=MODES),
    Parameter("process_faults", "string[]", "Faults of processes, a mapping each, or none"),
    *(_same_as(name) for name in SHORT_FOR),
    Parameter("commit", "string", "Commit of the sources that flew, for the reader"),
    Parameter("changed", "string[]", "Parameters unlike the packaged ones, for the reader"),
)


@dataclass(frozen=True)
class FlightDefaults:
    """A parameter file and what its section `flight` says.

    Attributes
    ----------
    file : ParameterFile
        What was short for parameters of other sections stands there, too.
    section : mapping of name to Entry
    """

    file: ParameterFile
    section: Mapping[str, Entry]


def read_defaults(file: ParameterFile) -> FlightDefaults:
    """Read the section of a file.

    Raises
    ------
    ParameterError
        Something unknown or not allowed, or the file contradicts itself.
    """
    file = _spread(file)
    by_name = stated(FLIGHT_TABLE, [file], FLIGHT_SECTION)
    moved = []
    for name, (section, key) in SHORT_FOR.items():
        if name not in by_name:
            continue
        here = by_name[name]
        there = assigned([file], section, key)
        if there is not None and not equal_values(there.value, here.value):
            raise ParameterError(
                f"{here.where}: flight: {name}: {here.value} does not agree with {section}: {key}: "
                f"{there.value} at {there.where}; change both together"
            )
        moved.append(Entry(f"/**/{section}", key, here.value, here.where))
    sections = (*file.sections, *((entry.pattern, entry.where) for entry in moved))
    return FlightDefaults(
        replace(file, sections=sections, entries=(*file.entries, *moved)), by_name
    )


def _spread(file: ParameterFile) -> ParameterFile:
    """The file with what stands under `/**` put where it is known: not all sections know all.

    Raises
    ------
    ParameterError
        No section knows it.
    """
    wild = [entry for entry in file.entries if entry.pattern.strip("/") in ("*", "**")]
    if not wild:
        return file
    known = {row.name: row for table in TABLES.values() for row in table}
    known |= {row.name: row for row in FLIGHT_TABLE}
    spread = []
    for entry in wild:
        if is_of_ros(entry.key):
            continue
        if entry.key not in known:
            raise unknown(known, entry.key, entry.where)
        spread += [
            replace(entry, pattern=f"/**/{section}")
            for section, table in {**TABLES, FLIGHT_SECTION: FLIGHT_TABLE}.items()
            if any(row.name == entry.key for row in table)
        ]
    named = [entry for entry in file.entries if entry not in wild]
    # A section that is named is stronger, and among equals the last one is.
    sections = (*file.sections, *((entry.pattern, entry.where) for entry in spread))
    return replace(file, sections=sections, entries=(*spread, *named))


def assigned(files: Sequence[ParameterFile], section: str, key: str) -> Entry | None:
    """The strongest assignment of a parameter in files, None if there is none."""
    assignments = [e for file in files for e in applicable(file, section) if e.key == key]
    return assignments[-1] if assignments else None


def default_of(files: Sequence[FlightDefaults], name: str) -> Entry | None:
    """What the last file that says it says of scenario, receiver, world, control preset or mode."""
    return next(
        (defaults.section[name] for defaults in reversed(files) if name in defaults.section), None
    )


@dataclass(frozen=True)
class Packaged:
    """What decides which values a flight takes from the packages, and what its seed draws."""

    scenario: str
    gps: str
    world: str
    laws: str
    seed: int | None


def without_packaged(defaults: FlightDefaults, read: Reader, wanted: Packaged) -> ParameterFile:
    """The file for a flight of this scenario, receiver, world, control preset and seed.

    If it was made for others, what equals their packaged values is left out: it belongs to them.
    """
    of = {name: entry.value for name, entry in defaults.section.items()}
    seed = assigned([defaults.file], *SHORT_FOR["seed"])
    made_for = Packaged(
        of.get("scenario", wanted.scenario),
        of.get("gps", wanted.gps),
        of.get("world", PAPER if "commit" in of else wanted.world),
        of.get("laws", PACKAGED if "commit" in of else wanted.laws),
        wanted.seed if seed is None else seed.value,
    )
    if made_for == wanted or made_for.scenario not in scenario_names():
        return defaults.file
    try:
        WORLDS.file(made_for.world)
        LAWS.file(made_for.laws)
    except ParameterError:
        return defaults.file
    packaged = layered(
        read,
        made_for.scenario,
        made_for.gps,
        made_for.world,
        seed=made_for.seed,
        laws=made_for.laws,
    )
    kept = [entry for entry in defaults.file.entries if not _is_packaged(entry, packaged)]
    return replace(defaults.file, entries=tuple(kept))


def _is_packaged(entry: Entry, packaged: Layered) -> bool:
    values = packaged.values.get(entry.pattern.rsplit("/", 1)[-1], {})
    return entry.key in values and equal_values(entry.value, values[entry.key])


def equal_values(a: Any, b: Any) -> bool:
    """Equal as parameters: arrays flat, as files have them."""
    return np.array_equal(np.ravel(np.asarray(a)), np.ravel(np.asarray(b)))


def section_of(paths: Sequence[Path]) -> Mapping[str, Any]:
    """What the section `flight` of parameter files says, by name; empty without one.

    Raises
    ------
    ParameterError
    """
    read = Reader()
    defaults = [read_defaults(read(path)) for path in paths]
    return {name: entry.value for each in defaults for name, entry in each.section.items()}


def hover_test_world(world: str | None, scenario: str | None, paths: Sequence[Path]) -> str | None:
    """The world of a command that flies: option, else what files say, else the hover test's own.

    None for a file that says it, and for what is not the hover test: the paper's. So is a file
    of a flight that was flown before there were worlds.

    Raises
    ------
    ParameterError
    """
    section = section_of(paths)
    known = "world" in section or "commit" in section
    hovers = (scenario or section.get("scenario", "hover")) == "hover"
    return HOVER_TEST_WORLD if world is None and not known and hovers else world


def override_section(section: str, values: dict[str, Any], changes: Mapping[str, Any]) -> None:
    """Put the overrides of a section over its values."""
    for key, value in changes.items():
        set_value(section, values, key, value, f"override of {section}")


def set_value(section: str, values: dict[str, Any], key: str, value: Any, where: str) -> None:
    """Put one checked value over a loaded one."""
    rows = {row.name: row for row in TABLES[section]}
    row = rows.get(key)
    if row is None:
        raise ParameterError(f"{where}: {key}: {suggestion(rows, key)}")
    try:
        values[key] = row.check(value)
    except ParameterError as error:
        raise ParameterError(f"{where}: {key}: {error}") from None
