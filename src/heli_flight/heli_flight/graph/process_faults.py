# SPDX-License-Identifier: Apache-2.0
"""Faults of processes, done in flight and undone at its end."""

import contextlib
import os
import signal
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from heli_flight.graph.processes import NodeProcess
from heli_flight.loop.process_fault import HOG, KILL, ProcessFault


class ProcessFaults:
    """Kills, pauses and hogs of a flight, by its time.

    Parameters
    ----------
    faults : sequence of ProcessFault
    processes : mapping
        The flight's, by name; looked at anew each time.
    log : Path
        Gets what busy processes write.
    say : callable
        Takes a line for the user.

    Attributes
    ----------
    done : list of (ProcessFault, float)
        What was begun, and at which flight time, s.
    """

    def __init__(
        self,
        faults: Sequence[ProcessFault],
        processes: Mapping[str, NodeProcess],
        log: Path,
        say: Callable[[str], None],
    ) -> None:
        self._left = sorted(faults, key=lambda fault: fault.start_s)
        self._processes, self._log, self._say = processes, log, say
        self._paused: list[tuple[float, int]] = []
        self._killed: set[int] = set()
        self._busy: list[tuple[float, list[NodeProcess]]] = []
        self.done: list[tuple[ProcessFault, float]] = []

    def look(self, flight_s: float) -> None:
        """Begin and end what is due; what is due of a node that is dead waits for its successor."""
        for fault in [fault for fault in self._left if fault.start_s <= flight_s]:
            if not self._is_there(fault):
                continue
            self._left.remove(fault)
            self._begin(fault, fault.duration_s + flight_s)
            self.done.append((fault, flight_s))
            self._say(f"fault: {fault.words}")
        self._end(lambda end_s: end_s <= flight_s)

    def _is_there(self, fault: ProcessFault) -> bool:
        """Whether it can be done: in lockstep two kills may be due before the first is noticed."""
        process = self._processes.get(fault.node)
        return process is None or (process.exit_code() is None and process.pid not in self._killed)

    def _begin(self, fault: ProcessFault, end_s: float) -> None:
        if fault.kind == HOG:
            module = "heli_flight.graph.hog"
            self._busy.append(
                (end_s, [NodeProcess("hog", module, [], self._log, {}) for _ in range(fault.hogs)])
            )
            return
        process = self._processes.get(fault.node)
        if process is None:
            return
        number = signal.SIGKILL if fault.kind == KILL else signal.SIGSTOP
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, number)
        if fault.kind == KILL:
            self._killed.add(process.pid)
        else:
            self._paused.append((end_s, process.pid))

    def _end(self, is_over: Callable[[float], bool]) -> None:
        for end_s, pid in list(self._paused):
            if is_over(end_s):
                self._paused.remove((end_s, pid))
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGCONT)
        for entry in list(self._busy):
            if is_over(entry[0]):
                self._busy.remove(entry)
                for process in entry[1]:
                    process.kill()

    def undo(self) -> None:
        """End all of it: nobody stays stopped, nothing stays busy."""
        self._left.clear()
        self._end(lambda end_s: True)

    def as_dicts(self) -> list[dict[str, Any]]:
        """As JSON has it: each that was begun, with the flight time at which it was."""
        return [{**fault.as_dict(), "begun_s": round(at_s, 3)} for fault, at_s in self.done]
