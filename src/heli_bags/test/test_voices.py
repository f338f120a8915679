# SPDX-License-Identifier: Apache-2.0
"""Whose statuses are those of an aircraft's nodes, by the numbers of the messages."""

import pytest

from heli_msgs_bridge.sources import DiagnosticSenders

OWN = ("plant", "observer")


@pytest.mark.parametrize("space", ["/", "/heli1"])
def test_one_who_speaks_as_a_node_of_ours_is_found(space):
    """Whatever its numbers, and whether it is heard first; the node's own go on by one."""
    plant = f"{space}/plant".strip("/")
    for first in (1, 2, 7, 900):
        voices = DiagnosticSenders(space, OWN)
        assert all(voices.hear([plant], number) for number in range(5, 9))
        assert not voices.hear([plant], first)
        assert voices.foreign == {plant}
        assert voices.hear([plant], 9)
    voices = DiagnosticSenders(space, OWN)
    assert voices.hear([plant], 1) and not voices.hear([plant], 40)


def test_others_may_say_what_they_like_under_their_own_names():
    voices = DiagnosticSenders("/heli1", OWN)
    for number in (3, 1, 77):
        assert voices.hear(["heli2/plant", "camera: frequency"], number)
    assert voices.foreign == set()


def test_strangers_are_those_without_a_name_of_their_own():
    """Another aircraft's node and a driver report as themselves; a double has our node's name."""
    voices = DiagnosticSenders("/heli1", OWN)
    voices.hear(["heli2/plant", "camera: frequency", "heli1/nav"], 1)
    ours = [("/heli1", "plant"), ("/heli1", "observer"), ("/heli1", "nav")]
    known = [*ours, ("/heli2", "plant"), ("/", "camera")]
    assert voices.strangers(known) == []
    assert voices.strangers([*known, ("/", "pilot")]) == ["/pilot"]
    assert voices.strangers([*known, ("/heli1", "plant")]) == ["/heli1/plant"]


def test_the_successor_of_a_node_that_was_started_again_is_taken_once():
    """As the supervisor says; the last words of the dead one may come after it has."""
    voices = DiagnosticSenders("/heli1", OWN)
    name = "heli1/observer"
    assert voices.hear([name], 40)
    voices.forget("observer", 1)
    assert voices.hear([name], 41) and voices.hear([name], 1) and voices.hear([name], 2)
    voices.forget("observer", 1)
    assert not voices.hear([name], 70) and voices.foreign == {name}
    voices.forget("observer", 2)
    assert voices.hear([name], 1)
