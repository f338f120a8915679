# SPDX-License-Identifier: Apache-2.0
"""The section `flight` of a parameter file: scenario, receiver, world, laws, mode, seed,
controller, duration.

It makes a parameter file a flight. A file that was written by one flight and is taken for another
(`heli hover --scenario attitude --params flights/x/params.yaml`) brings along what its user had
changed, and leaves behind what its own scenario, receiver, world and laws had packaged, and its own
seed drawn.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from heli_flight.loop import scenario as scenario_table
from heli_flight.loop.laws import LAWS, PACKAGED
from heli_flight.loop.layers import (
    GPS_PRESETS,
    TABLES,
    Layered,
    Reader,
    layered,
    scenario_names,
)
from heli_flight.loop.worlds import HOVER_TEST_WORLD, PAPER, WORLDS
from heli_parameters.parameters import Entry, Parameter, ParameterError, ParameterFile, stated
from heli_parameters.rcl_yaml import applicable

NODE_NAME = "flight"
LOCKSTEP, REAL_TIME, ONE_PROCESS = "lockstep", "real time", "one process"
MODES = (LOCKSTEP, REAL_TIME, ONE_PROCESS)
"""Through the graph as fast as it goes; through the graph by the wall clock; without the graph."""

SHORT_FOR: Mapping[str, tuple[str, str]] = {
    "seed": ("plant", "seed"),
    "controller": ("inner_loop", "controller"),
    "duration_s": (scenario_table.NODE_NAME, "duration_s"),
}
"""Names of the section that stand for a parameter of another one."""


def _same_as(name: str) -> Parameter:
    section, key = SHORT_FOR[name]
    return replace(next(row for row in TABLES[section] if row.name == key), name=name)


TABLE: tuple[Parameter, ...] = (
    Parameter("scenario", "string", "Packaged scenario"),
    Parameter("gps", "string", "Receiver", choices=GPS_PRESETS),
    Parameter("world", "string", "Packaged world, or the path of one"),
    Parameter("laws", "string", "Packaged laws, or the path of some"),
    Parameter("mode", "string", "How it is flown", choices=MODES),
    Parameter("process_faults", "string[]", "Faults of processes, a mapping each, or none"),
    *(_same_as(name) for name in SHORT_FOR),
    Parameter("commit", "string", "Commit of the sources that flew, for the reader"),
    Parameter("changed", "string[]", "Parameters unlike the packaged ones, for the reader"),
)


@dataclass(frozen=True)
class Told:
    """A parameter file and what its section `flight` says.

    Attributes
    ----------
    file : ParameterFile
        What was short for parameters of other sections stands there, too.
    said : mapping of name to Entry
    """

    file: ParameterFile
    said: Mapping[str, Entry]


def told_by(file: ParameterFile) -> Told:
    """Read the section of a file.

    Raises
    ------
    ParameterError
        Something unknown or not allowed, or the file contradicts itself.
    """
    said = stated(TABLE, [file], NODE_NAME)
    moved = []
    for name, (section, key) in SHORT_FOR.items():
        if name not in said:
            continue
        here = said[name]
        there = assigned([file], section, key)
        if there is not None and not _equal(there.value, here.value):
            raise ParameterError(
                f"{here.where}: flight: {name}: {here.value} does not agree with {section}: {key}: "
                f"{there.value} at {there.where}; change both together"
            )
        moved.append(Entry(f"/**/{section}", key, here.value, here.where))
    sections = (*file.sections, *((entry.pattern, entry.where) for entry in moved))
    return Told(replace(file, sections=sections, entries=(*file.entries, *moved)), said)


def assigned(files: Sequence[ParameterFile], section: str, key: str) -> Entry | None:
    """The strongest assignment of a parameter in files, None if there is none."""
    found = [e for file in files for e in applicable(file, section) if e.key == key]
    return found[-1] if found else None


def said_by(files: Sequence[Told], name: str) -> Entry | None:
    """What the last file that says it says of scenario, receiver, world, laws or mode."""
    return next((told.said[name] for told in reversed(files) if name in told.said), None)


@dataclass(frozen=True)
class Packaged:
    """What decides which values a flight takes from the packages, and what its seed draws."""

    scenario: str
    gps: str
    world: str
    laws: str
    seed: int | None


def fitted(told: Told, read: Reader, wanted: Packaged) -> ParameterFile:
    """The file for a flight of this scenario, receiver, world, laws and seed.

    If it was made for others, what equals their packaged values is left out: it belongs to them.
    """
    of = {name: entry.value for name, entry in told.said.items()}
    seed = assigned([told.file], *SHORT_FOR["seed"])
    own = Packaged(
        of.get("scenario", wanted.scenario),
        of.get("gps", wanted.gps),
        of.get("world", PAPER if "commit" in of else wanted.world),
        of.get("laws", PACKAGED if "commit" in of else wanted.laws),
        wanted.seed if seed is None else seed.value,
    )
    if own == wanted or own.scenario not in scenario_names():
        return told.file
    try:
        WORLDS.file(own.world)
        LAWS.file(own.laws)
    except ParameterError:
        return told.file
    packaged = layered(read, own.scenario, own.gps, own.world, seed=own.seed, laws=own.laws)
    kept = [entry for entry in told.file.entries if not _is_packaged(entry, packaged)]
    return replace(told.file, entries=tuple(kept))


def _is_packaged(entry: Entry, packaged: Layered) -> bool:
    values = packaged.values.get(entry.pattern.rsplit("/", 1)[-1], {})
    return entry.key in values and _equal(entry.value, values[entry.key])


def _equal(a: Any, b: Any) -> bool:
    """Equal as parameters: arrays flat, as files have them."""
    return np.array_equal(np.ravel(np.asarray(a)), np.ravel(np.asarray(b)))


def flown(paths: Sequence[Path]) -> Mapping[str, Any]:
    """What the section `flight` of parameter files says, by name; empty without one.

    Raises
    ------
    ParameterError
    """
    read = Reader()
    told = [told_by(read(path)) for path in paths]
    return {name: entry.value for each in told for name, entry in each.said.items()}


def hover_test_world(world: str | None, scenario: str | None, paths: Sequence[Path]) -> str | None:
    """The world of a command that flies: option, else what files say, else the hover test's own.

    None for a file that says it, and for what is not the hover test: the paper's. So is a file
    of a flight that was flown before there were worlds.

    Raises
    ------
    ParameterError
    """
    said = flown(paths)
    known = "world" in said or "commit" in said
    hovers = (scenario or said.get("scenario", "hover")) == "hover"
    return HOVER_TEST_WORLD if world is None and not known and hovers else world
