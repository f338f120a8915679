# SPDX-License-Identifier: Apache-2.0
"""What a call that takes long says of itself."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from heli_flight.terminal import console

PATIENCE_S = 2.0
"""So long nothing is said."""


@contextmanager
def told_when_long(
    what: str, quiet: bool = False, after_s: float = PATIENCE_S
) -> Iterator[Callable[[str], None]]:
    """Gives a function that takes what comes next; it is said on stderr once the call is long.

    Parameters
    ----------
    what : str
        The call.
    quiet : bool
        True: nothing is said.
    after_s : float
        So long nothing is said; then what is under way, and each that follows.
    """
    if quiet:
        yield lambda _: None
        return
    out, lock = console(stderr=True), threading.Lock()
    now, long = [""], threading.Event()

    def say() -> None:
        if now[0]:
            out.print(f"{what}: {now[0]} ...", highlight=False, soft_wrap=True, markup=False)

    def begin_to_say() -> None:
        with lock:
            long.set()
            say()

    def tell(step: str) -> None:
        with lock:
            now[0] = step
            if long.is_set():
                say()

    timer = threading.Timer(after_s, begin_to_say)
    timer.daemon = True
    timer.start()
    try:
        yield tell
    finally:
        timer.cancel()
