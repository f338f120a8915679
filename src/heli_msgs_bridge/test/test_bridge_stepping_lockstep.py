# SPDX-License-Identifier: Apache-2.0
"""When a node steps in lockstep: `Lockstep` against a plain specification, over any history.

The steps in one sentence: a step is made as soon as it is its turn and either all that it waits for
has come, or its trigger's sender has gone on to a later tick, or it has been waited for so long.

Stamps in one sentence: what is more than `AHEAD_TICKS` ahead of the clock is not taken, and neither
is a trigger that is as far behind it, unless it follows upon another such one.
"""

from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

from heli_msgs_bridge.lockstep import AHEAD_TICKS, Demand, Lockstep

WINDOW = 64
TIMEOUT_S = 10.0
TOPICS = ("odom", "rotor", "setpoint")
DEMANDS = {
    "odom": Demand(),
    "rotor": Demand(lag_ticks=1, first_tick=1),
    "setpoint": Demand(every_ticks=4),
}


class LockstepMachine(RuleBasedStateMachine):
    """A node that is started and stopped; messages of any tick; time that passes; a closed gate."""

    leads = False

    @initialize()
    def build(self):
        self.time_s, self.open, self.silences = 0.0, True, 0
        self.made = []
        self.real = Lockstep(
            DEMANDS,
            lambda tick, arrived: self.made.append((tick, dict(arrived))),
            TIMEOUT_S,
            ready=lambda: self.open,
            on_silence=self.hear_of_silence,
            leads=self.leads,
            now_s=lambda: self.time_s,
            refused=lambda *odd: self.refused.append(odd),
        )
        self.refused, self.expected_refused = [], []
        self.serial, self.begun, self.collecting, self.stepping = 0, [], True, False
        self.expected = []
        self.expected_silences = 0
        self.forget()

    def hear_of_silence(self):
        self.silences += 1
        assert self.real.silent

    def forget(self):
        self.kept, self.next, self.passed, self.silent = {}, None, None, set()
        self.doubted = None

    # --- the specification -----------------------------------------------------------------------

    def here(self):
        return {name: value for (tick, name), value in self.kept.items() if tick == self.next}

    def lacks(self):
        """What the next step waits for."""
        return {
            name
            for name, demand in DEMANDS.items()
            if self.next >= demand.first_tick
            and self.next % demand.every_ticks == 0
            and name not in self.silent
            and name not in self.here()
        }

    def step(self):
        here = self.here()
        self.expected.append((self.next, here))
        for name in here:
            del self.kept[self.next, name]
        self.next += 1
        self.since_s = self.time_s

    def make_what_can_be_made(self):
        while self.stepping and self.next is not None and self.open:
            passed = self.passed is not None and self.next < self.passed
            if not passed and (self.lacks() or not self.here()):
                return
            self.step()

    def begin_at(self, tick):
        self.next = tick
        inside = range(tick, tick + WINDOW)
        self.kept = {key: value for key, value in self.kept.items() if key[0] in inside}

    def admitted(self, name, tick):
        """Whether a stamp fits to the clock, or sets it."""
        if self.next is None:
            return True
        sets = name == "odom" and not self.leads
        clock = self.next if self.passed is None else max(self.next, self.passed)
        ahead = tick - clock > AHEAD_TICKS
        if not ahead and not (sets and self.next - tick > AHEAD_TICKS):
            self.doubted = None if sets else self.doubted
            return True
        if sets:
            before, self.doubted = self.doubted, tick
            if before is not None and before < tick <= before + AHEAD_TICKS:
                self.begin_at(tick)
                self.passed = self.doubted = None
                return True
        self.expected_refused.append((name, tick - DEMANDS[name].lag_ticks, clock))
        return False

    # --- what happens ----------------------------------------------------------------------------

    @rule(
        name=st.sampled_from(TOPICS),
        offset=st.integers(-3, 6),
        far=st.sampled_from([0, 0, WINDOW, 100_000, -300]),
    )
    def message(self, name, offset, far):
        self.arrives(name, (self.next if self.next is not None else 0) + offset + far)

    @precondition(lambda self: self.next is not None)
    @rule(first=st.integers(-500, 500), gap=st.integers(0, 6), then=st.sampled_from(TOPICS))
    def another_time(self, first, gap, then):
        """The trigger twice in a row from somewhere else, and what belongs to it."""
        first += self.next
        self.arrives("odom", first)
        self.arrives("odom", first + gap)
        self.arrives(then, first + gap)

    def arrives(self, name, tick):
        """A message for the step of a tick."""
        self.serial += 1
        stamp = tick - DEMANDS[name].lag_ticks
        value = self.serial if self.serial % 5 else None
        self.real.take(name, stamp, value)
        if not (self.collecting or self.stepping) or not self.admitted(name, tick):
            return
        self.silent.discard(name)
        known = (tick, name) in self.kept
        outside = self.next is not None and not self.next <= tick < self.next + WINDOW
        if known or outside:
            return
        self.kept[tick, name] = (stamp, value)
        if not self.stepping:
            return
        if name == "odom":
            if self.next is None:
                self.begin_at(tick)
            self.passed = tick if self.passed is None else max(tick, self.passed)
        self.make_what_can_be_made()

    @precondition(lambda self: self.stepping and self.next is not None)
    @rule()
    def a_whole_tick(self):
        """All that the next step waits for, the trigger first, as in a flight."""
        for name in sorted(self.lacks()):
            self.message(name, 0, 0)

    @precondition(lambda self: not self.stepping)
    @rule()
    def start(self):
        self.real.start()
        self.stepping, self.since_s = True, self.time_s
        if self.next is not None:  # it was paused
            self.make_what_can_be_made()
            return
        first = min((tick for tick, name in self.kept if name == "odom"), default=None)
        if self.leads:
            first = 0
        if first is not None:
            self.begin_at(first)
            self.passed = None
            for tick in sorted(tick for tick, name in self.kept if name == "odom"):
                if self.passed is None or tick <= self.passed + AHEAD_TICKS:
                    self.passed = tick
            self.make_what_can_be_made()

    @precondition(lambda self: self.stepping)
    @rule()
    def pause(self):
        self.real.pause()
        self.collecting, self.stepping = True, False

    @precondition(lambda self: self.stepping)
    @rule()
    def stop(self):
        self.real.stop()
        self.stepping = self.collecting = False
        self.forget()

    @rule(seconds=st.sampled_from([0.05, 4.0, TIMEOUT_S]))
    def time_passes(self, seconds):
        self.time_s += seconds
        self.real.look()
        if not self.stepping or self.next is None:
            return
        self.make_what_can_be_made()
        if "odom" in self.silent:
            self.step()
            return
        lacks = self.lacks()
        stands = "odom" in lacks and not self.leads
        if lacks and not stands and self.time_s - self.since_s >= TIMEOUT_S:
            self.silent |= lacks
            self.expected_silences += 1
            if "odom" in lacks:
                self.step()
            self.make_what_can_be_made()

    @rule(is_open=st.booleans())
    def gate(self, is_open):
        self.open = is_open
        if is_open:
            self.real.resume()
            self.make_what_can_be_made()

    # --- what must be true afterwards ------------------------------------------------------------

    @invariant()
    def the_same_steps_were_made(self):
        assert self.made == self.expected
        assert self.refused == self.expected_refused
        assert self.real.silent == self.silent
        assert self.silences == self.expected_silences


