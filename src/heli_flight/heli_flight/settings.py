# SPDX-License-Identifier: Apache-2.0
"""A flight's resolved parameters: its layers, what the command line says over them, agreement."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from heli_bags import parameter_table as recorder_table
from heli_dynamics_sim.config import PlantConfig
from heli_flight.loop import flight_section
from heli_flight.loop import scenario as scenario_table
from heli_flight.loop.agreement import check_agreement, check_faults, check_ground
from heli_flight.loop.commit import is_another, sources_commit
from heli_flight.loop.flight_section import MODES, REAL_TIME, Packaged, Told
from heli_flight.loop.ground_figures import Gear
from heli_flight.loop.laws import LAWS, PACKAGED
from heli_flight.loop.laws import SECTIONS as LAWS_TELL
from heli_flight.loop.layers import (
    GPS_PRESETS,
    NODES,
    PACKAGE,
    TABLES,
    Layered,
    Reader,
    layered,
    scenario_file,
)
from heli_flight.loop.process_fault import process_faults_of
from heli_flight.loop.rates import check_rate, refused
from heli_flight.loop.worlds import NODE_NAME as WORLD
from heli_flight.loop.worlds import PAPER, WORLDS, Draw
from heli_math.ticks import Rate
from heli_outer_pd.script import script_of
from heli_parameters.entry import NONE
from heli_parameters.locate import config_folder
from heli_parameters.parameters import (
    ParameterError,
    ParameterFile,
    check_node_names,
    suggestion,
)

_FILES = {"scenario": scenario_file, "world": WORLDS.file, "laws": LAWS.file}
_SECTIONS = (*TABLES, flight_section.NODE_NAME, "live_view", "identify", "robust")


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
        One of `flight_section.MODES`.
    seed : int
    files : tuple of Path
        Every file that was read, weakest first.
    recorder : dict
        The recorder's parameters; they change nothing in the flight.
    remarks : tuple of str
        Sentences: where the command line was stronger than a file of the user's, and what to
        know of such a file.
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

    @property
    def rate(self) -> Rate:
        """The rate of the flight's ticks."""
        return Rate.of_parameters(self.nodes["plant"])

    def at_100_hz(self, what: str) -> "Settings":
        """These, for what is worked out for steps of 10 ms; ParameterError at another rate."""
        if self.rate.fold != 1:
            raise refused(self.rate.hz, what)
        return self

    def with_seed(self, seed: int) -> "Settings":
        """The same flight in other wind, with other sensor errors, on what else the seed draws."""
        nodes = {name: {**values, "link_seed": seed} for name, values in self.nodes.items()}
        nodes["plant"] |= {"seed": seed, **{k: draw.value(seed) for k, draw in self.drawn.items()}}
        return replace(self, seed=seed, nodes=nodes)


