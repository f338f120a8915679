# SPDX-License-Identifier: Apache-2.0
"""`--composed`: the four nodes in one process, still over DDS. The same flight, the same words."""

import json
import os
import signal
import subprocess
import sys

import numpy as np
import pytest
import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.parameter import Parameter

from heli_bags.reader import read_bag
from heli_flight.graph.bag_record import flight_from_bag
from heli_flight.settings import resolve

LIMIT_S = 120.0


@pytest.mark.slow
def test_it_is_the_same_flight_number_for_number(hover_test, tmp_path):
    flights = []
    for name, words in (("apart", ()), ("composed", ("--composed",))):
        # On crowded cores a recorder may miss what it is sent, and says so: then it flies again.
        for attempt in range(3):
            folder = tmp_path / f"{name}{attempt}"
            done = hover_test("--out", folder, "--seed", 5, "--duration", 4, "--gps", "rtk", *words)
            assert done.returncode == 0, done.stdout + done.stderr
            result = json.loads((folder / "result.json").read_text())
            assert (result["mode"], result["composed"]) == ("lockstep", bool(words))
            if not any(note.startswith("the bag lacks") for note in result["notes"]):
                break
        assert (result["lost"], result["notes"]) == ("", [])
        bag = read_bag(folder / "bag")
        assert {remark.node for remark in bag.remarks} >= {"plant", "observer", "inner_loop"}
        flights.append(flight_from_bag(folder / "bag", resolve(seed=5)).record)
    apart, composed = flights
    assert len(apart) == len(composed) == 400
    for field in ("truth_pos_ned_m", "truth_q_nb", "truth_rotor", "nav_pos_ned_m", "u"):
        np.testing.assert_array_equal(getattr(apart, field), getattr(composed, field))
    logs = {path.stem for path in (folder / "logs").iterdir()}
    assert logs == {"composed", "recorder"}


def ask(env, node_name, **values):
    """Set parameters of a node that flies; returns why each was refused, empty if it was not."""
    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=int(env["ROS_DOMAIN_ID"]))
    node, executor = rclpy.create_node("tuner", context=context), EventsExecutor(context=context)
    executor.add_node(node)
    client = node.create_client(SetParameters, f"/{node_name}/set_parameters")
    assert client.wait_for_service(LIMIT_S)
    request = SetParameters.Request()
    request.parameters = [Parameter(k, value=v).to_parameter_msg() for k, v in values.items()]
    future = client.call_async(request)
    executor.spin_until_future_complete(future, LIMIT_S)
    executor.shutdown()
    node.destroy_node()
    context.shutdown()
    return [result.reason for result in future.result().results]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "code", "word"),
    [
        (signal.SIGKILL, 1, "plant, observer, inner_loop, outer_loop: killed by SIGKILL"),
        (None, 130, "interrupted"),
    ],
    ids=["killed", "Ctrl-C"],
)
def test_who_ends_is_named(ros_env, tmp_path, holder_of, living, number, code, word):
    out = tmp_path / "flight"
    command = [sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report", "--realtime"]
    flying = subprocess.Popen(
        [*command, "--composed", "--out", str(out)],
        env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert "flown" in flying.stdout.readline()
    if number is None:
        # Each node has its own parameters; the others fly on while one judges.
        assert ask(ros_env, "inner_loop", gamma=0.07) == [""]
        (refused,) = ask(ros_env, "outer_loop", gamma=0.07)
        assert refused
        assert "flown" in flying.stdout.readline()
        flying.send_signal(signal.SIGINT)
    else:
        os.kill(holder_of(out / "logs" / "composed.log"), number)
    _, err = flying.communicate(timeout=120)
    assert flying.returncode == code and word in err, err
    assert living() == []
    read_bag(out / "bag")


def test_it_needs_the_graph(refused, tmp_path):
    folder = tmp_path / "flight"
    assert "--composed" in refused("--out", folder, "--composed", "--one-process")
    assert not folder.exists()
