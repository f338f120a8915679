# SPDX-License-Identifier: Apache-2.0
"""Weights, gamma and trims change while the node runs: judged first, refused in the same words."""

import subprocess
import sys

import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from heli_core.errors import SynthesisError
from heli_flight.settings import resolve
from heli_inner_hinf.design import AttitudeConfig

LIMIT_S = 120.0


@pytest.fixture
def inner_loop(ros_env):
    """Configured inner-loop node in a process of its own, and a way to call its services."""
    command = [sys.executable, "-m", "heli_inner_hinf.node", "--ros-args", "-p", "autostart:=false"]
    process = subprocess.Popen(
        command, env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=int(ros_env["ROS_DOMAIN_ID"]))
    node = rclpy.create_node("tuner", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def call(service_type, name, request):
        client = node.create_client(service_type, f"/inner_loop/{name}")
        assert client.wait_for_service(LIMIT_S)
        future = client.call_async(request)
        executor.spin_until_future_complete(future, LIMIT_S)
        return future.result()

    configure = ChangeState.Request()
    configure.transition.id = Transition.TRANSITION_CONFIGURE
    assert call(ChangeState, "change_state", configure).success
    yield call
    executor.shutdown()
    node.destroy_node()
    context.shutdown()
    process.terminate()
    process.communicate(timeout=120)
    assert process.returncode == 0


def set_parameters(call, **values):
    request = SetParameters.Request()
    request.parameters = [
        Parameter(name.replace("__", "."), value=value).to_parameter_msg()
        for name, value in values.items()
    ]
    return call(SetParameters, "set_parameters", request).results[0]


def get_gamma(call):
    request = GetParameters.Request(names=["output.gamma"])
    return call(GetParameters, "get_parameters", request).values[0].double_value


def test_changes_are_judged_and_refused_in_the_librarys_words(inner_loop):
    refused = set_parameters(inner_loop, output__gamma=0.5)
    assert not refused.successful
    with pytest.raises(SynthesisError) as caught:
        AttitudeConfig.from_parameters(resolve().nodes["inner_loop"] | {"output.gamma": 0.5})
    assert refused.reason == " ".join(str(caught.value).split())
    assert get_gamma(inner_loop) == 4.3

    short = set_parameters(inner_loop, D11=[12.0, 11.0, 31.0])
    assert not short.successful
    assert "D11" in short.reason and "9" in short.reason
    assert not set_parameters(inner_loop, output__gamma=float("nan")).successful
    assert not set_parameters(inner_loop, lockstep=False).successful
    assert get_gamma(inner_loop) == 4.3

    assert set_parameters(inner_loop, output__gamma=5.0).successful
    assert get_gamma(inner_loop) == 5.0
    assert set_parameters(inner_loop, controller="pid").successful
    unknown = set_parameters(inner_loop, controller="fuzzy")
    assert "fuzzy" in unknown.reason and "hinf" in unknown.reason
