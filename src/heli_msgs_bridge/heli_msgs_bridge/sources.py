# SPDX-License-Identifier: Apache-2.0
"""Messages together with what DDS says of them: which one of its sender's it is, and when sent.

So a message that two subscriptions hear counts once, and a topic has one owner. No ROS.
"""

import inspect
import json
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.topic_endpoint_info import TopicEndpointInfo

from heli_core.ticks import NS_PER_S
from heli_msgs_bridge.cdr import stamp_of
from heli_msgs_bridge.handover import Successors, respawns
from heli_msgs_bridge.signatures import signature_of
from heli_msgs_bridge.topics import BY_NAME, message_class

# -------------------------------------------------------------------------------------------------
# Arrivals.
# -------------------------------------------------------------------------------------------------

Info = Mapping[str, Any]
"""rclpy's message info: `source_timestamp` (ns), `publication_sequence_number` and others."""
MessageCallback = Callable[[Any, Info | None], None]
_MESSAGE_AND_INFO = inspect.Signature(
    [inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY) for name in ("message", "info")]
)
_REMEMBERED = 256
_MOST_PERIODS, _MOST_OTHERS = 4, 64
# Of a message that holds a stamp.
_LEAST_BYTES = 12
SUCCESSOR_S = 0.08
"""Wall time after which a successor succeeds an owner that is not heard."""
FOLLOWED_S = 0.5
"""Wall time for which an owner that is not heard counts as one that is followed."""


def with_info(hearer: MessageCallback) -> Callable[..., None]:
    """Callback for a subscription, by which every executor hands over the message's info, too.

    The EventsExecutor of Jazzy gives a pair where the others give two arguments. Without info (a
    callback called by hand) it is None.
    """

    def call(message: Any, info: Info | None = None) -> None:
        if isinstance(message, tuple):
            message, info = message
        hearer(message, info)

    return taking_info(call)


def taking_info(call: Callable[..., None]) -> Callable[..., None]:
    """The callback, marked: by its signature rclpy decides whether it hands the info over."""
    call.__signature__ = _MESSAGE_AND_INFO  # type: ignore[attr-defined]
    return call


def locked(
    owner: "PublisherLock", hear: Callable[[bytes], bool | None], ignored: Callable[[], None] | None
) -> Callable[..., None]:
    """Callback for `taking_info` that hears the owner's serialised messages, no others.

    What `hear` finds to be no message of the topic (it returns False) was nobody's.
    """
    admits = owner.admits

    def call(message: Any, info: Info | None = None) -> None:
        if type(message) is tuple:
            message, info = message
        if admits(message, info):
            if hear(message) is False:
                owner.retract()
        elif ignored is not None:
            ignored()

    return call


class DuplicateFilter:
    """Whether a message has not come before, for two subscriptions to one topic.

    A latched topic has two: only one that asks for old messages gets the last one of a latched
    sender, only one that does not hears a sender of default QoS. Both hear a latched sender.
    """

    def __init__(self) -> None:
        self._heard: deque[tuple[int, int]] = deque(maxlen=_REMEMBERED)

    def is_new(self, info: Info | None) -> bool:
        """True the first time; also for a message of which nothing is known."""
        if info is None:
            return True
        key = info["publication_sequence_number"], info["source_timestamp"]
        if key in self._heard:
            return False
        self._heard.append(key)
        return True


