# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C: at any time one line, exit code 130, nothing half-made.

`hover_test.sh` and `heli` start Python with the signal held back, as an interpreter that is still
starting answers with a traceback. Then it is taken in one of three ways:

- while a command's modules are loaded nothing has been made: the process ends on the spot;
- while it works: KeyboardInterrupt, once, so that what is half-made can be undone in peace; an
  import that is under way is finished first;
- once the command has ended the result stands: too late.
"""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

EXIT_CODE = 130
LINE = "interrupted"
_SOON_S = 0.01
_IMPORTING = "<frozen importlib._bootstrap>"

_interrupted = False
_held = 0
"""How many `held_back` the main thread is in."""


def _end(signum: int, frame: FrameType | None) -> None:
    """Nothing has been made yet: end now, whatever is being imported."""
    os.write(2, f"{LINE}\n".encode())
    os._exit(EXIT_CODE)


def _is_importing(frame: FrameType | None) -> bool:
    """Whether a module is being imported, in this frame or in one that it is called from."""
    while frame is not None:
        if frame.f_code.co_filename == _IMPORTING:
            return True
        frame = frame.f_back
    return False


def _raise_soon() -> None:
    signal.signal(signal.SIGALRM, _raise)
    signal.setitimer(signal.ITIMER_REAL, _SOON_S)


def _raise(signum: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt; a second Ctrl-C shall not disturb the clearing up.

    An import is finished first: a library in C++ that is being loaded may take the exception for
    the end of the process (nanobind's do: "terminate called").
    """
    global _interrupted
    _interrupted = True
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if _held or _is_importing(frame):
        _raise_soon()
        return
    raise KeyboardInterrupt


def _not_lost(unraisable: Any) -> None:
    """Raise an interrupt anew that fell into a destructor, where Python drops exceptions."""
    if isinstance(unraisable.exc_value, KeyboardInterrupt):
        _raise_soon()
    elif not _interrupted:  # what is half-made when an interrupt comes may fail to end
        sys.__unraisablehook__(unraisable)


def check() -> None:
    """Raise KeyboardInterrupt if there was one: for between two steps, should it be swallowed."""
    if _interrupted:
        raise KeyboardInterrupt


@contextmanager
def interrupts_reported() -> Iterator[None]:
    """Have what fails after a swallowed interrupt fail as that: C code may drop the exception."""
    try:
        yield
    except Exception:
        check()
        raise


@contextmanager
def held_back() -> Iterator[None]:
    """Let Ctrl-C wait for the end of a step that must be done as a whole.

    Of several threads another may take the signal, and Python then runs the handler in the main
    one, where the signal is blocked: so a handler that waits stands there meanwhile.
    """
    global _held
    came: list[int] = []
    handler = signal.getsignal(signal.SIGINT)
    ours = handler is not None and threading.current_thread() is threading.main_thread()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    if ours:
        _held += 1
        signal.signal(signal.SIGINT, lambda *_: came.append(signal.SIGINT))
    try:
        yield
    finally:
        # Changing nothing, it runs the handler if another thread has taken the signal: Python does
        # not tell the main thread of that.
        signal.pthread_sigmask(signal.SIG_BLOCK, ())
        if ours:
            signal.signal(signal.SIGINT, handler)
            _held -= 1
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if came:
            signal.raise_signal(signal.SIGINT)


def take() -> None:
    """Take Ctrl-C if it was held back when this process was started."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def run(load: Callable[[], Callable[[], int]]) -> int:
    """Run a command; returns its exit code.

    Parameters
    ----------
    load : callable
        Imports the command and gives the function that runs it.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # in the background of a shell
        take()
        return load()()
    signal.signal(signal.SIGINT, _end)
    take()
    command = load()
    sys.unraisablehook = _not_lost
    try:
        signal.signal(signal.SIGINT, _raise)
        with interrupts_reported():
            return command()
    except KeyboardInterrupt:
        print(LINE, file=sys.stderr)
        return EXIT_CODE
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        # One that was put off would come when nobody takes it any more.
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        # If the exception has passed through an exec(), Python would end by the signal, not with
        # the code; the next exec() makes it forget.
        exec("")
