# SPDX-License-Identifier: Apache-2.0
"""A file of faults, as `--faults` takes it, and the faults of a flight."""

from pathlib import Path
from typing import Any, NamedTuple

import yaml

from heli_dynamics_sim.config_error import PlantConfigError
from heli_dynamics_sim.fault_table import NONE, Fault, fault_of, faults_of
from heli_flight.loop.layers import NODES
from heli_flight.loop.process_fault import (
    PROCESS,
    ProcessFault,
    is_of_process,
    process_fault_of,
    process_faults_of,
)
from heli_flight.loop.settings import Settings
from heli_msgs_bridge.link_faults import WHAT as LINK
from heli_msgs_bridge.link_faults import LinkFault, link_fault_of, link_faults_of
from heli_parameters.parameters import ParameterError

_KEY, _LINKS = "faults", "link_faults"
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
    entries = _entries(path)
    of_links = [node for node in entries if _what(node) == LINK]
    of_processes = [node for node in entries if is_of_process(node)]
    others = [node for node in entries if node not in of_links and node not in of_processes]
    try:
        found = [fault_of(node, _place(path, node)) for node in others]
        # Together they may be too many.
        faults_of(texts := _texts(found))
    except PlantConfigError as error:
        raise ParameterError(str(error)) from None
    links = _texts([link_fault_of(node, _place(path, node)) for node in of_links])
    link_faults_of(links)
    process = _texts([process_fault_of(node, _place(path, node)) for node in of_processes])
    process_faults_of(process)
    over: dict[str, dict[str, Any]] = {node.name: {_LINKS: links} for node in NODES}
    over["plant"][_KEY] = texts
    return FaultsRead(over, process)


def _entries(path: Path) -> list[yaml.Node]:
    """The list of a file."""
    try:
        root = yaml.compose(path.read_text(encoding="utf-8"), Loader=yaml.SafeLoader)
    except OSError as error:
        raise ParameterError(f"{path}: cannot read faults: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ParameterError(f"{path}: cannot read faults: it is not UTF-8") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark is not None else ""
        raise ParameterError(f"{path}{line}: not valid YAML; expected {_FORM}") from None
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


def _texts(faults: list[Fault] | list[LinkFault] | list[ProcessFault]) -> tuple[str, ...]:
    return tuple(fault.text for fault in faults) or (NONE,)


def flown_faults(settings: Settings) -> tuple[Fault | LinkFault | ProcessFault, ...]:
    """The faults that a flight is to have."""
    links = [
        fault
        for name, values in settings.nodes.items()
        for fault in link_faults_of(values[_LINKS])
        if any(sink == name for _, sink in fault.links)
    ]
    plant = faults_of(settings.nodes["plant"][_KEY])
    return (*plant, *dict.fromkeys(links), *process_faults_of(settings.process_faults))
