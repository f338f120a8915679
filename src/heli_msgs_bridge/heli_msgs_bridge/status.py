# SPDX-License-Identifier: Apache-2.0
"""The state of one aircraft as programs read it, out of what its outer loop says. No ROS.

`/diagnostics` is for people and has its facts as texts. These are the same facts with their types:
of a pilot in Python, and as the message `heli_interfaces/Status`.
"""

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from heli_core.foreign_files import load_json
from heli_core.ticks import NS_PER_S
from heli_msgs_bridge.diagnostics import (
    FACT_ARMED,
    FACT_FAILSAFE,
    FACT_HOME,
    FACT_LANDED,
    FACT_MODE,
    offset_of,
)
from heli_msgs_bridge.topics import MAP

NO_FAILSAFE = "NONE"
"""Name of the action of a failsafe that does nothing (`heli_outer_pd.failsafes.Action`)."""


@dataclass(frozen=True)
class AircraftStatus:
    """What an outer loop says of its aircraft.

    Attributes
    ----------
    stamp_ns : int
        Flight time; 0 before anything was heard.
    mode : str
        Mode that is flown; `inactive` while the outer loop is; empty before anything was heard.
    ready : bool
        Whether it holds a position, in the air or on the ground, and can be commanded.
    armed, landed : bool
        Whether a take-off is obeyed; whether it stands on the ground.
    failsafe : str
        What it does by itself, a name of `heli_outer_pd.failsafes.Action`; NONE for nothing.
    home_enu_m : tuple of float or None
        Where its flight began, in `map`: east, north, up; None until that is known.
    sentence : str
        The same for people.
    """

    stamp_ns: int = 0
    mode: str = ""
    ready: bool = False
    armed: bool = False
    landed: bool = False
    failsafe: str = NO_FAILSAFE
    home_enu_m: tuple[float, float, float] | None = None
    sentence: str = ""

    @classmethod
    def of_facts(cls, stamp_ns: int, sentence: str, facts: Mapping[str, str]) -> Self:
        """Out of the facts of a status in `/diagnostics`; what is not told is as at first."""
        return cls(
            stamp_ns=stamp_ns,
            mode=facts.get(FACT_MODE, ""),
            ready=offset_of(facts) is not None,
            armed=facts.get(FACT_ARMED) == str(True),
            landed=facts.get(FACT_LANDED) == str(True),
            failsafe=facts.get(FACT_FAILSAFE, NO_FAILSAFE),
            home_enu_m=_home_of(facts),
            sentence=sentence,
        )


def _home_of(facts: Mapping[str, str]) -> tuple[float, float, float] | None:
    with contextlib.suppress(ValueError, TypeError, KeyError, OverflowError):
        north, east, down = load_json(facts[FACT_HOME])
        return float(east), float(north), -float(down)
    return None


def encode_status(message: Any, status: AircraftStatus) -> Any:
    """Fill a message of type `heli_interfaces/Status`, which is given and returned."""
    message.header.frame_id = MAP
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(status.stamp_ns, NS_PER_S)
    message.mode, message.failsafe, message.message = status.mode, status.failsafe, status.sentence
    message.ready, message.armed, message.landed = status.ready, status.armed, status.landed
    message.home_known = status.home_enu_m is not None
    if status.home_enu_m is not None:
        message.home.x, message.home.y, message.home.z = status.home_enu_m
    return message
