# SPDX-License-Identifier: Apache-2.0
"""A record by its time: the record's own values at any moment, a browser's way through, events."""

import json
import math

import numpy as np
import pytest

from heli_bags.reader import Remark, Stream
from heli_core.command_line import config_folder
from heli_core.parameters import load, with_common
from heli_core.rows import NAV
from heli_core.trajectory import Trajectory
from heli_live_view.parameters import NODE_NAME, TABLE
from heli_live_view.replay import (
    FAULT,
    MODE,
    EmptyRecordError,
    FlightEvent,
    FlightRecording,
    Replay,
    ReplayError,
    ReplayOutcome,
    Viewer,
    in_order,
    of_faults,
    of_remarks,
)
from heli_live_view.state import TimelineEvent, compact
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import FACT_OFFSET, NodeState

S = 1_000_000_000
TICK = S // 100
START_NS = 5 * S
SIZES = {topics.TRUTH_ODOM: 13, topics.ODOM: NAV.size, topics.ATTITUDE_SETPOINT: 3,
         topics.ACTUATORS: 4, topics.TRUTH_WIND: 3}  # fmt: skip


@pytest.fixture(scope="module")
def values():
    packaged = config_folder("heli_live_view") / "live_view.yaml"
    common = config_folder("heli_core") / "common.yaml"
    return load(with_common(TABLE), [common, packaged], NODE_NAME)


def streams(length_s=20.0, seed=1, gap_s=(8.0, 12.0)):
    """Random rows; each topic lacks messages at random, and all are silent within the gap."""
    rng, made = np.random.default_rng(seed), {}
    for name, size in SIZES.items():
        every = topics.BY_NAME[name].every_ticks
        ticks = np.arange(0, round(100 * length_s), every)
        kept = (rng.random(ticks.size) > 0.3) & ~(
            (ticks > 100 * gap_s[0]) & (ticks < 100 * gap_s[1])
        )
        rows = rng.normal(size=(int(kept.sum()), size))
        if size >= 13:
            rows[:, 6:10] /= np.linalg.norm(rows[:, 6:10], axis=1)[:, None]
        made[name] = Stream(START_NS + ticks[kept].astype(np.int64) * TICK, rows)
    return made


def recording(remarks=(), references=(), **changed):
    return FlightRecording(streams(**changed), remarks, references, START_NS, stale_s=1.0)


def newest(stream, stamp_ns):
    """The last row that is not later, by looking at each; None: there is none, or it is old."""
    row = None
    for stamp, candidate in zip(stream.stamp_ns.tolist(), stream.rows, strict=True):
        if stamp <= stamp_ns:
            row = candidate if stamp_ns - stamp <= S else None
    return row


def test_a_seek_gives_the_records_values_at_that_time(values):
    r = recording()
    replay, rng = Replay(r, values), np.random.default_rng(2)
    silent = 0
    for stamp_ns in rng.integers(r.first_ns, r.last_ns + 1, 120).tolist():
        row = replay.state(stamp_ns)
        assert row["t"] == round((stamp_ns - START_NS) / S, 3)
        for source, name in (("truth", topics.TRUTH_ODOM), ("nav", topics.ODOM)):
            expected = newest(r.streams[name], stamp_ns)
            assert (row[source] is None) == (expected is None)
            if expected is not None:
                north, east, down = expected[:3]
                assert row[source]["p"] == pytest.approx([east, north, -down], abs=5e-5)
        u = newest(r.streams[topics.ACTUATORS], stamp_ns)
        assert row["u"] is None if u is None else row["u"] == pytest.approx(u, abs=5e-5)
        asked = newest(r.streams[topics.ATTITUDE_SETPOINT], stamp_ns)
        if asked is not None:
            assert row["setpoint_deg"] == pytest.approx(np.degrees(asked), abs=5e-5)
        silent += u is None
    assert 5 < silent < 60  # the gap was met, and not only the gap
    # A message's own stamp shows it, the tick before does not.
    stamp_ns = int(r.streams[topics.ACTUATORS].stamp_ns[300])
    for at_ns, i in ((stamp_ns, 300), (stamp_ns - 1, 299)):
        shown = replay.state(at_ns)["u"]
        assert shown == pytest.approx(r.streams[topics.ACTUATORS].rows[i], abs=5e-5)


def test_going_back_is_no_other_than_going_on(values):
    """A state is a function of the time, whatever was looked at before."""
    replay = Replay(recording(remarks_of()), values)
    stamps = [replay.recording.stamp(t) for t in (3.0, 15.0, 7.77, 19.9, 0.0)]
    once = [replay.state(stamp) for stamp in stamps]
    assert [replay.state(stamp) for stamp in reversed(stamps)] == once[::-1]


