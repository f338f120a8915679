# SPDX-License-Identifier: Apache-2.0
"""A pause of the plant is a pause: time stands still for all, and the same flight goes on."""

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_core.ticks import TICK_NS
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import Level

CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE = 1, 2, 3, 4
NODES = ("scenario", "recorder", "outer_loop", "inner_loop", "observer", "plant")
STREAMS = (topics.TRUTH_ODOM, topics.TRUTH_WIND, topics.TRUTH_ROTOR, topics.ODOM, topics.ACTUATORS)


def pause(crew):
    """Deactivate the plant, let the others do what they still do, and activate it."""
    assert crew.change("plant", DEACTIVATE)
    tick = crew.nodes["plant"].tick
    for name in NODES:
        for _ in range(5):
            crew.state(name)
    assert crew.nodes["plant"].tick == tick
    assert crew.change("plant", ACTIVATE)


def flown(crew, folder, pauses):
    """Bag of a flight of 3 s, paused at these ticks."""
    crew.bring_up()
    plant = crew.nodes["plant"]
    for tick in pauses:
        crew.fly(tick - plant.tick)
        pause(crew)
    crew.spin_until(lambda: plant.health.facts.get("over"))
    for number in (DEACTIVATE, CLEANUP):
        assert crew.change("recorder", number)
    (bag,) = folder.glob("bag*")
    recorded = read_bag(bag)
    crew.close()
    return recorded


def test_a_paused_flight_is_the_same_flight_number_for_number(crew, tmp_path):
    """Lockstep: truth, estimate and commands of a flight with three pauses and of one without."""
    options = {"duration_s": 3.0, "peer_timeout_s": 60.0, "seed": 3}
    bags = []
    for name, pauses in (("through", ()), ("paused", (20, 21, 150))):
        (tmp_path / name).mkdir()
        one = crew(*NODES, folder=tmp_path / name, **options)
        bags.append(flown(one, tmp_path / name, pauses))
    through, paused = bags
    for name in STREAMS:
        np.testing.assert_array_equal(paused.streams[name].stamp_ns, through.streams[name].stamp_ns)
        np.testing.assert_array_equal(paused.streams[name].rows, through.streams[name].rows)
    assert len(paused.streams[topics.TRUTH_ODOM].rows) == 300
    assert not [r for r in paused.remarks if "gaps" in r.message]


@pytest.mark.slow
def test_a_pause_in_real_time(crew, tmp_path):
    """The aircraft hovers on: no jump in time, truth or estimate, one flight in the bag."""
    one = crew(*NODES, folder=tmp_path, lockstep=False, duration_s=4.0, peer_timeout_s=60.0)
    bag = flown(one, tmp_path, (100, 200))
    truth, clock = bag.streams[topics.TRUTH_ODOM], bag.streams[topics.IMU]
    for stream in (truth, clock):
        assert set(np.diff(stream.stamp_ns)) == {TICK_NS} and len(stream.stamp_ns) == 400
    assert np.abs(np.diff(truth.rows[:, :3], axis=0)).max() < 0.05
    assert np.abs(truth.rows[-1, :3] - truth.rows[0, :3]).max() < 2.0
    warnings = {r.message for r in bag.remarks if r.node == "observer" and r.level > 0}
    assert not [s for s in warnings if "rejected" in s or "IMU" in s and "align" not in s], warnings


@pytest.mark.slow
@pytest.mark.parametrize("lockstep", [True, False])
def test_another_flight_of_the_plant_takes_the_others_along(crew, tmp_path, lockstep):
    """Clean-up, configuration, activation: tick 0. Who is active begins anew with it."""
    one = crew(*NODES[2:], lockstep=lockstep, duration_s=600.0, peer_timeout_s=0.3)
    one.bring_up()
    plant, observer = one.nodes["plant"], one.nodes["observer"]
    one.fly(200)
    for number in (DEACTIVATE, CLEANUP, CONFIGURE):
        assert one.change("plant", number)
    assert plant.tick == 0 and observer.tick >= 199
    assert one.change("plant", ACTIVATE)
    one.fly(300)
    assert plant.health.level == Level.OK, plant.health.message
    start, here = plant.core.config.pos_ned_m, plant.core.state.x[:3]
    assert np.abs(here - start).max() < 2.0
    for name in ("observer", "inner_loop", "outer_loop"):
        node = one.nodes[name]
        assert node.health.level == Level.OK and abs(node.tick - plant.tick) < 20, name
