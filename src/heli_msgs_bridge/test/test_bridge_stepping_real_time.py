# SPDX-License-Identifier: Apache-2.0
"""When a node steps in real time: `RealTime` against a plain specification, over any history.

Which stamps are taken is said in `test_bridge_stepping_lockstep.py`; here the clock runs by itself
from the newest trigger on.
"""

import math

from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    rule,
    run_state_machine_as_test,
)

from heli_msgs_bridge.lockstep import AHEAD_TICKS, SILENT_S, RealTime, TriggerClock

TOPICS = ("odom", "rotor", "setpoint")


class RealTimeMachine(RuleBasedStateMachine):
    """Newest values: none older than one that was known, none of the future, each handed out once.

    The specification keeps one flat list of what was admitted: the tick that it counts for, topic,
    stamp, value, and whether it was handed out.
    """

    trigger = "odom"

    @initialize()
    def build(self):
        self.made, self.refused, self.expected_refused = [], [], 0
        self.time_s, self.clock_tick = 0.0, 0
        self.real = RealTime(
            self.trigger,
            lambda tick, arrived: self.made.append((tick, dict(arrived))),
            None if self.trigger else lambda: self.clock_tick,
            now_s=lambda: self.time_s,
            refused=lambda *odd: self.refused.append(odd),
        )
        self.expected, self.serial = [], 0
        self.stepping = self.paused = False
        self.forget()

    def forget(self):
        self.history, self.anchor, self.doubted = [], None, None
        self.windows = []
        self.heard, self.is_silent = None, False

    def clock(self):
        if not self.trigger:
            return self.clock_tick
        # Of each window all that was heard in it; the last two count.
        heard = [one for window in self.windows[-2:] for one in window]
        return max((tick + int((self.time_s - at_s) * 100) for tick, at_s in heard), default=None)

    def newest(self, name):
        return max((counts for counts, topic, *_ in self.history if topic == name), default=None)

    def drop_topics_from(self, tick):
        """Topics whose newest message counts for this tick or a later one are as never heard."""
        gone = {topic for counts, topic, *_ in self.history if counts >= tick}
        self.history = [entry for entry in self.history if entry[1] not in gone]

    def hand_out(self):
        """The newest of each topic, if nobody has had it."""
        newest = {}
        for entry in self.history:
            if entry[0] == self.newest(entry[1]) and not entry[4]:
                newest[entry[1]] = (entry[2], entry[3])
            entry[4] = True
        return newest

    def admitted(self, name, tick):
        now, newest = self.clock(), self.newest(name)
        if now is None:
            return True
        sets = name == self.trigger
        if tick <= now + AHEAD_TICKS and (not sets or tick >= newest - AHEAD_TICKS):
            self.doubted = None if sets else self.doubted
            return True
        if sets:
            before, self.doubted = self.doubted, tick
            if before is not None and before < tick <= before + AHEAD_TICKS:
                self.doubted = None
                self.drop_topics_from(tick)
                self.windows = []
                return True
        self.expected_refused += 1
        return False

    @rule(
        name=st.sampled_from(TOPICS),
        offset=st.integers(-8, 12),
        far=st.sampled_from([0, 0, 0, 1000, -40]),
    )
    def message(self, name, offset, far):
        self.arrives(name, (self.clock() or 0) + offset + far)

    @rule(first=st.integers(-300, 300), gap=st.integers(0, 6))
    def another_time(self, first, gap):
        """The trigger twice in a row from somewhere else."""
        for tick in (first, first + gap):
            self.arrives("odom", tick)

    def arrives(self, name, tick):
        self.serial += 1
        self.real.take(name, tick, self.serial)
        if not (self.stepping or self.paused) or not self.admitted(name, tick):
            return
        now, newest = self.clock(), self.newest(name)
        if newest is not None and tick <= newest:
            return
        counts = tick if name == self.trigger or now is None else min(tick, now)
        if name == self.trigger and self.anchor is None:
            self.drop_topics_from(tick + AHEAD_TICKS + 1)
        self.history.append([counts, name, tick, self.serial, False])
        if name == self.trigger:
            self.anchor = tick, self.time_s
            begun_s = self.windows[-1][0][1] if self.windows else -math.inf
            if self.time_s - begun_s >= TriggerClock.WINDOW_S:
                self.windows.append([])
            self.windows[-1].append(self.anchor)
            if tick >= 0 and self.stepping:
                self.expected.append((tick, self.hand_out()))

    @rule(ticks=st.integers(1, 30))
    def time_passes(self, ticks):
        self.time_s += ticks / 100 + 0.001
        self.clock_tick += ticks

    @rule()
    def collect(self):
        """Who keeps time himself takes what there is."""
        assert self.real.collect() == self.hand_out()

    @rule()
    def start(self):
        self.real.start()
        self.stepping, self.paused = True, False

    @rule()
    def pause(self):
        """What comes meanwhile is kept."""
        self.real.pause()
        self.stepping, self.paused = False, True

    @rule()
    def stop(self):
        self.real.stop()
        self.stepping = self.paused = False
        self.forget()

    @invariant()
    def the_same_steps_were_made(self):
        self.real.look()
        self.real.resume()
        anchor = self.anchor if self.trigger else None
        if anchor is None or anchor != self.heard:
            self.heard, self.is_silent = anchor, False
        if anchor is not None and self.stepping and self.time_s - anchor[1] > SILENT_S:
            self.is_silent = True
        assert self.made == self.expected
        assert self.real.silent == ({self.trigger} if self.is_silent else set())
        assert len(self.refused) == self.expected_refused


