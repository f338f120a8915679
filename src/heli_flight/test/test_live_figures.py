# SPDX-License-Identifier: Apache-2.0
"""The live page's largest errors are those of report and result.json, of the same flight."""

from dataclasses import replace

import numpy as np
import pytest

from heli_core.rotations import quat_to_R_nb
from heli_core.rows import NAV, PLANT
from heli_core.ticks import TICK_NS
from heli_flight.graph.live import LiveOrder, live_view
from heli_flight.loop import simulate
from heli_flight.scoring import score
from heli_flight.settings import resolve
from heli_live_view.parameters import BOUNDS
from heli_live_view.state import LiveState
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import FACT_OFFSET

START_NS = 1_000_000_000
RECORDS = {"nav": "navigation", "truth": "truth", "truth_less_drift": "truth_less_drift"}


@pytest.fixture(scope="module")
def flown():
    settings = resolve(gps="standalone", seed=3, duration_s=33.0)
    return settings, simulate(settings).record


def watched(settings):
    """A live view of the flight, its reference heard; nothing has been flown."""
    live = LiveState(START_NS, 1.0, settings.scenario.windows_s.ravel().tolist())
    live.take_reference(replace(settings.scenario.reference, start_ns=START_NS))
    return live


def show(live, record, ticks):
    """The samples of some ticks as messages, drawn at every third."""
    for tick in ticks:
        nav, truth = np.zeros(NAV.size), np.zeros(PLANT.rigid.stop)
        nav[NAV.pos], nav[NAV.vel] = record.nav_pos_ned_m[tick], record.nav_vel_ned_mps[tick]
        truth[PLANT.pos], truth[PLANT.quat] = record.truth_pos_ned_m[tick], record.truth_q_nb[tick]
        truth[PLANT.vel] = quat_to_R_nb(truth[PLANT.quat]).T @ record.truth_vel_ned_mps[tick]
        live.take_sample(topics.ODOM, START_NS + tick * TICK_NS, nav)
        live.take_sample(topics.TRUTH_ODOM, START_NS + tick * TICK_NS, truth)
        if tick % 3 == 0:
            live.row(0.01 * tick)
    return live.row(0.01 * ticks[-1])["largest"]


def engage(live, offset="[0.0, 0.0, 0.0]"):
    live.take_status("outer_loop", 0, "position is held", {FACT_OFFSET: offset})


def test_the_live_view_and_the_report_give_the_same_figures(flown):
    """No sample is missed, whatever is drawn, and none counts before the outer loop has engaged."""
    settings, record = flown
    figures, live = score(record, settings.scenario), watched(settings)
    assert show(live, record, range(150)) is None
    engage(live)
    largest = show(live, record, range(150, 3300))
    assert largest["since_s"] == 0.0
    compared = 0
    for stretch in ("whole", "windows"):
        for name, source in RECORDS.items():
            for bound, key in BOUNDS.items():
                scored = figures.find(stretch, key, source)
                if scored is not None:
                    assert largest[stretch][name][bound] == pytest.approx(scored.max, abs=1e-4)
                    compared += 1
    assert compared == 2 * 2 * 6 + 2 * 3
    for name, source in RECORDS.items():
        report = {f.metric.key: f.value for f in figures.climb if f.source == source}
        assert len(report) == 3 and largest["climb"][name] == pytest.approx(report, abs=1e-4)


def test_the_climb_is_not_told_before_the_reference_has_arrived(flown):
    settings, record = flown
    live = watched(settings)
    engage(live)
    assert show(live, record, range(2349))["climb"] == {}
    early = show(live, record, range(2349, 2400))["climb"]["nav"]
    assert early["climb_time"] == pytest.approx(4.7, abs=0.1)
    assert early["climb_lag"] == pytest.approx(0.0, abs=0.1)


def test_the_reference_counts_from_where_the_aircraft_engaged(flown):
    """A reference that the outer loop has moved is the one that errors are taken from."""
    settings, record = flown
    live, moved = watched(settings), watched(settings)
    engage(live)
    engage(moved, "[1.5, 0.0, 0.0]")
    shift = record.nav_pos_ned_m + [1.5, 0.0, 0.0]
    as_given = show(live, record, range(600))["whole"]["nav"]
    as_moved = show(moved, replace(record, nav_pos_ned_m=shift), range(600))["whole"]["nav"]
    assert as_moved == pytest.approx(as_given, abs=1e-4)


def test_who_comes_late_says_since_when(flown):
    settings, record = flown
    live = watched(settings)
    engage(live)
    largest = show(live, record, range(400, 450))
    assert largest["since_s"] == 4.0 and largest["windows"] == {}
    # Without the half second about 5 s nobody knows the receiver's drift.
    assert "truth_less_drift" in show(live, record, range(450, 700))["whole"]
    late = watched(settings)
    engage(late)
    assert "truth_less_drift" not in show(late, record, range(470, 700))["whole"]


@pytest.mark.parametrize(("port", "is_open"), [(None, False), (8765, True), (0, True)])
def test_foxglove_is_closed_unless_it_is_asked_for(flown, port, is_open):
    """Its protocol knows no token: whoever reaches the port can read."""
    order = LiveOrder(foxglove_port=port)
    assert live_view(order, flown[0]).parameters["foxglove"] is is_open
