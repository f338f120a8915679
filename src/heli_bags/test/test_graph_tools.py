# SPDX-License-Identifier: Apache-2.0
"""When the graph counts as known: discovery on a scripted clock, no wall time."""

from types import SimpleNamespace

import pytest

from heli_bags import graph_tools

STILL, CHANGING = "nothing new for 1.5 s", "still changing after 12 s"
UNKNOWN = f"no topic imu in the graph ({STILL}); there is /odom"


class ScriptedGraph:
    """Stands for a node: what discovery has brought by now, endpoint by endpoint.

    Parameters
    ----------
    arrivals : sequence of (float, str, str)
        Time in s, "publisher" or "subscriber", topic.
    """

    def __init__(self, arrivals):
        self.arrivals, self.now = arrivals, 0.0

    def get_name(self):
        return "listener"

    def _known(self):
        return [row for row in self.arrivals if row[0] <= self.now]

    def get_node_names_and_namespaces(self):
        return [("listener", "/")]

    def get_topic_names_and_types(self):
        return [(name, ["std_msgs/msg/Empty"]) for name in {row[2] for row in self._known()}]

    def _infos(self, kind, name):
        rows = [row for row in self._known() if row[1:] == (kind, name)]
        return [SimpleNamespace(node_name="other") for _ in rows]

    def get_publishers_info_by_topic(self, name):
        return self._infos("publisher", name)

    def get_subscriptions_info_by_topic(self, name):
        return self._infos("subscriber", name)


@pytest.fixture
def graph(monkeypatch):
    """Make a scripted graph whose clock is the one that graph_tools reads."""

    def make(*arrivals):
        scripted = ScriptedGraph(arrivals)
        monkeypatch.setattr(graph_tools.time, "monotonic", lambda: scripted.now)

        def sleep(seconds):
            scripted.now += seconds

        monkeypatch.setattr(graph_tools.time, "sleep", sleep)
        return scripted

    return make


def test_a_subscriber_that_announces_itself_late_is_counted(graph):
    node = graph(
        (0.1, "publisher", "/odom"),
        (0.1, "subscriber", "/odom"),
        (0.3, "subscriber", "/odom"),
        (1.7, "subscriber", "/odom"),
    )
    rows, discovery = graph_tools.list_topics(node)
    assert [(row.topic, row.publishers, row.subscribers) for row in rows] == [("/odom", 1, 3)]
    assert discovery.still and 3.2 < node.now < 3.4
    assert discovery.settle_s == graph_tools.SETTLED_S and str(discovery) == STILL
    rows, _ = graph_tools.list_topics(graph(*node.arrivals), settle_s=0.5)
    assert rows[0].subscribers == 2


def test_a_graph_that_never_stands_still_is_taken_at_the_limit_and_said(graph):
    node = graph(*[(0.4 * n, "publisher", f"/topic_{n}") for n in range(100)])
    rows, discovery = graph_tools.list_topics(node)
    assert not discovery.still and 11.4 < node.now < 11.7 and len(rows) == 29
    assert round(discovery.waited_s) == 12 and str(discovery) == CHANGING


def test_an_empty_graph_gets_its_time(graph):
    node = graph()
    assert graph_tools.list_topics(node, settle_s=0.1)[0] == [] and 1.9 < node.now < 2.2
    node = graph((1.8, "publisher", "/clock"))
    assert graph_tools.list_topics(node, settle_s=0.1)[0][0].topic == "/clock"


def test_hidden_topics_are_left_out_unless_asked_for(graph):
    node = graph((0.0, "publisher", "/a/_b"), (0.0, "publisher", "/c"))
    assert [row.topic for row in graph_tools.list_topics(node)[0]] == ["/c"]
    assert [row.topic for row in graph_tools.list_topics(node, True)[0]] == ["/a/_b", "/c"]


def test_the_listener_waits_for_the_publisher_whose_qos_it_needs(graph):
    """A latched message that was sent before is lost on whoever asks without knowing its QoS."""
    node = graph((0.1, "subscriber", "/reference"), (1.4, "publisher", "/reference"))
    status = graph_tools.find(node, "reference", graph_tools.SETTLED_S)
    assert (status.topic, status.publishers) == ("/reference", 1)
    silent = graph((0.1, "subscriber", "/reference"))
    assert graph_tools.find(silent, "/reference", graph_tools.SETTLED_S).publishers == 0
    late = graph((0.1, "subscriber", "/reference"), (20.0, "publisher", "/reference"))
    assert graph_tools.find(late, "reference", 1.5, wait_s=30.0).publishers == 1
    assert 20.0 <= late.now < 20.1
    with pytest.raises(graph_tools.TopicError) as caught:
        graph_tools.find(graph((0.1, "publisher", "/odom")), "imu", graph_tools.SETTLED_S)
    error = caught.value
    assert error.cause == graph_tools.TopicCause.UNKNOWN
    assert (error.topic, error.known) == ("imu", ("/odom",)) and str(error) == UNKNOWN
