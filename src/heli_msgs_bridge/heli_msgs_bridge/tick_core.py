# SPDX-License-Identifier: Apache-2.0
"""What a node that steps by tick hears, and what it has while it is configured."""

from dataclasses import dataclass, field

from heli_msgs_bridge.lockstep import Demand
from heli_msgs_bridge.stepping import Pace


@dataclass(frozen=True)
class Input:
    """A topic that a step uses.

    Attributes
    ----------
    topic : str
    demand : Demand
        When lockstep waits for it.
    off_tick : bool
        True if stamps between ticks are allowed (they count for the tick before).
    """

    topic: str
    demand: Demand
    off_tick: bool = False


@dataclass(kw_only=True)
class TickCore:
    """What every tick node has while it is configured.

    Attributes
    ----------
    pace : Lockstep or RealTime
        When it steps; made by `TickNode.listen`.
    stepped : int or None
        Newest tick of the present activation.
    refused : dict of str
        Per topic, why its last refused message was refused.
    refusals : dict of Refusals
        Per topic, the messages that /diagnostics speaks of: those whose stamps did not fit to the
        clock, references that were not followed.
    rivals : dict of str
        Per topic that has more than one sender now, a sentence that names them.
    senders : dict of str
        The same of all that had more than one, with what was ignored.
    """

    pace: Pace
    stepped: int | None = None
    refused: dict[str, str] = field(default_factory=dict)
    refusals: dict[str, "Refusals"] = field(default_factory=dict)
    rivals: dict[str, str] = field(default_factory=dict)
    senders: dict[str, str] = field(default_factory=dict)


@dataclass
class Refusals:
    """Messages of a topic that were refused: how many, why, tick of the last."""

    count: int = 0
    why: str = ""
    tick: int = 0