class LeaderMachine(LockstepMachine):
    """The node that makes time: it begins at tick 0 and goes on without its trigger."""

    leads = True


def test_any_history_of_a_node(search):
    run_state_machine_as_test(LockstepMachine, settings=search)


def test_any_history_of_the_node_that_leads(search):
    run_state_machine_as_test(LeaderMachine, settings=search)


def test_no_step_waits_once_the_trigger_has_gone_on():
    """Ticks 1 and 3 lack something, 2 does not; a node that was not ready makes them all."""
    ticks, ready = [], []
    pace = Lockstep(
        {"a": Demand(), "b": Demand()},
        lambda tick, _: ticks.append(tick),
        TIMEOUT_S,
        ready=lambda: bool(ready),
    )
    pace.start()
    for name, tick in (("a", 1), ("a", 2), ("b", 2), ("a", 3), ("a", 5)):
        pace.take(name, tick, 0)
    assert ticks == []
    ready.append(True)
    pace.resume()
    assert ticks == [1, 2, 3, 4]
    pace.take("b", 5, 0)
    assert ticks == [1, 2, 3, 4, 5]


def test_ticks_before_the_flights_first_moment_are_passed_as_any():
    """A clock that was set back: the trigger's sender has gone on to a later tick here, too."""
    ticks = []
    pace = Lockstep({"a": Demand(), "b": Demand()}, lambda tick, _: ticks.append(tick), TIMEOUT_S)
    for tick in (0, -3):
        pace.take("a", tick, 0)
    pace.start()
    assert ticks == [-3, -2, -1]


