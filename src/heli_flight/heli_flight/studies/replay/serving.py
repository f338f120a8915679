# SPDX-License-Identifier: Apache-2.0
"""A replay served to browsers of this machine until the user, or the last of them, leaves."""

import contextlib
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from heli_flight import interrupts
from heli_live_view.access import RECORDED, Access
from heli_live_view.page_server import PageServer
from heli_live_view.replay import Replay
from heli_live_view.viewer import Viewer
from heli_live_view.web_folder import web_folder


def server_of(
    replay: Replay,
    port: int,
    beside: Mapping[str, Path],
    port_names: tuple[str, str] = ("", "--port"),
) -> PageServer:
    """A server of the replay that has not begun to serve.

    Parameters
    ----------
    replay : Replay
    port : int
        0: any free one.
    beside : mapping
        What is served beside the page, by name.
    port_names : (str, str)
        Parameter and option by which the user names the port, for the error.

    Raises
    ------
    PortError
        The port is in use or not allowed; one line.
    MissingFileError
        The page is not installed.
    """
    return PageServer(
        web_folder(), port, Access("", RECORDED), replay.hello, lambda command: None,
        lambda: Viewer(replay), beside, port_names,
    )  # fmt: skip


@contextlib.contextmanager
def served(
    replay: Replay,
    port: int,
    beside: Mapping[str, Path],
    port_names: tuple[str, str] = ("", "--port"),
) -> Iterator[PageServer]:
    """The same, serving while the block runs."""
    server = server_of(replay, port, beside, port_names)
    try:
        server.start()
        yield server
    finally:
        server.stop()


def serve(
    replay: Replay, port: int, beside: Mapping[str, Path], say: Callable[[str], None]
) -> None:
    """Serve until Ctrl-C, which is raised.

    Parameters
    ----------
    replay : Replay
    port : int
        0: any free one.
    beside : mapping
        What is served beside the page, by name.
    say : callable
        Takes a line for the user.
    """
    with served(replay, port, beside) as server:
        for note in replay.notes:
            say(f"note: {note}")
        r = replay.recording
        length_s = r.seconds(r.last_ns) - r.seconds(r.first_ns)
        say(f"replay: {server.url} ({length_s:.1f} s, {len(replay.events)} events; Ctrl-C ends it)")
        interrupts.check()
        threading.Event().wait()
