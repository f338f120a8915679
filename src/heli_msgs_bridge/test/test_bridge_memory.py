# SPDX-License-Identifier: Apache-2.0
"""What a node leaves to its successor, and in what order that makes up for what it missed."""

import os
import signal

import numpy as np
import pytest

from heli_msgs_bridge.handover import (
    FOLDER,
    HandoverFile,
    Successors,
    handover_file_of,
    note_restart,
    respawns,
)
from heli_msgs_bridge.lockstep import Backlog, Demand, Lockstep, RealTime


@pytest.fixture
def path(tmp_path):
    return tmp_path / "observer.memory"


def test_a_successor_finds_the_newest_record(path):
    assert HandoverFile(path).load() is None
    left = HandoverFile(path)
    for tick in range(7):
        left.keep(tick, {"x": np.full(3, float(tick)), "way": [tick] * tick})
    memory = HandoverFile(path).load()
    assert memory.tick == 6 and memory.content["way"] == [6] * 6
    memory.content["x"][:] += 1.0  # its own, to be changed
    assert (memory.content["x"] == 7.0).all()


@pytest.mark.parametrize("cut", [0, 1, 24, 60, 200])
def test_a_record_that_was_cut_off_leaves_the_one_before(path, cut):
    """Whatever part of the third record had been written, without the number at its end."""
    left = HandoverFile(path)
    for tick in (1, 2):
        left.keep(tick, np.full(50, tick))
    raw = bytearray(path.read_bytes())
    half = len(raw) // 2
    first = half  # of tick 1, which the third record would overwrite
    raw[first + 24 : first + 24 + cut] = b"\xff" * cut
    path.write_bytes(raw)
    assert HandoverFile(path).load().tick == 2


def test_what_is_too_long_is_left_out_and_said(path):
    left = HandoverFile(path)
    left.keep(1, b"short")
    left.keep(2, bytes(9 << 20))
    assert left.too_long and HandoverFile(path).load().tick == 1


def test_it_outlives_a_process_that_is_killed(path):
    pid = os.fork()
    if pid == 0:
        left = HandoverFile(path)
        for tick in range(10_000_000):
            left.keep(tick, (tick, np.full(100, tick)))
    while not path.exists() or (memory := HandoverFile(path).load()) is None:
        pass
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    memory = HandoverFile(path).load()
    assert memory.content[0] == memory.tick and (memory.content[1] == memory.tick).all()


def test_what_took_long_is_kept_beside_the_records(path):
    left = HandoverFile(path)
    assert left.lasting() is None
    left.keep_lasting([1, 2])
    left.keep_lasting([3])
    assert HandoverFile(path).lasting() == [3]


def test_only_a_flight_that_starts_nodes_again_has_memories(monkeypatch, tmp_path):
    monkeypatch.delenv("HELI_MEMORY", raising=False)
    assert handover_file_of("observer") is None and not respawns()
    monkeypatch.setenv("HELI_MEMORY", str(tmp_path))
    assert handover_file_of("observer") is not None and respawns()


DEMANDS = {"imu": Demand(), "mag": Demand(2), "fix": Demand(4, lag_ticks=3), "u": Demand(1, 1, 1)}


def stepped(order):
    """Steps of a node in real time that hears the messages in this order, the last one late."""
    made, now = [], [0.0]
    backlog = Backlog("imu", DEMANDS, 0.005, lambda: now[0])
    real = RealTime("imu", lambda tick, arrived: made.append((tick, arrived)),
                    now_s=lambda: now[0])  # fmt: skip
    real.start(9, backlog)
    for topic, tick in order:
        real.take(topic, tick, f"{topic} {tick}")
    now[0] += 0.01
    return real, made, now


def test_what_was_missed_is_stepped_through_in_the_order_of_time():
    """However the topics come one after the other; who died itself has sent nothing since."""
    imu = [("imu", tick) for tick in range(10, 30)]
    rest = [("mag", tick) for tick in range(10, 31, 2)]
    rest += [("fix", tick) for tick in (9, 13, 17, 21, 25)] + [("u", 9)]
    for order in (imu + rest, rest + imu):
        real, made, _ = stepped(order)
        real.take("imu", 30, "imu 30")
        assert [tick for tick, _ in made] == list(range(10, 31))
        for tick, arrived in made:
            assert arrived["imu"] == (tick, f"imu {tick}")
            assert ("mag" in arrived) == (tick % 2 == 0)
            assert ("fix" in arrived) == (tick in (12, 16, 20, 24, 28))
            assert ("u" in arrived) == (tick == 10)
        real.take("imu", 31, "imu 31")
        assert made[-1] == (31, {"imu": (31, "imu 31")})


def test_a_topic_that_still_comes_is_waited_for_but_not_for_long():
    real, made, now = stepped([("mag", 10), *(("imu", tick) for tick in range(10, 30))])
    real.take("imu", 30, "imu 30")
    assert made == []
    now[0] += 0.2
    real.take("imu", 31, "imu 31")
    assert [tick for tick, _ in made] == list(range(10, 32))


def test_lockstep_goes_on_after_the_predecessors_tick():
    made = []
    lock = Lockstep({"imu": Demand(), "mag": Demand(2)}, lambda tick, a: made.append(tick), 1.0)
    lock.take("imu", 12, 0)
    lock.start(11)
    assert made == []
    lock.take("mag", 12, 0)
    assert made == [12]


def answered():
    """A node in lockstep that needs the answer to its own last message; its steps; the time, s."""
    made, now = [], [0.0]
    lock = Lockstep(
        {"imu": Demand(), "u": Demand(1, 1, 1)},
        lambda tick, arrived: made.append((tick, sorted(arrived))),
        1.0,
        now_s=lambda: now[0],
    )
    return lock, made, now


def test_in_lockstep_what_is_repeated_is_waited_for_though_the_trigger_is_ahead():
    """Who died between what it sent and its note of it: the trigger of the next tick is out."""
    lock, made, _ = answered()
    lock.take("imu", 12, 0)
    lock.take("imu", 13, 0)
    lock.start(11)
    assert made == []
    lock.take("u", 11, 0)
    assert made == [(12, ["imu", "u"])]
    lock.take("u", 12, 0)
    assert made[1:] == [(13, ["imu", "u"])]
    # From then on a tick that the trigger's sender has left behind gets nothing more.
    lock.take("imu", 14, 0)
    lock.take("imu", 15, 0)
    assert made[2:] == [(14, ["imu"])]


def test_in_lockstep_what_a_successor_does_not_get_is_not_waited_for_for_ever():
    lock, made, now = answered()
    lock.start(11)
    lock.take("imu", 12, 0)
    lock.take("imu", 13, 0)
    now[0] += 1.1
    lock.look()
    assert made == [(12, ["imu"]), (13, ["imu"])] and lock.silent == {"u"}


def test_a_successor_is_due_from_its_restart_until_it_is_met(tmp_path, monkeypatch):
    """Each restart once; those before a listener's own beginning are no news to it."""
    monkeypatch.setenv(FOLDER, str(tmp_path))
    early = Successors(("observer",))
    assert not early.due()
    note_restart(tmp_path, "inner_loop")
    assert not early.due()
    note_restart(tmp_path, "observer")
    assert early.due() and early.due()
    late = Successors(("observer",))
    early.meet()
    assert not early.due() and not late.due()
    note_restart(tmp_path, "observer")
    assert early.due() and late.due()
