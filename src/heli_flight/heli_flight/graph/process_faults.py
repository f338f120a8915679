# SPDX-License-Identifier: Apache-2.0
"""Faults of processes, done in flight and undone at its end."""

import contextlib
import os
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from heli_flight.graph.processes import NodeProcess
from heli_flight.loop.process_fault import HOG, KILL, ProcessFault

RECORDER = "recorder"
# Wall time after which a flight that does not go on is taken to wait for a recorder that is paused.
_STANDS_S = 1.0
# Long enough for a thread to leave a lock, and short beside what a pause is for.
_STEP_S = 0.02


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
    now_s, wait : callable, optional
        Wall time, s, and how to let some of it pass.

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
        now_s: Callable[[], float] = time.monotonic,
        wait: Callable[[float], None] = time.sleep,
    ) -> None:
        self._left = sorted(faults, key=lambda fault: fault.start_s)
        self._processes, self._log, self._say = processes, log, say
        self._now_s, self._wait = now_s, wait
        self._moved = (-1.0, now_s())
        self._paused: list[tuple[float, int, str]] = []
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
        self._let_out_of_locks(flight_s)

    def _let_out_of_locks(self, flight_s: float) -> None:
        """Let a paused recorder run for a moment where the flight stands still meanwhile.

        Nobody waits for it, unless it was stopped within a lock of the shared memory that senders
        want: a flight that stands still does not come to the end of the pause either.
        """
        now_s = self._now_s()
        if flight_s != self._moved[0]:
            self._moved = flight_s, now_s
        held = [pid for _, pid, node in self._paused if node == RECORDER]
        if not held or now_s - self._moved[1] < _STANDS_S:
            return
        self._moved = flight_s, now_s
        for pid in held:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)
                self._wait(_STEP_S)
                os.kill(pid, signal.SIGSTOP)

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
            self._paused.append((end_s, process.pid, fault.node))

    def _end(self, is_over: Callable[[float], bool]) -> None:
        for entry in [entry for entry in self._paused if is_over(entry[0])]:
            self._paused.remove(entry)
            with contextlib.suppress(ProcessLookupError):
                os.kill(entry[1], signal.SIGCONT)
        for busy in [busy for busy in self._busy if is_over(busy[0])]:
            self._busy.remove(busy)
            for process in busy[1]:
                process.kill()

    def undo(self) -> None:
        """End all of it: nobody stays stopped, nothing stays busy."""
        self._left.clear()
        self._end(lambda end_s: True)

    def as_dicts(self) -> list[dict[str, Any]]:
        """As JSON has it: each that was begun, with the flight time at which it was."""
        return [{**fault.as_dict(), "begun_s": round(at_s, 3)} for fault, at_s in self.done]
