# SPDX-License-Identifier: Apache-2.0
"""Bands of modes, faults, failsafes and health: recorded facts, in every chart over time."""

import html
from dataclasses import replace

import numpy as np
import pytest

from heli_bags.reader import Remark
from heli_core.faults import Fault
from heli_dynamics_sim.faults import FaultLog
from heli_flight.loop import simulate
from heli_flight.report.charts import paper_charts, timeline_charts
from heli_flight.report.data import (
    Band,
    Chart,
    DiagnosticEvent,
    Panel,
    Report,
    Rival,
    Trace,
    bands_beside,
    bands_of,
    legend,
    runs,
    stretch,
    with_bands,
)
from heli_flight.report.figures import draw
from heli_flight.report.page import render
from heli_flight.report.plotly import page_data
from heli_flight.report.tables import band_table
from heli_flight.result import Result
from heli_flight.scoring import Figures
from heli_flight.settings import resolve

Event = DiagnosticEvent

FAULTS = (
    "{what: gps, kind: loss, start_s: 2, duration_s: 3}",
    "{what: delta_ped, kind: offset, start_s: 6, value: 0.02}",
    "{what: imu, kind: freeze, start_s: 400, duration_s: 1}",
)


@pytest.fixture(scope="module")
def flown():
    over = {"plant": {"faults": FAULTS}, "outer_loop": {"failsafe.land_astray_m": 1e4}}
    settings = resolve(duration_s=8.0, overrides=over)
    return simulate(settings).record, settings


def remark(flight_s, node="plant", level=0, message="", **facts):
    return Remark(round(1e9 * (1 + flight_s)), node, level, message, facts)


def of(bands, kind):
    return [(band.start_s, band.end_s, band.name) for band in bands if band.kind == kind]


def test_runs_meet_each_other_and_end_with_the_record():
    time_s, names = np.arange(5.0), np.array(["a", "a", "b", "b", "a"])
    assert list(runs(time_s, names)) == [(0.0, 2.0, "a"), (2.0, 4.0, "b"), (4.0, 4.0, "a")]


def test_faults_are_those_that_were_ordered_up_to_the_end(flown):
    record, settings = flown
    end_s = record.time_s[-1]
    bands = bands_of(record, settings)
    assert of(bands, "fault") == [(2.0, 5.0, "gps loss"), (6.0, end_s, "delta_ped offset 0.02")]
    assert {band.kind for band in bands} == {"fault"}


def test_modes_are_shown_where_there_is_more_than_one(flown):
    record, settings = flown
    mode = np.where(record.time_s < 4.0, "hover", "land")
    bands = bands_of(replace(record, mode=mode), settings)
    assert of(bands, "mode") == [(0.0, 4.0, "hover"), (4.0, record.time_s[-1], "land")]
    alone = replace(record, mode=np.full(len(record), "hover"))
    assert of(bands_of(alone, settings), "mode") == []


def test_failsafes_are_what_the_position_loop_did(flown):
    record, settings = flown
    done = np.where((record.time_s > 3.0) & (record.time_s < 5.0), "HOLD_LEAN", "NONE")
    failsafes = [
        b for b in bands_of(replace(record, failsafe=done), settings) if b.kind == "failsafe"
    ]
    (band,) = failsafes
    assert (band.start_s, band.end_s) == pytest.approx((3.01, 5.0))
    assert band.name == "HOLD_LEAN" and "no place" in band.detail


def test_a_flight_in_one_process_writes_its_failsafes_down():
    """A receiver that is stuck; then the landing by itself."""
    over = {
        "plant": {"faults": ("{what: gps, kind: freeze, start_s: 3}",)},
        "outer_loop": {"failsafe.land_after_s": 1.0},
    }
    record = simulate(resolve(seed=3, duration_s=25.0, world="paper", overrides=over)).record
    assert record.failsafe.shape == record.time_s.shape and record.failsafe[0] == "NONE"
    assert {"LAND"} <= set(record.failsafe) and record.mode[-1] == "standing"
    assert simulate(resolve(duration_s=2.0)).record.failsafe is None


