# SPDX-License-Identifier: Apache-2.0
"""Floods of requests and commands, in flight: refused in a sentence, counted, and not felt."""

import json
import subprocess
import sys

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_core.rows import REFERENCE
from heli_flight.graph.bag_record import flight_from_bag
from heli_flight.settings import resolve

# A client of its own process: it asks as fast as it can, without waiting for answers.
FLOOD = """
import sys, time
import rclpy
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from std_srvs.srv import Trigger

rclpy.init()
node = rclpy.create_node("flooder")
value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE)
asks = []
for name, parameter in (("inner_loop", "gamma"), ("outer_loop", "kp_pos"), ("plant", "x")):
    request = SetParameters.Request(parameters=[Parameter(name=parameter, value=value)])
    asks.append((node.create_client(SetParameters, f"/{name}/set_parameters"), request))
asks.append((node.create_client(Trigger, "/hold"), Trigger.Request()))
goto = node.create_publisher(PoseStamped, "goto", 10)
pose = PoseStamped()
pose.header.frame_id, pose.pose.orientation.w = "map", 1.0
pose.pose.position.z = 900.0
deadline = time.monotonic() + 120.0
while not (asks[0][0].service_is_ready() and goto.get_subscription_count()):
    assert time.monotonic() < deadline
    rclpy.spin_once(node, timeout_sec=0.02)
print("floods", flush=True)
reasons, sent, begun = set(), 0, time.monotonic()
while time.monotonic() - begun < float(sys.argv[1]):
    for client, request in asks:
        if client.service_is_ready():
            future = client.call_async(request)
            if sent % 50 == 0:
                future.add_done_callback(
                    lambda f: reasons.update(
                        [r.reason for r in getattr(f.result(), "results", [])]
                    )
                )
            sent += 1
    goto.publish(pose)
    rclpy.spin_once(node, timeout_sec=0.0)
print(sent / (time.monotonic() - begun))
print("\\n".join(reasons))
"""


@pytest.mark.nightly
def test_a_flood_is_refused_and_the_flight_is_flown(ros_env, tmp_path):
    """Three nodes and the commands at once, for eight seconds of a flight in real time."""
    folder = tmp_path / "f"
    command = [sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report", "--realtime"]
    command += ["--gps", "rtk", "--world", "paper", "--duration", "16", "--out", str(folder)]
    flying = subprocess.Popen(
        command, env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert "flown" in flying.stdout.readline()
    flood = subprocess.run(
        [sys.executable, "-c", FLOOD, "8"], env=ros_env, capture_output=True, text=True, timeout=120
    )
    assert flood.returncode == 0, flood.stderr
    out, err = flying.communicate(timeout=120)
    assert flying.returncode in (0, 1), out + err
    reasons = flood.stdout.splitlines()
    assert any("50 requests" in reason for reason in reasons[2:]), reasons
    result = json.loads((folder / "result.json").read_text())
    assert result["lost"] == "" and result["flown_s"] >= 15.9, result["notes"]
    facts = {}
    for remark in read_bag(folder / "bag").remarks:
        facts.setdefault(remark.node, {}).update(remark.facts)
    for node in ("plant", "inner_loop", "outer_loop"):
        count, _, why = facts[node]["refused.requests"].partition("; ")
        assert int(count) > 100 and why == reasons[2 + reasons[2:].index(why)], (node, count, why)
        assert any(f"{node}: requests refused: " in note for note in result["notes"])
    count = int(facts["outer_loop"]["refused.goto"].partition(";")[0])
    assert count > 100
    record = flight_from_bag(folder / "bag", resolve(gps="rtk")).record
    away_m = np.abs(record.truth_pos_ned_m - record.reference[:, REFERENCE.pos])
    assert away_m.max() < 1.0, away_m.max(axis=0)
    assert float(facts["plant"]["real_time_factor"]) > 0.95, facts["plant"]
