# SPDX-License-Identifier: Apache-2.0
"""Charts: what thinning must keep, what Plotly reads, what a broken-off flight still shows."""

import base64
import html
import math
import re
from dataclasses import replace

import matplotlib
import numpy as np
import pytest

from heli_bags.reader import Remark
from heli_core.metrics import METRICS
from heli_flight.loop import simulate
from heli_flight.report.charts import flight_charts, paper_charts, timeline_charts
from heli_flight.report.data import (
    MAX_POINTS,
    PALETTE,
    Chart,
    DiagnosticEvent,
    Panel,
    Report,
    Trace,
    envelope,
    events_of,
    limits,
    thinned,
)
from heli_flight.report.figures import draw
from heli_flight.report.first_screen import charts_of as first_charts
from heli_flight.report.first_screen import numbers_of
from heli_flight.report.page import render
from heli_flight.report.plotly import figure, with_indices
from heli_flight.report.tables import result_tables
from heli_flight.report.write import write_report
from heli_flight.result import Result, Verdict, phases, sentence
from heli_flight.scoring import (
    SETTLED_S,
    SOURCE_NAMES,
    STRETCHES,
    TRUTH_LESS_DRIFT,
    WHOLE,
    WINDOWS,
    Figures,
    score,
)
from heli_flight.settings import resolve


@pytest.mark.parametrize("n", [1, 100, 2401, 60_000, 1_000_003])
def test_thinning_keeps_the_envelope_and_both_ends(n):
    rng = np.random.default_rng(n)
    y = rng.normal(size=n).cumsum()
    keep = envelope([y], 2400)
    assert keep.size <= max(min(n, 2400), 1) * 1.01 + 2
    assert np.all(np.diff(keep) > 0)
    assert (keep[0], keep[-1]) == (0, n - 1)
    assert (y[keep].max(), y[keep].min()) == (y.max(), y.min())


def test_a_spike_of_one_sample_survives_in_every_column():
    y, y2 = np.zeros(100_000), np.zeros(100_000)
    y[31_415], y2[27_182] = 1.0, -1.0
    keep = envelope([y, y2])
    assert {31_415, 27_182} <= set(keep.tolist())


def test_gaps_stay_gaps():
    x = np.arange(50_000.0)
    y = np.sin(x / 500.0)
    y[20_000:30_000] = np.nan
    y[40_000] = np.nan
    thin = thinned(Trace(x, y, "", "nav"))
    assert thin.x.size < 2 * MAX_POINTS
    assert np.isnan(thin.y[(thin.x >= 20_020) & (thin.x < 29_980)]).all()
    assert np.isnan(thin.y[thin.x == 40_000.0]).all()
    assert np.isfinite(thin.y[(thin.x > 30_100) & (thin.x < 39_900)]).all()


def test_a_track_keeps_its_extremes_on_both_axes():
    turn = np.linspace(0.0, 2.0 * np.pi, 30_000)
    track = Trace(3.0 * np.cos(turn), 2.0 * np.sin(turn), "", "nav")
    thin = thinned(track, planar=True)
    for name in ("x", "y"):
        kept, full = getattr(thin, name), getattr(track, name)
        assert (kept.min(), kept.max()) == (full.min(), full.max())


def test_limits_are_drawn_on_both_sides():
    bound = limits(np.array([0.0, 60.0]), 0.4, "paper")
    assert sorted(set(bound.y[np.isfinite(bound.y)])) == [-0.4, 0.4]


def drawn_numbers(trace, time=True):
    """x and y of a trace as the page gets them."""
    chart = Chart("key", "title", "", [Panel("y", "", [trace])], "flight", time=time)
    (made,) = figure(chart)["data"]
    return [np.frombuffer(base64.b64decode(made[k]["bdata"]), f"<{made[k]['dtype']}") for k in "xy"]


def test_numbers_arrive_as_they_are():
    values = np.array([0.0, -1.5, math.nan, 3e4])
    _, y = drawn_numbers(Trace(np.arange(4.0), values, "", "nav"))
    np.testing.assert_array_equal(y, values.astype("<f4"))
    # A day in seconds to 10 ms needs more than 32 bits.
    late = np.array([86_399.98, 86_399.99])
    x, _ = drawn_numbers(Trace(late, np.zeros(2), "", "nav"))
    np.testing.assert_array_equal(x, late)