class PublisherLock:
    """Whose messages of a topic are used: those of the sender that was heard first.

    Jazzy's rclpy does not say who sent a message, but which one of its sender's it is. The owner's
    next one has the next number; another sender's numbers are elsewhere. Where both are the same,
    the stamps decide, which go on from the owner's last by whole periods: a sender with the same
    numbers and the same stamps is not told from it. If the owner is gone or silent for long,
    the next message's sender succeeds it, until the owner is heard again. A successor, a node of
    the owner's name that was started in its place, need not wait so long.

    Parameters
    ----------
    count : callable
        How many senders the topic has now, by the graph; asked only about unexpected numbers.
    silence_s : float
        Wall time after which a silent owner is succeeded by whoever sends.
    period_ns : int
        Distance of two stamps; 0 where there is none: any later one within a second goes on.
    now_s : callable, optional
        Steady time, s. What waited in a queue came earlier than it is judged: a reader that lags
        sees no silence in its own time.
    wall_s : callable, optional
        The system clock, s, of which the middleware says when a message came. Only for how long it
        waited: who sets that clock makes no owner silent.
    is_genuine : callable, optional
        Whether a serialised message is signed by a node of this graph (`signatures`); others are
        nobody's then, whatever their numbers.
    is_message : callable, optional
        Whether a serialised message is one of the topic's type; asked before another sender
        becomes the owner.
    strangers : callable, optional
        Whether a sender has another name than the owner should have. None of them succeeds an
        owner that is silent, but still in the graph.
    successor : callable, optional
        Whether an unexpected number is that of a successor of the owner, which may be dead; called
        with whether the owner has been silent for `SUCCESSOR_S`; before that not for known others.

    Attributes
    ----------
    ignored : int
        Messages of others, so far.
    successions : int
        How often another sender has become the owner; successors do not count.
    """

    def __init__(
        self,
        count: Callable[[], int],
        silence_s: float,
        period_ns: int,
        now_s: Callable[[], float] = time.monotonic,
        successor: Callable[[bool], bool] = lambda silent: False,
        strangers: Callable[[], bool] = lambda: False,
        is_message: Callable[[bytes], bool] = lambda raw: True,
        is_genuine: Callable[[bytes], bool] | None = None,
        wall_s: Callable[[], float] = time.time,
    ) -> None:
        self._count, self._silence_s = count, silence_s
        self._now_s, self._wall_s = now_s, wall_s
        self._successor, self._strangers = successor, strangers
        self._is_message, self._is_genuine = is_message, is_genuine
        self._period_ns = period_ns
        self._number: int | None = None
        self._before: int | None = None
        self._raw = b""
        self._heard_s = 0.0
        self._last: tuple[int | None, bytes, float] = (None, b"", 0.0)
        self._others: set[int] = set()
        self.ignored = self.successions = 0

    @property
    def followed(self) -> bool:
        """Whether there is an owner that was heard lately."""
        return self._number is not None and self._now_s() - self._heard_s < FOLLOWED_S

    def admits(self, raw: bytes, info: Info | None) -> bool:
        """Whether a serialised message is the owner's; without info it counts as the owner's."""
        if info is None:
            return True
        if self._is_genuine is not None and not self._is_genuine(raw):
            self.ignored += 1
            return False
        number = info["publication_sequence_number"]
        came_s, received_ns = self._now_s(), info.get("received_timestamp", 0)
        if received_ns:
            waited_s = max(self._wall_s() - received_ns / NS_PER_S, 0.0)
            came_s = max(came_s - waited_s, self._heard_s)
        if (number - 1 == self._number and not self._others) or self._judge(number, raw, came_s):
            self._last = self._number, self._raw, self._heard_s
            self._number, self._raw, self._heard_s = number, raw, came_s
            return True
        self.ignored += 1
        return False

    def retract(self) -> None:
        """What was admitted last is no message of the topic: it was not the owner's."""
        self._number, self._raw, self._heard_s = self._last
        self.ignored += 1

    def _judge(self, number: int, raw: bytes, came_s: float) -> bool:
        """Whether a message is the owner's, though its number says so not by itself."""
        last_number, before = self._number, self._before
        if last_number is None:
            return self._is_message(raw)
        next_one, known = number == last_number + 1, number in self._others
        if next_one and (not known or self._continues(raw)):
            return True
        if before is not None and number == before + 1 and self._is_message(raw):
            self._others.add(last_number + 1)
            self._before = None
            return True
        alone, silent_s = not next_one and self._count() <= 1, came_s - self._heard_s
        silent = silent_s > SUCCESSOR_S
        asked = silent or not (known or next_one)
        # What is no message uses up no successor.
        if asked and self._is_message(raw) and self._successor(silent):
            self._others.clear()
            self._before = last_number
            return True
        gone = alone or (silent_s > self._silence_s and not self._strangers())
        if gone and self._is_message(raw):
            # Numbers that go on are the owner's: messages between were lost.
            self.successions += not (alone and number > last_number)
            self._others.clear()
            self._before = last_number
            return True
        self._others.discard(number)
        if len(self._others) < _MOST_OTHERS:
            self._others.add(number + 1)
        return False

    def _continues(self, raw: bytes) -> bool:
        """Whether a stamp follows upon the owner's last one."""
        if min(len(raw), len(self._raw)) < _LEAST_BYTES:
            return False
        step_ns = stamp_of(raw) - stamp_of(self._raw)
        if not self._period_ns:
            return 0 < step_ns <= NS_PER_S
        return 0 < step_ns <= _MOST_PERIODS * self._period_ns and step_ns % self._period_ns == 0


# -------------------------------------------------------------------------------------------------
# Who sends on a topic, in names and in words.
# -------------------------------------------------------------------------------------------------

