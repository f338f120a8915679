# SPDX-License-Identifier: Apache-2.0
"""After a live flight: who watched it gets report and replay, at the same address."""

import contextlib
import threading
import time
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

from heli_flight.graph.live import LiveView, viewers

# A browser comes back within a second or two, one in a hidden tab later.
_BACK_S = 10.0
# A page that is loaded anew is away for a moment.
_AWAY_S = 3.0
_LOOK_S = 0.2


def serve_after(folder: Path, live: LiveView, say: Callable[[str], None]) -> None:
    """Serve report and replay while somebody looks who has watched the flight to its end.

    Nobody waits for it: without a browser it returns at once. Ctrl-C ends it and nothing else, as
    the flight is over and written.

    Parameters
    ----------
    folder : Path
        Of the flight.
    live : LiveView
    say : callable
        Takes a line for the user.
    """
    stay_s, address = live.parameters["stay_s"], live.told.get("page", "")
    if not (viewers(live.told) and stay_s and address):
        return
    with contextlib.suppress(KeyboardInterrupt):
        try:
            _serve(folder, urlsplit(address).port or 0, stay_s, say)
        except (OSError, ValueError) as error:
            say(f"the page is not served any more: {error}")


def _serve(folder: Path, port: int, stay_s: float, say: Callable[[str], None]) -> None:
    # Only who is watched needs all this.
    from heli_flight.studies.replay.opened import replay_of
    from heli_flight.studies.replay.serving import served

    replay, beside = replay_of(folder, at_end=True)
    with served(replay, port, beside, ("port", "--live-port")) as server:
        say(f"report and replay: {server.url} (while the page is open; Ctrl-C ends it)")
        if not server.came.wait(_BACK_S):
            return
        begun_s = seen_s = time.monotonic()
        pause = threading.Event()
        while (now_s := time.monotonic()) - seen_s < _AWAY_S and now_s - begun_s < stay_s:
            if server.viewers:
                seen_s = now_s
            pause.wait(_LOOK_S)