def test_what_the_plant_told_of_faults_in_flight_reads_back(flown):
    """Its own words, by its own log."""
    record, settings = flown
    settings = replace(settings, nodes={**settings.nodes, "plant": {
        **settings.nodes["plant"], "faults": ("none",)}})  # fmt: skip
    gust = Fault("wind", "gust", 1.5, 2.0, (1.0, -2.0, 0.0))
    bias = Fault("imu", "bias", 2.25, value=(0.1,) * 6)
    log = FaultLog()
    log.change([], [gust], 1.5)
    log.change([gust], [gust, bias], 2.25)
    log.change([gust, bias], [gust], 4.0)
    remarks = [remark(1.5, faults_in_flight="x"), remark(5.0, **log.facts([gust], 5.0))]
    faults = of(bands_of(record, settings, remarks), "fault")
    assert faults == [
        (1.5, 3.5, "wind gust 1, -2, 0"),
        (2.25, 4.0, "imu bias 0.1, 0.1, 0.1, 0.1, 0.1, 0.1"),
    ]
    # Another node's words, and words of nobody, say nothing.
    strange = [remark(5.0, "stranger", faults_in_flight="gps loss from 1 to 2 s"),
               remark(5.0, faults_in_flight="<b>; gps from ... s on; and more")]  # fmt: skip
    assert of(bands_of(record, settings, strange), "fault") == []


def test_a_fault_that_was_ordered_and_taken_back_ends_then(flown):
    record, settings = flown
    log = FaultLog()
    pedal = Fault("delta_ped", "offset", 6.0, value=(0.02,))
    log.change([pedal], [], 7.0)
    faults = of(bands_of(record, settings, [remark(7.0, **log.facts([], 7.0))]), "fault")
    assert faults == [(2.0, 5.0, "gps loss"), (6.0, 7.0, "delta_ped offset 0.02")]


def test_health_is_what_nodes_complained_of(flown):
    record, settings = flown
    events = [Event(-0.5, "outer_loop", 1, "waits"), Event(-0.2, "outer_loop", 0, "flies"),
              Event(0.0, "inner_loop", 1, "starts"), Event(0.2, "inner_loop", 0, "flies"),
              Event(2.0, "plant", 1, "fault: gps loss"), Event(5.0, "plant", 0, "flying"),
              Event(3.0, "observer", 1, "GPS <lost>"), Event(5.0, "observer", 0, "ok"),
              Event(7.0, "plant", 9, "?")]  # fmt: skip
    health = of(bands_of(record, settings, (), events), "health")
    assert health == [(3.0, 5.0, "observer WARN"), (7.0, record.time_s[-1], "plant STALE")]


def test_every_chart_over_time_has_them_and_no_other(flown):
    record, settings = flown
    bands = bands_of(record, settings)
    line = [Panel("y", "m", [Trace(record.time_s, record.time_s, "a", "nav")])]
    charts = [Chart("a", "", "", line, "flight"), Chart("b", "", "", line, "flight", time=False),
              Chart("c", "", "", line, "flight", bands=())]  # fmt: skip
    over_time, other, without_bands = with_bands(charts, bands)
    assert list(over_time.bands) == bands and other.bands is None and without_bands.bands == ()
    data = page_data([over_time, other, without_bands])
    first, *others = (data["bands"][drawn["bands"]] for drawn in data["figures"])
    assert [band["name"] for band in first] == ["gps loss", "delta_ped offset 0.02"]
    assert others == [[], []]
    # The arrays of all three are there once: x and y are the same.
    assert len(data["arrays"]) == 1
    drawn = draw(over_time, "")
    shaded = [p for p in drawn.axes[0].patches if p.get_label().startswith("fault")]
    assert {p.get_label() for p in shaded} == {f"fault: {band.name}" for band in bands}


