# SPDX-License-Identifier: Apache-2.0
"""The lifecycle manager and the nodes that it leads, over DDS: up, pause, a node that is lost."""

import pytest
from std_srvs.srv import Trigger

from heli_flight.graph.manager import SystemState
from heli_msgs_bridge.diagnostics import NodeState

MANAGER = "lifecycle_manager"
NODES = ("scenario", "observer", "inner_loop", "outer_loop", "plant")
ACTIVE, INACTIVE, UNCONFIGURED = 3, 2, 1
PATIENT = {"peer_timeout_s": 100.0}
"""Time stands still for whoever is lost: the aircraft does not crash meanwhile."""


@pytest.fixture
def led(crew):
    """Nodes and their manager, which is active and was told nothing yet."""

    def make(**changes):
        changes = {"peer_timeout_s": 0.05} | changes
        one = crew(*NODES, duration_s=600.0, node_names=NODES, **changes)
        one.join(MANAGER, **PATIENT).bring_up(MANAGER)
        return one

    return make


def order(crew, command):
    return crew.call(Trigger, f"/{MANAGER}/{command}", Trigger.Request())


def states(crew):
    return [crew.state(name) for name in NODES if name in crew.nodes]


def system(crew):
    return crew.nodes[MANAGER].core.manager.state


def test_up_pause_resume_reset(led):
    """Paused, time stands still; resumed, the same flight goes on."""
    crew = led()
    assert not order(crew, "is_active").success
    assert order(crew, "startup").success and order(crew, "is_active").success
    assert states(crew) == [ACTIVE] * len(NODES)
    plant = crew.nodes["plant"]
    crew.spin_until(lambda: plant.tick > 20)
    assert order(crew, "pause").success and states(crew) == [INACTIVE] * len(NODES)
    tick = plant.tick
    assert not order(crew, "is_active").success and plant.tick == tick
    assert order(crew, "resume").success
    crew.spin_until(lambda: plant.tick > tick + 20)
    assert order(crew, "reset").success and states(crew) == [UNCONFIGURED] * len(NODES)


def test_who_refuses_is_named(led):
    crew = led(controller="pid")
    crew.nodes["inner_loop"].values["controller"] = "no_such_law"
    answer = order(crew, "startup")
    assert not answer.success and answer.message.startswith("inner_loop: refused to configure")
    assert system(crew) == SystemState.FAILED
    assert crew.nodes[MANAGER].health.state == NodeState.FAILED


def test_who_is_lost_and_comes_back_is_brought_up(led):
    """The observer's process dies; another one is started in its place, as by launch.

    Time stands still meanwhile: the plant is paused.
    """
    crew = led(bond_timeout=2.0, bond_respawn_max_duration=120.0, **PATIENT)
    assert order(crew, "startup").success
    crew.spin_until(lambda: crew.nodes["plant"].tick > 20)
    crew.leave("observer")
    crew.spin_until(lambda: system(crew) == SystemState.RECONNECTING)
    assert "observer is lost" in crew.nodes[MANAGER].health.message
    assert "time stands still" in crew.nodes[MANAGER].health.message
    plant = crew.nodes["plant"]
    crew.spin_until(lambda: crew.state("plant") == INACTIVE)
    assert states(crew) == [ACTIVE] * 3 + [INACTIVE] and plant.core.fallback.ticks == 0
    crew.join("observer")
    crew.spin_until(lambda: system(crew) == SystemState.ACTIVE)
    assert states(crew) == [ACTIVE] * len(NODES)


def test_who_does_not_come_back_takes_the_others_down(led):
    crew = led(bond_timeout=2.0, bond_respawn_max_duration=0.1, **PATIENT)
    assert order(crew, "startup").success
    crew.leave("observer")
    crew.spin_until(lambda: system(crew) == SystemState.FAILED)
    assert states(crew) == [UNCONFIGURED] * 4
    assert "observer is lost" in crew.nodes[MANAGER].health.message


def test_a_bond_that_no_node_can_keep_is_refused(crew):
    one = crew(MANAGER, bond_timeout=0.5)
    assert not one.change(MANAGER, 1)
    assert one.nodes[MANAGER].failure.startswith("bond_timeout: ")