# What the middleware calls a node whose publishers it has discovered, but not yet its name.
_UNKNOWN = ("_NODE_NAME_UNKNOWN_", "_NODE_NAMESPACE_UNKNOWN_")
SENDERS = "senders."
"""Key of a topic's senders in /diagnostics; the topic's name follows."""
SENDER_FIELDS = "sender_fields."
"""Key of the same as fields: a `TopicSenders` in JSON."""
NOT_YET_NAMED = "a node that is not named yet"
_MOST_FIELDS_CHARACTERS = 20_000


@dataclass(frozen=True)
class TopicSenders:
    """Who sends on a topic that should have one sender, and what becomes of it.

    Attributes
    ----------
    topic : str
    names : tuple of str
        Full names of the senders; empty: they are not known.
    each : bool
        Whether all are followed; else one is.
    first : str
        Which one; empty: the first that was heard, whose name is not known.
    ignored, not_recorded : int or None
        How many messages were not used, or not recorded; None where nobody counts.
    successions : int
        How often another sender has become the one that is followed.
    """

    topic: str
    names: tuple[str, ...] = ()
    each: bool = False
    first: str = ""
    ignored: int | None = None
    not_recorded: int | None = None
    successions: int = 0

    @property
    def sentence(self) -> str:
        """All of it."""
        parts = [self.topic]
        if self.names:
            parts = [f"{self.topic}: sent by {', '.join(self.names)}", self._followed()]
        if self.ignored is not None:
            parts.append(f"ignored so far: {self.ignored} messages")
        if self.successions:
            parts.append(f"the sender that is used has changed: {self.successions} times")
        if self.not_recorded is not None:
            parts.append(f"not recorded: {self.not_recorded} messages")
        return "; ".join(parts)

    def _followed(self) -> str:
        if self.each:
            return f"each {self.topic} is followed as it comes"
        if self.first:
            return f"only {self.first} is followed, which was heard first"
        return "only the first sender's messages are used"

    def facts(self) -> dict[str, str]:
        """For /diagnostics, by `SENDERS` and `SENDER_FIELDS`."""
        return {
            f"{SENDERS}{self.topic}": self.sentence,
            f"{SENDER_FIELDS}{self.topic}": json.dumps(asdict(self)),
        }

    @classmethod
    def read(cls, text: str) -> "TopicSenders":
        """Out of the JSON of `facts`; ValueError: it is none, or longer than a node's."""
        if len(text) > _MOST_FIELDS_CHARACTERS:
            raise ValueError(f"senders: {len(text)} characters")
        try:
            fields = json.loads(text)
            names = fields.pop("names")
            read = cls(**fields, names=tuple(names))
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            raise ValueError(f"senders: not their fields: {error}") from None
        if not isinstance(names, list) or not all(isinstance(n, str) for n in (read.topic, *names)):
            raise ValueError("senders: topic and names are no texts")
        return read


def senders_of(node: Node, topic: str) -> list[tuple[str, str]]:
    """Namespace and name of each node that sends on a topic, sorted.

    A name comes after its publishers, by a topic of its own: until then it is NOT_YET_NAMED.
    """
    infos = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
    return sorted(map(_sender_of, infos))


def _sender_of(info: TopicEndpointInfo) -> tuple[str, str]:
    if info.node_name in _UNKNOWN:
        return "", NOT_YET_NAMED
    return info.node_namespace, info.node_name


class EverSent:
    """Who sends on a topic, or has sent on it and left: full names, one per publisher.

    By publishers, because only so a name that comes later takes the place of NOT_YET_NAMED.
    """

    def __init__(self) -> None:
        self._names: dict[bytes, str] = {}

    def look(self, node: Node, topic: str) -> None:
        """Add who sends now; a name that was known once stays known."""
        for info in node.get_publishers_info_by_topic(node.resolve_topic_name(topic)):
            gid, name = bytes(info.endpoint_gid), full_name(_sender_of(info))
            if name != NOT_YET_NAMED or gid not in self._names:
                self._names[gid] = name

    def names(self, besides: str) -> list[str]:
        """Sorted, each once; `besides` is the full name of who asks."""
        return sorted(set(self._names.values()) - {besides})


def strangers_of(node: Node, topic: str) -> bool | None:
    """Whether another node, by name, sends on a topic than those that should; None: not yet known.

    A process that was killed stays in the graph for some seconds beside its successor.
    """
    space = node.get_namespace()
    expected = {(space, name) for name in BY_NAME[topic].source}
    others = set(senders_of(node, topic)) - expected
    return None if others == {("", NOT_YET_NAMED)} else bool(others)


def successors_of(node: Node, topic: str) -> Callable[[bool], bool]:
    """For `PublisherLock`: whether who sends now is the successor of one that was killed.

    A restart is noted before the successor can speak, so the first that comes after it is a
    successor even before its name has come. Later ones are, when the owner is silent and all
    have its name.
    """
    successors = Successors(BY_NAME[topic].source)

    def successor(silent: bool) -> bool:
        if not respawns():
            return False
        strangers = strangers_of(node, topic)
        if not strangers and successors.due():
            successors.meet()
            return True
        return silent and strangers is False

    return successor


