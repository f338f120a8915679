# SPDX-License-Identifier: Apache-2.0
"""One owner per topic: whose messages are used, by their senders' numbers."""

import numpy as np
import pytest

from heli_msgs_bridge import topics
from heli_msgs_bridge.layouts import CHANNELS
from heli_msgs_bridge.messages import Encoder
from heli_msgs_bridge.signatures import KEY_BYTES, Signature
from heli_msgs_bridge.sources import (
    FOLLOWED_S,
    SUCCESSOR_S,
    PublisherLock,
    is_message,
    locked,
)

PERIOD_NS = 10_000_000
ENCODE = Encoder(topics.BARO).encode


class Topic:
    """Senders with numbers of their own, and the owner as a listener has it."""

    def __init__(self, silence_s=0.5):
        self.senders, self.time_s = 1, 0.0
        self.owner = PublisherLock(lambda: self.senders, silence_s, PERIOD_NS, lambda: self.time_s)

    def hears(self, number, tick=0):
        raw = ENCODE(np.zeros(1), tick * PERIOD_NS)
        return self.owner.admits(raw, {"publication_sequence_number": number})


@pytest.fixture
def topic():
    return Topic()


@pytest.mark.parametrize("first", [1, 700])
def test_another_sender_is_ignored_whatever_its_numbers(topic, first):
    """One that begins to send, one that has sent much more; slower and faster ones."""
    for number in range(100, 200):
        assert topic.hears(number)
    topic.senders = 2
    other = first
    for number in range(200, 300):
        assert topic.hears(number)
        for _ in range(number % 4):
            assert not topic.hears(other)
            other += 1
    assert topic.owner.ignored == other - first and topic.owner.successions == 0


def test_a_faster_sender_whose_numbers_pass_the_owners_is_told_by_its_stamps(topic):
    topic.senders, other = 2, 1
    assert topic.hears(100, tick=100)
    for number in range(101, 400):
        for _ in range(2):
            assert not topic.hears(other, tick=179_000_000 + other), (number, other)
            other += 1
        assert topic.hears(number, tick=number), (number, other)


def test_an_owner_is_followed_as_long_as_it_is_heard(topic):
    assert not topic.owner.followed
    topic.hears(1)
    topic.time_s = 0.9 * FOLLOWED_S
    assert topic.owner.followed
    topic.time_s = FOLLOWED_S
    assert not topic.owner.followed
    topic.hears(2)
    assert topic.owner.followed


def test_the_owners_lost_messages_cost_it_nothing(topic):
    assert topic.hears(1) and topic.hears(2)
    assert topic.hears(9) and topic.hears(10)
    assert topic.owner.successions == topic.owner.ignored == 0


def test_when_the_owner_is_gone_another_sender_succeeds_it(topic):
    assert topic.hears(50)
    topic.senders = 2
    assert not topic.hears(7)
    topic.senders = 1
    assert topic.hears(9) and topic.hears(10)
    assert topic.owner.successions == 1


def test_a_silent_owner_is_succeeded_and_comes_back(topic):
    """As after `kill -9`: the graph lists the dead one for long. Who only paused is the owner."""
    topic.senders = 2
    assert topic.hears(50) and not topic.hears(7)
    topic.time_s += 0.6
    assert topic.hears(8) and topic.hears(9)
    assert topic.hears(51) and topic.hears(52)
    assert not topic.hears(10) and not topic.hears(11)


def test_without_info_a_message_is_the_owners(topic):
    assert topic.owner.admits(b"", None) and topic.owner.ignored == 0


def test_a_successor_of_the_owners_name_succeeds_soon_and_nobody_else_does(topic):
    """A node that was started again; its predecessor is in the graph for seconds."""
    topic.senders, names = 2, [True]
    topic.owner = PublisherLock(
        lambda: topic.senders,
        10.0,
        PERIOD_NS,
        lambda: topic.time_s,
        lambda silent: silent and names[0],
    )
    assert topic.hears(50)
    topic.time_s += SUCCESSOR_S / 2
    assert not topic.hears(1)
    topic.time_s += SUCCESSOR_S
    names[0] = False
    assert not topic.hears(7)
    names[0] = True
    assert topic.hears(2) and topic.hears(3)
    assert topic.owner.successions == 0
    # Who only was paused is the owner still.
    assert topic.hears(51) and not topic.hears(4)


class Queue:
    """Messages that DDS has received at times of a system clock, and a reader that may lag."""

    def __init__(self, successor=lambda silent: silent):
        self.time_s, self.wall_s = 1000.0, 1_795_613_931.0
        self.owner = PublisherLock(
            lambda: 2, 10.0, PERIOD_NS, lambda: self.time_s, successor, wall_s=lambda: self.wall_s
        )

    def goes_on(self, seconds):
        self.time_s += seconds
        self.wall_s += seconds

    def hears(self, number, ago_s=0.0):
        received_ns = round((self.wall_s - ago_s) * 1e9)
        info = {"publication_sequence_number": number, "received_timestamp": received_ns}
        return self.owner.admits(b"", info)


def test_silence_counts_by_when_a_message_came_not_by_when_it_is_judged():
    """A reader that lags finds the last message of the owner and the first of its successor."""
    queue = Queue()
    assert queue.hears(50)
    queue.goes_on(60.0)
    assert not queue.hears(1, 60.0 - SUCCESSOR_S / 2)
    assert queue.hears(2, 60.0 - 2 * SUCCESSOR_S) and queue.hears(3, 60.0 - 2 * SUCCESSOR_S)
    assert queue.owner.successions == 0