class _CommandLine:
    """What options say over what the user's files say, remembering where they differ."""

    def __init__(self, read: Reader, user: Sequence[Told]):
        self._user = user
        self._packaged = flight_section.told_by(read(config_folder(PACKAGE) / "flight.yaml"))
        self._won: list[str] = []

    def choose(self, name: str, option: str | None) -> Any:
        """Scenario, receiver, world, laws or mode: option, else files, else packaged."""
        said = flight_section.said_by(self._user, name)
        if option is None:
            said = said or self._packaged.said[name]
            if name in _FILES:
                _FILES[name](said.value, f"{said.where}: flight: {name}:")
            return said.value
        self._compare(name, option, said)
        return option

    def laws_of(self, controller: str | None) -> str | None:
        """The packaged laws of a controller's name: the option's, else the user's files'.

        Laws that these files name stay, unless they are packaged or those of their controller.
        """
        laws, own = (flight_section.said_by(self._user, name) for name in ("laws", "controller"))
        replaced = () if controller is None else (PACKAGED, own and own.value)
        if laws is not None and laws.value not in replaced:
            return None
        taken = own.value if controller is None and own is not None else controller
        return taken if taken in LAWS.names() else None

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
        section, key = flight_section.SHORT_FOR[name]
        word = name.removesuffix("_s")
        _set(section, values[section], key, option, f"--{word}")
        self._compare(word, option, flight_section.assigned(files, section, key))

    def _compare(self, word: str, option: Any, said: Any) -> None:
        if said is not None and said.value != option:
            self._won.append(f"{word} {option}, not {said.value} ({said.where})")

    def remarks(self) -> tuple[str, ...]:
        """One line about all options that differ from the files; one per file of other sources."""
        lines = [f"the command line wins: {'; '.join(self._won)}"] if self._won else []
        for told in self._user:
            commit = told.said["commit"].value if "commit" in told.said else ""
            if is_another(commit):
                lines.append(
                    f"{told.file.path} was flown by the sources of commit {commit[:12]}, "
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
        A packaged scenario, one of GPS_PRESETS, one of `flight_section.MODES`, a packaged world or
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
    given = [read(path) for path in params]
    check_node_names(given, _SECTIONS)
    user = [flight_section.told_by(file) for file in given]
    line = _CommandLine(read, user)
    name = line.choose("scenario", scenario_name)
    receiver, mode = line.choose("gps", gps), line.choose("mode", mode)
    around, control = (
        kind.full_name(line.choose(kind.word, given and kind.full_name(given)))
        for kind, given in ((WORLDS, world), (LAWS, laws or line.laws_of(controller)))
    )
    check_node_names([read(WORLDS.file(around))], _SECTIONS)
    check_node_names([read(LAWS.file(control))], LAWS_TELL)
    drawn_by = _seed(user, seed, overrides or {})
    broken = tuple(process_faults or line.choose("process_faults", None))
    process_faults_of(broken)
    wanted = Packaged(name, receiver, around, control, drawn_by)
    fitting = [flight_section.fitted(told, read, wanted) for told in user]
    layers = layered(read, name, receiver, around, fitting, drawn_by, control)
    values = _over(layers, fitting, line, options, overrides or {})
    for node in NODES:
        values[node.name] |= {"lockstep": mode != REAL_TIME, "link_seed": values["plant"]["seed"]}
    return Settings(
        {node.name: values[node.name] for node in NODES},
        _scenario(values),
        values[scenario_table.NODE_NAME],
        name,
        receiver,
        mode,
        values["plant"]["seed"],
        layers.files,
        values[recorder_table.NODE_NAME],
        line.remarks(),
        around,
        values[WORLD],
        {k: d for k, d in layers.drawn.items() if k not in (overrides or {}).get("plant", {})},
        control,
        broken,
    )


def _seed(
    user: Sequence[Told], option: int | None, overrides: Mapping[str, Mapping[str, Any]]
) -> int | None:
    """The seed that will be flown, None for that of scenario or packages."""
    if option is not None:
        # One that cannot be is refused when it is put in.
        return option if option >= 0 else None
    said = flight_section.assigned([told.file for told in user], "plant", "seed")
    given = overrides.get("plant", {}).get("seed", None if said is None else said.value)
    return given if isinstance(given, int) and given >= 0 else None


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
    for name, given in (("scenario", scenario_name), ("world", world), ("laws", laws)):
        if given is not None:
            _FILES[name](given)


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
        for key, value in changes.items():
            _set(section, values[section], key, value, f"override of {section}")
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


def _scenario(values: Mapping[str, Mapping[str, Any]]) -> scenario_table.Scenario:
    """The scenario; of one that begins on the ground with what it is judged by."""
    found = scenario_table.Scenario.from_parameters(values[scenario_table.NODE_NAME])
    try:
        script_of(values["outer_loop"])
    except ParameterError as error:
        raise ParameterError(f"outer_loop: {error}") from None
    if not values["plant"]["start.on_ground"]:
        return found
    ground = PlantConfig.from_parameters(values["plant"]).kernel.aircraft.ground
    return replace(found, gear=Gear(ground, values["outer_loop"]["takeoff.height_m"]))


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
