# SPDX-License-Identifier: Apache-2.0
"""No service call of any kind, in any state, ends a node: what is not possible is refused."""

import random
import re
from array import array

import pytest
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from type_description_interfaces.srv import GetTypeDescription

from heli_msgs_bridge.services import ros_value

KINDS = ("scenario", "recorder", "live_view", "outer_loop", "inner_loop", "observer", "plant")
# By state what leads on to the next one; of shutdown, which ends a node on purpose, the number too.
UP = {1: 1, 2: 3, 3: 4}
SHUTDOWN = {1: 5, 2: 6, 3: 7}
ODD = ("", " ", ".", "..", "a..b", "/", "ü\u4e2d", "\U0001f681", "x" * 5000, "use_sim_time", "qos")
LABELS = (*ODD, "destroy", "create", "transition_success", "transition_error", "Configure")
TYPES = (*range(11), 42, 255)


def odd_value(draw, kind):
    """A value that says to be of a type, known or not, with something in every place."""
    number = draw.choice([0.0, -1.0, 1e308, float("nan"), float("inf"), 0.07])
    return ParameterValue(
        type=kind,
        bool_value=draw.random() < 0.5,
        integer_value=draw.choice([0, -1, 2**63 - 1, -(2**63)]),
        double_value=number,
        string_value=draw.choice(ODD),
        byte_array_value=[b"\xff"],
        bool_array_value=[True],
        integer_array_value=[1, -(2**63)],
        double_array_value=[number] * draw.choice([0, 1, 9, 4000]),
        string_array_value=list(ODD),
    )


def odd_parameters(draw, names):
    """A request's parameters: of the node, odd ones, the same twice, none."""
    chosen = [draw.choice([*names, *names, *ODD]) for _ in range(draw.choice([0, 1, 1, 2, 5]))]
    return [Parameter(name=name, value=odd_value(draw, draw.choice(TYPES))) for name in chosen]


def ask_anything(crew, name, draw):
    """One call of each service; answers are checked as far as the question has one."""
    names = list(crew.nodes[name].values)
    some = draw.sample([*names, *ODD], 3)
    asked = odd_parameters(draw, names)

    def call(kind, service, **fields):
        return crew.call(kind, f"/{name}/{service}", kind.Request(**fields))

    results = call(SetParameters, "set_parameters", parameters=asked).results
    assert len(results) == len(asked)
    assert all(result.successful or result.reason for result in results)
    result = call(SetParametersAtomically, "set_parameters_atomically", parameters=asked).result
    assert result.successful or result.reason
    for service, kind in (
        ("get_parameters", GetParameters),
        ("describe_parameters", DescribeParameters),
        ("get_parameter_types", GetParameterTypes),
    ):
        call(kind, service, names=some)
    depth = draw.choice([0, 1, 2**64 - 1])
    call(ListParameters, "list_parameters", prefixes=draw.sample(ODD, 2), depth=depth)
    call(
        GetTypeDescription, "get_type_description", type_name=draw.choice(ODD),
        type_hash=draw.choice(["RIHS01_" + "0" * 64, *ODD]),
    )  # fmt: skip
    call(GetState, "get_state")
    call(GetAvailableStates, "get_available_states")
    call(GetAvailableTransitions, "get_available_transitions")
    call(GetAvailableTransitions, "get_transition_graph")


@pytest.mark.parametrize("name", KINDS)
def test_whatever_is_asked_a_node_lives_and_answers(crew, name):
    """In each state; parameters and their values stay the same two things."""
    one, draw = crew(name), random.Random(f"{name} is asked")
    node = one.nodes[name]
    for state in (1, 2, 3):
        assert one.state(name) == state
        for _ in range(25):
            ask_anything(one, name, draw)
            for key, value in node.values.items():
                declared = node.get_parameter(key).value
                if isinstance(declared, array):  # how rclpy keeps numbers that a service has set
                    declared = declared.tolist()
                assert declared == ros_value(value) or declared != declared, key
        if state < 3:
            one.set(name, **{"use_sim_time": False})
            assert one.change(name, UP[state]), node.failure


@pytest.mark.parametrize("name", KINDS)
def test_every_number_and_label_of_a_transition(crew, name):
    """Those of the state are carried out, all others refused by name; then it ends."""
    one = crew(name)
    node = one.nodes[name]
    for state in (1, 2, 3):
        possible = {1: (1, 5), 2: (2, 3, 6), 3: (4, 7)}[state]

        def refused(word, possible=possible):
            """The refusal names what was asked for, and each number that would do."""
            answers = {int(number) for number in re.findall(r"\((\d+)\)", node.failure)}
            return node.failure.startswith(f"{word} ") and answers == set(possible)

        for number in range(256):
            if number not in possible:
                assert not one.change(name, number)
                assert refused(f"transition {number}")
        for label in LABELS:
            if label:
                # The label decides, whatever the number says.
                assert not one.change(name, possible[0], label)
                assert refused(f"'{label}'")
        assert one.state(name) == state
        if state < 3:
            assert one.change(name, UP[state])
    for number in (4, 2, 1, 3):
        assert one.change(name, number)
    assert not node.finished
    assert one.change(name, SHUTDOWN[3]) and node.finished and not node.configured
    assert one.state(name) == 4
    request = ChangeState.Request()
    for number in range(256):
        request.transition.id = number
        assert not one.call(ChangeState, f"/{name}/change_state", request).success
    ask_anything(one, name, random.Random(name))
