# SPDX-License-Identifier: Apache-2.0
"""`--respawn`: a node that is killed in flight is started again, and the flight goes on."""

import json
import os
import re
import signal
import subprocess
import sys

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_core.ticks import NS_PER_S
from heli_flight.graph.respawn import MOST, WITHIN_S
from heli_msgs_bridge import topics
from heli_outer_pd.failsafes import Condition, of

NODES = ("observer", "inner_loop", "outer_loop")
HOVER = [sys.executable, "-m", "heli_flight.cli.app", "hover", "--no-report", "--world", "honest"]
# The last kill ends the flight; on loaded cores it waits for seconds until there is whom to kill.
SECONDS = 40.0
KILLED_S = 3.0
LIMIT_S = 200
MAY_GO = ("odom", "rotor_state", "actuators", "attitude_setpoint")
"""Topics of which a killed node may take with it what it had sent."""
BACK_S, LOST_M = 1.5, 3.0
"""Goals. On loaded cores a flight may miss the first: one of three has to meet it."""


def faults(tmp_path, *entries):
    path = tmp_path / "faults.yaml"
    path.write_text("faults:\n" + "".join(f"  - {{what: process, {e}}}\n" for e in entries))
    return ["--faults", str(path)]


def fly(ros_env, folder, *words):
    return subprocess.run(
        [*HOVER, "--seed", "2", *words, "--out", str(folder)],
        env=ros_env, capture_output=True, text=True, timeout=LIMIT_S,
    )  # fmt: skip


def kills(tmp_path, first_s, apart_s):
    """Faults that kill all three, one after the other."""
    lines = (
        f"node: {node}, kind: kill, start_s: {first_s + i * apart_s}"
        for i, node in enumerate(NODES)
    )
    return faults(tmp_path, *lines)


def respawned(folder):
    """result.json and bag of a flight in which all three came back; nobody is called a stranger."""
    result, bag = json.loads((folder / "result.json").read_text()), read_bag(folder / "bag")
    # Two that are due at once, as on loaded cores, are noticed in either order.
    assert not result["lost"] and sorted(r["node"] for r in result["restarts"]) == sorted(NODES)
    for restart in result["restarts"]:
        assert re.search(rf"\b{restart['node']}: .*SIGKILL", restart["why"])
        assert any(restart["why"] in note and "back after" in note for note in result["notes"])
    strange = [n for n in result["notes"] if "somebody else" in n or "sent by" in n]
    assert not strange, strange
    assert not (folder / "memory").exists()
    return result, bag


def last_step_s(folder, node):
    """Flight time of the last step of a node that was killed, as its successor found it.

    The supervisor knows the flight's time by messages, on loaded cores late: it cannot say when in
    flight it has killed.
    """
    log = (folder / "logs" / f"{node}.log").read_text()
    (last_s,) = re.findall(r"started again in flight, after (\d+\.\d+) s of it", log)
    return float(last_s)


def in_pairs(result):
    """Each restart with the flight time of the kill that it answers."""
    begun_s = {fault["node"]: fault["begun_s"] for fault in result["process_faults_done"]}
    return [(restart, begun_s[restart["node"]]) for restart in result["restarts"]]


def went_with_its_sender(bag, result, topic, sent_ns, recorded_ns):
    """Whether what a bag lacks is what a killed node took with it, and the recorder said so.

    It had sent that, and a recorder that lags had not fetched it yet.
    """
    lacking_ns = np.setdiff1d(sent_ns, recorded_ns)
    (source,) = topics.BY_NAME[topic].source
    (back_s,) = [r["back_s"] for r in result["restarts"] if r["node"] == source]
    gaps = [note for note in result["notes"] if note.startswith("recorder: gaps on")]
    began_ns = bag.streams[topics.TRUTH_ODOM].stamp_ns[0]
    of_one_time = (sent_ns >= lacking_ns[0]) & (sent_ns <= lacking_ns[-1])
    return (
        all(topic in note for note in gaps)
        and len(gaps) == 1
        and np.array_equal(sent_ns[of_one_time], lacking_ns)
        and (recorded_ns[recorded_ns > lacking_ns[-1]][0] - began_ns) / NS_PER_S <= back_s + 0.1
    )


