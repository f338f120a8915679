# SPDX-License-Identifier: Apache-2.0
"""The table of a goal: from which stage which event leads where. No ROS.

What has no row changes nothing. A row that names kinds of goals wins over one for all of them.
"""

from dataclasses import dataclass
from enum import IntEnum, StrEnum


class Kind(StrEnum):
    """What a goal asks for; also the word for it."""

    TAKEOFF = "takeoff"
    GOTO = "goto"
    FOLLOW = "follow"
    LAND = "land"


class Stage(StrEnum):
    """Where a goal is that has not ended."""

    WAITING = "waiting"
    """Another goal is being asked for; this one is next."""
    ASKED = "asked"
    """The command is with the outer loop, which has not answered."""
    WITHDRAWN = "withdrawn"
    """Asked, and cancelled before the answer."""
    FLOWN = "flown"
    HOLDING = "holding"
    """Cancelled: `hold` is asked."""
    BREAKING = "breaking off"
    """Cancelled on the ground, where nothing is held: `land` is asked."""
    BOUND = "bound"
    """Cancelled, but neither was done: it is flown to its end."""


class Event(StrEnum):
    """What happens to a goal; the first three answer what it has asked last."""

    GRANTED = "granted"
    REFUSED = "refused"
    UNANSWERED = "unanswered"
    TURN = "its turn"
    CANCEL = "cancel"
    DONE = "done"
    LEFT = "mode left"
    REPLACED = "way replaced"
    LATE = "end not reached"
    PREEMPTED = "preempted"
    SILENT = "silence"
    CLOSED = "closed"


class Outcome(StrEnum):
    """How a goal ends, in ROS's words."""

    SUCCEEDED = "succeeded"
    CANCELED = "canceled"
    ABORTED = "aborted"


class Code(IntEnum):
    """Why a goal has ended: the constants of heli_interfaces/action/*.action."""

    DONE = 0
    CANCELED = 1
    REFUSED = 2
    NO_ANSWER = 3
    PREEMPTED = 4
    REPLACED = 5
    MODE_LEFT = 6
    NOT_REACHED = 7
    SILENT = 8
    CLOSED = 9


HOLD, LAND = "hold", "land"
"""Services of the outer loop that a cancelled goal asks for."""


@dataclass(frozen=True)
class End:
    """A goal ends."""

    outcome: Outcome
    code: Code


@dataclass(frozen=True)
class Row:
    """One row.

    Attributes
    ----------
    stages : tuple of Stage
    event : Event
    target : Stage or End
    asks : str
        Service that is called on the way; empty for none.
    kinds : tuple of Kind
    """

    stages: tuple[Stage, ...]
    event: Event
    target: Stage | End
    asks: str = ""
    kinds: tuple[Kind, ...] = tuple(Kind)


_UNDER_WAY = (Stage.FLOWN, Stage.BOUND)
_CANCELLED = (Stage.HOLDING, Stage.BREAKING)
_ABORTED, _CANCELED = Outcome.ABORTED, End(Outcome.CANCELED, Code.CANCELED)

TABLE: tuple[Row, ...] = (
    Row((Stage.WAITING,), Event.TURN, Stage.ASKED),
    Row((Stage.WAITING,), Event.CANCEL, _CANCELED),
    Row((Stage.ASKED,), Event.GRANTED, Stage.FLOWN),
    Row((Stage.ASKED,), Event.REFUSED, End(_ABORTED, Code.REFUSED)),
    Row((Stage.ASKED,), Event.CANCEL, Stage.WITHDRAWN),
    Row((Stage.WITHDRAWN,), Event.GRANTED, Stage.HOLDING, HOLD),
    Row((Stage.WITHDRAWN,), Event.REFUSED, _CANCELED),
    Row((Stage.FLOWN,), Event.CANCEL, Stage.HOLDING, HOLD),
    # A reference is refused later than it is taken for granted.
    Row((Stage.FLOWN,), Event.REFUSED, End(_ABORTED, Code.REFUSED), kinds=(Kind.FOLLOW,)),
    Row(_CANCELLED, Event.GRANTED, _CANCELED),
    Row((Stage.HOLDING,), Event.REFUSED, Stage.BREAKING, LAND, (Kind.TAKEOFF,)),
    Row(_CANCELLED, Event.REFUSED, Stage.BOUND),
    Row((Stage.ASKED, Stage.WITHDRAWN, *_CANCELLED), Event.UNANSWERED,
        End(_ABORTED, Code.NO_ANSWER)),
    Row(_UNDER_WAY, Event.DONE, End(Outcome.SUCCEEDED, Code.DONE)),
    Row(_UNDER_WAY, Event.LEFT, End(_ABORTED, Code.MODE_LEFT)),
    Row(_UNDER_WAY, Event.REPLACED, End(_ABORTED, Code.REPLACED)),
    Row(_UNDER_WAY, Event.LATE, End(_ABORTED, Code.NOT_REACHED)),
    Row(tuple(Stage), Event.PREEMPTED, End(_ABORTED, Code.PREEMPTED)),
    Row(tuple(Stage), Event.SILENT, End(_ABORTED, Code.SILENT)),
    Row(tuple(Stage), Event.CLOSED, End(_ABORTED, Code.CLOSED)),
)  # fmt: skip
"""Every step of every goal."""


def row_of(kind: Kind, stage: Stage, event: Event) -> Row | None:
    """The row of an event; None where it means nothing."""
    rows = [r for r in TABLE if r.event == event and stage in r.stages and kind in r.kinds]
    return min(rows, key=lambda row: len(row.kinds), default=None)


@dataclass(frozen=True)
class Rule:
    """What a kind of goal is, in the words of the outer loop.

    Attributes
    ----------
    service : str
        Service that begins it; empty: a message on `topic` does.
    topic : str
    modes : frozenset of str
        Modes in which it is under way.
    done : str
        Mode that tells its end; empty: its end is a place and a time.
    """

    modes: frozenset[str]
    service: str = ""
    topic: str = ""
    done: str = ""


ALONG_A_WAY = frozenset({"trajectory", "hover"})
STANDING = "standing"
RULES: dict[Kind, Rule] = {
    Kind.TAKEOFF: Rule(frozenset({"takeoff"}), service="takeoff", done="hover"),
    Kind.GOTO: Rule(ALONG_A_WAY, topic="goto"),
    Kind.FOLLOW: Rule(ALONG_A_WAY, topic="reference"),
    Kind.LAND: Rule(frozenset({"land"}), service="land", done=STANDING),
}
