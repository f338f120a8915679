# SPDX-License-Identifier: Apache-2.0
"""The table: from which phase which event leads where, under which guards, or why it does not.

Each pair of phase and command stands in it once, so nothing is refused for want of a row. Facts are
what is measured; where a fact has no row it changes nothing.
"""

import difflib
from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum, StrEnum

# -------------------------------------------------------------------------------------------------
# Table.
# -------------------------------------------------------------------------------------------------


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
    AUTOROTATING = "autorotating"
    VELOCITY = "velocity"
    ATTITUDE = "attitude"
    MANUAL = "manual"

    @property
    def mode(self) -> str:
        """The mode that it is a part of: takeoff has three phases, land four."""
        return _MODES.get(self, self.value)

    @property
    def on_ground(self) -> bool:
        """True where the skids carry the aircraft, or a part of it."""
        return self in ON_GROUND


ON_GROUND = (Phase.STANDING, Phase.SPOOLING, Phase.LIFTING, Phase.SETTLING)
TAKING_OFF = (Phase.SPOOLING, Phase.LIFTING, Phase.CLIMBING)
LANDING = (Phase.HALTING, Phase.DESCENDING, Phase.SETTLING, Phase.AUTOROTATING)
GUIDED = (Phase.HOVER, Phase.TRAJECTORY, Phase.VELOCITY)
"""In the air along a reference."""
STEERED = (Phase.ATTITUDE, Phase.MANUAL)
"""By a pilot's sticks, or an attitude that is commanded. By hand the aircraft may stand on the
ground, too."""
FLYING = (*GUIDED, *STEERED)
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
    VELOCITY = "velocity"
    ATTITUDE = "attitude"
    MANUAL = "manual"

    @property
    def names(self) -> tuple[str, ...]:
        """Its own name, and that of the mode that it leads to."""
        return (self.value, *_ALSO.get(self, ()))


_ALSO = {Command.HOLD: ("hover",), Command.FOLLOW: ("trajectory",)}

SERVED = {
    Command.HOLD: "hold",
    Command.TAKEOFF: "takeoff",
    Command.LAND: "land",
    Command.VELOCITY: "mode/velocity",
    Command.ATTITUDE: "mode/attitude",
    Command.MANUAL: "mode/manual",
}
"""Commands without an argument, and their services: `std_srvs/Trigger`."""


class Fact(StrEnum):
    """What has happened, by measured values."""

    SPOOLED_UP = "rotor at speed"
    LIGHT = "light on the skids"
    ARRIVED = "arrived"
    STUCK = "does not lift"
    TIPPING = "tips over a skid"
    BLIND = "position lost"
    BLIND_LONG = "position lost for long"
    FOUND = "position found again"
    TOUCHED_DOWN = "touched down"
    IDLE = "collective idle"
    SILENT = "nothing commanded for too long"
    FENCED = "outside the fence"
    ROTOR_SLOW = "rotor slow"
    ROTOR_BACK = "rotor at speed again"


class Guard(Enum):
    """What must be so for a command; the value is the reason if it is not."""

    NAVIGATION = "there is no position estimate"
    LEVEL = "neither attitude nor altitude is known"
    UPRIGHT = "the aircraft is outside the envelope: it stands tilted more than is allowed"
    UNSATURATED = "an actuator is saturated: the collective is at its limit"
    CLEAR = "the ground is too near"
    ENVELOPE = (
        "the aircraft is outside the envelope: its tilt is more than the controller may command"
    )
    STICKS = "no sticks are heard"
    HEARD = "neither sticks nor an attitude are heard"
    FENCE = "the aircraft is outside the fence: it is coming back"
    LOWERED = "the collective stick is not at its lower end"


