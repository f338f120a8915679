# SPDX-License-Identifier: Apache-2.0
"""Links that lose, delay, exchange and repeat: what is handed over when, and what is refused."""

import numpy as np
import pytest
import yaml
from scipy import stats

from heli_core.errors import ParameterCause
from heli_core.rcl_yaml import ParameterError
from heli_core.ticks import Rate
from heli_msgs_bridge import topics
from heli_msgs_bridge.links import (
    COUNTED,
    LINKS,
    NOTHING,
    PLACE,
    HeardLinks,
    fault_rows,
    initial_links,
    link_fault_of,
    link_faults_of,
    link_params,
    pass_on,
)

RATE = Rate()
ODOM = PLACE[topics.ODOM, "inner_loop"]
ACTING = "link fault: odom loss, collective delay"
WORDS = "link odom observer to inner_loop reorder 0.25 from 3 to 5 s"


def text(kind, value, topic=topics.ODOM, to="inner_loop", start_s=0.0, sender="any", more=""):
    return (f"{{what: link, from: {sender}, to: {to}, topic: {topic}, kind: {kind}, "
            f"value: {value}, start_s: {start_s}{more}}}")  # fmt: skip


def kernel(texts, seed=1, receiver="inner_loop"):
    return link_params(fault_rows(texts, receiver, RATE), seed, RATE)


def over(k, ticks, link=ODOM, period=1):
    """Stamps that are handed over at each tick, of messages that say their tick; and counts."""
    state, out, received = initial_links(k, RATE), np.zeros(2), []
    for tick in range(ticks):
        row = np.array([float(tick), 2.0 * tick])
        stamp = pass_on(state, k, link, tick, tick, tick % period == 0, row, out)
        if stamp != NOTHING:
            assert out.tolist() == [stamp, 2.0 * stamp]
        received.append(None if stamp == NOTHING else int(stamp))
    return received, dict(zip(COUNTED, state.counts[link].tolist(), strict=True))


def test_the_links_are_those_of_the_table_of_topics():
    assert (topics.ODOM, "outer_loop") in LINKS and (topics.ACTUATORS, "observer") in LINKS
    assert not any(topic in (topics.REFERENCE, topics.CLOCK) for topic, _ in LINKS)


def test_a_link_without_a_fault_hands_over_at_once():
    received, counts = over(
        kernel([text("loss", 1.0)]), 20, PLACE[topics.ROTOR_STATE, "inner_loop"]
    )
    assert received == list(range(20)) and not any(counts.values())


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_a_share_is_lost_and_which_hangs_on_the_seed(share):
    n = 4000
    received, counts = over(kernel([text("loss", share)]), n)
    lost = [tick for tick, stamp in enumerate(received) if stamp is None]
    assert counts == {"lost": len(lost), "delayed": 0, "overtaken": 0, "twice": 0}
    assert stats.binomtest(len(lost), n, share).pvalue > 1e-3
    # Whether one is lost says nothing of the next one.
    after = sum(received[tick + 1] is None for tick in lost if tick + 1 < n)
    assert stats.binomtest(after, len(lost), share).pvalue > 1e-3
    again, _ = over(kernel([text("loss", share)]), n)
    other, _ = over(kernel([text("loss", share)], seed=2), n)
    assert again == received and other != received


def test_two_losses_on_a_link_are_drawn_apart():
    n = 4000
    received, _ = over(kernel([text("loss", 0.5), text("loss", 0.5)]), n)
    assert stats.binomtest(received.count(None), n, 0.75).pvalue > 1e-3


def test_two_links_lose_different_messages():
    both = [text("loss", 0.5), text("loss", 0.5, topics.ROTOR_STATE)]
    k = kernel(both)
    assert over(k, 300)[0] != over(k, 300, PLACE[topics.ROTOR_STATE, "inner_loop"])[0]


