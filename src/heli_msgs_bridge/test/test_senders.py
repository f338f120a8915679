# SPDX-License-Identifier: Apache-2.0
"""Who sends on a topic, in words: also before the middleware knows a node's name."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from heli_msgs_bridge.handover import FOLDER, note_restart
from heli_msgs_bridge.sources import (
    NOT_YET_NAMED,
    SENDER_FIELDS,
    SENDERS,
    EverSent,
    TopicSenders,
    full_name,
    senders_of,
    several,
    successors_of,
)

SENTENCES = {
    "used": "odom: sent by /pilot, /red/observer; only the first sender's messages are used",
    "followed": "joy: sent by /one, /two; only /one is followed, which was heard first; "
    "ignored so far: 3 messages; the sender that is used has changed: 2 times",
    "unknown": "odom; ignored so far: 1 messages",
}
UNKNOWN = "_NODE_NAMESPACE_UNKNOWN_", "_NODE_NAME_UNKNOWN_"


class Graph:
    """A node's look at the graph."""

    def __init__(self, *senders):
        self.now(*((s, n, number) for number, (s, n) in enumerate(senders)))

    def now(self, *senders):
        """Namespace, name and number of each publisher that is there."""
        self.infos = [
            SimpleNamespace(node_namespace=s, node_name=n, endpoint_gid=[number])
            for s, n, number in senders
        ]

    def resolve_topic_name(self, topic):
        return f"/red/{topic}"

    def get_publishers_info_by_topic(self, topic):
        assert topic == "/red/odom"
        return self.infos

    def get_namespace(self):
        return "/red"


def test_senders_are_named_in_order():
    senders = senders_of(Graph(("/red", "observer"), ("/", "pilot")), "odom")
    assert senders == [("/", "pilot"), ("/red", "observer")]
    both = several("odom", senders)
    assert both == TopicSenders("odom", ("/pilot", "/red/observer"))
    assert both.sentence == SENTENCES["used"]


def test_fields_of_senders_come_back_and_make_the_sentence():
    named = several("joy", [("", NOT_YET_NAMED), ("/", "one")], "/one")
    counted = replace(named, ignored=3, successions=2)
    facts = counted.facts()
    read = TopicSenders.read(facts[f"{SENDER_FIELDS}joy"])
    assert read == counted
    assert replace(read, names=("/one", "/two")).sentence == SENTENCES["followed"]
    unknown = TopicSenders("odom", ignored=1)
    assert unknown.facts()[f"{SENDERS}odom"] == SENTENCES["unknown"]


@pytest.mark.parametrize(
    "text",
    ["", "[]", "3", "null", "{}", '{"names": 3}', '{"names": [], "topic": 7}', "[" * 10_000,
     '{"names": [[]], "topic": "joy"}', '{"names": [], "topic": "joy", "more": 1}',
     '{"names": ["' + "a" * 20_000 + '"], "topic": "joy"}'],
)  # fmt: skip
def test_what_is_no_fields_of_senders_is_refused(text):
    """A stranger may say it in /diagnostics of a flight without a key."""
    with pytest.raises(ValueError, match="^senders: "):
        TopicSenders.read(text)


def test_a_node_whose_name_has_not_come_is_no_name_of_the_middleware():
    """rmw's own words for it are no name that a user could look for."""
    (sender,) = senders_of(Graph(UNKNOWN), "odom")
    assert full_name(sender) == NOT_YET_NAMED
    assert not any(word in full_name(sender) for word in UNKNOWN)


def test_a_name_takes_the_place_of_not_yet_named_whenever_it_comes():
    """Also that of a node that is known by another publisher; nobody is counted twice."""
    graph, ever = Graph(), EverSent()
    names = []
    for now in (
        [("/", "scenario", 1), (*UNKNOWN, 2)],
        [("/", "scenario", 1), ("/", "outer_loop", 2)],
        [(*UNKNOWN, 1), ("/", "outer_loop", 2), ("/", "outer_loop", 3)],
    ):
        graph.now(*now)
        ever.look(graph, "odom")
        names.append(ever.names(besides="/outer_loop"))
    assert names == [["/scenario", NOT_YET_NAMED], ["/scenario"], ["/scenario"]]


def test_who_has_sent_and_left_stays_named():
    graph, ever = Graph(), EverSent()
    for now in ([(*UNKNOWN, 7), ("/", "pilot", 8)], []):
        graph.now(*now)
        ever.look(graph, "odom")
    assert ever.names(besides="/outer_loop") == ["/pilot", NOT_YET_NAMED]


def test_the_first_after_a_restart_is_a_successor_before_its_name_has_come(tmp_path, monkeypatch):
    """Without a note who has no name is none; with one it is, once; nor is another by name."""
    monkeypatch.setenv(FOLDER, str(tmp_path))
    old, successor, pilot = ("/red", "observer", 1), (*UNKNOWN, 2), ("/", "pilot", 3)
    graph = Graph()
    is_successor = successors_of(graph, "odom")
    graph.now(old, successor)
    assert not is_successor(False) and not is_successor(True)
    note_restart(tmp_path, "observer")
    graph.now(old, successor, pilot)
    assert not is_successor(False) and not is_successor(True)
    graph.now(old, successor)
    assert is_successor(False)
    assert not is_successor(False) and not is_successor(True)
    graph.now(old, ("/red", "observer", 2))
    assert is_successor(True) and not is_successor(False)


def test_nobody_is_a_successor_where_nobody_is_started_again(monkeypatch):
    monkeypatch.delenv(FOLDER, raising=False)
    assert not successors_of(Graph(("/red", "observer"), ("/red", "observer")), "odom")(True)
