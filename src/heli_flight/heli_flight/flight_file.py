# SPDX-License-Identifier: Apache-2.0
"""The params.yaml of a flight: what it was, every parameter of it, and how to fly it again."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from heli_bags.parameters import NODE_NAME as RECORDER
from heli_core.faults import NONE, Fault, check_count, fault_of, faults_of
from heli_core.foreign_files import FileCause, FileError, compose_yaml, read_text
from heli_core.rcl_yaml import ParameterError, dump_all, file_refusal
from heli_flight.layers import AUTOPILOTS, FLIGHT_SECTION, NODES, SHORT_FOR, Reader, layered
from heli_flight.process_faults import PROCESS, process_fault_of, process_faults_of
from heli_flight.scenario import NODE_NAME as SCENARIO
from heli_flight.settings import Settings, sources_commit
from heli_flight.worlds import DRAWN, WORLD_SECTION
from heli_msgs_bridge.links import WHAT as LINK
from heli_msgs_bridge.links import link_fault_of, link_faults_of

# -------------------------------------------------------------------------------------------------
# A file of faults, as `--faults` takes it, and the faults of a flight.
# -------------------------------------------------------------------------------------------------

_KEY, _LINKS, _PROCESSES = "faults", "link_faults", "process_faults"
# Per `what` the parameter that it goes to and who reads it; all else is the plant's.
_READERS: dict[str, tuple[str, Callable[[yaml.Node, str], Fault]]] = {
    LINK: (_LINKS, link_fault_of),
    PROCESS: (_PROCESSES, process_fault_of),
}
NO_PROCESSES = "needs the ROS graph with a process for each node, of one aircraft"
_FORM = f"'{_KEY}:' and a list of mappings"


class FaultsRead(NamedTuple):
    """What a file of faults sets.

    `nodes`: by node and parameter, as `resolve` takes it; faults of sensors, actuators and air are
    the plant's, those of links are told every node. `process`: of the flight; None for no file.
    """

    nodes: dict[str, dict[str, Any]] | None
    process: tuple[str, ...] | None


def fault_overrides(path: Path | None) -> dict[str, dict[str, Any]] | None:
    """What a file sets by node and parameter, for a flight without processes; None for no file.

    Raises
    ------
    ParameterError
        One sentence: file and line, key, value, and what is allowed.
    """
    read = read_faults(path)
    if read.process is not None and read.process != (NONE,):
        raise ParameterError(f"{path}: what: {PROCESS}: {NO_PROCESSES}")
    return read.nodes


def read_faults(path: Path | None) -> FaultsRead:
    """All faults of a file; raises as `fault_overrides`, but for those of processes."""
    if path is None:
        return FaultsRead(None, None)
    groups: dict[str, list[Fault]] = {_KEY: [], _LINKS: [], _PROCESSES: []}
    for node in _entries(path):
        group, read_one = _READERS.get(_what(node), (_KEY, fault_of))
        groups[group].append(read_one(node, _place(path, node)))
    for group, faults in groups.items():
        check_count(group, len(faults))
    texts, links, process = map(_texts, groups.values())
    over: dict[str, dict[str, Any]] = {node.name: {_LINKS: links} for node in NODES}
    over["plant"][_KEY] = texts
    return FaultsRead(over, process)


def _entries(path: Path) -> list[yaml.Node]:
    """The list of a file."""
    try:
        root = compose_yaml(read_text(path), path)
    except FileError as error:
        refused = file_refusal(error, path, "faults")
        if error.cause == FileCause.SYNTAX:
            refused.problem = f"not valid YAML; expected {_FORM}"
        raise refused from None
    pairs = root.value if isinstance(root, yaml.MappingNode) else []
    entries = pairs[0][1] if [key.value for key, _ in pairs] == [_KEY] else None
    if not isinstance(entries, yaml.SequenceNode):
        raise ParameterError(f"{path}: expected {_FORM}")
    return entries.value


def _what(node: yaml.Node) -> str:
    """What an entry says under `what`; empty for nothing."""
    pairs = node.value if isinstance(node, yaml.MappingNode) else []
    return next((str(value.value) for key, value in pairs if key.value == "what"), "")


def _place(path: Path, node: yaml.Node) -> str:
    return f"{path}:{node.start_mark.line + 1}"


def _texts(faults: Iterable[Fault]) -> tuple[str, ...]:
    return tuple(fault.text for fault in faults) or (NONE,)


def flown_faults(settings: Settings) -> tuple[Fault, ...]:
    """The faults that a flight is to have."""
    links = [
        fault
        for name, values in settings.nodes.items()
        for fault in link_faults_of(values[_LINKS])
        if any(sink == name for _, sink in fault.links)
    ]
    plant = faults_of(settings.nodes["plant"][_KEY])
    return (*plant, *dict.fromkeys(links), *process_faults_of(settings.process_faults))


# -------------------------------------------------------------------------------------------------
# Flight file.
# -------------------------------------------------------------------------------------------------

NAME = "params.yaml"
_LONGEST = 60
# Decided by the flight itself, or by the scenario: no change of its own.
_DERIVED = {*SHORT_FOR.values(), ("plant", "duration_s")}
_OF_FLIGHT = ("lockstep", "link_seed")
_DERIVED |= {("plant", "initial.pos_ned_m"), ("plant", "initial.psi_deg")}


@dataclass(frozen=True)
class ParameterChange:
    """A parameter unlike the packaged one of scenario, receiver, world and control preset."""

    section: str
    key: str
    value: Any
    packaged: Any

    @property
    def name(self) -> str:
        """Section and key in one word."""
        return f"{self.section}.{self.key}"

    def __str__(self) -> str:
        return (
            f"{self.section}: {self.key}: {_short(self.value)} (packaged: {_short(self.packaged)})"
        )


def _short(value: Any) -> str:
    text = str(value.tolist() if isinstance(value, np.ndarray) else value)
    return text if len(text) <= _LONGEST else f"{np.size(value)} numbers"


def sections(settings: Settings) -> dict[str, Mapping[str, Any]]:
    """Parameters by section: the nodes, scenario, world, recorder."""
    return {
        **settings.nodes,
        SCENARIO: settings.scenario_parameters,
        WORLD_SECTION: settings.world_parameters,
        RECORDER: settings.recorder,
    }


def packaged(settings: Settings) -> Mapping[str, Mapping[str, Any]]:
    """Packaged parameters by section, of scenario, receiver, world, control preset and seed."""
    return layered(
        Reader(),
        settings.scenario_name,
        settings.gps,
        settings.world,
        seed=settings.seed,
        laws=settings.laws,
    ).values


def own_parameters(settings: Settings) -> dict[tuple[str, str], Any]:
    """Parameters by section and key; without seed, controller, length, mode and what these set."""
    return {
        (section, key): value
        for section, values in sections(settings).items()
        for key, value in values.items()
        if key not in _OF_FLIGHT and (section, key) not in _DERIVED
    }


def changes(settings: Settings) -> list[ParameterChange]:
    """What the flight has changed; seed, controller, length and mode are told apart from it."""
    before = packaged(settings)
    return [
        ParameterChange(section, key, value, before[section][key])
        for (section, key), value in own_parameters(settings).items()
        if not np.array_equal(value, before[section][key])
    ]


def drawn(settings: Settings) -> dict[str, float | int]:
    """What of the aircraft a world may draw, as it was flown; empty in a world that draws nothing.

    Per parameter of the plant: `scale.*`, `delay_ticks`.
    """
    if not any(settings.world_parameters[name] for name in settings.world_parameters
               if name.startswith("draw.")):  # fmt: skip
        return {}
    return {key: settings.nodes["plant"][key] for key in DRAWN}


def drawn_words(settings: Settings) -> str:
    """The same in words, on one line."""
    parts = [
        f"{key.removeprefix('scale.').replace('_', ' ')} {value:.3f}"
        for key, value in drawn(settings).items()
        if key != "delay_ticks"
    ]
    delay = settings.nodes["plant"]["delay_ticks"]
    unit = "tick" if delay == 1 else "ticks"
    return f"true aircraft / design model: {', '.join(parts)}; delay {delay} {unit}"


def custom_data(settings: Settings) -> list[str]:
    """What a bag's metadata say of the flight, each as `name: text`."""
    facts = {
        "scenario": settings.scenario_name,
        "gps": settings.gps,
        "seed": settings.seed,
        "world": settings.world,
        "laws": settings.laws,
        **drawn(settings),
    }
    faults = flown_faults(settings)
    if faults:
        facts["faults"] = "; ".join(fault.words for fault in faults)
    return [f"{name}: {value}" for name, value in facts.items()]