class RefusalCause(Enum):
    """Why a command or a reference is not followed; a guard that fails is a cause, too."""

    TAKING_OFF = "the aircraft is taking off already"
    AIRBORNE = "the aircraft is in the air already"
    PILOT_TAKES_OFF = "the aircraft is flown by hand: the pilot takes off"
    TOUCHED_DOWN = "the aircraft has just touched down: wait until it stands"
    GROUNDED = "the aircraft is on the ground: take off first"
    RISING = "the aircraft is taking off: wait until it hovers, or hold"
    SINKING = "the aircraft is landing: hold first"
    AUTOROTATING = "the rotor is slow: the aircraft lands without its engine"
    COLLECTIVE_RISES = "the collective is being raised: wait until it climbs, or land"
    COLLECTIVE_SINKS = "the collective is being lowered: wait until it stands"
    LANDED = "the aircraft has landed already"
    LANDING = "the aircraft is landing already"
    UNKNOWN_MODE = "no such mode"
    DISARMED = "the aircraft is disarmed"
    PILOT_STEERS = "the pilot's sticks fly the attitude"
    NO_ATTITUDE = "no commanded attitude is flown"
    INACTIVE = "outer_loop is not active; activate it first"
    NO_POSITION_LOOP = "the controller holds no position"
    NO_NAVIGATION_YET = "no position is held yet: the controller waits for navigation"
    STAMP = "it begins before the flight, or too late"
    ALTITUDE = "it is too low or too high"
    DISTANCE = "it is too far from where the flight began"
    NOT_NUMBERS = "its numbers are not finite, or not as many as they have to be"
    TILT = "the attitude is tilted too much"
    NO_ALTITUDE_LEFT = "the limits leave no altitude"


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
    cause: RefusalCause


_AIRBORNE = (*GUIDED, Phase.ATTITUDE, Phase.HALTING, Phase.DESCENDING, Phase.AUTOROTATING)
_LANDS = (Phase.HALTING, Phase.DESCENDING)
_HELD = (Guard.ENVELOPE, Guard.CLEAR)
_BY_HAND = (Guard.NAVIGATION, *_HELD)
"""For whatever takes over from a pilot's hand and holds a position."""