LOSS, OVER = "gps loss from 4 to 6 s", "flight over after 20 s"


def remarks_of():
    """What nodes say: the outer loop its offset, the plant a fault and the end."""
    outer = {FACT_OFFSET: "[1.0, 0.0, 0.0]", "mode": "hover"}
    every = [
        Remark(START_NS + k * S, "outer_loop", 0, "position is held", outer) for k in range(20)
    ]
    others = [
        Remark(START_NS + 4 * S, "plant", 1, "fault: gps loss", {"faults": LOSS}),
        Remark(START_NS + 19 * S, "plant", 0, OVER, {"over": "true"}),
    ]
    return sorted([*every, *others], key=lambda remark: remark.stamp_ns)


def test_largest_errors_are_those_so_far(values):
    """Of every message up to the moment, from the reference as moved; never of later ones."""
    trajectory = Trajectory.hover(np.array([0.0, 0.0, -10.0]), 0.0)
    r = recording(remarks_of(), [(START_NS, trajectory)], gap_s=(30.0, 30.0))
    replay = Replay(r, values)
    stream = r.streams[topics.ODOM]
    for time_s in (1.0, 6.5, 19.5):
        stamp_ns = r.stamp(time_s)
        largest = replay.state(stamp_ns)["largest"]["whole"]["nav"]["longitudinal_m"]
        until = {late: np.abs(stream.rows[stream.stamp_ns <= stamp_ns - late, 0] - 1.0).max()
                 for late in (0, 7 * TICK)}  # fmt: skip
        assert until[7 * TICK] - 1e-4 <= largest <= until[0] + 1e-4
    assert replay.state(r.last_ns)["end"] == {"kind": "over", "text": OVER}


def test_a_record_without_what_is_shown_is_refused():
    with pytest.raises(EmptyRecordError, match="nothing was recorded"):
        FlightRecording({}, [], [], START_NS, 1.0)


class Clock:
    """A wall clock that is set by hand."""

    def __init__(self):
        self.now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def watched(values):
    clock = Clock()
    return Viewer(Replay(recording(), values), clock), clock


def sent(viewer):
    return json.loads(viewer.text())


def test_time_goes_as_fast_as_is_asked_and_stands_at_the_end(watched):
    viewer, clock = watched
    assert sent(viewer)["t"] == 0.0 and not viewer.runs
    for speed, wall_s, at_s in ((1.0, 2.0, 2.0), (0.25, 4.0, 3.0), (16.0, 0.5, 11.0)):
        viewer.ask({"run": True, "speed": speed})
        clock.now_s += wall_s
        assert sent(viewer)["t"] == pytest.approx(at_s)
    viewer.ask({"run": False})
    clock.now_s += 5.0
    assert sent(viewer)["t"] == pytest.approx(11.0)
    viewer.ask({"run": True, "speed": 16.0, "id": 7})
    clock.now_s += 60.0
    last = sent(viewer)
    assert last["t"] == pytest.approx(19.99) and last["replay"] == {
        "runs": False, "speed": 16.0, "anew": False, "wish": 7
    }  # fmt: skip
    # Played on at the end it begins again.
    viewer.ask({"run": True, "speed": 1.0})
    assert sent(viewer)["t"] == 0.0 and viewer.runs


@pytest.mark.parametrize("speed", [0.25, 1.0, 16.0])
def test_no_row_of_the_charts_is_lost_or_sent_twice(watched, speed):
    viewer, clock = watched
    viewer.ask({"run": True, "speed": speed})
    rows = []
    for _ in range(40):
        rows += sent(viewer)["past"]
        clock.now_s += 1 / 30
    times = [row["t"] for row in rows]
    assert times == sorted(set(times)) and times[0] == 0.0
    assert max(np.diff(times)) == pytest.approx(0.07)
    assert times[-1] >= min(19.99, speed * 39 / 30) - 0.08


def test_a_jump_brings_the_rows_before_it_and_stays_in_the_record(watched):
    viewer, _ = watched
    sent(viewer)
    viewer.ask({"at": 15.0, "id": 3})
    state = sent(viewer)
    assert state["t"] == 15.0 and state["replay"]["anew"] and state["replay"]["wish"] == 3
    assert state["past"][0]["t"] == 0.0 and 14.9 < state["past"][-1]["t"] <= 15.0
    for asked, t in ((1e5, 19.99), (-3.0, 0.0)):
        viewer.ask({"at": asked})
        assert sent(viewer)["t"] == pytest.approx(t)


