# SPDX-License-Identifier: Apache-2.0
"""What the browsers are told: greeting, the state, its past, events. No ROS."""

import json
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from heli_live_view.access import VIEW_ONLY
from heli_live_view.faults import WHAT
from heli_live_view.history import History
from heli_live_view.live_state import LiveState
from heli_live_view.page_server import Command
from heli_live_view.parameter_table import COMMAND_LIMITS
from heli_live_view.vehicle import bounds

if TYPE_CHECKING:
    from heli_live_view.ros_commands import Commander

STATE_HZ = 30
"""States that a browser gets per second."""
_EVENTS_KEPT = 200


def compact(content: Any) -> str:
    """JSON without blanks; a number that is not finite is null."""
    try:
        return json.dumps(content, separators=(",", ":"), allow_nan=False)
    except ValueError:
        return json.dumps(_finite(content), separators=(",", ":"), allow_nan=False)


def _finite(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def greeting(values: Mapping[str, Any], commands: bool) -> dict[str, Any]:
    """What a connection is told first of flight and aircraft, by the live view's parameters.

    Parameters
    ----------
    values : mapping
        Parameters of the node `live_view`.
    commands : bool
        Whether commands are admitted.
    """
    return {
        "type": "hello",
        "commands": commands,
        "flight": {
            "scenario": values["flight.scenario"],
            "seed": values["flight.seed"] if values["flight.seed"] >= 0 else None,
            "duration_s": values["flight.duration_s"] or None,
            "realtime": not values["lockstep"],
        },
        "aircraft": {
            "name": values["aircraft.name"],
            "rotor_radius_m": values["aircraft.rotor_radius_m"],
        },
        "bounds": bounds(values),
        "faults": WHAT,
        "limits": {name.partition(".")[2]: values[name] for name in COMMAND_LIMITS},
        "foxglove_url": None,
        "state_hz": STATE_HZ,
    }


class Screen:
    """What the browsers are told: the state, its past, events; commands that come back.

    Parameters
    ----------
    values : mapping
        Parameters of the node.
    start_ns : int
        Message stamp of tick 0.
    commands : bool
        Whether commands are admitted.

    Attributes
    ----------
    live : LiveState
    foxglove_url : str or None
        Where Foxglove is served, once it is.
    commander : Commander or None
        Who carries commands out, once there is one.
    """

    def __init__(self, values: Mapping[str, Any], start_ns: int, commands: bool) -> None:
        self._values, self._commands = values, commands
        self._history, self._past_events = History(), list[dict[str, Any]]()
        windows_s = values["flight.windows_s"].ravel().tolist()
        self.live = LiveState(start_ns, values["stale_s"], windows_s)
        self.foxglove_url: str | None = None
        self.commander: Commander | None = None

    def hello(self) -> str:
        """First message of a connection; called by the page server's thread."""
        head = greeting(self._values, self._commands) | {
            "foxglove_url": self.foxglove_url,
            "after": self._values["flight.report"],
            "events": list(self._past_events),
        }
        return f'{compact(head)[:-1]},"history":[{",".join(list(self._history.rows))}]}}'

    def obey(self, command: Command) -> None:
        """Called by the page server's thread, for commands of the token's owner only."""
        if self.commander is None:
            command.reply(False, VIEW_ONLY)
        else:
            self.commander.put(command)

    def row(self, wall_s: float) -> dict[str, Any]:
        """The present state, kept for those who come later."""
        row = self.live.row(wall_s)
        time_s = row["t"]
        if time_s is not None and self._history.wants(time_s):
            self._history.add(time_s, compact({**row, "nodes": {}, "alarms": [], "largest": None}))
        return row

    def events(self) -> list[dict[str, Any]]:
        """Messages of what has happened since the last call."""
        messages = [event.message() for event in self.live.take_events()]
        self._past_events += messages
        del self._past_events[:-_EVENTS_KEPT]
        return messages

    def begin_anew(self) -> None:
        """Another flight: forget the past one."""
        self._history.clear()
        self._past_events.clear()