def test_the_faults_of_other_receivers_change_nothing():
    """One process knows all of them, a node its own."""
    fault = text("loss", 0.5)
    others = [text("loss", 0.5, to="outer_loop"), text("delay", 0.1, topics.IMU, "observer")]
    rows = [fault_rows([*others, fault], name, RATE) for name in ("observer", "outer_loop")]
    rows.append(fault_rows([*others, fault], "inner_loop", RATE))
    everybody = link_params(np.concatenate(rows), 1, RATE)
    assert over(everybody, 500) == over(kernel([*others, fault]), 500)


def test_a_delay_hands_over_that_much_later_with_the_old_stamp():
    received, counts = over(kernel([text("delay", 0.03, start_s=0.1)]), 30)
    assert received == [*range(10), None, None, None, *range(10, 27)]
    assert counts["delayed"] == 20


def test_a_delay_that_ends_is_overtaken():
    received, counts = over(kernel([text("delay", 0.05, more=", duration_s: 0.1")]), 20)
    assert received == [None] * 5 + [0, 1, 2, 3, 4, *range(10, 20)]
    assert counts["overtaken"] == 5


def test_delays_add_up_to_what_is_remembered():
    received, _ = over(kernel([text("delay", 1.0), text("delay", 1.0)]), 300)
    first = next(tick for tick, stamp in enumerate(received) if stamp is not None)
    assert received[first:] == list(range(300 - first)) and first >= 100


def test_of_a_pair_the_second_comes_first_and_the_first_is_of_no_use():
    received, counts = over(kernel([text("reorder", 1.0)]), 20)
    assert received == [None if tick % 2 == 0 else tick for tick in range(20)]
    assert counts["overtaken"] == 10 and counts["lost"] == 0


def test_an_exchanged_message_is_used_if_the_other_is_lost():
    k = kernel([text("reorder", 1.0), text("loss", 0.5)])
    received, _ = over(k, 200)
    assert any(stamp is not None and stamp < tick for tick, stamp in enumerate(received))
    heard = [stamp for stamp in received if stamp is not None]
    assert heard == sorted(set(heard))


def test_a_repeat_is_used_once():
    received, counts = over(kernel([text("duplicate", 1.0)]), 20)
    assert received == list(range(20)) and counts["twice"] == 19


@pytest.mark.parametrize("period", [2, 5])
def test_slow_topics_keep_their_period(period):
    topic = {2: topics.MAG, 5: topics.BARO}[period]
    link = PLACE[topic, "observer"]
    k = kernel([text("delay", 0.03, topic, "observer")], receiver="observer")
    received, _ = over(k, 40, link, period)
    assert [(tick, s) for tick, s in enumerate(received) if s is not None] == [
        (sent + 3, sent) for sent in range(0, 37, period)
    ]


def heard(*texts, node="inner_loop", lags=None):
    values = {"link_faults": texts, "link_seed": 1, "rate_hz": 100}
    return HeardLinks(node, lags or {topics.ODOM: 0, topics.COLLECTIVE: 0}, values)


def test_a_node_hears_what_has_arrived_and_counts_the_rest():
    links = heard(text("loss", 1.0, start_s=0.02), text("delay", 0.02, topics.COLLECTIVE))
    assert links.faulty and links.has(topics.ODOM)
    arrived = [
        links.through(t, {topics.ODOM: (t, np.full(31, float(t))),
                          topics.COLLECTIVE: (t, np.array([0.1 * t])), "other": (t, None)})
        for t in range(5)
    ]  # fmt: skip
    assert [topics.ODOM in one for one in arrived] == [True, True, False, False, False]
    stamp, row = arrived[3][topics.COLLECTIVE]
    assert stamp == 1 and row[0] == 0.1 and np.isnan(row[1:]).all()
    assert all("other" in one for one in arrived)
    assert links.facts() == {"link.odom": "lost 3", "link.collective": "delayed 5"}
    collective = (topics.COLLECTIVE, "delay")
    assert links.acting_on(0.01) == [collective]
    assert links.acting_on(0.02) == [(topics.ODOM, "loss"), collective]
    assert links.acting(0.02) == ACTING
    links.begin_anew()
    assert links.through(0, {topics.ODOM: (0, np.zeros(31))})[topics.ODOM][0] == 0


