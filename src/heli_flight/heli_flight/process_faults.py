# SPDX-License-Identifier: Apache-2.0
"""Faults of a flight's processes, as a file has them: killed, paused, short of time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import yaml

from heli_core.errors import ParameterCause
from heli_core.faults import (
    LONGEST_S,
    Fault,
    FaultEntry,
    FaultKind,
    entries,
    flow_mapping,
)

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