@pytest.mark.parametrize(("last", "axis"), [(9.0, "tickformat"), (1000.0, "dtick")])
def test_a_short_logarithmic_axis_has_ticks_between_the_powers(last, axis):
    trace = Trace(np.array([2.0, last]), np.array([0.3, 20.0]), "", "nav", "points")
    chart = Chart("key", "title", "", [Panel("y", "", [trace])], "flight", time=False, log_x=True)
    drawn = figure(chart)["layout"]["xaxis"]
    assert drawn["type"] == "log" and {"tickformat", "dtick"} & set(drawn) == {axis}


def test_a_short_logarithmic_axis_of_a_figure_is_labelled_with_numbers(tmp_path):
    trace = Trace(np.array([2.1, 8.4]), np.array([0.4, 20.0]), "", "nav")
    panels = [Panel("y", "", [trace], log_y=True)] * 2
    chart = Chart("key", "title", "", panels, "flight", time=False, log_x=True)
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        drawn = draw(chart, "")
        drawn.savefig(tmp_path / "key.svg")
    upper, lower = (
        [t.get_text() for t in ax.get_xticklabels(which="both") if t.get_visible() and t.get_text()]
        for ax in drawn.axes
    )
    assert {"3", "4", "5", "6", "7", "8"} <= set(lower) and upper == []
    assert {"0.5", "1", "2", "5", "10"} <= {t.get_text() for t in drawn.axes[0].get_yticklabels()}


@pytest.mark.parametrize(
    ("of", "label", "unit"),
    [(("v_z", "m/s"), "v_z, m/s", "m/s"), (("roll error", "°"), "roll error, °", "°"),
     (("added", "1"), "added, 1", ""), (("command", ""), "command", ""),
     (("input, as a part of its range", ""), "input, as a part of its range", "")],
)  # fmt: skip
def test_what_the_pointer_is_told_has_the_axis_unit(of, label, unit):
    trace = Trace(np.arange(3.0), np.arange(3.0), "<a>", "nav")
    chart = Chart("key", "", "", [Panel(*of, [trace])], "flight", x_quantity="east", x_unit="m")
    assert (chart.panels[0].y_label, chart.x_label) == (label, "east, m")
    (over_time,) = figure(chart)["data"]
    assert over_time["hovertemplate"] == f"%{{y:.4g}} {unit}".rstrip()
    assert figure(chart)["layout"]["xaxis"]["unifiedhovertitle"] == {"text": "%{x:.2f} s"}
    (planar,) = figure(replace(chart, time=False))["data"]
    value = f"%{{y:.4g}} {unit}".rstrip()
    assert (
        planar["hovertemplate"] == f"%{{x:.4g}} m: {value}<extra>{html.escape(trace.label)}</extra>"
    )


def test_symbols_get_their_indices():
    assert with_indices("v_z, m/s") == "<i>v</i><sub>z</sub>, m/s"
    assert with_indices("a < b_s") == "a &lt; <i>b</i><sub>s</sub>"


def test_colours_differ_in_both_themes():
    for theme in (0, 1):
        used = [PALETTE[role][theme] for role in ("nav", "truth", "reference", "bound", "green")]
        assert len(set(used)) == len(used)


@pytest.fixture(scope="module")
def hover():
    settings = resolve(duration_s=30.0)
    flight = simulate(settings)
    scores = score(flight.record, settings.scenario)
    return Report(flight.record, settings, Result(scores, "", 30.0, 1.0), "one process")


def test_hover_charts_redraw_the_paper_with_its_bounds(hover):
    charts = {chart.paper: chart for chart in paper_charts(hover)}
    assert set(charts) == {"Fig. 5", "Fig. 6", "Fig. 7", "Fig. 8", "Fig. 9"}
    for name, value in (("Fig. 5", 0.18), ("Fig. 6", 0.3), ("Fig. 7", 0.3)):
        traces = charts[name].panels[-1].traces
        (bound,) = [t for t in traces if t.role == "bound"]
        assert np.nanmax(bound.y) == value
    tube = next(t for t in charts["Fig. 8"].panels[1].traces if t.role == "bound")
    assert (np.nanmin(tube.y), np.nanmax(tube.y)) == pytest.approx((9.6, 20.4))
    box = next(t for t in charts["Fig. 9"].panels[0].traces if t.role == "bound")
    assert (np.max(box.x), np.max(box.y)) == (1.02, 0.65)