def test_an_early_stamp_is_counted_from_its_sending():
    """A fix is stamped with when it was true."""
    links = heard(text("delay", 0.03, topics.GPS_FIX, "observer"), node="observer",
                  lags={topics.GPS_FIX: 15})  # fmt: skip
    assert links.through(20, {topics.GPS_FIX: (5, np.ones(3))}) == {}
    assert links.through(22, {}) == {}
    assert links.through(23, {})[topics.GPS_FIX][0] == 5


def test_a_message_that_cannot_be_used_is_none():
    links = heard(text("delay", 0.01))
    assert links.through(0, {topics.ODOM: (0, None)}) == {}
    assert links.through(1, {}) == {}


def test_a_fault_reads_back():
    whole = text("reorder", 0.25, sender="observer", start_s=3, more=", duration_s: 2")
    (fault,) = link_faults_of([whole, "none"])
    assert link_faults_of([fault.text]) == (fault,)
    assert fault.links == ((topics.ODOM, "inner_loop"),)
    assert (fault.sender, fault.kind, fault.value) == ("observer", "reorder", (0.25,))
    assert (fault.start_s, fault.end_s, fault.words) == (3.0, 5.0, WORDS)
    assert fault.as_dict()["duration_s"] == 2.0
    everywhere = link_faults_of(["{what: link, from: any, to: any, kind: loss, start_s: 0}"])[0]
    assert everywhere.links == LINKS and everywhere.value == (1.0,)
    assert everywhere.as_dict()["duration_s"] is None


@pytest.mark.parametrize(
    ("entry", "why"),
    [
        ("what: link, from: a, to: any, kind: loss, start_s: 0", "from: a is not allowed"),
        ("what: link, from: any, to: inner_lop, kind: loss, start_s: 0", "did you mean inner_loop"),
        ("what: link, from: any, to: any, topic: odm, kind: loss, start_s: 0", "did you mean odom"),
        ("what: link, from: plant, to: inner_loop, kind: loss, start_s: 0", "goes no topic; known"),
        ("what: link, from: observer, to: inner_loop, topic: baro, kind: loss, start_s: 0",
         "from observer to inner_loop goes not baro"),
        ("what: link, from: any, to: any, kind: lose, start_s: 0", "did you mean loss"),
        ("what: link, from: any, to: any, kind: loss", "start_s: missing"),
        ("what: link, to: any, kind: loss, start_s: 0", "from: missing"),
        ("what: link, from: any, to: any, kind: loss, start_s: -1", "start_s: -1 is not allowed"),
        ("what: link, from: any, to: any, kind: loss, start_s: 0, value: 1.5", "value: 1.5"),
        ("what: link, from: any, to: any, kind: loss, start_s: 0, value: 0", "(0, 1]"),
        ("what: link, from: any, to: any, kind: delay, start_s: 0", "value: missing"),
        ("what: link, from: any, to: any, kind: delay, start_s: 0, value: .nan", "value: nan"),
        ("what: link, from: any, to: any, kind: loss, start_s: 0, valeu: 1", "did you mean value"),
        ("what: link, from: any, from: any, to: any, kind: loss, start_s: 0", "stands here twice"),
        ("what: link, from: [any], to: any, kind: loss, start_s: 0", "expected one value"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_one_sentence(entry, why):
    with pytest.raises(ParameterError) as caught:
        link_faults_of([f"{{{entry}}}"])
    assert str(caught.value).startswith("link_faults: entry 1: ") and why in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_no_mapping_and_too_many():
    for wrong, cause in (("[1]", ParameterCause.TYPE), ("{", ParameterCause.SYNTAX)):
        with pytest.raises(ParameterError) as caught:
            link_faults_of([wrong])
        assert (caught.value.cause, caught.value.where) == (cause, "link_faults: entry 1")
    with pytest.raises(ParameterError, match="at most 64") as caught:
        link_faults_of([text("loss", 1.0)] * 65)
    assert (caught.value.cause, caught.value.value) == (ParameterCause.LENGTH, 65)
    with pytest.raises(ParameterError) as caught:
        link_fault_of(yaml.compose("3"), "here")
    assert (caught.value.cause, caught.value.where) == (ParameterCause.TYPE, "here")