def test_a_step_that_stops_the_node_is_the_last():
    """As the plant does at the end of the flight, though more messages wait."""
    ticks = []

    def step(tick, arrived):
        ticks.append(tick)
        if tick == 3:
            pace.stop()

    pace = Lockstep({"a": Demand(), "b": Demand()}, step, TIMEOUT_S, leads=True)
    pace.start()
    for tick in range(3):
        pace.take("a", tick, 0)
        pace.take("b", tick, 0)
    pace.take("a", 6, 0)
    pace.look()
    pace.take("a", 7, 0)
    assert ticks == [0, 1, 2, 3]


def test_a_message_of_another_time_costs_no_tick():
    """Lockstep, the trigger itself: what follows is stepped as if it had not come."""
    ticks, odd = [], []
    pace = Lockstep(
        {"a": Demand()},
        lambda tick, _: ticks.append(tick),
        TIMEOUT_S,
        refused=lambda *what: odd.append(what),
    )
    pace.start()
    for tick in (7, 8, 100_000, 9, 40, 10, 3, 11):
        pace.take("a", tick, 0)
    assert ticks == [7, 8, 9, 10, 11]
    assert odd == [("a", 100_000, 9), ("a", 40, 10), ("a", 3, 11)]


def test_the_trigger_of_another_time_twice_in_a_row_sets_the_clock():
    """The first message that was heard had a stamp of the future: the true ones are not late."""
    ticks = []
    pace = Lockstep({"a": Demand()}, lambda tick, _: ticks.append(tick), TIMEOUT_S)
    pace.start()
    for tick in (179_530_000, 5, 6, 7):
        pace.take("a", tick, 0)
    assert ticks == [179_530_000, 6, 7]


def joined(tick, *heard):
    """Ticks that a node makes which joins at one, by its trigger "a"; "b" is of the leader."""
    ticks = []
    pace = Lockstep(
        {"a": Demand(), "b": Demand(), "c": Demand()},
        lambda tick, _: ticks.append(tick),
        TIMEOUT_S,
        of_leader=["b"],
    )
    for name, before in heard:
        pace.take(name, before, 0)
    pace.start()
    pace.take("c", tick, 0)
    pace.take("a", tick, 0)
    return ticks, pace


def test_one_that_joins_in_flight_waits_for_nothing_of_the_leader_that_it_never_heard():
    """It may not have been connected when that was sent; from its first message on it waits."""
    ticks, pace = joined(7)
    assert ticks == [7] and pace.silent == {"b"}
    pace.take("b", 6, 0)
    assert not pace.silent
    pace.take("a", 8, 0)
    pace.take("c", 8, 0)
    assert ticks == [7]
    pace.take("b", 8, 0)
    assert ticks == [7, 8]


def test_one_that_is_there_from_the_first_tick_waits_for_all():
    assert joined(0)[0] == []


def test_what_was_heard_once_is_waited_for():
    """Also after a pause: who has been heard is connected."""
    ticks, pace = joined(7, ("b", 5))
    assert ticks == [] and not pace.silent
    pace.stop()
    pace.start()
    pace.take("c", 9, 0)
    pace.take("a", 9, 0)
    assert ticks == [] and not pace.silent