@pytest.mark.parametrize(
    "wish",
    [{"at": "3"}, {"at": None}, {"at": math.nan}, {"at": True}, {"speed": 0.0}, {"speed": 17},
     {"run": 1}, {"at": 3.0, "speed": []}],
)  # fmt: skip
def test_a_wish_that_cannot_be_is_refused_and_changes_nothing(watched, wish):
    viewer, _ = watched
    viewer.ask({"at": 5.0})
    with pytest.raises(ReplayError, match="is not allowed; allowed: "):
        viewer.ask(wish)
    assert sent(viewer)["t"] == 5.0 and not viewer.runs


# --- events --------------------------------------------------------------------------------------


def remark(time_s, message="", level=0, node="outer_loop", **facts):
    return Remark(START_NS + round(time_s * S), node, level, message, facts)


TOO_FAR = {"refused.goto": "1; goto: too far"}


def test_modes_failsafes_and_refusals_come_from_what_is_said():
    events = of_remarks(
        [
            remark(0.0, mode="standing", failsafe="NONE"),
            remark(2.0, mode="takeoff", failsafe="NONE"),
            remark(3.0, mode="takeoff", failsafe="HOLD_LEAN"),
            remark(4.0, mode="takeoff", failsafe="HOLD_LEAN", **TOO_FAR),
            remark(5.0, mode="takeoff", failsafe="NONE", **TOO_FAR),
            remark(6.0, "lost: hit the ground", 2, "plant", over="true"),
        ],
        START_NS,
    )  # fmt: skip
    assert [(h.time_s, h.kind, h.level, h.text) for h in events] == [
        (0.0, "mode", 0, "mode: standing"), (2.0, "mode", 0, "mode: takeoff"),
        (3.0, "failsafe", 1, "failsafe: hold lean"), (4.0, "refusal", 1, "refused: goto: too far"),
        (5.0, "failsafe", 0, "failsafe ends"), (6.0, "end", 2, "lost: hit the ground"),
    ]  # fmt: skip


def test_faults_have_a_beginning_and_an_end():
    events = of_faults(["gps bias 1.5, -2, 0 from 40.1 to 45.1 s", "baro freeze from 7 s on",
                       "baro freeze from 7 s on", "no time"])  # fmt: skip
    assert [(h.time_s, h.text) for h in events] == [
        (40.1, "gps bias 1.5, -2, 0 begins"), (45.1, "gps bias 1.5, -2, 0 ends"),
        (7.0, "baro freeze begins"),
    ]  # fmt: skip


def test_what_is_said_twice_is_one_event():
    twice = [
        FlightEvent(4.0, "refusal", 1, "outer_loop", "refused: goto: too far"),
        FlightEvent(4.01, "health", 1, "outer_loop", "message refused: goto: too far"),
        FlightEvent(9.0, MODE, 0, "outer_loop", "mode: land"),
        FlightEvent(9.05, MODE, 0, "live_view", "mode: land"),
        FlightEvent(0.0, MODE, 0, "live_view", "mode: hover"),
        FlightEvent(3.0, FAULT, 1, "plant", "fault: gps loss"),
        FlightEvent(3.0, FAULT, 1, "fault", "gps loss begins"),
        FlightEvent(50.0, MODE, 0, "outer_loop", "mode: late"),
    ]
    assert in_order(twice, 20.0) == [twice[6], twice[0], twice[2]]


def test_the_greeting_names_span_events_and_report(values):
    outcome = ReplayOutcome("Flown to its end.", ["a note"], "report.html")
    replay = Replay(
        recording(remarks_of()), values, outcome, [FlightEvent(9.0, "ground", 0, "ground", "down")]
    )
    hello = json.loads(replay.hello())
    assert hello["commands"] is False and hello["history"] == []
    assert hello["replay"] == {
        "from_s": 0.0, "to_s": 19.99, "at_end": False, "ended": "Flown to its end.",
        "notes": ["a note"], "report": "report.html",
    }  # fmt: skip
    texts = [event["text"] for event in hello["events"]]
    begins, ends = (texts.index(event.text) for event in of_faults([LOSS]))
    assert begins < ends < texts.index("down") and texts[-1] == OVER
    assert not any(e["kind"] == FAULT and e["source"] == "plant" for e in hello["events"])
    assert [event["t"] for event in hello["events"]] == sorted(e["t"] for e in hello["events"])


def test_numbers_that_are_not_finite_are_null():
    assert compact({"a": [1.0, math.inf], "b": (math.nan, "x"), "c": {"d": -math.inf}}) == (
        '{"a":[1.0,null],"b":[null,"x"],"c":{"d":null}}'
    )


def test_a_line_before_the_clock_is_at_the_beginning():
    from heli_live_view.replay import as_flight_event

    assert as_flight_event(TimelineEvent(None, 1, "observer", "waits")).time_s == 0.0
    assert as_flight_event(TimelineEvent(3.0, 0, "plant", "", NodeState.CONFIGURED)) is None
