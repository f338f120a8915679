# SPDX-License-Identifier: Apache-2.0
"""Nodes that are started again when they die in flight: which, how often, and when they are back.

A new process takes the place of the dead one under the same name, with the same parameters. What it
goes on from is `heli_msgs_bridge.handover`; whose messages are used then, `arrivals`.
"""

import contextlib
import fcntl
import os
import re
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

from heli_core.errors import FlightError
from heli_flight.graph.lifecycle import NodeStatus
from heli_flight.graph.processes import SHARED_MEMORY, NodeProcess, stop
from heli_flight.graph.supervisor import Supervisor
from heli_msgs_bridge.diagnostics import Level, NodeState
from heli_msgs_bridge.handover import FOLDER, note_restart

# -------------------------------------------------------------------------------------------------
# Respawn.
# -------------------------------------------------------------------------------------------------

AGAIN = ("observer", "inner_loop", "outer_loop")
"""Nodes that are started again. The plant is the world, and the recorder's bag cannot be gone on
with: without one of them the flight ends, as it does without --respawn."""
MOST, WITHIN_S = 3, 10.0
"""A node that dies so often within so many seconds of flight ends the flight."""
_MEMORY = "memory"


@dataclass
class Restart:
    """A node that was started again.

    Attributes
    ----------
    node : str
    why : str
        How it ended.
    noticed_s : float
        Flight time at which that was noticed.
    back_s : float or None
        Flight time at which its successor was heard to step; None if it never was.
    """

    node: str
    why: str
    noticed_s: float
    back_s: float | None = None

    @property
    def words(self) -> str:
        """One sentence."""
        back = (
            "not back until the end"
            if self.back_s is None
            else f"back after {self.back_s - self.noticed_s:.2f} s"
        )
        return f"{self.why} at {self.noticed_s:.2f} s: started again, {back}"

    def as_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        return {"node": self.node, "why": self.why, "noticed_s": round(self.noticed_s, 3),
                "back_s": None if self.back_s is None else round(self.back_s, 3)}  # fmt: skip


class DiesAgainError(FlightError):
    """A node that is not started again, as it died `MOST` times within `WITHIN_S`.

    Attributes
    ----------
    node : str
    why : str
        How it ended the last time.
    """

    def __init__(self, node: str, why: str) -> None:
        super().__init__(f"{why}, {MOST} times in {WITHIN_S:g} s of flight: not started again")
        self.node, self.why = node, why


class Standby:
    """A process that can become any node of `AGAIN`, at once."""

    def __init__(self, arguments: Sequence[str], log: Path, env: Mapping[str, str]) -> None:
        self._orders, theirs = Pipe()
        module = "heli_flight.graph.standby"
        self.process = NodeProcess("standby", module, arguments, log, env, theirs)
        theirs.close()

    def become(self, name: str, log: Path) -> NodeProcess:
        """Be this node from now on."""
        # Who has died meanwhile is noticed as that node.
        with contextlib.suppress(BrokenPipeError):
            self._orders.send((name, str(log.absolute()), ["-p", "autostart:=true"]))
        self.process.name, self.process.log = name, log
        return self.process


