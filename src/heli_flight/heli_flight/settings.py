# SPDX-License-Identifier: Apache-2.0
"""A flight's resolved parameters: its layers, what the command line says over them, agreement."""

from __future__ import annotations

import functools
import os
import subprocess
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.random import SeedSequence

import heli_dynamics_sim.parameters as plant_table
import heli_inner_hinf.parameters as inner_table
import heli_observer.parameters as observer_table
import heli_outer_pd.parameters as outer_table
from heli_bags import parameters as recorder_table
from heli_core.command_line import config_folder
from heli_core.errors import ParameterCause
from heli_core.faults import (
    LONGEST_S,
    NONE,
    Fault,
    FaultEntry,
    FaultKind,
    entries,
    faults_of,
    flow_mapping,
)
from heli_core.parameters import (
    Parameter,
    is_of_ros,
    load,
    stated,
    suggestion,
    unknown,
    with_common,
)
from heli_core.python_controller import INNER, OUTER, PARAMETER, LawError, short_name
from heli_core.rcl_yaml import (
    Entry,
    ParameterError,
    ParameterFile,
    applicable,
    check_node_names,
    matches,
    opened,
)
from heli_core.rows import ACTUATOR
from heli_core.signals import NOTHING
from heli_core.ticks import TICKS_PER_S, Rate
from heli_dynamics_sim.aircraft import AircraftError, find_aircraft
from heli_dynamics_sim.config import PlantConfig
from heli_flight import scenario as scenario_table
from heli_flight.scenario import NODE_NAME as SCENARIO
from heli_flight.scenario import Gear
from heli_inner_hinf.excitation import disturbance_params, excitation_params
from heli_msgs_bridge.agreement import PAIRS
from heli_msgs_bridge.links import link_faults_of
from heli_outer_pd.parameters import outer_params
from heli_outer_pd.script import script_of

# -------------------------------------------------------------------------------------------------
# Parameter files that an option names: packaged ones by their name, the user's own by path.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class NamedFiles:
    """One kind of them: worlds, laws.

    Attributes
    ----------
    word : str
        Key in the section `flight`.
    folder : str
        Where the packaged ones lie, under the config folder.
    option : str
        That names one on the command line.
    """

    word: str
    folder: str
    option: str

    def names(self) -> list[str]:
        """Names of the packaged ones."""
        return sorted(path.stem for path in self._folder().glob("*.yaml"))

    def file(self, name: str, where: str = "") -> Path:
        """File of a packaged one, or the user's own, by its path.

        Raises
        ------
        ParameterError
            There is none; `where` says who named it, default: the option.
        """
        if name in self.names():
            return self._folder() / f"{name}.yaml"
        path = Path(name)
        if path.suffix in (".yaml", ".yml") and path.is_file():
            return path
        raise ParameterError(
            f"{where or self.option} {name}: unknown {self.word}; known: "
            f"{', '.join(self.names())}, or the path of a YAML file"
        )

    def full_name(self, name: str) -> str:
        """A packaged one's name, or the whole path of a user's: what params.yaml says of it."""
        return name if name in self.names() else str(Path(name).absolute())

    def _folder(self) -> Path:
        return config_folder("heli_flight") / self.folder


# -------------------------------------------------------------------------------------------------
# Laws: which attitude law, position law and observer a scenario is flown with.
#
# A file of laws is an rcl parameter file that says only what differs from the packaged parameters
# of
# the three nodes that control the aircraft. It knows nothing of the aircraft, the air or the
# sensors:
# those are the world's. A law in Python stands in no such file: the parameter `own_law` of its
# node
# names it, and only the command line or Python gives that.
# -------------------------------------------------------------------------------------------------

LAWS = NamedFiles("laws", "laws", "--control-preset")
PACKAGED = "packaged"
"""The laws that fly unless others are named: nothing is changed."""
SECTIONS = ("observer", "inner_loop", "outer_loop")
"""What a file of laws may tell."""

LAW_NODES = {INNER: "inner_loop", OUTER: "outer_loop"}
"""The node in whose place a law in Python flies, by its loop."""


def own_laws(settings: Settings) -> dict[str, str]:
    """By loop the law in Python that the settings name; without those that are packaged."""
    sources = {loop: str(settings.nodes[node][PARAMETER]) for loop, node in LAW_NODES.items()}
    return {loop: source for loop, source in sources.items() if source}


def own_words(settings: Settings) -> str:
    """The same in words, empty for none: my_law:MyLaw in the place of the inner loop."""
    laws = own_laws(settings).items()
    return ", ".join(f"{short_name(s)} in the place of the {loop} loop" for loop, s in laws)


def laws_words(settings: Settings) -> str:
    """What controlled the aircraft, in words: packaged laws by name, a user's file, ArduPilot."""
    return "ArduPilot's" if settings.mode == ARDUPILOT else Path(settings.laws).stem


