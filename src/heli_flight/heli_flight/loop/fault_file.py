# SPDX-License-Identifier: Apache-2.0
"""A file of faults, as `--faults` takes it, and the faults of a flight."""

from pathlib import Path
from typing import Any

import yaml

from heli_dynamics_sim.config_error import PlantConfigError
from heli_dynamics_sim.fault_table import NONE, Fault, fault_of, faults_of
from heli_flight.loop.layers import NODES
from heli_flight.loop.settings import Settings
from heli_msgs_bridge.link_faults import WHAT as LINK
from heli_msgs_bridge.link_faults import LinkFault, link_fault_of, link_faults_of
from heli_parameters.parameters import ParameterError

_KEY, _LINKS = "faults", "link_faults"
_FORM = f"'{_KEY}:' and a list of mappings"


def fault_overrides(path: Path | None) -> dict[str, dict[str, Any]] | None:
    """What a file of faults sets, by node and parameter, as `resolve` takes it; None for no file.

    Faults of sensors, actuators and air are the plant's; those of links are told every node.

    Raises
    ------
    ParameterError
        One sentence: file and line, key, value, and what is allowed.
    """
    if path is None:
        return None
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
    links = [node for node in entries.value if _what(node) == LINK]
    others = [node for node in entries.value if _what(node) != LINK]
    try:
        found = [fault_of(node, _place(path, node)) for node in others]
        # Together they may be too many.
        faults_of(texts := _texts(found))
    except PlantConfigError as error:
        raise ParameterError(str(error)) from None
    told = _texts([link_fault_of(node, _place(path, node)) for node in links])
    link_faults_of(told)
    over: dict[str, dict[str, Any]] = {node.name: {_LINKS: told} for node in NODES}
    over["plant"][_KEY] = texts
    return over


def _what(node: yaml.Node) -> str:
    """What an entry says under `what`; empty for nothing."""
    pairs = node.value if isinstance(node, yaml.MappingNode) else []
    return next((str(value.value) for key, value in pairs if key.value == "what"), "")


def _place(path: Path, node: yaml.Node) -> str:
    return f"{path}:{node.start_mark.line + 1}"


def _texts(faults: list[Fault] | list[LinkFault]) -> tuple[str, ...]:
    return tuple(fault.text for fault in faults) or (NONE,)


def flown_faults(settings: Settings) -> tuple[Fault | LinkFault, ...]:
    """The faults that a flight is to have."""
    links = [
        fault
        for name, values in settings.nodes.items()
        for fault in link_faults_of(values[_LINKS])
        if any(sink == name for _, sink in fault.links)
    ]
    return (*faults_of(settings.nodes["plant"][_KEY]), *dict.fromkeys(links))