class Respawn:
    """Starts nodes again, in one flight.

    Parameters
    ----------
    folder : Path
        Of the flight; the nodes' memories lie in it until it is over.
    say : callable
        Takes a line for the user.

    Attributes
    ----------
    restarts : list of Restart
    """

    def __init__(self, folder: Path, say: Callable[[str], None]) -> None:
        self._folder, self._say = folder / _MEMORY, say
        self._logs = folder / "logs"
        self._died_s: dict[str, list[float]] = {}
        self._make: Callable[[], Standby] | None = None
        self._standby: Standby | None = None
        self.restarts: list[Restart] = []

    def environment(self) -> Mapping[str, str]:
        """What the nodes' processes are told; makes the folder of their memories."""
        self._folder.mkdir()
        return {FOLDER: str(self._folder.absolute())}

    def stand_by(self, arguments: Sequence[str], env: Mapping[str, str]) -> None:
        """Have a process stand by, and always another one when it is needed."""
        self._make = partial(Standby, arguments, self._logs / "standby.log", env)
        self._standby = self._make()

    def again(self, name: str, why: str, up: Supervisor) -> NodeProcess:
        """Start a node again that has died.

        Raises
        ------
        DiesAgainError
            It dies again and again.
        """
        # By flight time: in lockstep a flight waits, on loaded cores for long, until one is back.
        now_s = up.flight_s()
        died = self._died_s.setdefault(name, [])
        died[:] = [*(s for s in died if now_s - s < WITHIN_S), now_s]
        if len(died) >= MOST:
            raise DiesAgainError(name, why)
        assert self._make is not None and self._standby is not None, "stand_by comes first"
        up.forget(name)
        # Before the successor can say a word: what is said in DDS may come after it.
        note_restart(self._folder, name)
        process = self._standby.become(name, self._logs / f"{name}.log")
        restart = Restart(name, why, up.flight_s())
        self.restarts.append(restart)
        sentence = f"{why} at {restart.noticed_s:.2f} s: started again"
        self._say(sentence)
        up.announce(Level.WARN, sentence, {})
        self._standby = self._make()
        return process

    def look(self, up: Supervisor) -> None:
        """Notice who is back."""
        for restart in self.restarts:
            status = up.statuses.get(restart.node)
            if restart.back_s is None and status is not None and _steps(status):
                restart.back_s = up.flight_s()
                self._say(restart.words)

    def words(self) -> list[str]:
        """A sentence for each restart."""
        return [restart.words for restart in self.restarts]

    def as_dicts(self) -> list[dict[str, Any]]:
        """Restarts as JSON has them."""
        return [restart.as_dict() for restart in self.restarts]

    def close(self) -> list[str]:
        """End who stands by and remove the memories; returns who had to be killed."""
        killed = stop([self._standby.process]) if self._standby is not None else []
        shutil.rmtree(self._folder, ignore_errors=True)
        return killed


def _steps(status: NodeStatus) -> bool:
    """Whether a node says of itself what only one says that has made a step."""
    return status.state in (NodeState.RUNNING, NodeState.WITHOUT_INPUT)


# -------------------------------------------------------------------------------------------------
# What a process that was killed leaves in shared memory: Fast DDS does not take it away again.
#
# Each participant has a segment of half a megabyte, `fastrtps_` and 16 digits, and beside it a
# file
# with `_el` behind the name, on which it holds a lock (flock) for as long as it lives. Whose lock
# is
# free is dead. Ports (`fastrtps_port...`) are left to Fast DDS: the next process with the same
# number
# takes them over.
# -------------------------------------------------------------------------------------------------

_LOCK = re.compile(r"(fastrtps_[0-9a-f]{16})_el")
# Who is about to begin has its file before its lock.
_YOUNG_S = 2.0


def remove_left(folder: Path = SHARED_MEMORY, now_s: Callable[[], float] = time.time) -> list[str]:
    """Remove this user's segments whose process is dead, and their lock files.

    Parameters
    ----------
    folder : Path
        Where they are.
    now_s : callable, optional
        Time of the files' clock, s.

    Returns
    -------
    list of str
        Names of the segments.
    """
    gone = []
    for lock in sorted(folder.glob("fastrtps_*_el")):
        match = _LOCK.fullmatch(lock.name)
        # What others remove meanwhile, or did not let us have, is not ours to remove.
        with contextlib.suppress(OSError):
            if match and _is_left(lock, now_s()):
                (folder / match[1]).unlink(missing_ok=True)
                lock.unlink()
                gone.append(match[1])
    return gone


def _is_left(lock: Path, now_s: float) -> bool:
    status = lock.stat()
    # One of the future is old: the clock was set back since.
    if status.st_uid != os.getuid() or abs(now_s - status.st_mtime) < _YOUNG_S:
        return False
    descriptor = os.open(lock, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    finally:
        os.close(descriptor)
    return True