def without_own(settings: Settings) -> Settings:
    """The same flight with the packaged laws."""
    packaged_laws = {
        LAW_NODES[loop]: {**settings.nodes[LAW_NODES[loop]], PARAMETER: ""} for loop in LAW_NODES
    }
    return replace(settings, nodes={**settings.nodes, **packaged_laws})


def refuse_own_laws(settings: Settings) -> None:
    """Raise LawError where a law in Python is named for what flies compiled laws alone."""
    for loop, source in own_laws(settings).items():
        raise LawError(
            f"{LAW_NODES[loop]}: {PARAMETER}: {short_name(source)} is flown by heli hover "
            "--custom-law and heli.fly; allowed here: none"
        )


def refuse_unnamed(settings: Settings, over: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise LawError where a file names code: a file alone runs none."""
    for loop, source in own_laws(settings).items():
        if PARAMETER not in over.get(LAW_NODES[loop], {}):
            raise LawError(
                f"{LAW_NODES[loop]}: {PARAMETER}: {source}: a parameter file names this law, "
                f"whose code would run; if you trust it, name it: --custom-law {source}"
            )


# -------------------------------------------------------------------------------------------------
# Worlds: what air, aircraft and sensors a scenario is flown in, and what the seed draws of them.
#
# A world is an rcl parameter file: what it changes in the nodes, and a section `world` with what
# is
# drawn per seed. The aircraft that flies is drawn; the controllers keep their own.
# -------------------------------------------------------------------------------------------------

WORLD_SECTION = "world"
WORLDS = NamedFiles("world", "worlds", "--world")
PAPER = "paper"
HOVER_TEST_WORLD = "honest"
"""The world of the hover test where neither option nor file names one."""

_GRADES = ("none", "consumer", "industrial", "rtk")
# Child of the seed's sequence from which worlds draw: far from those of the sources in
# `heli_dynamics_sim.noise`, which are counted from 0, so that no flight's wind or sensors move.
_STREAM = 1 << 20


def _width(name: str, of: str) -> Parameter:
    return Parameter(
        f"draw.{name}", "double", f"Half width of the draw of {of}", "1", lower=0.0, upper=0.8
    )


WORLD_TABLE: tuple[Parameter, ...] = (
    _width("mass", "scale.mass"),
    _width("inertia", "scale.inertia"),
    _width("rotor_stiffness", "scale.rotor_stiffness"),
    _width("thrust", "scale.thrust"),
    _width("servo_speed", "scale.servo_speed"),
    Parameter(
        "draw.delay_ticks", "int", "Half width of the draw of delay_ticks", "ticks",
        lower=0, upper=10,
    ),
    Parameter("sensors.standalone", "string", "Grade of sensors beside this receiver",
              choices=_GRADES),
    Parameter("sensors.rtk", "string", "Grade of sensors beside this receiver", choices=_GRADES),
)  # fmt: skip

DRAWN: tuple[str, ...] = (
    "scale.mass",
    "scale.inertia",
    "scale.rotor_stiffness",
    "scale.thrust",
    "scale.servo_speed",
    "delay_ticks",
)
"""Parameters of the plant that a world may draw. A new one goes to the end: each has a stream of
its own by its place, so that the others keep their numbers."""


@dataclass(frozen=True)
class Draw:
    """A parameter of the plant that is drawn uniformly per seed.

    Attributes
    ----------
    key : str
        One of `DRAWN`.
    centre : float or int
        What it is without the draw.
    width : float or int
        A scale is drawn from centre (1 - width) to centre (1 + width), a number of ticks from
        centre - width to centre + width, whole, and not below 0.
    """

    key: str
    centre: float | int
    width: float | int

    def value(self, seed: int) -> float | int:
        """What a seed draws; independent of wind, sensors and other draws of that seed."""
        children = (_STREAM, DRAWN.index(self.key))
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=children))
        if isinstance(self.centre, int):
            width = int(self.width)
            return max(0, self.centre + int(rng.integers(-width, width, endpoint=True)))
        return float(self.centre * rng.uniform(1.0 - self.width, 1.0 + self.width))


def draws(world: Mapping[str, Any], plant: Mapping[str, Any]) -> dict[str, Draw]:
    """What a world draws, by parameter of the plant.

    Parameters
    ----------
    world, plant : mapping
        Parameters of the section `world` and of the plant.
    """
    drawn = {}
    for key in DRAWN:
        width = world[f"draw.{key.removeprefix('scale.')}"]
        if width > 0:
            drawn[key] = Draw(key, plant[key], width)
    return drawn


# -------------------------------------------------------------------------------------------------
# Layers of a flight's parameters.
#
# Packaged < receiver < world < laws < scenario < the user's files.
# -------------------------------------------------------------------------------------------------

GPS_PRESETS = ("standalone", "rtk")
PACKAGE = "heli_flight"
PLANT = "plant"
PAPERS_AIRCRAFT = "helion.yaml"
"""The aircraft that the packages fly and the paper's figures are held against."""


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
        Packaged laws, or the path of some.
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
    _override(WORLD_SECTION, values[WORLD_SECTION], overrides or {})
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
# The section `flight` of a parameter file: scenario, receiver, world, laws, mode, seed,
#
# controller, duration.
#
# It makes a parameter file a flight. A file that was written by one flight and is taken for
# another
# (`heli hover --scenario attitude --params flights/x/params.yaml`) brings along what its user had
# changed, and leaves behind what its own scenario, receiver, world and laws had packaged, and its
# own
# seed drawn.
# -------------------------------------------------------------------------------------------------

FLIGHT_SECTION = "flight"
LOCKSTEP, REAL_TIME, ONE_PROCESS = "lockstep", "real time", "one process"
ARDUPILOT = "ardupilot"
MODES = (LOCKSTEP, REAL_TIME, ONE_PROCESS, ARDUPILOT)
"""Through the graph as fast as it goes; through the graph by the wall clock; without the graph;
by ArduPilot, which has the plant alone."""

SHORT_FOR: Mapping[str, tuple[str, str]] = {
    "seed": ("plant", "seed"),
    "controller": ("inner_loop", "controller"),
    "duration_s": (scenario_table.NODE_NAME, "duration_s"),
}
"""Names of the section that stand for a parameter of another one."""
_OPTIONS = {
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
    Parameter("laws", "string", "Packaged laws, or the path of some"),
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
        if there is not None and not _equal(there.value, here.value):
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
    """What the last file that says it says of scenario, receiver, world, laws or mode."""
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
    """The file for a flight of this scenario, receiver, world, laws and seed.

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
    return entry.key in values and _equal(entry.value, values[entry.key])


def _equal(a: Any, b: Any) -> bool:
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


# -------------------------------------------------------------------------------------------------
# Whether the parameters of a flight's nodes fit together, and its faults are some.
# -------------------------------------------------------------------------------------------------


def check_agreement(nodes: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise ParameterError, naming both sides, where two nodes would wait for different things."""
    for first, key, second, other in PAIRS:
        a, b = nodes[first][key], nodes[second][other]
        if a != b:
            raise ParameterError(
                f"{first}: {key}: {a} does not agree with {second}: {other}: {b}; "
                "change both together"
            )


def check_ground(nodes: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise ParameterError where the outer loop may command what is standing to the inner one."""
    outer, law = outer_params(nodes["outer_loop"]), nodes["inner_loop"]
    share, lowest = nodes["outer_loop"]["blade_pitch_floor"], outer.collective_floor
    stands, side = law["ground_collective"], law["ground_collective"] - law["trim.u"][ACTUATOR.col]
    if (lowest - stands) * side >= 0.0:
        raise ParameterError(
            f"inner_loop: ground_collective: {stands:g} is one that is flown: outer_loop: "
            f"blade_pitch_floor: {share:g} of hover's pitch is collective {lowest:.3g}; raise "
            f"blade_pitch_floor or move ground_collective away from hover"
        )


def check_faults(nodes: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise ParameterError before anything is started where a fault is none."""
    try:
        faults_of(nodes["plant"]["faults"])
    except ParameterError as error:
        raise error.placed(f"plant: {error.where}".rstrip(": "), error.key) from None
    for node in NODES:
        try:
            link_faults_of(nodes[node.name]["link_faults"])
        except ParameterError as error:
            where = f"{node.name}: {error.where}".rstrip(": ")
            raise error.placed(where, error.key) from None


# -------------------------------------------------------------------------------------------------
# What may be flown at another rate than 100 Hz, and what may not, with a sentence.
# -------------------------------------------------------------------------------------------------

_SCENARIOS = ("hover", "path")


def check_rate(values: Mapping[str, Mapping[str, Any]]) -> None:
    """Refuse what is made for steps of 10 ms in a flight of other ones.

    Parameters
    ----------
    values : mapping
        Parameters by section; the nodes agree on `rate_hz`.

    Raises
    ------
    ParameterError
    """
    plant, law = values["plant"], values["inner_loop"]
    rate_hz, kind = plant["rate_hz"], values[SCENARIO]["kind"]
    if rate_hz == TICKS_PER_S:
        return
    if law["controller"] == "matrices":
        raise refused(rate_hz, "controller: matrices: they are those of steps of 10 ms")
    if kind not in _SCENARIOS:
        raise refused(rate_hz, f"scenario: kind: {kind}; allowed: {' or '.join(_SCENARIOS)}")
    if plant["start.on_ground"]:
        raise refused(rate_hz, "start.on_ground: the ground is tried in steps of 10 ms alone")
    excited = excitation_params(law).on or disturbance_params(law).shape != NOTHING
    if excited or np.any(plant["wind.sines.amplitude_mps"]):
        raise refused(rate_hz, "an excitation: what reads it counts samples of 10 ms")


def refused(rate_hz: int, why: str) -> ParameterError:
    """The error that says it."""
    return ParameterError(f"rate_hz: {rate_hz} does not go with {why}; fly it at {TICKS_PER_S}")


# -------------------------------------------------------------------------------------------------
# The git commit of the sources that run, where they are a git work tree.
# -------------------------------------------------------------------------------------------------

UNKNOWN = "unknown"
_CHANGED = " with local changes"
_LIMIT_S = 5.0


@functools.cache
def sources_commit() -> str:
    """Commit of this file's work tree, 40 digits, and whether files were changed since.

    "unknown" without git, in an installed copy, and in somebody else's repository.
    """
    here = Path(__file__).resolve()
    try:
        _git(here.parent, "ls-files", "--error-unmatch", here.name)
        text = _git(
            here.parent, "describe", "--always", "--abbrev=40", "--exclude=*", f"--dirty={_CHANGED}"
        )
    except (OSError, subprocess.SubprocessError):
        return UNKNOWN
    return text.strip() or UNKNOWN


def is_another(commit: str) -> bool:
    """Whether a commit of `sources_commit` is known not to be that of the present sources."""
    theirs, ours = commit.removesuffix(_CHANGED), sources_commit().removesuffix(_CHANGED)
    return bool(theirs) and UNKNOWN not in (theirs, ours) and theirs != ours


def _git(folder: Path, *words: str) -> str:
    # A hook's or a rebase's own GIT_DIR must not lead to another repository.
    env = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    command = ["git", "--no-optional-locks", "-C", str(folder), *words]
    done = subprocess.run(
        command, env=env, capture_output=True, text=True, timeout=_LIMIT_S, check=True
    )
    return done.stdout


# -------------------------------------------------------------------------------------------------
# Several aircraft in one world: how many, and the seed of each.
# -------------------------------------------------------------------------------------------------

MOST_AIRCRAFT = 9
"""Of more, one machine's ROS domain could not hold the participants."""


def seed_of(seed: int, number: int) -> int:
    """Seed of an aircraft (0 is the first) of a flight of several: independent of one another.

    It does not depend on how many fly, so that each can be flown again alone.
    """
    (aircraft_seed,) = SeedSequence(seed).spawn(number + 1)[number].generate_state(1)
    # Parameters are signed.
    return int(aircraft_seed) >> 1


# -------------------------------------------------------------------------------------------------
# Faults of a flight's processes, as a file of faults has them: killed, paused, short of time.
# -------------------------------------------------------------------------------------------------

PROCESS = "process"
"""`what` of such a fault."""
FAULTY_NODES = ("observer", "inner_loop", "outer_loop", "plant", "recorder")
KILL, PAUSE, HOG = "kill", "pause", "hog"
KINDS = (KILL, PAUSE, HOG)
_HOGS = FaultKind(1.0, 16.0, "busy processes, a whole number", open_lower=False)
_KEYS = ("what", "node", "kind", "start_s", "duration_s", "value")


@dataclass(frozen=True)
class ProcessFault(Fault):
    """A fault of a node's process, or of all by what takes their time.

    KILL: SIGKILL, and 0 s long. PAUSE: SIGSTOP until its end. HOG: as many processes as `value`
    says that are always busy.

    Attributes
    ----------
    node : str
        One of `FAULTY_NODES`; empty for HOG.
    """

    node: str = ""

    @property
    def which(self) -> dict[str, str]:
        """Keys that say whose process it is."""
        return {"node": self.node} if self.node else {}

    @property
    def name(self) -> str:
        """What has the fault, in words."""
        return self.node or PROCESS

    @property
    def hogs(self) -> int:
        """Number of busy processes."""
        return int(self.value[0]) if self.value else 0

    @property
    def text(self) -> str:
        """The mapping that reads back as this fault."""
        return flow_mapping(self.as_dict())

    def as_dict(self) -> dict[str, Any]:
        """As JSON has it: what the kind has."""
        pairs = {"kind": self.kind, "start_s": self.start_s}
        lasts = {} if self.kind == KILL else {"duration_s": self.duration_s}
        count = {"value": self.hogs} if self.kind == HOG else {}
        return {"what": PROCESS, **self.which, **pairs, **lasts, **count}

    @property
    def words(self) -> str:
        """For people: observer kill at 20 s; inner_loop pause from 20 to 20.5 s."""
        if self.kind == KILL:
            return f"{self.node} kill at {self.start_s:g} s"
        who = f"hog by {self.hogs} processes" if self.kind == HOG else f"{self.node} pause"
        return f"{who} from {self.start_s:g} to {self.end_s:g} s"


def process_faults_of(texts: Iterable[str]) -> tuple[ProcessFault, ...]:
    """The faults of the parameter `process_faults`; ParameterError says what is wrong with one."""
    return entries(texts, "process_faults", _KEYS, process_fault_of)


def process_fault_of(node: yaml.Node | None, where: str) -> ProcessFault:
    """The fault of a YAML mapping; `where` begins the sentence of a ParameterError."""
    entry = FaultEntry(node, _KEYS, where)
    what = entry.word("what", (PROCESS,))
    kind = entry.word("kind", KINDS, PROCESS)
    wanted = {KILL: ("node",), PAUSE: ("node", "duration_s"), HOG: ("duration_s", "value")}[kind]
    for key in ("node", "duration_s", "value"):
        if key in entry and key not in wanted:
            problem = f"{kind} has none; leave it out"
            raise entry.refusal(key, ParameterCause.CONFLICT, problem)
    start_s = entry.number("start_s", LONGEST_S)
    name = entry.word("node", FAULTY_NODES) if "node" in wanted else ""
    duration_s = entry.number("duration_s", LONGEST_S) if "duration_s" in wanted else 0.0
    value = entry.numbers(1, _HOGS, f"{PROCESS} {kind}") if kind == HOG else ()
    if kind == HOG and value[0] != int(value[0]):
        raise entry.refusal("value", ParameterCause.TYPE, allowed=_HOGS.allowed)
    return ProcessFault(what, kind, start_s, duration_s, value, name)


# -------------------------------------------------------------------------------------------------
# Settings.
# -------------------------------------------------------------------------------------------------

_FILES = {"scenario": scenario_file, "world": WORLDS.file, "laws": LAWS.file}
_SECTIONS = (*TABLES, FLIGHT_SECTION, "live_view", "identify", "robust")


@dataclass(frozen=True)
class Overridden:
    """An option of the command line that was stronger than a file of the user's.

    Attributes
    ----------
    option : str
        scenario, gps, world, laws, mode, seed, duration or controller.
    value : object
        What was asked for, and is flown.
    entry : Entry
        What the file says, and where.
    """

    option: str
    value: Any
    entry: Entry

    @property
    def words(self) -> str:
        """In one sentence with others: seed 5, not 4 (file:3)."""
        return f"{self.option} {self.value}, not {self.entry.value} ({self.entry.where})"


@dataclass(frozen=True)
class NotFlown:
    """What a file of the user's states, and no node flies.

    Attributes
    ----------
    section : str
        Node or section of the file.
    key : str
        Parameter; empty where no node of the flight has the section's name.
    flown : object
        What is flown in its place.
    where : str
        `file:line`
    """

    section: str
    key: str
    flown: Any
    where: str

    @property
    def sentence(self) -> str:
        """In one line."""
        if not self.key:
            return f"{self.where}: {self.section}: no node of this flight has that name: not read"
        by = _BY_SCENARIO.get(self.key)
        hint = f"; say it as {by}" if by else ""
        return f"{self.where}: {self.section}: {self.key}: {self.flown} is flown{hint}"


@dataclass(frozen=True)
class Settings:
    """Resolved parameters of every node and of the scenario.

    Attributes
    ----------
    nodes : dict
        Node name to its parameters (dotted name to value).
    scenario : Scenario
    scenario_name, gps : str
    world : str
        Name of a packaged world, or the path of one.
    world_parameters : dict
        Its section `world`.
    drawn : dict
        By parameter of the plant what the seed has drawn.
    laws : str
        Name of packaged laws, or the path of some.
    process_faults : tuple of str
        Faults of processes, a mapping each.
    mode : str
        One of `settings.MODES`.
    seed : int
    files : tuple of Path
        Every file that was read, weakest first.
    recorder : dict
        The recorder's parameters; they change nothing in the flight.
    remarks : tuple of str
        Sentences: where the command line was stronger than a file of the user's, and what to
        know of such a file.
    overridden : tuple of Overridden
        Where the command line was stronger.
    unread : tuple of Unread
        What the user's files, options or overrides have changed of the inner loop, and the
        controller that flies does not read.
    not_flown : tuple of NotFlown
        What the user's files state, and no node flies.
    """

    nodes: Mapping[str, Mapping[str, Any]]
    scenario: scenario_table.Scenario
    scenario_parameters: Mapping[str, Any]
    scenario_name: str
    gps: str
    mode: str
    seed: int
    files: tuple[Path, ...]
    recorder: Mapping[str, Any] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    world: str = PAPER
    world_parameters: Mapping[str, Any] = field(default_factory=dict)
    drawn: Mapping[str, Draw] = field(default_factory=dict)
    laws: str = PACKAGED
    process_faults: tuple[str, ...] = (NONE,)
    overridden: tuple[Overridden, ...] = ()
    unread: tuple[inner_table.Unread, ...] = ()
    not_flown: tuple[NotFlown, ...] = ()

    @property
    def rate(self) -> Rate:
        """The rate of the flight's ticks."""
        return Rate.of_parameters(self.nodes["plant"])

    def at_100_hz(self, what: str) -> Settings:
        """These, for what is worked out for steps of 10 ms; ParameterError at another rate."""
        if self.rate.fold != 1:
            raise refused(self.rate.hz, what)
        return self

    def with_seed(self, seed: int) -> Settings:
        """The same flight in other wind, with other sensor errors, on what else the seed draws."""
        nodes = {name: {**values, "link_seed": seed} for name, values in self.nodes.items()}
        nodes["plant"] |= {"seed": seed, **{k: draw.value(seed) for k, draw in self.drawn.items()}}
        return replace(self, seed=seed, nodes=nodes)


class _CommandLine:
    """What options say over what the user's files say, remembering where they differ."""

    def __init__(self, read: Reader, user: Sequence[FlightDefaults]):
        self._user = user
        self._packaged = read_defaults(read(config_folder(PACKAGE) / "flight.yaml"))
        self.overridden: list[Overridden] = []

    def choose(self, name: str, option: str | None) -> Any:
        """Scenario, receiver, world, laws or mode: option, else files, else packaged."""
        entry = default_of(self._user, name)
        if option is None:
            entry = entry or self._packaged.section[name]
            if name in _FILES:
                _FILES[name](entry.value, f"{entry.where}: flight: {name}:")
            return entry.value
        self._compare(name, option, entry)
        return option

    def laws_of(self, controller: str | None) -> str | None:
        """The packaged laws of a controller's name: the option's, else the user's files'.

        Laws that these files name stay, unless they are packaged or those of their controller.
        """
        laws, controller_entry = (default_of(self._user, name) for name in ("laws", "controller"))
        replaced = (
            () if controller is None else (PACKAGED, controller_entry and controller_entry.value)
        )
        if laws is not None and laws.value not in replaced:
            return None
        if controller is None and controller_entry is not None:
            controller = controller_entry.value
        return controller if controller in LAWS.names() else None

    def put(
        self,
        files: Sequence[ParameterFile],
        values: Mapping[str, dict[str, Any]],
        name: str,
        option: Any,
    ) -> None:
        """Seed, controller or duration: checked, over what the files gave."""
        if option is None:
            return
        section, key = SHORT_FOR[name]
        word = name.removesuffix("_s")
        _set(section, values[section], key, option, _OPTIONS[name])
        self._compare(word, option, assigned(files, section, key))

    def _compare(self, word: str, option: Any, entry: Entry | None) -> None:
        if entry is not None and entry.value != option:
            self.overridden.append(Overridden(word, option, entry))

    def remarks(self) -> tuple[str, ...]:
        """One line about all options that differ from the files; one per file of other sources."""
        words = "; ".join(overridden.words for overridden in self.overridden)
        lines = [f"the command line wins: {words}"] if words else []
        for defaults in self._user:
            commit = defaults.section["commit"].value if "commit" in defaults.section else ""
            if is_another(commit):
                lines.append(
                    f"{defaults.file.path} was flown by the sources of commit {commit[:12]}, "
                    f"these are of {sources_commit()[:12]}"
                )
        return tuple(lines)


def resolve(
    scenario_name: str | None = None,
    gps: str | None = None,
    seed: int | None = None,
    duration_s: float | None = None,
    mode: str | None = None,
    params: Sequence[str | Path] = (),
    overrides: Mapping[str, Mapping[str, Any]] | None = None,
    controller: str | None = None,
    world: str | None = None,
    laws: str | None = None,
    rate_hz: int | None = None,
    process_faults: Sequence[str] | None = None,
) -> Settings:
    """Read, layer and check the parameters of a flight.

    Parameters
    ----------
    scenario_name, gps, mode, world, laws : str, optional
        A packaged scenario, one of GPS_PRESETS, one of `settings.MODES`, a packaged world or
        the path of one, packaged laws or the path of some; default: the files', else hover,
        standalone, lockstep, paper, packaged.
    seed, duration_s, controller : optional
        Override parameters of plant, scenario and inner loop; a controller of packaged laws takes
        these along, unless others are named.
    rate_hz : int, optional
        Overrides the parameter of every node.
    process_faults : sequence of str, optional
        In place of those that a section `flight` names.
    params : sequence of path
        The user's rcl parameter files; a later one overrides an earlier one. A section `flight`
        in them says what these options say, and is weaker.
    overrides : mapping of node name to mapping of parameter name to value, optional
        Strongest layer, for campaigns and tests; checked like a file.

    Returns
    -------
    Settings

    Raises
    ------
    ParameterError
        One line that names the file or option, the key, its value and what is allowed.
    """
    _check_options(scenario_name, gps, mode, world, laws)
    options = {"duration_s": duration_s, "controller": controller, "seed": seed, "rate": rate_hz}
    read = Reader()
    files = [read(path) for path in params]
    check_node_names(files, _SECTIONS)
    user = [read_defaults(file) for file in files]
    line, chosen = _CommandLine(read, user), mode
    name = line.choose("scenario", scenario_name)
    receiver, mode = line.choose("gps", gps), line.choose("mode", mode)
    around, control = (
        kind.full_name(line.choose(kind.word, option and kind.full_name(option)))
        for kind, option in ((WORLDS, world), (LAWS, laws or line.laws_of(controller)))
    )
    check_node_names([read(WORLDS.file(around))], _SECTIONS)
    check_node_names([read(LAWS.file(control))], SECTIONS)
    drawn_by = _seed(user, seed, overrides or {})
    broken = tuple(process_faults or line.choose("process_faults", None))
    process_faults_of(broken)
    wanted = Packaged(name, receiver, around, control, drawn_by)
    fitting = [without_packaged(defaults, read, wanted) for defaults in user]
    in_world = (overrides or {}).get(WORLD_SECTION)
    layers = layered(read, name, receiver, around, fitting, drawn_by, control, in_world)
    values = _over(layers, fitting, line, options, overrides or {})
    unread = _unread(read, values["inner_loop"], fitting, overrides or {})
    by_hand = [one for one, file in zip(fitting, user, strict=True) if "commit" not in file.section]
    for node in NODES:
        values[node.name] |= {"lockstep": mode != REAL_TIME, "link_seed": values["plant"]["seed"]}
    # What the plant does, the recorder must know; nobody has to say it twice.
    latency_ticks = values["plant"]["sensors.gps.latency_ticks"]
    values[recorder_table.NODE_NAME] |= {"schedule.gps_latency_ticks": latency_ticks}
    stronger = {name for name, option in {**options, "mode": chosen}.items() if option is not None}
    not_flown = _not_flown(by_hand, values, stronger, overrides or {})
    return Settings(
        {node.name: values[node.name] for node in NODES},
        _scenario(values, _is_papers_test(read, name, values)),
        values[scenario_table.NODE_NAME],
        name,
        receiver,
        mode,
        values["plant"]["seed"],
        layers.files,
        values[recorder_table.NODE_NAME],
        (*line.remarks(), *_remark(unread), *(one.sentence for one in not_flown)),
        around,
        values[WORLD_SECTION],
        {k: d for k, d in layers.drawn.items() if k not in (overrides or {}).get("plant", {})},
        control,
        broken,
        tuple(line.overridden),
        tuple(unread),
        tuple(not_flown),
    )


_BY_OPTION = {
    "duration_s": ("duration_s",),
    "controller": ("controller",),
    "seed": ("seed", "link_seed"),
    "rate": ("rate_hz",),
    "mode": ("lockstep",),
}
"""By option the parameters that it decides."""
_BY_SCENARIO = {
    "initial.pos_ned_m": "scenario: start_pos_ned_m",
    "initial.psi_deg": "scenario: heading_deg",
    "duration_s": "scenario: duration_s",
    "lockstep": "flight: mode",
    "link_seed": "plant: seed",
    "schedule.gps_latency_ticks": "plant: sensors.gps.latency_ticks",
}
"""By parameter of a node what decides it in a flight."""


def _not_flown(
    files: Sequence[ParameterFile],
    values: Mapping[str, Mapping[str, Any]],
    options: Collection[str],
    overrides: Mapping[str, Mapping[str, Any]],
) -> list[NotFlown]:
    """What files state and no node flies: another value is, or no node has that name.

    What an option or an override decides is left out: whoever gave it knows.
    """
    decided = {key for option in options for key in _BY_OPTION[option]}
    ones = [
        NotFlown(pattern.strip("/"), "", None, where)
        for file in files
        for pattern, where in file.sections
        if not any(matches(pattern, section) for section in _SECTIONS)
    ]
    for section in TABLES:
        keys = dict.fromkeys(entry.key for file in files for entry in applicable(file, section))
        for key in keys:
            if key in decided or key in overrides.get(section, {}) or key not in values[section]:
                continue
            entry = assigned(files, section, key)
            if entry is not None and not _equal(entry.value, values[section][key]):
                ones.append(NotFlown(section, key, values[section][key], entry.where))
    return ones


def _unread(
    read: Reader,
    inner: Mapping[str, Any],
    files: Sequence[ParameterFile],
    overrides: Mapping[str, Mapping[str, Any]],
) -> list[inner_table.Unread]:
    """What the user has changed of the inner loop that its controller does not read."""
    node = next(node for node in NODES if node.name == inner_table.NODE_NAME)
    names = [entry.key for file in files for entry in applicable(file, node.name)]
    stated_names = dict.fromkeys((*names, *overrides.get(node.name, {})))
    own = inner[PARAMETER]
    ones = inner_table.unread(short_name(own) if own else inner["controller"], stated_names)
    if not ones:
        return []
    defaults = config_folder(node.package) / f"{node.name}.yaml"
    packaged = load(
        node.table, [read(config_folder("heli_core") / "common.yaml"), read(defaults)], node.name
    )
    return [one for one in ones if not _equal(inner[one.parameter], packaged[one.parameter])]


def _remark(ones: Sequence[inner_table.Unread]) -> list[str]:
    return [f"{inner_table.NODE_NAME}: {inner_table.unread_sentence(ones)}"] if ones else []


def _seed(
    user: Sequence[FlightDefaults], option: int | None, overrides: Mapping[str, Mapping[str, Any]]
) -> int | None:
    """The seed that will be flown, None for that of scenario or packages."""
    if option is not None:
        # One that cannot be is refused when it is put in.
        return option if option >= 0 else None
    entry = assigned([defaults.file for defaults in user], "plant", "seed")
    value = overrides.get("plant", {}).get("seed", None if entry is None else entry.value)
    return value if isinstance(value, int) and value >= 0 else None


def _check_options(
    scenario_name: str | None,
    gps: str | None,
    mode: str | None,
    world: str | None,
    laws: str | None,
) -> None:
    if gps is not None and gps not in GPS_PRESETS:
        raise ParameterError(f"--gps {gps}: unknown preset; known: {', '.join(GPS_PRESETS)}")
    if mode is not None and mode not in MODES:
        raise ParameterError(f"mode {mode}: unknown; known: {', '.join(MODES)}")
    for name, option in (("scenario", scenario_name), ("world", world), ("laws", laws)):
        if option is not None:
            _FILES[name](option)


def _over(
    layers: Layered,
    files: Sequence[ParameterFile],
    line: _CommandLine,
    options: Mapping[str, Any],
    overrides: Mapping[str, Mapping[str, Any]],
) -> Mapping[str, dict[str, Any]]:
    """Parameters by section with options and overrides put in."""
    values = layers.values
    for name in ("duration_s", "controller"):
        line.put(files, values, name, options[name])
    if options["rate"] is not None:
        for section in (*(node.name for node in NODES), recorder_table.NODE_NAME):
            _set(section, values[section], "rate_hz", options["rate"], "--rate")
    for section, changes in overrides.items():
        if section not in TABLES:
            raise ParameterError(f"override of unknown node {section}")
        _override(section, values[section], changes)
    check_agreement(values)
    check_rate(values)
    check_ground(values)
    check_faults(values)
    values["plant"] |= _initial_state(values[scenario_table.NODE_NAME])
    line.put(files, values, "seed", options["seed"])
    return values


def _initial_state(scenario: Mapping[str, Any]) -> dict[str, Any]:
    """What the scenario decides for the plant: where, how long."""
    return {
        "initial.pos_ned_m": scenario["start_pos_ned_m"],
        "initial.psi_deg": scenario["heading_deg"],
        "duration_s": scenario["duration_s"],
    }


def _is_papers_test(read: Reader, name: str, values: Mapping[str, Mapping[str, Any]]) -> bool:
    """Whether the paper flew this: its scenario, unchanged but for air and length, its aircraft."""
    if name not in scenario_table.PAPERS_TESTS:
        return False
    defaults = [config_folder(PACKAGE) / "scenario.yaml", scenario_file(name)]
    packaged = load(scenario_table.TABLE, list(map(read, defaults)), SCENARIO)
    flown = values[SCENARIO]
    if any(flown[key] != packaged[key] for key in scenario_table.MISSION):
        return False
    try:
        if script_of(values["outer_loop"]):
            return False
        return find_aircraft(values[PLANT]["aircraft_file"]) == find_aircraft(PAPERS_AIRCRAFT)
    except (AircraftError, ParameterError):
        return False  # what reads it says why


def _scenario(
    values: Mapping[str, Mapping[str, Any]], is_papers_test: bool
) -> scenario_table.Scenario:
    """The scenario; of one that begins on the ground with what it is judged by."""
    scenario = scenario_table.Scenario.from_parameters(
        values[scenario_table.NODE_NAME], is_papers_test
    )
    try:
        script_of(values["outer_loop"])
    except ParameterError as error:
        raise ParameterError(f"outer_loop: {error}") from None
    if not values["plant"]["start.on_ground"]:
        return scenario
    ground = PlantConfig.from_parameters(values["plant"]).params.aircraft.ground
    return replace(scenario, gear=Gear(ground, values["outer_loop"]["takeoff.height_m"]))


def _override(section: str, values: dict[str, Any], changes: Mapping[str, Any]) -> None:
    """Put the overrides of a section over its values."""
    for key, value in changes.items():
        _set(section, values, key, value, f"override of {section}")


def _set(section: str, values: dict[str, Any], key: str, value: Any, where: str) -> None:
    """Put one checked value over a loaded one."""
    rows = {row.name: row for row in TABLES[section]}
    row = rows.get(key)
    if row is None:
        raise ParameterError(f"{where}: {key}: {suggestion(rows, key)}")
    try:
        values[key] = row.check(value)
    except ParameterError as error:
        raise ParameterError(f"{where}: {key}: {error}") from None
