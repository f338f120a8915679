# SPDX-License-Identifier: Apache-2.0
"""A flight's resolved parameters: the command line over its layers, and agreement."""

from __future__ import annotations

import functools
import os
import subprocess
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import SeedSequence

import heli_inner_hinf.parameters as inner_table
from heli_bags import parameters as recorder_table
from heli_core.command_line import config_folder
from heli_core.faults import (
    NONE,
    faults_of,
)
from heli_core.parameters import (
    load,
)
from heli_core.python_controller import INNER, OUTER, PARAMETER, LawError, short_name
from heli_core.rcl_yaml import (
    Entry,
    ParameterError,
    ParameterFile,
    applicable,
    check_node_names,
    matches,
)
from heli_core.rows import ACTUATOR
from heli_core.signals import NOTHING
from heli_core.ticks import TICKS_PER_S, Rate
from heli_dynamics_sim.aircraft import AircraftError, find_aircraft
from heli_dynamics_sim.config import PlantConfig, imu_delay_s
from heli_flight import scenario as scenario_table
from heli_flight.layers import (
    AUTOPILOTS,
    FLIGHT_SECTION,
    GPS_PRESETS,
    MODES,
    NODES,
    OPTION_OF,
    PACKAGE,
    PAPERS_AIRCRAFT,
    PLANT,
    REAL_TIME,
    SHORT_FOR,
    TABLES,
    FlightDefaults,
    Layered,
    Packaged,
    Reader,
    assigned,
    default_of,
    equal_values,
    layered,
    override_section,
    read_defaults,
    scenario_file,
    set_value,
    without_packaged,
)
from heli_flight.process_faults import process_faults_of
from heli_flight.scenario import NODE_NAME as SCENARIO
from heli_flight.scenario import Gear
from heli_flight.worlds import LAWS, PACKAGED, PAPER, SECTIONS, WORLD_SECTION, WORLDS, Draw
from heli_inner_hinf.excitation import disturbance_params, excitation_params
from heli_msgs_bridge.agreement import PAIRS
from heli_msgs_bridge.links import link_faults_of
from heli_outer_pd.parameters import outer_params
from heli_outer_pd.script import script_of

LAW_NODES = {INNER: "inner_loop", OUTER: "outer_loop"}
"""The node in whose place a controller in Python flies, by its loop."""


def own_laws(settings: Settings) -> dict[str, str]:
    """By loop the controller in Python that the settings name; without those that are packaged."""
    sources = {loop: str(settings.nodes[node][PARAMETER]) for loop, node in LAW_NODES.items()}
    return {loop: source for loop, source in sources.items() if source}


def own_words(settings: Settings) -> str:
    """The same in words, empty for none: my_law:MyLaw in place of the inner loop."""
    laws = own_laws(settings).items()
    return ", ".join(f"{short_name(s)} in place of the {loop} loop" for loop, s in laws)


def laws_words(settings: Settings) -> str:
    """What controlled the aircraft, in words: a preset, a user's file, an autopilot."""
    autopilot = AUTOPILOTS.get(settings.mode)
    return f"{autopilot}'s" if autopilot else Path(settings.laws).stem


def without_own(settings: Settings) -> Settings:
    """The same flight with the packaged controllers."""
    packaged_laws = {
        LAW_NODES[loop]: {**settings.nodes[LAW_NODES[loop]], PARAMETER: ""} for loop in LAW_NODES
    }
    return replace(settings, nodes={**settings.nodes, **packaged_laws})


def refuse_own_laws(settings: Settings) -> None:
    """Raise LawError if a controller in Python is named where only compiled ones can fly."""
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
                f"{LAW_NODES[loop]}: {PARAMETER}: {source}: a parameter file names this "
                f"controller, whose code would run; if you trust it, name it: --custom-law {source}"
            )


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
        scenario, gps, world, control preset, mode, seed, duration or controller.
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
        Name of a packaged control preset, or the path of one.
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
        """Scenario, receiver, world, control preset or mode: option, else files, else packaged."""
        entry = default_of(self._user, name)
        if option is None:
            entry = entry or self._packaged.section[name]
            if name in _FILES:
                _FILES[name](entry.value, f"{entry.where}: flight: {name}:")
            return entry.value
        self._compare(name, option, entry)
        return option

    def laws_of(self, controller: str | None) -> str | None:
        """The packaged controllers of a controller's name: the option's, else the user's files'.

        Controllers that these files name stay, unless they are packaged or those of their
        controller.
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
        set_value(section, values[section], key, option, OPTION_OF[name])
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
        the path of one, packaged control preset or the path of one; default: the files', else
        hover, standalone, lockstep, paper, packaged.
    seed, duration_s, controller : optional
        Override parameters of plant, scenario and inner loop; a controller of packaged controllers
        takes these along, unless others are named.
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
    values["observer"] |= _sensors_as_built(files, values["plant"], overrides or {})
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
    "ekf.imu.lever_arm_m": "plant: sensors.imu.lever_arm_m",
    "ekf.gps.lever_arm_m": "plant: sensors.gps.lever_arm_m",
    "ekf.imu.delay_s": "plant: sensors.imu.lowpass_motion",
}
"""By parameter of a node what decides it in a flight."""


def _itself(value: Any) -> Any:
    return value


_TOLD: Mapping[str, tuple[Callable[..., Any], tuple[str, ...]]] = {
    "ekf.imu.lever_arm_m": (_itself, ("sensors.imu.lever_arm_m",)),
    "ekf.gps.lever_arm_m": (_itself, ("sensors.gps.lever_arm_m",)),
    "ekf.imu.delay_s": (imu_delay_s, ("sensors.imu.lowpass_motion", "sensors.imu.lowpass_hz")),
}
"""By parameter of the observer: how it follows from which of the plant."""


def _sensors_as_built(
    files: Sequence[ParameterFile],
    plant: Mapping[str, Any],
    overrides: Mapping[str, Mapping[str, Any]],
) -> dict[str, Any]:
    """What the plant tells the observer of its sensors: all that nobody gives it otherwise.

    A value of its own that the same files give the plant, too, as those of a flight that was flown
    do, is none that is meant otherwise.
    """
    told = {}
    for known, (follows, names) in _TOLD.items():
        own = assigned(files, "observer", known)
        given = {name: assigned(files, "plant", name) for name in names}
        in_files = {name: one.value for name, one in given.items() if one is not None}
        meant = own is not None and not (
            in_files
            and equal_values(own.value, follows(*({**plant, **in_files}[name] for name in names)))
        )
        if not meant and known not in overrides.get("observer", {}):
            told[known] = follows(*(plant[name] for name in names))
    return told


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
            if entry is not None and not equal_values(entry.value, values[section][key]):
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
    return [one for one in ones if not equal_values(inner[one.parameter], packaged[one.parameter])]


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
            set_value(section, values[section], "rate_hz", options["rate"], "--rate")
    for section, changes in overrides.items():
        if section not in TABLES:
            raise ParameterError(f"override of unknown node {section}")
        override_section(section, values[section], changes)
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
