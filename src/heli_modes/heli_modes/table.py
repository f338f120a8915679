# SPDX-License-Identifier: Apache-2.0
"""The table: from which phase which event leads where, under which guards, or why it does not.

Each pair of phase and command stands in it once, so nothing is refused for want of a row. Facts are
what is measured; where a fact has no row it changes nothing.
"""

from dataclasses import dataclass
from enum import Enum, StrEnum


class Phase(StrEnum):
    """What the aircraft does; `mode` is what people call it."""

    STANDING = "standing"
    SPOOLING = "spooling"
    LIFTING = "lifting"
    CLIMBING = "climbing"
    HOVER = "hover"
    TRAJECTORY = "trajectory"
    HALTING = "halting"
    DESCENDING = "descending"
    SETTLING = "settling"

    @property
    def mode(self) -> str:
        """The mode that it is a part of: takeoff and land have three phases each."""
        return _MODES.get(self, self.value)

    @property
    def on_ground(self) -> bool:
        """True where the skids carry the aircraft, or a part of it."""
        return self in ON_GROUND


ON_GROUND = (Phase.STANDING, Phase.SPOOLING, Phase.LIFTING, Phase.SETTLING)
TAKING_OFF = (Phase.SPOOLING, Phase.LIFTING, Phase.CLIMBING)
LANDING = (Phase.HALTING, Phase.DESCENDING, Phase.SETTLING)
FLYING = (Phase.HOVER, Phase.TRAJECTORY)
_MODES = {
    **dict.fromkeys(TAKING_OFF, "takeoff"),
    **dict.fromkeys(LANDING, "land"),
}


class Command(StrEnum):
    """What a pilot may ask for; `names` are the words for it."""

    TAKEOFF = "takeoff"
    LAND = "land"
    HOLD = "hold"
    GOTO = "goto"
    FOLLOW = "follow"

    @property
    def names(self) -> tuple[str, ...]:
        """Its own name, and that of the mode that it leads to."""
        return (self.value, *_ALSO.get(self, ()))


_ALSO = {Command.HOLD: ("hover",), Command.FOLLOW: ("trajectory",)}


class Fact(StrEnum):
    """What has happened, by measured values."""

    SPOOLED_UP = "rotor at speed"
    LIGHT = "light on the skids"
    ARRIVED = "arrived"
    STUCK = "does not lift"
    TIPPING = "tips over a skid"
    BLIND = "position lost"
    TOUCHED_DOWN = "touched down"
    IDLE = "collective idle"


class Guard(Enum):
    """What must be so for a command; the value is the reason if it is not."""

    NAVIGATION = "there is no position estimate"
    UPRIGHT = "the aircraft is outside the envelope: it stands tilted more than is allowed"
    UNSATURATED = "an actuator is saturated: the collective is at its limit"
    CLEAR = "the ground is too near"


@dataclass(frozen=True)
class Transition:
    """A row that leads somewhere.

    Attributes
    ----------
    sources : tuple of Phase
    event : Command or Fact
    target : Phase
    guards : tuple of Guard
        All must hold; the first one that does not is the reason.
    """

    sources: tuple[Phase, ...]
    event: Command | Fact
    target: Phase
    guards: tuple[Guard, ...] = ()


@dataclass(frozen=True)
class Refused:
    """A row that leads nowhere: a command that means nothing in these phases, and why."""

    sources: tuple[Phase, ...]
    event: Command
    reason: str


_AIRBORNE = (*FLYING, Phase.HALTING, Phase.DESCENDING)
_GROUNDED = "the aircraft is on the ground: take off first"

TABLE: tuple[Transition | Refused, ...] = (
    Transition((Phase.STANDING,), Command.TAKEOFF, Phase.SPOOLING,
               (Guard.NAVIGATION, Guard.UPRIGHT)),
    Refused(TAKING_OFF, Command.TAKEOFF, "the aircraft is taking off already"),
    Refused(_AIRBORNE, Command.TAKEOFF, "the aircraft is in the air already"),
    Refused((Phase.SETTLING,), Command.TAKEOFF, "the aircraft has just touched down: wait until "
            "it stands"),
    Transition((Phase.SPOOLING,), Fact.SPOOLED_UP, Phase.LIFTING),
    Transition((Phase.SPOOLING,), Fact.BLIND, Phase.STANDING),
    Transition((Phase.LIFTING,), Fact.LIGHT, Phase.CLIMBING),
    Transition((Phase.LIFTING, Phase.CLIMBING), Fact.TIPPING, Phase.SETTLING),
    Transition((Phase.LIFTING,), Fact.BLIND, Phase.SETTLING),
    Transition((Phase.CLIMBING,), Fact.STUCK, Phase.SETTLING),
    Transition((Phase.CLIMBING,), Fact.ARRIVED, Phase.HOVER),
    Transition((*FLYING, Phase.HALTING), Command.HOLD, Phase.HOVER, (Guard.NAVIGATION,)),
    Transition((Phase.CLIMBING, Phase.DESCENDING), Command.HOLD, Phase.HOVER,
               (Guard.NAVIGATION, Guard.CLEAR)),
    Refused(ON_GROUND, Command.HOLD, _GROUNDED),
    Transition(FLYING, Command.GOTO, Phase.TRAJECTORY, (Guard.NAVIGATION, Guard.UNSATURATED)),
    Refused(ON_GROUND, Command.GOTO, _GROUNDED),
    Refused((Phase.CLIMBING,), Command.GOTO, "the aircraft is taking off: wait until it hovers, "
            "or hold"),
    Refused((Phase.HALTING, Phase.DESCENDING), Command.GOTO, "the aircraft is landing: hold first"),
    Transition(FLYING, Command.FOLLOW, Phase.TRAJECTORY, (Guard.NAVIGATION,)),
    Refused(ON_GROUND, Command.FOLLOW, _GROUNDED),
    Refused((Phase.CLIMBING,), Command.FOLLOW, "the aircraft is taking off: wait until it hovers, "
            "or hold"),
    Refused((Phase.HALTING, Phase.DESCENDING), Command.FOLLOW, "the aircraft is landing: hold "
            "first"),
    Transition((Phase.TRAJECTORY,), Fact.ARRIVED, Phase.HOVER),
    Transition((Phase.CLIMBING, *FLYING), Command.LAND, Phase.HALTING, (Guard.NAVIGATION,)),
    Transition((Phase.SPOOLING,), Command.LAND, Phase.STANDING),
    Transition((Phase.LIFTING,), Command.LAND, Phase.SETTLING),
    Refused((Phase.STANDING,), Command.LAND, "the aircraft has landed already"),
    Refused(LANDING, Command.LAND, "the aircraft is landing already"),
    Transition((Phase.HALTING,), Fact.ARRIVED, Phase.DESCENDING),
    Transition((Phase.DESCENDING,), Fact.TOUCHED_DOWN, Phase.SETTLING),
    Transition((Phase.SETTLING,), Fact.IDLE, Phase.STANDING),
)  # fmt: skip
"""Every transition and every refusal."""
