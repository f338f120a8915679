# SPDX-License-Identifier: Apache-2.0
"""Pictures of scores: the track over ground by phases, each bounded signal with its bounds."""

from pathlib import Path

import numpy as np

from heli_flight.report.plot_style import BLUE, GREEN, GREY, ORANGE, RED, picture
from heli_handling.definitions import Criterion
from heli_handling.found import Trace
from heli_handling.scoring import Score
from heli_handling.tracks import Array, Track
from heli_parameters.parameters import ParameterError

FORMATS = (".png", ".svg", ".pdf")
_COLOURS = (BLUE, RED, GREEN, ORANGE)
_STYLES = ("-", "--")
_ENDS = 2
"""Marks of a straight course: where it begins and ends."""


def check_picture(path: Path) -> None:
    """Refuse a picture that cannot be written, before anything is worked out.

    Raises
    ------
    ParameterError
    """
    if path.suffix.lower() not in FORMATS:
        raise ParameterError(f"--plot {path}: ends in none of {', '.join(FORMATS)}")
    if not path.resolve().parent.is_dir():
        raise ParameterError(f"--plot {path}: its folder does not exist")


def draw_score(track: Track, score: Score, path: Path) -> None:
    """Draw a manoeuvre: ground track at the left, bounded signals over time at the right."""
    bounded = [c for c in score.table.criteria if c.name in score.found.traces]
    rows = max(len(bounded), 1)
    with picture(path, rows, 2, (9.0, 1.2 + 1.9 * rows)) as (figure, axes):
        grid = axes[0, 0].get_gridspec()
        for ax in axes[:, 0]:
            ax.remove()
        _plan(figure.add_subplot(grid[:, 0]), track, score)
        for ax, criterion in zip(axes[:, 1], bounded, strict=False):
            _bounded(ax, criterion, score.found.traces[criterion.name])
        axes[-1, 1].set_xlabel("time, s")
        scale = "" if score.scale.ratio == 1.0 else f", lengths x {score.scale.ratio:.4f} (Froude)"
        figure.suptitle(
            f"ADS-33E-PRF {score.table.paragraph} {score.table.title}{scale}: {score.level.value}"
        )


def _plan(ax, track: Track, score: Score) -> None:
    """The ground track by phases: east and north of where it begins, or along a straight course."""
    marks = score.found.marks_ned_m
    straight = len(marks) == _ENDS
    origin = marks[0] if straight else track.pos_ned_m[0, :2]
    turn = _course_axes(marks) if straight else np.eye(2)
    way, marks = (track.pos_ned_m[:, :2] - origin) @ turn, (marks - origin) @ turn
    ax.plot(way[:, 1], way[:, 0], color="#cccccc", linewidth=0.8)
    for n, phase in enumerate(score.found.phases):
        at = (track.time_s >= phase.start_s) & (track.time_s <= phase.end_s)
        label = f"{phase.name}, {phase.end_s - phase.start_s:.1f} s"
        ax.plot(way[at, 1], way[at, 0], color=_COLOURS[n % len(_COLOURS)], label=label)
    style = "k+" if len(marks) == 1 else "k:"
    ax.plot(marks[:, 1], marks[:, 0], style, markersize=10, linewidth=0.8)
    for line, colour in _bounds(track, score, marks):
        ax.plot(line[:, 1], line[:, 0], color=colour, linewidth=0.9)
    if straight:
        ax.set_xlabel("right of the course, m (not to the same scale)")
        ax.set_ylabel("along it, m")
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)
        return
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel("east of the first sample, m")
    ax.set_ylabel("north of it, m")
    ax.legend(loc="best")


def _course_axes(marks: Array) -> Array:
    """Matrix (2, 2) by which north, east become along and right of a straight course."""
    ahead = (marks[1] - marks[0]) / np.hypot(*(marks[1] - marks[0]))
    return np.array([[ahead[0], -ahead[1]], [ahead[1], ahead[0]]])


def _bounds(track: Track, score: Score, marks: Array) -> list[tuple[Array, str]]:
    """Lines on the ground that the bounds are, in the axes of the marks, with their colours."""
    lines: list[tuple[Array, str]] = []
    names = {c.name: c for c in score.table.criteria}
    for name, shape in (("position", _boxes), ("track", _sides), ("radius", _rings)):
        if name in names:
            for bound, colour in ((names[name].desired, GREEN), (names[name].adequate, ORANGE)):
                lines += [(line, colour) for line in shape(track, score, marks, bound)]
    if "clearance" in names:
        least, most = names["clearance"].desired, names["error"].desired
        for bound, colour in ((least, GREEN), (least + most, ORANGE)):
            lines += [(line, colour) for line in _sides(track, score, marks, bound)]
    return lines


def _boxes(track: Track, score: Score, marks: Array, bound: float) -> list[Array]:
    heading = _heading(track, score)
    corners = bound * np.array([[1, 1], [1, -1], [-1, -1], [-1, 1], [1, 1]])
    c, s = np.cos(heading), np.sin(heading)
    return [marks[0] + corners @ np.array([[c, s], [-s, c]])]


def _sides(track: Track, score: Score, marks: Array, bound: float) -> list[Array]:
    return [marks + [0.0, side] for side in (bound, -bound)]


def _rings(track: Track, score: Score, marks: Array, bound: float) -> list[Array]:
    radius = score.table["radius_m"]
    centre = 0.5 * (marks.min(axis=0) + marks.max(axis=0))
    return [centre + (marks - centre) * (radius + off) / radius for off in (bound, -bound)]


def _heading(track: Track, score: Score) -> float:
    """Yaw angle of the last phase, rad."""
    last = score.found.phases[-1]
    at = (track.time_s >= last.start_s) & (track.time_s <= last.end_s)
    return float(np.median(track.attitude_rad[at, 2]))


def _bounded(ax, criterion: Criterion, trace: Trace) -> None:
    """A signal with its bounds: desired in green, adequate in orange."""
    for k, label in enumerate(trace.labels):
        colour = (BLUE, GREY)[k % 2]
        ax.plot(trace.time_s, trace.values[:, k], _STYLES[k % 2], color=colour, label=label)
    value, at_s = trace.worst(criterion.at_least)
    ax.axvline(at_s, color=RED, linewidth=0.8, linestyle=":")
    one_sided = criterion.at_least or criterion.name == "height"
    for bound, colour in ((criterion.desired, GREEN), (criterion.adequate, ORANGE)):
        for side in (bound,) if one_sided else (bound, -bound):
            ax.axhline(side, color=colour, linewidth=0.9)
    ax.set_ylabel(f"{criterion.name}, {criterion.quantity.value}")
    ax.set_title(f"{criterion.text}: worst {value:.3g} {criterion.quantity.value}", loc="left")
    if len(trace.labels) > 1:
        # Room for it above the bounds.
        ax.set_ylim(-1.15 * criterion.adequate, 1.6 * criterion.adequate)
        ax.legend(loc="upper right", ncols=2)
