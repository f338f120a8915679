# SPDX-License-Identifier: Apache-2.0
"""`TickAssembler` against a plain specification, over arbitrary histories (hypothesis, stateful).

The specification remembers every message in one flat dictionary and answers each question by
looking through it; it shares no line and no structure with the code.
"""

import pickle

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

from heli_msgs_bridge.lockstep import Demand, TickAssembler

WINDOW = 6
TOPICS = ("imu", "mag", "gps", "command")
DEMANDS = st.fixed_dictionaries(
    {
        "imu": st.just(Demand()),
        "mag": st.builds(Demand, every_ticks=st.sampled_from([1, 2])),
        "gps": st.builds(Demand, every_ticks=st.sampled_from([3, 4]), lag_ticks=st.integers(0, 3)),
        "command": st.builds(
            Demand, lag_ticks=st.just(1), first_tick=st.integers(0, 2), every_ticks=st.just(1)
        ),
    }
)


class Assembling(RuleBasedStateMachine):
    """Messages in any order, duplicate, late, ahead; topics waived and wanted again; steps."""

    @initialize(demands=DEMANDS)
    def build(self, demands):
        self.demands = demands
        self.real = TickAssembler(demands, WINDOW)
        self.kept = {}
        self.next = None
        self.waived = set()
        self.counted = {"duplicate": 0, "late": 0, "ahead": 0}
        self.serial = 0

    # --- what happens ------------------------------------------------------------------------

    @rule(topic=st.sampled_from(TOPICS), offset=st.integers(-4, WINDOW + 4), usable=st.booleans())
    def message(self, topic, offset, usable):
        """A message for a step near the next one; None: it came but cannot be used."""
        self.serial += 1
        step = offset if self.next is None else self.next + offset
        value = self.serial if usable else None
        kept = self.real.add(topic, step - self.demands[topic].lag_ticks, value)
        assert kept == self.specified_add(topic, step, value)

    def specified_add(self, topic, step, value):
        if self.next is not None and step < self.next:
            self.counted["late"] += 1
            return False
        if self.next is not None and step >= self.next + WINDOW:
            self.counted["ahead"] += 1
            return False
        if (step, topic) in self.kept:
            self.counted["duplicate"] += 1
            return False
        self.kept[step, topic] = value
        steps = {at for at, _ in self.kept}
        if len(steps) > WINDOW:
            # Nobody has begun yet: the memory is for the newest steps.
            gone = [key for key in self.kept if key[0] == min(steps)]
            self.counted["late"] += len(gone)
            for key in gone:
                del self.kept[key]
        return (step, topic) in self.kept

    @precondition(lambda self: self.next is not None)
    @rule(data=st.data())
    def everything_due(self, data):
        """All that the next step waits for comes, in any order."""
        for topic in data.draw(st.permutations(self.real.missing())):
            self.message(topic, 0, True)
        if self.kept_now():
            assert self.real.complete()

    @rule(step=st.integers(-3, 12))
    def begin(self, step):
        step = step if self.next is None else self.next + step + 3
        self.real.start(step)
        self.next = step
        early = [key for key in self.kept if key[0] < step]
        far = [key for key in self.kept if key[0] >= step + WINDOW]
        self.counted["late"] += len(early)
        self.counted["ahead"] += len(far)
        for key in early + far:
            del self.kept[key]

    @precondition(lambda self: self.next is not None)
    @rule()
    def step(self):
        """Complete or not, a step takes exactly what was kept for it."""
        expected = self.kept_now()
        assert self.real.take() == expected
        for topic in expected:
            del self.kept[self.next, topic]
        self.next += 1

    @rule(topic=st.sampled_from(TOPICS))
    def peer_falls_silent(self, topic):
        self.real.waive(topic)
        self.waived.add(topic)

    @rule(topic=st.sampled_from(TOPICS))
    def peer_returns(self, topic):
        self.real.waive(topic, False)
        self.waived.discard(topic)

    @rule()
    def forget(self):
        self.real.reset()
        self.kept, self.next, self.waived = {}, None, set()

    # --- what must be true afterwards --------------------------------------------------------

    def kept_now(self):
        return {topic: value for (at, topic), value in self.kept.items() if at == self.next}

    def wanted_now(self):
        """Topics whose schedule names the next step and that somebody is expected to send."""
        wanted = set()
        for topic, demand in self.demands.items():
            scheduled = self.next >= demand.first_tick and self.next % demand.every_ticks == 0
            if scheduled and topic not in self.waived:
                wanted.add(topic)
        return wanted

    @invariant()
    def agrees(self):
        assert self.real.next_tick == self.next
        assert vars(self.real.counters) == self.counted
        for topic in TOPICS:
            assert self.real.kept(topic) == sorted(at for at, name in self.kept if name == topic)
        if self.next is None:
            assert set(self.real.missing()) == set(TOPICS) and not self.real.complete()
            return
        absent = self.wanted_now() - set(self.kept_now())
        assert set(self.real.missing()) == absent
        # Nothing steps on silence: at least one message must have come.
        assert self.real.complete() == (not absent and bool(self.kept_now()))


def test_any_history(search):
    run_state_machine_as_test(Assembling, settings=search)


def test_a_silent_peer_is_not_waited_for_and_counts_again_when_it_returns():
    """Four steps of two topics: the second falls silent after one and is back at the fourth."""
    assembler = TickAssembler({"a": Demand(), "b": Demand()})
    assembler.start(0)
    assembler.add("a", 0, "a0")
    assert assembler.missing() == ("b",) and not assembler.complete()
    assembler.add("b", 0, "b0")
    assert assembler.take() == {"a": "a0", "b": "b0"}
    assembler.add("a", 1, "a1")
    assembler.waive("b")
    assert assembler.complete() and assembler.take() == {"a": "a1"}
    # What it sends while it is waived is used where it belongs, and lost where it is late.
    assert not assembler.add("b", 1, "b1") and assembler.counters.late == 1
    assembler.add("b", 2, "b2")
    assembler.add("a", 2, "a2")
    assert assembler.take() == {"a": "a2", "b": "b2"}
    assembler.waive("b", False)
    assembler.add("a", 3, "a3")
    assert assembler.missing() == ("b",) and not assembler.complete()


def test_nothing_is_taken_before_the_first_tick_is_known():
    assembler = TickAssembler({"a": Demand()})
    assembler.add("a", 0, "a0")
    with pytest.raises(RuntimeError, match="start"):
        assembler.take()


@pytest.mark.parametrize("started", [False, True])
def test_a_flood_does_not_grow(started):
    """Ten thousand stamps all over the place, before or after the first tick is known."""

    def size_after(messages):
        assembler = TickAssembler({"a": Demand(), "b": Demand()}, window_ticks=8)
        if started:
            assembler.start(0)
        for number in range(messages):
            assembler.add("ab"[number % 2], number * 1_000_003 % 20_011, 0)
        return len(pickle.dumps(vars(assembler)))

    assert size_after(10_000) <= size_after(100) + 100