def lock_of(node: Node, topic: str, silence_s: float, period_ns: int) -> PublisherLock:
    """Who decides whose messages of a graph's topic a node uses.

    Parameters
    ----------
    node : Node
    topic : str
        Of the table (`topics.BY_NAME`).
    silence_s, period_ns : float, int
        As `PublisherLock` has them.

    Raises
    ------
    KeyFileError
        The environment names a key that is none.
    """
    name = node.resolve_topic_name(topic)
    signature = signature_of(name)
    return PublisherLock(
        lambda: node.count_publishers(name),
        silence_s,
        period_ns,
        successor=successors_of(node, topic),
        strangers=lambda: strangers_of(node, topic) is not False,
        is_message=lambda raw: is_message(topic, raw),
        is_genuine=None if signature is None else signature.is_genuine,
    )


def is_message(topic: str, raw: bytes) -> bool:
    """Whether serialised bytes are a message of a topic's type."""
    try:
        deserialize_message(raw, message_class(BY_NAME[topic].type))
    except Exception:  # rclpy raises what it likes
        return False
    return len(raw) >= _LEAST_BYTES


def full_name(sender: tuple[str, str]) -> str:
    """`/namespace/name`."""
    namespace, name = sender
    return name if name == NOT_YET_NAMED else f"{namespace.rstrip('/')}/{name}"


def several(topic: str, senders: Sequence[tuple[str, str]], first: str = "") -> TopicSenders:
    """That a topic has several senders; `first` is followed, if it is one of them."""
    names = tuple(map(full_name, senders))
    return TopicSenders(topic, names, first=first if first in names else "")


def others_in_words(node: Node, topic: str) -> str:
    """Full names of those who send on a topic besides a node; empty if nobody does."""
    this_node = (node.get_namespace(), node.get_name())
    return ", ".join(full_name(sender) for sender in senders_of(node, topic) if sender != this_node)


# -------------------------------------------------------------------------------------------------
# Who speaks in /diagnostics under the names of an aircraft's nodes without being one. No ROS.
#
# Jazzy's rclpy does not say who sent a message, but which one of its sender's it is. A node
# reports
# by one publisher, so the numbers of what is said under its name go on by one.
# -------------------------------------------------------------------------------------------------


class DiagnosticSenders:
    """What is said under the names of one aircraft's nodes, and who else may say it.

    Parameters
    ----------
    namespace : str
        Of the aircraft.
    node_names : iterable of str
        Names of its nodes.

    Attributes
    ----------
    foreign : set of str
        Names under which a message has come whose number was not the next one.
    """

    def __init__(self, namespace: str, node_names: Iterable[str]) -> None:
        self._space = namespace.strip("/")
        self._heard = {f"{self._space}/{name}".strip("/") for name in node_names}
        self._numbers: dict[str, int] = {}
        self._times: dict[str, int] = {}
        self._anew: set[str] = set()
        self.foreign: set[str] = set()

    def admits(self, names: Sequence[str], number: int) -> bool:
        """Take the names that a message speaks of; False if it is not the next one of ours.

        Parameters
        ----------
        names : sequence of str
            Full names of its statuses.
        number : int
            Which one of its sender's it is.
        """
        fits = True
        for full in names:
            name = full.strip("/")
            # Others than our nodes may report as "name: what".
            self._heard.add(name.split(":")[0])
            if name.rpartition("/")[0] != self._space:
                continue
            if self._numbers.setdefault(name, number - 1) + 1 == number:
                self._numbers[name] = number
            elif name in self._anew:
                self._anew.discard(name)
                self._numbers[name] = number
            else:
                self.foreign.add(name)
                fits = False
        return fits

    def forget(self, name: str, times: int) -> None:
        """A node of ours was started again, so many times by now: its number begins anew, once.

        The last words of its predecessor may still come before.
        """
        if times > self._times.get(name, 0):
            self._times[name] = times
            self._anew.add(f"{self._space}/{name}".strip("/"))

    def strangers(self, senders: Iterable[tuple[str, str]]) -> list[str]:
        """Of the senders of /diagnostics, those that may have said it.

        Who reports under a name of its own is none, unless two have the same.

        Parameters
        ----------
        senders : iterable of (str, str)
            Namespace and name of each.
        """
        counts = Counter(f"{space.strip('/')}/{name}".strip("/") for space, name in senders)
        return [f"/{n}" for n, count in sorted(counts.items()) if n not in self._heard or count > 1]