def test_what_is_drawn_is_what_was_scored(hover):
    """The largest value drawn inside the shaded phases is the number of the table."""
    chart = next(chart for chart in paper_charts(hover) if chart.paper == "Fig. 7")
    line = next(t for t in chart.panels[0].traces if t.role == "nav")
    shaded = np.zeros(line.x.shape, bool)
    for start, end in chart.spans:
        shaded |= (line.x >= start) & (line.x < end)
    top = np.abs(line.y[shaded]).max()
    assert top == pytest.approx(hover.score("v_y", "navigation").max, rel=1e-12)


def test_the_tables_give_what_decides_first_then_the_whole_flight_then_the_climb(hover):
    windows, whole, climb = result_tables(hover)
    for table, stretch, ends_s in (
        (whole, WHOLE, ["0", "30"]), (windows, WINDOWS, ["5", "18", "25", "30"]),
    ):  # fmt: skip
        when = phases(hover.settings, stretch)
        assert table.caption.startswith(f"{STRETCHES[stretch].capitalize()}, {when}. ")
        assert re.findall(r"[\d.]+", when) == ends_s
    assert ["exit code" in table.caption for table in (whole, windows)] == [False, True]
    assert "10 to 20 m in 5.50 s" in climb.caption
    for table, stretch in ((whole, WHOLE), (windows, WINDOWS)):
        assert table.head[1:4] == list(SOURCE_NAMES.values())
        for row in table.rows[:-1]:
            metric = next(m for m in METRICS["hover"] if row[0] == f"{m.label}, {m.unit}")
            for cell, source in zip(row[1:4], SOURCE_NAMES, strict=True):
                scored = hover.score(metric.key, source, stretch)
                assert cell == "–" if scored is None else cell.startswith(f"{scored.max:.2f} ")
    lag = next(f for f in hover.result.figures.climb if f.metric.key == "climb_lag")
    assert climb.rows[2][:2] == [lag.metric.label, f"{lag.value:.2f} s"]


def verdicts_of(text):
    return [" ".join(line.split()) for line in re.findall(r'<p class="verdict .*?</p>', text, re.S)]


def test_the_page_opens_with_one_verdict_and_four_numbers(hover):
    """The sentence is the one that decides the exit code, whatever the whole flight was."""
    assert hover.result.judged(hover.settings.gps, WHOLE)
    text = render(hover, first_charts(hover), None)
    (verdict,) = verdicts_of(text)
    assert 'verdict good"' in verdict
    assert html.escape(sentence(hover.result, hover.settings), quote=False) in html.unescape(
        verdict
    )
    numbers = numbers_of(hover)
    assert [number.label for number in numbers[2:]] == ["Tilt", "Wind"] and len(numbers) == 4
    height = hover.score("altitude", TRUTH_LESS_DRIFT)
    assert numbers[0].value == f"{height.max:.2f} m"
    head = text.partition("<main>")[0]
    assert all(number.value in head for number in numbers)
    assert [f'id="chart-{c.key}"' in head for c in first_charts(hover)] == [True, True]
    # Conditions are said once; every section folds out.
    assert text.count(html.escape(hover.conditions, quote=False)) <= 1
    assert "<section" in text and text.count("<section") == text.count('class="section"')