@pytest.mark.slow
@pytest.mark.parametrize("apart_s", [1.0, 0.0])
def test_in_lockstep_it_is_the_same_flight_number_for_number(ros_env, tmp_path, living, apart_s):
    """The row NODE_GONE: time stands still, and each successor makes up for what it missed.

    Also if all three die at once: what one of them has sent last comes from its successor.
    """
    words = ("--respawn", *kills(tmp_path, 3.0, apart_s))
    bags = []
    for name, more in (("sound", ()), ("killed", words)):
        done = fly(ros_env, tmp_path / name, "--duration", "7", *more)
        assert done.returncode in (0, 1), done.stdout + done.stderr
        assert living() == []
        bags.append(read_bag(tmp_path / name / "bag"))
    result, bag = respawned(tmp_path / "killed")
    for restart in result["restarts"]:
        stepped_s = last_step_s(tmp_path / "killed", restart["node"])
        assert restart["noticed_s"] - stepped_s <= of(Condition.NODE_GONE).within_s
    for topic in ("ground_truth/odom", "odom", "rotor_state", "actuators", "attitude_setpoint"):
        a, b = (flown.streams[topic] for flown in bags)
        # What nobody answered at once was sent again.
        stamps, first = np.unique(b.stamp_ns, return_index=True)
        if topic in MAY_GO and not np.array_equal(a.stamp_ns, stamps):
            assert went_with_its_sender(bag, result, topic, a.stamp_ns, stamps), result["notes"]
        same = np.isin(a.stamp_ns, stamps) if topic in MAY_GO else slice(None)
        np.testing.assert_array_equal(a.stamp_ns[same], stamps)
        np.testing.assert_array_equal(a.rows[same], b.rows[first])
    remarks = [r for r in bag.remarks if of(Condition.NODE_GONE).status in r.message]
    assert len(remarks) == 3 and all(r.node == "scenario" for r in remarks)


@pytest.mark.nightly
def test_in_real_time_they_are_back_soon_and_little_is_lost(ros_env, tmp_path, living):
    """The rows COMMANDS_GONE and OUTER_GONE; the others say what they miss, the bag is whole."""
    words = ("--respawn", "--realtime", "--duration", "15", *kills(tmp_path, 4.0, 4.0))
    late = []
    for attempt in range(3):
        folder = tmp_path / f"f{attempt}"
        done = fly(ros_env, folder, *words)
        assert done.returncode in (0, 1), done.stdout + done.stderr
        assert living() == []
        result, bag = respawned(folder)
        truth = bag.streams["ground_truth/odom"]
        begun_ns = truth.stamp_ns[0]
        assert truth.stamp_ns.size == 1500
        late.append([])
        for restart, at_s in in_pairs(result):
            node = restart["node"]
            condition = Condition.OUTER_GONE if node == "outer_loop" else Condition.COMMANDS_GONE
            since_s = (truth.stamp_ns - begun_ns) / NS_PER_S - at_s
            gone = truth.rows[(since_s >= 0.0) & (since_s < 4.0), :3]
            assert np.linalg.norm(gone - gone[0], axis=1).max() < LOST_M
            who = "scenario" if node == "outer_loop" else "plant"
            remarks = [
                r for r in bag.remarks if r.node == who and of(condition).status in r.message
            ]
            assert any(-0.1 < (r.stamp_ns - begun_ns) / NS_PER_S - at_s < 1.0 for r in remarks)
            noticed_s, back_s = (restart[key] - at_s for key in ("noticed_s", "back_s"))
            if noticed_s > of(condition).within_s or back_s > BACK_S:
                late[-1].append((node, noticed_s, back_s))
        if not late[-1]:
            return
    raise AssertionError(f"node, noticed, back after: {late}")


@pytest.mark.slow
def test_a_node_that_dies_again_and_again_ends_the_flight_named(ros_env, tmp_path, living):
    starts = [KILLED_S, KILLED_S + 0.5, KILLED_S + 1.0]
    killed = faults(tmp_path, *(f"node: observer, kind: kill, start_s: {s}" for s in starts))
    done = fly(ros_env, tmp_path / "f", "--respawn", "--duration", str(SECONDS), *killed)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert re.search(rf"observer: .*SIGKILL.* {MOST} .* {WITHIN_S:g} s", done.stderr)
    assert living() == []
    assert read_bag(tmp_path / "f" / "bag").streams["ground_truth/odom"].stamp_ns.size > 300


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "node"), [((), "inner_loop"), (("--respawn",), "plant"), (("--respawn",), "recorder")]
)
def test_what_is_not_started_again_ends_the_flight_named(ros_env, tmp_path, living, words, node):
    killed = faults(tmp_path, f"node: {node}, kind: kill, start_s: {KILLED_S}")
    done = fly(ros_env, tmp_path / "f", *words, "--duration", str(SECONDS), *killed)
    assert done.returncode == 1
    assert re.search(rf"\b{node}: .*SIGKILL", done.stderr) and done.stderr.count("\n") == 1
    assert living() == []


@pytest.mark.slow
def test_ctrl_c_leaves_nobody_stopped_or_busy(ros_env, tmp_path, living):
    doing = faults(
        tmp_path,
        "node: outer_loop, kind: pause, start_s: 1.0, duration_s: 100",
        "kind: hog, start_s: 1.0, duration_s: 100, value: 1",
    )
    flying = subprocess.Popen(
        [*HOVER, "--realtime", "--duration", "60", *doing, "--out", str(tmp_path / "f")],
        env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    for line in flying.stdout:
        if "hog by 1" in line:
            break
    os.kill(flying.pid, signal.SIGINT)
    _, err = flying.communicate(timeout=120)
    assert flying.returncode == 130, err
    assert living() == []
