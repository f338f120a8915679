# SPDX-License-Identifier: Apache-2.0
"""A process beside this one that works out what takes long. No ROS.

A thread shares Python's lock with the flight: a synthesis in it holds every tick up. This process
has a lock of its own, and pushes nobody aside who is woken up (`SCHED_BATCH`, Linux). It is started
when it is first needed, and ends with whoever started it.
"""

import contextlib
import os
import pickle
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import IO, Any

_LENGTH = struct.Struct("!Q")
_NICE = 5
# What pipes and pickle raise; a pipe that is closed in the midst of it, ValueError.
_LOST = (OSError, EOFError, pickle.PickleError, AttributeError, TypeError, ValueError)
_DONE, _REFUSED, _FAILED = "done", "refused", "failed"


class BesideError(Exception):
    """The process could not be started or has died, or what it gave cannot be handed over."""


class Beside:
    """The process; calls from several threads are made one after the other."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._one_call, self._changing = threading.Lock(), threading.Lock()
        self._closed = False

    @property
    def pid(self) -> int | None:
        """Id of the process; None where there is none."""
        process = self._process
        return None if process is None or process.poll() is not None else process.pid

    def call(self, function: Callable[..., Any], *args: Any) -> Any:
        """What a function gives, worked out in the other process.

        Parameters
        ----------
        function : callable
            Of a module's top level, that needs no other state than its arguments.
        *args : object
            Of kinds that pickle knows, as the result is.

        Raises
        ------
        ValueError
            The function refuses, in its words.
        BesideError
            Nothing is known of the result: work it out here.
        """
        with self._one_call:
            try:
                outcome, value = self._ask(pickle.dumps((function, args)))
            except _LOST as error:
                self._end()
                raise BesideError(f"{type(error).__name__}: {error}") from error
        if outcome == _REFUSED:
            raise ValueError(value)
        if outcome == _FAILED:
            raise BesideError(value)
        return value

    def close(self) -> None:
        """End the process, whatever it does; it is not started again."""
        with self._changing:
            self._closed = True
        self._end()

    def _end(self) -> None:
        with self._changing:
            process, self._process = self._process, None
        if process is None:
            return
        # It may be in the midst of something, and blocks the signals that this one blocks.
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            with contextlib.suppress(OSError):
                if pipe is not None:
                    pipe.close()

    def _started(self) -> "subprocess.Popen[bytes]":
        """The process, started if there is none; EOFError: there will be none."""
        with self._changing:
            if self._closed:
                raise EOFError("closed")
            if self._process is None or self._process.poll() is not None:
                self._process = subprocess.Popen(
                    [sys.executable, "-m", "heli_core.beside"],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    # Its share is one core's.
                    env={"OPENBLAS_NUM_THREADS": "1"} | dict(os.environ),
                )
            return self._process

    def _ask(self, request: bytes) -> tuple[str, Any]:
        process = self._started()
        assert process.stdin is not None and process.stdout is not None
        _write(process.stdin, request)
        outcome, value = pickle.loads(_read(process.stdout))
        return outcome, value


def _write(pipe: IO[bytes], content: bytes) -> None:
    pipe.write(_LENGTH.pack(len(content)) + content)
    pipe.flush()


def _read(pipe: IO[bytes]) -> bytes:
    """EOFError: the other side has ended."""
    head = pipe.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        raise EOFError("it has ended")
    (length,) = _LENGTH.unpack(head)
    content = pipe.read(length)
    if len(content) < length:
        raise EOFError("it has ended")
    return content


def _answer(request: bytes) -> bytes:
    try:
        function, args = pickle.loads(request)
        return pickle.dumps((_DONE, function(*args)))
    except ValueError as error:
        return pickle.dumps((_REFUSED, " ".join(str(error).split())))
    except Exception as error:
        return pickle.dumps((_FAILED, f"{type(error).__name__}: {error}"))


def serve(requests: IO[bytes], answers: IO[bytes]) -> None:
    """Answer one request after the other until there are no more."""
    with contextlib.suppress(EOFError, BrokenPipeError):
        while True:
            _write(answers, _answer(_read(requests)))


def main() -> int:
    """The other process: it ends when nobody asks any more, by no signal of the terminal."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(OSError):
        os.nice(_NICE)
        if hasattr(os, "SCHED_BATCH"):
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    # What a function prints must not come among the answers.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    serve(sys.stdin.buffer, answers)
    return 0


if __name__ == "__main__":
    sys.exit(main())