def test_what_nothing_bounds_is_measured_and_has_no_bound_drawn(hover):
    settings = resolve(duration_s=30.0, overrides={"scenario": {"climb.speed_mps": 1.0}})
    figures = score(hover.record, settings.scenario)
    mine = replace(hover, settings=settings, result=Result(figures, "", 30.0, 1.0))
    assert mine.result.verdict("standalone") is Verdict.MEASURED
    assert mine.result.exit_code("standalone") == 0
    for chart in (*paper_charts(mine), *first_charts(mine)):
        traces = [trace for panel in chart.panels for trace in panel.traces]
        assert not [trace for trace in traces if trace.role == "bound"] and not chart.paper
    (verdict,) = verdicts_of(render(mine, [], None))
    assert 'class="verdict "' in verdict
    bounds = {"scenario": {"climb.speed_mps": 1.0, "score.bounds.altitude_m": 0.01}}
    settings = resolve(duration_s=30.0, overrides=bounds)
    bounded = Result(score(hover.record, settings.scenario), "", 30.0, 1.0)
    assert bounded.verdict("standalone") is Verdict.OUTSIDE
    assert {s.metric.key for s in bounded.judged("standalone")} == {"altitude"}


def test_the_position_chart_says_which_sigma_it_shows(hover):
    """Of the position as it counts from the alignment; absolute where the filter is told so."""
    chart = next(c for c in flight_charts(hover) if c.key == "estimate_position")
    from_alignment = chart.caption
    (less,) = [t for t in chart.panels[0].traces if t.label.endswith(f"{SETTLED_S:g} s")]
    assert np.abs(less.y[np.abs(less.x - 5.0) < 0.5]).max() < 0.1
    observer = {**hover.settings.nodes["observer"], "ekf.initial.drift_at_alignment_fraction": 1.0}
    nodes = {**hover.settings.nodes, "observer": observer}
    absolute = replace(hover, settings=replace(hover.settings, nodes=nodes))
    chart = next(c for c in flight_charts(absolute) if c.key == "estimate_position")
    assert chart.caption != from_alignment
    assert less.label not in [t.label for t in chart.panels[0].traces]


def axis(drawn, i):
    return drawn["layout"]["xaxis" + (str(i + 1) if i else "")]


def test_charts_become_json(hover):
    for chart in [*paper_charts(hover), *flight_charts(hover), *timeline_charts(hover)]:
        drawn = figure(chart)
        assert len(drawn["data"]) >= len([t for p in chart.panels for t in p.traces])
        domains = [v["domain"] for k, v in drawn["layout"].items() if k.startswith("yaxis")]
        assert domains[0][1] == 1.0
        assert all(upper[0] > lower[1] for upper, lower in zip(domains, domains[1:], strict=False))
        gaps = [upper[0] - lower[1] for upper, lower in zip(domains, domains[1:], strict=False)]
        heights = [top - bottom for bottom, top in domains]
        assert np.ptp(gaps or [0.0]) < 1e-9
        share = np.array([panel.height for panel in chart.panels]) / heights
        assert np.ptp(share) < 1e-9 * share[0]
        common = [axis(drawn, i) for i, p in enumerate(chart.panels) if p.x_range is None]
        assert all(a.get("matches", "x") == "x" for a in common)
        spans = [s for s in drawn["layout"].get("shapes", ()) if s["type"] == "rect"]
        assert len(spans) == len(chart.spans) * len(common)


def test_health_is_told_when_it_changes():
    settings = resolve()

    def remark(second, level, message):
        return Remark(1_000_000_000 * (1 + second), "observer", level, message, {})

    events = events_of([remark(0, 0, "ok"), remark(1, 0, "ok"), remark(2, 1, "late")], settings)
    assert events == [
        DiagnosticEvent(0.0, "observer", 0, "ok"),
        DiagnosticEvent(2.0, "observer", 1, "late"),
    ]


@pytest.mark.slow
def test_a_flight_that_ends_at_once_still_gets_a_report(tmp_path):
    settings = resolve(duration_s=0.1)
    flight = simulate(settings)
    lost = "the helicopter <hit> the ground"
    page = write_report(flight.record, settings, Result(Figures(), lost, 0.1, 1.0), tmp_path)
    assert not (tmp_path / "figures").exists() and 'href="figures/' not in page.read_text()
    page = write_report(
        flight.record, settings, Result(Figures(), lost, 0.1, 1.0), tmp_path, figures=True
    )
    text = page.read_text(encoding="utf-8")
    assert "Lost after 0.10 s: " in text and "&lt;hit&gt;" in text and "<hit>" not in text
    assert (tmp_path / "figures" / "fig9_track.svg").stat().st_size > 0
    assert 'href="figures/fig9_track.svg"' in text