def identity(settings: Settings, changed: Sequence[ParameterChange]) -> dict[str, Any]:
    """The section `flight`: what makes this flight this one; `changed` as of `changes`."""
    broken = settings.process_faults
    return {
        "scenario": settings.scenario_name,
        "gps": settings.gps,
        "world": settings.world,
        "laws": settings.laws,
        "mode": settings.mode,
        **({} if broken == (NONE,) else {"process_faults": broken}),
        "seed": settings.seed,
        "controller": settings.nodes["inner_loop"]["controller"],
        "duration_s": settings.scenario_parameters["duration_s"],
        "commit": sources_commit(),
        "changed": tuple(change.name for change in changed),
    }


def write_parameters(settings: Settings, path: Path) -> None:
    """Write the file that flies the same flight again.

    Raises
    ------
    ParameterError
        The file cannot be written.
    """
    changed = changes(settings)
    flight = identity(settings, changed)
    kind = f"{settings.scenario_name}, {settings.gps} GPS, "
    kind += f"world {settings.world}, control preset {settings.laws}"
    of_package = f"the packaged parameters of {kind}"
    command = f"./heli {settings.mode}" if settings.mode in AUTOPILOTS else "./hover_test.sh"
    head = [
        f"A flight, all of its parameters; flown again by: {command} --params <this file>",
        f"{kind}, seed {settings.seed}, {flight['controller']}, {flight['duration_s']:g} s, "
        f"{settings.mode}",
        *([drawn_words(settings)] if drawn(settings) else []),
        f"sources: commit {flight['commit']}",
        f"changed from {of_package}:" if changed else f"nothing was changed from {of_package}",
        *(f"  {change}" for change in changed),
    ]
    # rcl does not take an empty array.
    flight["changed"] = flight["changed"] or ("none",)
    dump_all({FLIGHT_SECTION: flight, **sections(settings)}, path, head)
