# SPDX-License-Identifier: Apache-2.0
"""Faults of a flight's processes, as a file of faults has them: killed, paused, short of time."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import yaml

from heli_parameters.entry import entries, mapping, number_of, one_of
from heli_parameters.parameters import ParameterError
from heli_parameters.rcl_dump import number

PROCESS = "process"
"""`what` of such a fault."""
NODES = ("observer", "inner_loop", "outer_loop", "plant", "recorder")
KILL, PAUSE, HOG = "kill", "pause", "hog"
KINDS = (KILL, PAUSE, HOG)
_LONGEST_S = 86400.0
_MOST_HOGS = 16
_KEYS = ("what", "node", "kind", "start_s", "duration_s", "value")


@dataclass(frozen=True)
class ProcessFault:
    """A fault of a node's process, or of all by what takes their time.

    Attributes
    ----------
    kind : str
        KILL: SIGKILL. PAUSE: SIGSTOP until its end. HOG: so many processes that are always busy.
    node : str
        One of `NODES`; empty for HOG.
    start_s, duration_s : float
        Flight time; 0 long for KILL.
    hogs : int
        Number of busy processes.
    """

    kind: str
    node: str
    start_s: float
    duration_s: float = 0.0
    hogs: int = 0

    @property
    def what(self) -> str:
        """As other faults have it."""
        return PROCESS

    @property
    def end_s(self) -> float:
        """Flight time from which on it does not act."""
        return self.start_s + self.duration_s

    @property
    def text(self) -> str:
        """The mapping that reads back as this fault."""
        return "{" + ", ".join(f"{key}: {_shown(v)}" for key, v in self.as_dict().items()) + "}"

    def as_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        said: dict[str, Any] = {"what": PROCESS, "node": self.node, "kind": self.kind,
                                "start_s": self.start_s, "duration_s": self.duration_s,
                                "value": self.hogs}  # fmt: skip
        left_out = {KILL: ("duration_s", "value"), PAUSE: ("value",), HOG: ("node",)}
        return {key: v for key, v in said.items() if key not in left_out[self.kind]}

    @property
    def words(self) -> str:
        """For people: observer kill at 20 s; inner_loop pause from 20 to 20.5 s."""
        if self.kind == KILL:
            return f"{self.node} kill at {self.start_s:g} s"
        who = f"hog by {self.hogs} processes" if self.kind == HOG else f"{self.node} pause"
        return f"{who} from {self.start_s:g} to {self.end_s:g} s"


def _shown(value: Any) -> str:
    return number(value) if isinstance(value, float) else str(value)


def is_of_process(node: yaml.Node) -> bool:
    """Whether an entry of a file of faults is about a process."""
    pairs = node.value if isinstance(node, yaml.MappingNode) else []
    return any((key.value, value.value) == ("what", PROCESS) for key, value in pairs)


def process_faults_of(texts: Iterable[str]) -> tuple[ProcessFault, ...]:
    """The faults of the parameter `process_faults`; ParameterError says what is wrong with one."""
    return entries(texts, "process_faults", _KEYS, process_fault_of)


def process_fault_of(node: yaml.Node | None, where: str) -> ProcessFault:
    """The fault of a YAML mapping; `where` begins the sentence of a ParameterError."""
    said = mapping(node, _KEYS, where)
    one_of(said, "what", (PROCESS,), where)
    kind = one_of(said, "kind", KINDS, f"{where}: of {PROCESS}")
    wanted = {KILL: ("node",), PAUSE: ("node", "duration_s"), HOG: ("duration_s", "value")}[kind]
    for key in ("node", "duration_s", "value"):
        if key in said and key not in wanted:
            raise ParameterError(f"{where}: {key}: {kind} has none; leave it out")
    start_s = number_of(said, "start_s", _LONGEST_S, where)
    name = one_of(said, "node", NODES, where) if "node" in wanted else ""
    duration_s = number_of(said, "duration_s", _LONGEST_S, where) if "duration_s" in wanted else 0.0
    hogs = 0.0
    if kind == HOG:
        hogs = number_of(said, "value", _MOST_HOGS, where)
        if hogs != int(hogs) or hogs < 1:
            raise ParameterError(
                f"{where}: value: {said['value']} is not allowed; allowed: a whole number of busy "
                f"processes from 1 to {_MOST_HOGS}"
            )
    return ProcessFault(kind, name, start_s, duration_s, int(hogs))