class PulledMachine(RealTimeMachine):
    """Without a trigger no message makes a step; the clock is one's own."""

    trigger = None


def test_any_history_in_real_time(search):
    run_state_machine_as_test(RealTimeMachine, settings=search)


def test_any_history_of_who_keeps_time_himself(search):
    run_state_machine_as_test(PulledMachine, settings=search)


def test_a_setpoint_a_little_ahead_does_not_make_the_next_one_late():
    """Within the bound it is taken, and counts as one of now."""
    taken = []
    pace = RealTime("odom", lambda tick, arrived: taken.append(arrived.get("setpoint")))
    pace.start()
    pace.take("odom", 8, 0)
    pace.take("setpoint", 8 + AHEAD_TICKS, "ahead")
    pace.take("odom", 9, 0)
    pace.take("setpoint", 9, "true")
    pace.take("odom", 10, 0)
    assert taken == [None, (8 + AHEAD_TICKS, "ahead"), (9, "true")]


def test_the_trigger_of_another_time_twice_in_a_row_sets_the_clock():
    """The first message that was heard had a stamp of the future: the true ones are not late."""
    ticks = []
    pace = RealTime("a", lambda tick, _: ticks.append(tick))
    pace.start()
    for tick in (179_530_000, 5, 6, 7):
        pace.take("a", tick, 0)
    assert ticks == [179_530_000, 6, 7]


def test_a_late_trigger_makes_nothing_else_early():
    """The observer cannot run for 0.4 s, then catches up; the plant, and its sensors, go on."""
    time_s, heard, refused = 0.0, [], []
    pace = RealTime(
        "odom", lambda tick, arrived: heard.append(arrived.get("rotor_speed")),
        now_s=lambda: time_s, refused=lambda *odd: refused.append(odd),
    )  # fmt: skip
    pace.start()
    held_up = range(50, 90)
    for tick in range(300):
        time_s = tick / 100
        pace.take("rotor_speed", tick, tick)
        for late in (*held_up, tick) if tick == held_up.stop else (tick,):
            if tick not in held_up:
                pace.take("odom", late, 0)
                pace.take("rotor_speed", tick, tick)
    assert refused == [] and pace.counters.ahead == 0
    assert [heard[tick] for tick in (49, 50, 91)] == [(49, 49), (90, 90), (91, 91)]


def test_a_trigger_that_stays_late_sets_the_clock_back():
    """The plant could not run for a second, time was shifted: the clock is behind soon, too."""
    time_s, refused = 0.0, []
    pace = RealTime(
        "odom", lambda tick, arrived: None,
        now_s=lambda: time_s, refused=lambda *odd: refused.append(odd),
    )  # fmt: skip
    pace.start()
    for tick in range(1000):
        time_s = tick / 100
        if not 300 <= tick < 400:
            pace.take("odom", tick if tick < 300 else tick - 100, 0)
        if tick == 700:
            pace.take("rotor_speed", tick, 0)
    assert refused == [("rotor_speed", 700, 600)]