def test_the_page_tells_them_and_when(flown):
    record, settings = flown
    bands = [*bands_of(record, settings), Band(1.0, 1.0, "fault", "<kill>", "rival", of="<k>")]
    report = Report(record, settings, Result(Figures(), "", 8.0, 1.0), "x", bands=bands)
    charts = with_bands([*paper_charts(report), *timeline_charts(report)], bands)
    text = render(report, charts, None)
    keys = [band for band in legend(bands) if band.kind == "fault"]
    details = {key.name: key.detail for key in keys}
    loss, kill = (next(band for band in bands if band.name == n) for n in ("gps loss", "<kill>"))
    assert details[f"fault: {loss.name}"] == "2.00 to 5.00 s"
    assert details[f"fault: {kill.name}"] == "at 1.00 s"
    for key in keys:
        assert f'title="{key.detail}">{html.escape(key.name)}</span>' in text
    assert "<kill>" not in text
    rows = [row for row in band_table(report).rows if row[2] == "fault"]
    assert rows[0][:4] == ["1.00", "1.00", "fault", "<kill>"]
    assert rows[1][:4] == ["2.00", "5.00", "fault", "gps loss"] and rows[1][4]
    assert band_table(replace(report, bands=())) is None
    (lanes,) = timeline_charts(report)
    assert {"fault: gps", "fault: <k>"} <= set(lanes.panels[0].y_ticks) and lanes.bands == ()


def test_a_legend_has_each_once_with_its_first_times():
    bands = [Band(float(i), i + 0.5, "mode", "hover", "nav") for i in range(6)]
    (key,) = legend(bands)
    assert key.name == "hover" and key.detail.startswith("0.00 to 0.50 s, 1.00 to 1.50 s")
    assert key.detail.endswith("and 2 more")
    assert stretch(Band(2.0, 2.0, "fault", "kill", "rival")) == "at 2.00 s"


def test_flights_beside_each_other_share_what_is_alike():
    gust, loss = (Band(1.0, 2.0, "fault", name, "rival") for name in ("gust", "loss"))
    hover, land = (Band(0.0, 9.0, "mode", name, "nav") for name in ("hover", "land"))
    health = Band(0.0, 1.0, "health", "plant WARN", "warn")
    beside = bands_beside({"a": [hover, gust, health], "b": [hover, gust, loss]})
    assert [band.name for band in beside] == ["hover", "gust", "loss (b)"]
    beside = bands_beside({"a": [hover, gust], "b": [land, gust]})
    assert [band.name for band in beside] == ["gust"]


def test_another_flight_on_the_page_has_its_own():
    """The rival of the attitude test flew the same faults; what nodes said was not of it."""
    over = {"plant": {"faults": FAULTS[:1]}, "outer_loop": {"failsafe.land_astray_m": 1e4}}
    settings = resolve("attitude", duration_s=6.0, overrides=over)
    record = simulate(settings).record
    events = [Event(1.0, "observer", 1, "?")]
    report = Report(record, settings, Result(Figures(), "", 6.0, 1.0), "x", events,
                    Rival("pid", replace(record), Figures(), ""),
                    bands=bands_of(record, settings, (), events))  # fmt: skip
    rival, flown_chart = with_bands(paper_charts(report), report.bands)
    assert [band.kind for band in flown_chart.bands] == ["fault", "health"]
    assert [band.kind for band in rival.bands] == ["fault"]


def test_a_take_off_does_not_squash_what_is_scored():
    """Axes of Fig. 3 and 4 are made for the scored phases; a note says what is beyond."""
    settings = resolve("attitude", duration_s=8.0)
    record = simulate(settings).record
    tumbling = record.setpoint.copy()
    tumbling[record.time_s < 1.0, 0] += np.radians(25.0)
    report = Report(replace(record, setpoint=tumbling), settings,
                    Result(Figures(), "", 8.0, 1.0), "x")  # fmt: skip
    (chart,) = paper_charts(report)
    roll = chart.panels[0]
    assert roll.y_range[1] == pytest.approx(1.15 * 4.8)
    assert roll.note.startswith("to 2")
    assert chart.panels[1].note == ""