@pytest.mark.parametrize("jump_s", [-86400.0, -3600.0, -1.0, 1.0, 3600.0, 86400.0])
def test_a_system_clock_that_is_set_makes_no_owner_silent(jump_s):
    """Nor does it keep a successor waiting; also of what had come, but was not judged yet."""
    queue = Queue()
    for number in range(10):
        queue.goes_on(0.01)
        assert queue.hears(100 + number)
    queue.wall_s += jump_s
    assert not queue.hears(1)
    assert queue.hears(110, jump_s + 0.002) and not queue.hears(2, jump_s + 0.001)
    queue.goes_on(0.01)
    assert not queue.hears(3) and queue.hears(111)
    queue.goes_on(2 * SUCCESSOR_S)
    assert queue.hears(4) and queue.owner.successions == 0


def test_who_is_known_to_be_a_successor_need_not_wait_for_silence(topic):
    """It was started in the owner's place; others that are known by their numbers are not asked."""
    due = [False]
    topic.senders = 2
    topic.owner = PublisherLock(
        lambda: 2, 10.0, PERIOD_NS, lambda: topic.time_s, lambda silent: due[0]
    )
    assert topic.hears(50) and not topic.hears(7)
    due[0] = True
    assert not topic.hears(8)
    assert topic.hears(1) and topic.hears(2)
    assert topic.owner.successions == 0 and topic.owner.ignored == 2


def test_a_silent_owner_is_not_succeeded_by_a_stranger_while_it_is_there(topic):
    """A loaded machine is silent, too: the stranger waits until the owner has left the graph."""
    strangers = [True]
    topic.owner = PublisherLock(
        lambda: topic.senders, 0.5, PERIOD_NS, lambda: topic.time_s, strangers=lambda: strangers[0]
    )
    assert topic.hears(100)
    topic.senders, topic.time_s = 2, 30.0
    assert not topic.hears(7) and not topic.hears(8)
    assert topic.hears(101)
    topic.senders, topic.time_s = 1, 31.0
    assert topic.hears(9) and topic.owner.successions == 1
    # Of its own name: who was started again by hand.
    topic.senders, topic.time_s, strangers[0] = 2, 62.0, False
    assert topic.hears(1)


@pytest.mark.parametrize("raw", [b"", b"\0\1\0\0", bytes(64)])
def test_what_is_no_message_is_nobodys(topic, raw):
    """Neither as the first one, nor with the owner's next number, nor after a silence."""
    topic.owner = PublisherLock(
        lambda: topic.senders, 0.5, PERIOD_NS, lambda: topic.time_s,
        is_message=lambda raw: is_message(topics.ODOM, raw),
    )  # fmt: skip
    heard = []

    def hear(message):
        heard.append(message)
        return is_message(topics.ODOM, message)

    call = locked(topic.owner, hear, None)
    odom = Encoder(topics.ODOM).encode(np.zeros(CHANNELS[topics.ODOM].size), PERIOD_NS)
    call(raw, {"publication_sequence_number": 5})
    assert heard == []
    call(odom, {"publication_sequence_number": 100})
    call(raw, {"publication_sequence_number": 101})
    call(odom, {"publication_sequence_number": 101})
    assert heard == [odom, raw, odom] and topic.owner.ignored == 2
    topic.time_s = 9.0
    call(raw, {"publication_sequence_number": 7})
    assert len(heard) == 3


def test_a_forged_number_is_of_no_use_without_the_key(topic):
    signature = Signature(bytes(KEY_BYTES), "/baro")
    topic.owner = PublisherLock(
        lambda: 2, 0.5, PERIOD_NS, lambda: topic.time_s, is_genuine=signature.is_genuine
    )
    raw = ENCODE(np.zeros(1), 0)
    forged = signature.sign(raw)[:-1] + b"\1"
    assert not topic.owner.admits(forged, {"publication_sequence_number": 99})
    assert topic.owner.admits(signature.sign(raw), {"publication_sequence_number": 100})
    topic.time_s = 60.0
    assert not topic.owner.admits(forged, {"publication_sequence_number": 101})
    assert not topic.owner.admits(raw, {"publication_sequence_number": 101})
    assert topic.owner.admits(signature.sign(raw), {"publication_sequence_number": 101})
    assert topic.owner.ignored == 3 and topic.owner.successions == 0


def test_messages_of_a_second_sender_are_not_decoded(topic):
    """A flood of another sender's costs looks at numbers; only who is to be owner is read."""
    decoded = []
    topic.senders = 2
    topic.owner = PublisherLock(
        lambda: topic.senders, 0.5, PERIOD_NS, lambda: topic.time_s,
        is_message=lambda raw: not decoded.append(raw),
    )  # fmt: skip
    assert topic.hears(100) and not topic.hears(1)
    read = len(decoded)
    for number in range(2, 50):
        assert not topic.hears(number, tick=number) and topic.hears(99 + number, tick=number)
    assert len(decoded) == read
    topic.time_s = 60.0
    assert topic.hears(50) and len(decoded) > read


def test_a_successor_is_due_though_no_message_came_before_it(topic):
    """What is no message of the topic does not use up the one successor that is due."""
    due = [1]

    def successor(silent):
        due[0] -= 1
        return due[0] >= 0

    topic.senders = 2
    topic.owner = PublisherLock(
        lambda: 2, 10.0, PERIOD_NS, lambda: topic.time_s, successor,
        is_message=lambda raw: is_message(topics.BARO, raw),
    )  # fmt: skip
    assert topic.hears(50)
    assert not topic.owner.admits(b"\0\1\0\0" + bytes(8), {"publication_sequence_number": 7})
    assert topic.hears(1) and topic.owner.successions == 0