TABLE: tuple[Transition | Refused, ...] = (
    Transition((Phase.STANDING,), Command.TAKEOFF, Phase.SPOOLING,
               (Guard.NAVIGATION, Guard.UPRIGHT)),
    Refused(TAKING_OFF, Command.TAKEOFF, RefusalCause.TAKING_OFF),
    Refused(_AIRBORNE, Command.TAKEOFF, RefusalCause.AIRBORNE),
    Refused((Phase.MANUAL,), Command.TAKEOFF, RefusalCause.PILOT_TAKES_OFF),
    Refused((Phase.SETTLING,), Command.TAKEOFF, RefusalCause.TOUCHED_DOWN),
    Transition((Phase.SPOOLING,), Fact.SPOOLED_UP, Phase.LIFTING),
    Transition((Phase.SPOOLING,), Fact.BLIND, Phase.STANDING),
    Transition((Phase.LIFTING,), Fact.LIGHT, Phase.CLIMBING),
    Transition((Phase.LIFTING, Phase.CLIMBING), Fact.TIPPING, Phase.SETTLING),
    Transition((Phase.LIFTING,), Fact.BLIND, Phase.SETTLING),
    Transition((Phase.CLIMBING,), Fact.STUCK, Phase.SETTLING),
    Transition((Phase.CLIMBING,), Fact.ARRIVED, Phase.HOVER),
    Transition((*GUIDED, Phase.HALTING), Command.HOLD, Phase.HOVER, (Guard.NAVIGATION,)),
    Transition((Phase.CLIMBING, Phase.DESCENDING), Command.HOLD, Phase.HOVER,
               (Guard.NAVIGATION, Guard.CLEAR)),
    Transition((Phase.ATTITUDE,), Command.HOLD, Phase.HOVER, (Guard.NAVIGATION, Guard.ENVELOPE)),
    Transition((Phase.MANUAL,), Command.HOLD, Phase.HOVER, _BY_HAND),
    Refused(ON_GROUND, Command.HOLD, RefusalCause.GROUNDED),
    Transition(GUIDED, Command.GOTO, Phase.TRAJECTORY,
               (Guard.NAVIGATION, Guard.FENCE, Guard.UNSATURATED)),
    Transition((Phase.ATTITUDE,), Command.GOTO, Phase.TRAJECTORY,
               (Guard.NAVIGATION, Guard.FENCE, Guard.ENVELOPE, Guard.UNSATURATED)),
    Transition((Phase.MANUAL,), Command.GOTO, Phase.TRAJECTORY,
               (*_BY_HAND, Guard.FENCE, Guard.UNSATURATED)),
    Refused(ON_GROUND, Command.GOTO, RefusalCause.GROUNDED),
    Refused((Phase.CLIMBING,), Command.GOTO, RefusalCause.RISING),
    Refused(_LANDS, Command.GOTO, RefusalCause.SINKING),
    Transition(GUIDED, Command.FOLLOW, Phase.TRAJECTORY, (Guard.NAVIGATION, Guard.FENCE)),
    Transition((Phase.ATTITUDE,), Command.FOLLOW, Phase.TRAJECTORY,
               (Guard.NAVIGATION, Guard.FENCE, Guard.ENVELOPE)),
    Transition((Phase.MANUAL,), Command.FOLLOW, Phase.TRAJECTORY,
               (*_BY_HAND, Guard.FENCE)),
    Refused(ON_GROUND, Command.FOLLOW, RefusalCause.GROUNDED),
    Refused((Phase.CLIMBING,), Command.FOLLOW, RefusalCause.RISING),
    Refused(_LANDS, Command.FOLLOW, RefusalCause.SINKING),
    Transition(GUIDED, Command.VELOCITY, Phase.VELOCITY,
               (Guard.NAVIGATION, Guard.FENCE, Guard.UNSATURATED)),
    Transition((Phase.ATTITUDE,), Command.VELOCITY, Phase.VELOCITY,
               (Guard.NAVIGATION, Guard.FENCE, Guard.ENVELOPE, Guard.UNSATURATED)),
    Transition((Phase.MANUAL,), Command.VELOCITY, Phase.VELOCITY,
               (*_BY_HAND, Guard.FENCE, Guard.UNSATURATED)),
    Refused(ON_GROUND, Command.VELOCITY, RefusalCause.GROUNDED),
    Refused((Phase.CLIMBING,), Command.VELOCITY, RefusalCause.RISING),
    Refused(_LANDS, Command.VELOCITY, RefusalCause.SINKING),
    Transition((*GUIDED, Phase.ATTITUDE), Command.ATTITUDE, Phase.ATTITUDE,
               (Guard.LEVEL, Guard.FENCE, Guard.HEARD)),
    Transition((Phase.MANUAL,), Command.ATTITUDE, Phase.ATTITUDE,
               (Guard.LEVEL, *_HELD, Guard.FENCE, Guard.HEARD)),
    Refused(ON_GROUND, Command.ATTITUDE, RefusalCause.GROUNDED),
    Refused((Phase.CLIMBING,), Command.ATTITUDE, RefusalCause.RISING),
    Refused(_LANDS, Command.ATTITUDE, RefusalCause.SINKING),
    Transition((*FLYING, Phase.CLIMBING, *_LANDS, Phase.AUTOROTATING), Command.MANUAL, Phase.MANUAL,
               (Guard.STICKS, Guard.FENCE)),
    Transition((Phase.STANDING,), Command.MANUAL, Phase.MANUAL,
               (Guard.NAVIGATION, Guard.STICKS, Guard.LOWERED)),
    Refused((Phase.SPOOLING, Phase.LIFTING), Command.MANUAL, RefusalCause.COLLECTIVE_RISES),
    Refused((Phase.SETTLING,), Command.MANUAL, RefusalCause.COLLECTIVE_SINKS),
    Transition((Phase.TRAJECTORY,), Fact.ARRIVED, Phase.HOVER),
    Transition((Phase.TRAJECTORY, Phase.VELOCITY), Fact.BLIND, Phase.HOVER),
    Transition((Phase.CLIMBING, *GUIDED), Fact.BLIND_LONG, Phase.HALTING),
    Transition((Phase.TRAJECTORY, Phase.VELOCITY, *STEERED), Fact.FENCED, Phase.HOVER),
    Transition((Phase.CLIMBING, *GUIDED, Phase.ATTITUDE, *_LANDS), Fact.ROTOR_SLOW,
               Phase.AUTOROTATING),
    Transition((Phase.AUTOROTATING,), Fact.ROTOR_BACK, Phase.HOVER),
    Transition((Phase.AUTOROTATING,), Fact.TOUCHED_DOWN, Phase.SETTLING),
    *(
        Refused((Phase.AUTOROTATING,), command, RefusalCause.AUTOROTATING)
        for command in (Command.HOLD, Command.GOTO, Command.FOLLOW, Command.VELOCITY,
                        Command.ATTITUDE)
    ),
    Transition((Phase.CLIMBING, *GUIDED), Fact.FOUND, Phase.HOVER),
    Transition(_LANDS, Fact.FOUND, Phase.HALTING),
    Transition((Phase.VELOCITY, *STEERED), Fact.SILENT, Phase.HOVER),
    Transition((Phase.CLIMBING, *GUIDED), Command.LAND, Phase.HALTING, (Guard.LEVEL,)),
    Transition((Phase.ATTITUDE,), Command.LAND, Phase.HALTING, (Guard.LEVEL, Guard.ENVELOPE)),
    Transition((Phase.MANUAL,), Command.LAND, Phase.HALTING, (Guard.LEVEL, *_HELD)),
    Transition((Phase.SPOOLING,), Command.LAND, Phase.STANDING),
    Transition((Phase.LIFTING,), Command.LAND, Phase.SETTLING),
    Refused((Phase.STANDING,), Command.LAND, RefusalCause.LANDED),
    Refused(LANDING, Command.LAND, RefusalCause.LANDING),
    Transition((Phase.HALTING,), Fact.ARRIVED, Phase.DESCENDING),
    Transition((Phase.DESCENDING,), Fact.TOUCHED_DOWN, Phase.SETTLING),
    Transition((Phase.SETTLING, Phase.MANUAL), Fact.IDLE, Phase.STANDING),
)  # fmt: skip
"""Every transition and every refusal."""


