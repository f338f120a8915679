# SPDX-License-Identifier: Apache-2.0
"""Who sends on a topic, in words: also before the middleware knows a node's name."""

from types import SimpleNamespace

from heli_msgs_bridge.senders import NOT_YET_NAMED, full_name, senders_of, several_in_words


class Graph:
    """A node's look at the graph."""

    def __init__(self, *senders):
        self.infos = [SimpleNamespace(node_namespace=s, node_name=n) for s, n in senders]

    def resolve_topic_name(self, topic):
        return f"/red/{topic}"

    def get_publishers_info_by_topic(self, topic):
        assert topic == "/red/odom"
        return self.infos


def test_senders_are_named_in_order():
    senders = senders_of(Graph(("/red", "observer"), ("/", "pilot")), "odom")
    assert senders == [("/", "pilot"), ("/red", "observer")]
    assert several_in_words("odom", senders) == (
        "odom: sent by /pilot, /red/observer; only the first sender's messages are used"
    )


def test_a_node_whose_name_has_not_come_is_no_name_of_the_middleware():
    """rmw's own words for it are no name that a user could look for."""
    unknown = "_NODE_NAMESPACE_UNKNOWN_", "_NODE_NAME_UNKNOWN_"
    (sender,) = senders_of(Graph(unknown), "odom")
    assert full_name(sender) == NOT_YET_NAMED == "a node that is not named yet"
