# SPDX-License-Identifier: Apache-2.0
"""A peer with other parameters, or of another version, is named, counted and not flown."""

import pytest

from heli_msgs_bridge.diagnostics import FACT_DISAGREE, NodeState

FLYING = ["plant", "observer", "inner_loop", "outer_loop"]


@pytest.mark.parametrize(
    ("changes", "term"),
    [({"rate_hz": 200}, "rate_hz"), ({"origin__altitude_m": 60.0}, "origin.altitude_m"),
     ({"schedule__gps_latency_ticks": 12}, "schedule.gps_latency_ticks")],
)  # fmt: skip
def test_an_observer_with_other_parameters_is_waited_for_as_if_it_were_not_there(
    crew, changes, term
):
    one = crew("plant", "inner_loop", "outer_loop", peers=FLYING, connect_timeout_s=3600.0)
    plant = one.nodes["plant"]
    one.join("observer", **changes).bring_up()
    one.spin_until(lambda: term in plant.health.message)
    assert not plant.active and plant.health.state == NodeState.WAITING
    assert term in plant.standing_facts()[FACT_DISAGREE]
    # One that agrees takes its place.
    one.leave("observer")
    one.join("observer").bring_up("observer")
    one.spin_until(lambda: plant.active)
    assert FACT_DISAGREE not in plant.standing_facts()
    one.fly(100)
    assert plant.core.fallback.ticks == 0