# -------------------------------------------------------------------------------------------------
# What the table says of an event: the next phase, or a refusal in words.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Refusal:
    """A command that is not followed; nothing has changed.

    Attributes
    ----------
    asked : str
        What was asked.
    cause : RefusalCause or Guard
        Why it is not done, for programs.
    reason : str
        The same for people.
    allowed : tuple of str
        What would be.
    """

    asked: str
    cause: RefusalCause | Guard
    reason: str
    allowed: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """One line for people."""
        return f"{self.asked}: {self.reason}; allowed: {', '.join(self.allowed)}"


def _row(phase: Phase, event: Command | Fact) -> Transition | Refused | None:
    return next((row for row in TABLE if row.event == event and phase in row.sources), None)


def allowed(phase: Phase) -> tuple[str, ...]:
    """Names of the commands that have a way out of a phase, whether or not its guards hold."""
    return tuple(c.value for c in Command if isinstance(_row(phase, c), Transition))


def decide(
    phase: Phase, event: Command | Fact, fails: Collection[Guard] = ()
) -> Phase | Refusal | None:
    """The phase that follows; it is for the caller to enter it.

    Parameters
    ----------
    phase : Phase
        The present one.
    event : Command or Fact
    fails : collection of Guard
        Guards that do not hold now.

    Returns
    -------
    Phase or Refusal or None
        A fact is never refused: where it means nothing it is None, the phase stays.
    """
    row = _row(phase, event)
    if isinstance(row, Transition):
        failed = next((guard for guard in row.guards if guard in fails), None)
        if failed is None:
            return row.target
        reason = f"not in {phase.mode} now: {failed.value}"
        return Refusal(event.value, failed, reason, _others(row, phase))
    if row is None:
        return None
    return Refusal(row.event.value, row.cause, row.cause.value, allowed(phase))


def _others(row: Transition, phase: Phase) -> tuple[str, ...]:
    """What else may be asked; the same again if that is all."""
    others = tuple(name for name in allowed(phase) if name != row.event.value)
    return others or (f"{row.event.value} once it is otherwise",)


def command_named(name: str) -> Command | Refusal:
    """The command of a name, its own or that of its mode; an unknown one with a suggestion."""
    known = {word: command for command in Command for word in command.names}
    if name in known:
        return known[name]
    near = difflib.get_close_matches(name, known, n=1)
    hint = f"; did you mean {near[0]}?" if near else ""
    cause = RefusalCause.UNKNOWN_MODE
    return Refusal(f"mode {name!r}", cause, f"{cause.value}{hint}", tuple(known))
