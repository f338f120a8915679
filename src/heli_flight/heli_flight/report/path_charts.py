# SPDX-License-Identifier: Apache-2.0
"""A path from above, its height, and how far the aircraft was from its point."""

from collections.abc import Sequence

import numpy as np

from heli_flight.loop.scoring import SOURCE_NAMES, errors
from heli_flight.report.chart import Chart, Panel, Trace, beyond, largest, level, limits
from heli_flight.report.data import Report
from heli_math.paper_metrics import BY_KEY, PATH
from heli_math.rows import REFERENCE

SECTION = "path"
_ROLES = {"navigation": "nav", "truth": "truth"}


def path_charts(report: Report) -> list[Chart]:
    """Charts of a flight along a path."""
    if report.kind != PATH or not len(report.record):
        return []
    return [_from_above(report), _errors(report)]


def _positions(report: Report, source: str) -> np.ndarray:
    record = report.record
    return record.nav_pos_ned_m if source == "navigation" else record.truth_pos_ned_m


def _from_above(report: Report) -> Chart:
    """North over east, with equal scales."""
    places = {source: _positions(report, source) for source in report.sources()}
    wanted = report.record.reference[:, REFERENCE.pos]
    traces = [
        Trace(pos[:, 1], pos[:, 0], SOURCE_NAMES[source], _ROLES[source], width=1.4)
        for source, pos in places.items()
    ]
    traces.append(Trace(wanted[:, 1], wanted[:, 0], "path", "reference", "dash", width=1.2))
    middle = 0.5 * (np.nanmin(wanted[:, :2], axis=0) + np.nanmax(wanted[:, :2], axis=0))
    every = np.concatenate([wanted, *places.values()])[:, :2] - middle
    side = float(np.clip(1.1 * largest(every), 2.0, 500.0))
    north, east = ((float(m) - side, float(m) + side) for m in middle)
    return Chart(
        "path_from_above",
        "The path from above",
        "What was flown and the path, on a 1 m grid.",
        [Panel("north, m", traces, y_range=north, x_range=east)],
        SECTION,
        x_label="east, m",
        time=False,
        square=True,
    )


def _reach(report: Report, lines: Sequence[Trace], goal: float) -> float:
    """End of an axis: by the scored phases, so that no take-off squashes what is judged."""
    scored = report.settings.scenario.scored(report.record.time_s)
    if not scored.any():
        scored = np.ones(len(report.record), bool)
    return 1.08 * max(1.08 * goal, *(largest(line.y[scored]) for line in lines))


def _errors(report: Report) -> Chart:
    """Height, distance and heading error over time, with the goals."""
    r, kinds = report.record, report.sources()
    found = {source: errors(r, source, PATH) for source in kinds}
    height = [
        Trace(r.time_s, -_positions(report, s)[:, 2], SOURCE_NAMES[s], _ROLES[s])
        for s in reversed(kinds)
    ]
    down = r.reference[:, REFERENCE.pos][:, 2]
    height.append(Trace(r.time_s, -down, "path", "reference", "dash", width=1.2))
    lines = {
        key: [Trace(r.time_s, found[s][key], SOURCE_NAMES[s], _ROLES[s]) for s in reversed(kinds)]
        for key in ("position", "heading")
    }
    away, turned = BY_KEY["position"].paper, BY_KEY["heading"].paper
    reach = {"position": _reach(report, lines["position"], away)}
    reach["heading"] = _reach(report, lines["heading"], turned)
    notes = {
        key: beyond(r.time_s, [line.y for line in lines[key]], reach[key], unit)
        for key, unit in (("position", "m"), ("heading", "°"))
    }
    return Chart(
        "path_errors",
        "On the path",
        "Height; distance from the point of the path at that moment; heading less the path's.",
        [
            Panel("altitude, m", height),
            Panel(
                "distance, m",
                [*lines["position"], level(r.time_s, away, f"goal: {away:g} m")],
                y_range=(-0.05 * reach["position"], reach["position"]),
                note=notes["position"],
            ),
            Panel(
                "heading error, °",
                [*lines["heading"], limits(r.time_s, turned, f"goal: ±{turned:g}°")],
                y_range=(-reach["heading"], reach["heading"]),
                note=notes["heading"],
            ),
        ],
        SECTION,
        spans=report.spans,
    )
