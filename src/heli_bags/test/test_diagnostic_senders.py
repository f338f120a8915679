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
        diagnostic_senders = DiagnosticSenders(space, OWN)
        assert all(diagnostic_senders.admits([plant], number) for number in range(5, 9))
        assert not diagnostic_senders.admits([plant], first)
        assert diagnostic_senders.foreign == {plant}
        assert diagnostic_senders.admits([plant], 9)
    diagnostic_senders = DiagnosticSenders(space, OWN)
    assert diagnostic_senders.admits([plant], 1) and not diagnostic_senders.admits([plant], 40)


def test_others_may_say_what_they_like_under_their_own_names():
    diagnostic_senders = DiagnosticSenders("/heli1", OWN)
    for number in (3, 1, 77):
        assert diagnostic_senders.admits(["heli2/plant", "camera: frequency"], number)
    assert diagnostic_senders.foreign == set()


def test_strangers_are_those_without_a_name_of_their_own():
    """Another aircraft's node and a driver report as themselves; a double has our node's name."""
    diagnostic_senders = DiagnosticSenders("/heli1", OWN)
    diagnostic_senders.admits(["heli2/plant", "camera: frequency", "heli1/nav"], 1)
    ours = [("/heli1", "plant"), ("/heli1", "observer"), ("/heli1", "nav")]
    known = [*ours, ("/heli2", "plant"), ("/", "camera")]
    assert diagnostic_senders.strangers(known) == []
    assert diagnostic_senders.strangers([*known, ("/", "pilot")]) == ["/pilot"]
    assert diagnostic_senders.strangers([*known, ("/heli1", "plant")]) == ["/heli1/plant"]


def test_the_successor_of_a_node_that_was_started_again_is_taken_once():
    """As the supervisor says; the last words of the dead one may come after it has."""
    diagnostic_senders = DiagnosticSenders("/heli1", OWN)
    name = "heli1/observer"
    assert diagnostic_senders.admits([name], 40)
    diagnostic_senders.forget("observer", 1)
    assert (
        diagnostic_senders.admits([name], 41)
        and diagnostic_senders.admits([name], 1)
        and diagnostic_senders.admits([name], 2)
    )
    diagnostic_senders.forget("observer", 1)
    assert not diagnostic_senders.admits([name], 70) and diagnostic_senders.foreign == {name}
    diagnostic_senders.forget("observer", 2)
    assert diagnostic_senders.admits([name], 1)
