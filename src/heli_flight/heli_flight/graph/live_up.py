# SPDX-License-Identifier: Apache-2.0
"""Brings up a flight's live view, says where to look, and waits for who wants to see the start."""

from collections.abc import Callable, Mapping

from lifecycle_msgs.msg import Transition

from heli_flight.graph.live import LiveView, addresses, viewers
from heli_flight.graph.supervisor import BringUpError, Supervisor
from heli_live_view.parameter_table import NODE_NAME as LIVE

_LIMIT_S = 60.0


def _facts(up: Supervisor) -> Mapping[str, str]:
    status = up.statuses.get(LIVE)
    return status.facts if status else {}


def bring_up_live(
    up: Supervisor, live: LiveView, say: Callable[[str], None], check: Callable[[], None]
) -> None:
    """Serve before anything flies, and say where.

    Raises
    ------
    BringUpError
        The view refused, or does not say where it serves.
    """
    for step in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
        up.transition([LIVE], step, _LIMIT_S, check)
    if not up.wait_until(lambda: "page" in _facts(up), _LIMIT_S, check):
        raise BringUpError(f"{LIVE}: has not said where the page is")
    for line in addresses(_facts(up), live):
        say(line)


def wait_for_viewer(
    up: Supervisor, live: LiveView, say: Callable[[str], None], check: Callable[[], None]
) -> None:
    """Wait for the first browser, if that was asked for, up to the parameter's limit."""
    if not live.wait or viewers(_facts(up)):
        return
    limit_s = live.parameters["viewer_limit_s"]
    say(f"waiting for a browser, at most {limit_s:g} s (viewer_limit_s); Ctrl-C ends it")
    if up.wait_until(lambda: viewers(_facts(up)) > 0, limit_s, check):
        say("a browser looks: the flight begins")
    else:
        say(f"no browser has come within {limit_s:g} s: the flight begins")
