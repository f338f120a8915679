# SPDX-License-Identifier: Apache-2.0
"""What a report is made of, and the signals that its charts share."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from heli_bags.reader import Remark
from heli_core.metrics import PaperMetric
from heli_core.python_controller import INNER, short_name
from heli_core.rotations import euler_angles
from heli_flight.flight_file import drawn, drawn_words, flown_faults
from heli_flight.layers import AUTOPILOTS
from heli_flight.record import FlightRecord
from heli_flight.result import Result, conditions
from heli_flight.scoring import WINDOWS, Figures, Score, counted, errors
from heli_flight.settings import Settings, laws_words, own_laws
from heli_outer_pd.failsafes import Action

# -------------------------------------------------------------------------------------------------
# A chart as data: what is drawn, told once for the page (Plotly) and for the paper (Matplotlib).
#
# Colours are roles; each backend and theme has its own palette, all from Okabe and Ito's colours,
# which people with any colour vision tell apart.
# -------------------------------------------------------------------------------------------------

MAX_POINTS = 1600
"""Points per trace on the page; beyond that the envelope is kept."""

# Role: colour on white, colour on black.
PALETTE: dict[str, tuple[str, str]] = {
    "nav": ("#0072B2", "#56B4E9"),
    "truth": ("#D55E00", "#E69F00"),
    "reference": ("#222222", "#EDEDED"),
    "bound": ("#AA3377", "#E79AC6"),
    "rival": ("#E69F00", "#F0E442"),
    "green": ("#009E73", "#2FC79B"),
    "sky": ("#56B4E9", "#8CCBF2"),
    "purple": ("#CC79A7", "#CC79A7"),
    "muted": ("#8A8A8A", "#8F979E"),
    "good": ("#009E73", "#2FC79B"),
    "warn": ("#E69F00", "#F0E442"),
    "bad": ("#D55E00", "#FF7A45"),
}


@dataclass(frozen=True)
class Trace:
    """One line, step, band or set of points.

    Attributes
    ----------
    x, y : (N,) ndarray
    label : str
        Name in the legend; an empty one keeps it out.
    role : str
        Key of PALETTE.
    kind : str
        "line", "dash", "dot", "band" (between y and y2), "points" or "bar" (thick segments).
    y2 : (N,) ndarray, optional
        Lower edge of a band.
    width : float
        Line width, px.
    """

    x: np.ndarray
    y: np.ndarray
    label: str
    role: str
    kind: str = "line"
    y2: np.ndarray | None = None
    width: float = 1.4


def axis_label(quantity: str, unit: str) -> str:
    """Name of an axis: "v_z, m/s", or the quantity alone where it has no unit."""
    return f"{quantity}, {unit}" if unit else quantity


@dataclass(frozen=True)
class Panel:
    """One pair of axes; panels of a chart stand below each other.

    Attributes
    ----------
    quantity : str
        What y is, such as "v_z".
    unit : str
        Of y; "1" for a number without a unit, empty where none is to be named.
    traces : sequence of Trace
    height : float
        Relative to the chart's other panels.
    y_range, x_range : pair of float, optional
        An x_range of its own unties the panel from the others' x axis.
    y_ticks : sequence of str, optional
        Names of the lanes at y = 0, 1, 2, ...
    log_y : bool
    note : str
        Written above the panel.
    """

    quantity: str
    unit: str
    traces: Sequence[Trace]
    height: float = 1.0
    y_range: tuple[float, float] | None = None
    x_range: tuple[float, float] | None = None
    y_ticks: Sequence[str] = ()
    log_y: bool = False
    note: str = ""

    @property
    def y_label(self) -> str:
        """Quantity and unit, as the axis is named."""
        return axis_label(self.quantity, self.unit)


@dataclass(frozen=True)
class Band:
    """A stretch of flight time of which something was recorded, shaded in charts over time.

    Attributes
    ----------
    start_s, end_s : float
        Flight time; equal ends: a moment.
    kind : str
        "mode" (along the upper edge), "health" (along the lower edge), "fault", "failsafe".
    name : str
        Short, for a legend.
    role : str
        Key of PALETTE.
    detail : str
        A sentence more, for a table; or empty.
    of : str
        What a fault is of, which names its lane of the timeline; empty for other kinds.
    """

    start_s: float
    end_s: float
    kind: str
    name: str
    role: str
    detail: str = ""
    of: str = ""


@dataclass(frozen=True)
class Chart:
    """A figure.

    Attributes
    ----------
    key : str
        Name of its files and its anchor.
    title, caption : str
        The caption is a sentence or two; conditions are added by the page.
    panels : sequence of Panel
    section : str
        Where on the page it stands.
    paper : str
        The paper's figure that it redraws ("Fig. 5"), or empty.
    x_quantity, x_unit : str
    time : bool
        Whether x is flight time, so that its zoom is shared with the other charts of time.
    spans : sequence of (start, end)
        Shaded stretches of x: the scored phases.
    bands : sequence of Band, optional
        What was recorded of modes, faults, failsafes; None: not settled yet (`with_bands`).
    log_x, square, is_to_scale : bool
        square: equal scales and a 1 m grid. is_to_scale: equal scales.
    height_px : float
        0: as its panels ask.
    """

    key: str
    title: str
    caption: str
    panels: Sequence[Panel]
    section: str
    paper: str = ""
    x_quantity: str = "flight time"
    x_unit: str = "s"
    time: bool = True
    spans: Sequence[tuple[float, float]] = ()
    log_x: bool = False
    square: bool = False
    bands: Sequence[Band] | None = None
    is_to_scale: bool = False
    height_px: float = 0.0

    @property
    def x_label(self) -> str:
        """Quantity and unit, as the axis is named."""
        return axis_label(self.x_quantity, self.x_unit)

    @property
    def has_data(self) -> bool:
        """Whether anything is drawn besides bounds and references."""
        traces = [trace for panel in self.panels for trace in panel.traces]
        drawn = [trace for trace in traces if trace.role not in ("bound", "reference")]
        return any(bool(np.isfinite(trace.y).any()) for trace in drawn)


def with_bands(charts: Sequence[Chart], bands: Sequence[Band]) -> list[Chart]:
    """The charts, those over flight time with the bands, but for those that have their own."""
    return [
        replace(chart, bands=tuple(bands)) if chart.time and chart.bands is None else chart
        for chart in charts
    ]


FEW_DECADES = 2.0
"""A logarithmic axis over at most so many decades has ticks between the powers of ten."""


def decades(values: Sequence[np.ndarray]) -> float:
    """Decades from the smallest to the largest positive value; 0 if there is none."""
    flat = np.concatenate([np.ravel(v) for v in values]) if values else np.empty(0)
    positive = flat[np.isfinite(flat) & (flat > 0.0)]
    return float(np.log10(positive.max() / positive.min())) if positive.size else 0.0


def largest(values: np.ndarray) -> float:
    """Largest magnitude of the finite values, 0 if there is none."""
    finite = values[np.isfinite(values)]
    return float(np.abs(finite).max()) if finite.size else 0.0


def beyond(x: np.ndarray, lines: Sequence[np.ndarray], reach: float, unit: str) -> str:
    """Where lines over flight time leave an axis to +-reach, for a note; empty if they do not."""
    if not len(x):
        return ""
    magnitude = np.max(np.abs([np.nan_to_num(line) for line in lines]), axis=0)
    at = int(np.argmax(magnitude))
    if magnitude[at] <= reach:
        return ""
    space = "" if unit == "°" else " "
    return f"to {magnitude[at]:.1f}{space}{unit} at {x[at]:.1f} s, beyond this axis"


def limits(x: np.ndarray, value: float, label: str, role: str = "bound") -> Trace:
    """Dashed lines at +value and -value over the range of x."""
    ends = np.array([x[0], x[-1], np.nan, x[0], x[-1]], float)
    levels = np.array([value, value, np.nan, -value, -value])
    return Trace(ends, levels, label, role, "dash", width=1.2)


def level(
    x: np.ndarray, value: float, label: str, role: str = "bound", kind: str = "dash"
) -> Trace:
    """A horizontal line over the range of x."""
    return Trace(np.array([x[0], x[-1]], float), np.full(2, value), label, role, kind, width=1.2)


def envelope(columns: Sequence[np.ndarray], points: int = MAX_POINTS) -> np.ndarray:
    """Indices that keep the extremes of every column, and its gaps.

    Parameters
    ----------
    columns : sequence of (N,) ndarray
        Signals that are drawn over the same samples; NaN is a gap.
    points : int
        About how many indices are wanted.

    Returns
    -------
    (M,) ndarray of int
        Ascending; all N if N <= points. Each bucket of neighbouring samples gives the largest and
        the smallest sample of each column, and a gap if it has one.
    """
    n = len(columns[0])
    if n <= points:
        return np.arange(n)
    size = -(-n * 2 * len(columns) // points)
    buckets = -(-n // size)
    starts = np.arange(buckets) * size
    kept = [np.array([0, n - 1])]
    for column in columns:
        padded = np.full(buckets * size, column[-1], float)
        padded[:n] = column
        table = padded.reshape(buckets, size)
        gap = np.isnan(table)
        kept.append(starts + np.argmax(np.where(gap, -np.inf, table), axis=1))
        kept.append(starts + np.argmin(np.where(gap, np.inf, table), axis=1))
        partly = gap.any(axis=1)
        kept.append((starts + np.argmax(gap, axis=1))[partly])
    return np.unique(np.minimum(np.concatenate(kept), n - 1))


def thinned(trace: Trace, points: int = MAX_POINTS, planar: bool = False) -> Trace:
    """The trace with at most about `points` samples and the same envelope.

    Parameters
    ----------
    trace : Trace
    points : int
    planar : bool
        True if x is no time axis: then x keeps its extremes, too.
    """
    columns = [trace.y] if trace.y2 is None else [trace.y, trace.y2]
    if planar:
        columns.append(trace.x)
    keep = envelope(columns, points)
    if keep.size == len(trace.x):
        return trace
    y2 = None if trace.y2 is None else trace.y2[keep]
    return Trace(trace.x[keep], trace.y[keep], trace.label, trace.role, trace.kind, y2, trace.width)


# -------------------------------------------------------------------------------------------------
# Data.
# -------------------------------------------------------------------------------------------------

LEVELS = ("OK", "WARN", "ERROR", "STALE")


@dataclass(frozen=True)
class DiagnosticEvent:
    """What a node said on /diagnostics.

    Attributes
    ----------
    time_s : float
        Flight time.
    node : str
    level : int
        0 OK, 1 WARN, 2 ERROR, 3 STALE.
    message : str
    """

    time_s: float
    node: str
    level: int
    message: str


def events_of(remarks: Iterable[Remark], settings: Settings) -> list[DiagnosticEvent]:
    """Changes of the nodes' health out of /diagnostics; what only repeats is left out."""
    start_ns = round(settings.nodes["plant"]["start_time_s"] * 1e9)
    last: dict[str, tuple[int, str]] = {}
    events = []
    for remark in remarks:
        if last.get(remark.node) == (remark.level, remark.message):
            continue
        last[remark.node] = (remark.level, remark.message)
        time_s = (remark.stamp_ns - start_ns) / 1e9
        events.append(DiagnosticEvent(time_s, remark.node, remark.level, remark.message))
    return events


@dataclass(frozen=True)
class Rival:
    """The same flight under another controller."""

    controller: str
    record: FlightRecord
    figures: Figures
    lost: str


@dataclass(frozen=True)
class Report:
    """All that the pages show.

    Attributes
    ----------
    record : FlightRecord
        Ground truth that was not recorded is NaN.
    settings : Settings
    result : Result
    how : str
        How it was flown: "ROS 2 graph, lockstep", "one process".
    events : sequence of DiagnosticEvent
        Changes of the nodes' health; empty where nothing of the kind was recorded.
    rival : Rival, optional
        Same wind, same seed, another controller: Fig. 3 against Fig. 4.
    missing : sequence of str
        Sentences: what could not be shown, and why.
    assumed : bool
        True if the settings are not known to be those of the flight.
    commit : str
        Of the sources that flew; empty if it was not recorded.
    bands : sequence of Band
        Modes, faults, failsafes, health as they were recorded.
    """

    record: FlightRecord
    settings: Settings
    result: Result
    how: str
    events: Sequence[DiagnosticEvent] = ()
    rival: Rival | None = None
    missing: Sequence[str] = field(default=())
    assumed: bool = False
    commit: str = ""
    bands: Sequence[Band] = ()

    @property
    def kind(self) -> str:
        """Kind of scenario: hover or attitude."""
        return self.settings.scenario.kind

    @property
    def controller(self) -> str:
        """The attitude controller that flew: one of `CONTROLLERS`, one's own, or an autopilot's."""
        if self.settings.mode in AUTOPILOTS:
            return laws_words(self.settings)
        law = own_laws(self.settings).get(INNER, "")
        return short_name(law) if law else str(self.settings.nodes["inner_loop"]["controller"])

    @property
    def conditions(self) -> str:
        """Wind, sensors and seed in one line; stands next to every comparison."""
        line = conditions(self.settings).replace("\n", "; ")
        if drawn(self.settings):
            line += f"; {drawn_words(self.settings)}"
        return f"assumed, not recorded with the flight: {line}" if self.assumed else line

    @cached_property
    def has_truth(self) -> bool:
        """Whether ground truth was recorded."""
        return bool(np.isfinite(self.record.truth_pos_ned_m).any())

    @cached_property
    def has_rotor_truth(self) -> bool:
        """Whether flapping and gyro state were recorded."""
        return bool(np.isfinite(self.record.truth_rotor).any())

    @cached_property
    def has_wind(self) -> bool:
        """Whether the wind was recorded."""
        return bool(np.isfinite(self.record.wind_ned_mps).any())

    @cached_property
    def spans(self) -> list[tuple[float, float]]:
        """Scored stretches inside the flight, s."""
        if not len(self.record):
            return []
        end = float(self.record.time_s[-1])
        windows = self.settings.scenario.windows_s
        return [(float(a), min(float(b), end)) for a, b in windows if a < end]

    def sources(self) -> list[str]:
        """Of navigation and truth, those that were recorded; navigation if neither was."""
        known = {"navigation": self.record.nav_pos_ned_m, "truth": self.record.truth_pos_ned_m}
        recorded = [source for source, array in known.items() if np.isfinite(array).any()]
        return recorded or ["navigation"]

    def metric(self, key: str) -> PaperMetric:
        """A metric of this flight's kind, with what bounds it."""
        return next(m for m in self.settings.scenario.metrics if m.key == key)

    def error(self, key: str, source: str) -> np.ndarray:
        """Error (N,) of a metric of hover, in its unit."""
        return errors(self.record, source, "hover")[key]

    def counted(self, stretch: str) -> np.ndarray:
        """Mask (N,) of the samples of a stretch."""
        return counted(self.record, self.settings.scenario, stretch)

    def euler_deg(self, source: str, record: FlightRecord | None = None) -> np.ndarray:
        """phi, theta, psi (N, 3), deg."""
        r = self.record if record is None else record
        return np.degrees(euler_angles(r.nav_q_nb if source == "navigation" else r.truth_q_nb))

    def score(self, key: str, source: str, stretch: str = WINDOWS) -> Score | None:
        """One score of this flight, None if it was not scored."""
        return self.result.figures.find(stretch, key, source)


# -------------------------------------------------------------------------------------------------
# Modes, faults, failsafes and the nodes' health as stretches of flight time, for every chart.
#
# All of it is read from what was recorded: modes and failsafes from what the outer loop told (or
# the
# one process wrote down), faults from the parameters that were flown and from what the plant told
# of
# faults in flight, health from /diagnostics. Nothing is worked out from the motion.
# -------------------------------------------------------------------------------------------------

MODE, FAULT, FAILSAFE, HEALTH = KINDS = ("mode", "fault", "failsafe", "health")
"""Kinds of bands, in the order in which they are told."""
MODE_ROLES = {
    "standing": "muted", "takeoff": "green", "hover": "nav", "trajectory": "truth",
    "land": "purple", "velocity": "truth", "attitude": "green", "manual": "rival",
}  # fmt: skip
_ROLES = {FAULT: "rival", FAILSAFE: "bad"}
_LEVEL_ROLES = ("good", "warn", "bad", "muted")
_PLANT, _FACT_FAULTS = "plant", "faults_in_flight"
_ACTS = "fault: "  # how the plant says that a fault acts, which has a band of its own
_WORDS = re.compile(
    r"(?P<name>.+?) from (?P<start>[\d.e+-]+)(?: to (?P<end>[\d.e+-]+) s| s on)"
    r"(?:, cleared at (?P<cleared>[\d.e+-]+) s)?"
)
_MOST_HEALTH, _MOST_TIMES = 60, 4
_MOMENT_S = 0.005
_START_UP_S = 1.0
"""What is over by then is the start of nodes that wait for each other; the timeline has it."""


def bands_of(
    record: FlightRecord,
    settings: Settings,
    remarks: Iterable[Remark] = (),
    events: Iterable[DiagnosticEvent] = (),
) -> list[Band]:
    """The bands of a flight, kind by kind, each in the order of its beginnings.

    Parameters
    ----------
    record : FlightRecord
        What was told of modes and failsafes.
    settings : Settings
        With the faults that were to be flown.
    remarks : iterable of Remark
        What nodes told; of it the faults that were given in flight.
    events : iterable of DiagnosticEvent
        Changes of the nodes' health.
    """
    if not len(record):
        return []
    end_s = float(record.time_s[-1])
    bands = [
        *_modes(record),
        *_faults(settings, remarks, end_s),
        *_failsafes(record),
        *_health(list(events), end_s),
    ]
    inside = (
        replace(band, start_s=max(0.0, band.start_s), end_s=min(band.end_s, end_s))
        for band in bands
        if band.start_s < end_s and band.end_s >= 0.0
    )
    return sorted(inside, key=lambda band: (KINDS.index(band.kind), band.start_s))


def bands_beside(flights: Mapping[str, Sequence[Band]]) -> list[Band]:
    """Bands of flights laid over each other: what all have once, the rest with the flight's name.

    Health is left out; where modes differ they are left out, too: there is one edge for them.
    """
    each = {
        name: [band for band in bands if band.kind != HEALTH] for name, bands in flights.items()
    }
    common = [band for band in next(iter(each.values())) if all(band in b for b in each.values())]
    merged = list(common)
    for name, bands in each.items():
        rest = [band for band in bands if band not in common and band.kind != MODE]
        merged += [replace(band, name=f"{band.name} ({name})") for band in rest]
    modes = {tuple(b for b in bands if b.kind == MODE) for bands in each.values()}
    return [band for band in merged if band.kind != MODE or len(modes) == 1]


def legend(bands: Sequence[Band]) -> list[Band]:
    """One band for each that has the same kind and name; its `detail` says all their times."""
    groups: dict[tuple[str, str, str], list[Band]] = {}
    for band in bands:
        groups.setdefault((band.kind, band.name, band.role), []).append(band)
    keys = []
    for (kind, name, _), group in groups.items():
        times = ", ".join(stretch(band) for band in group[:_MOST_TIMES])
        left = len(group) - _MOST_TIMES
        detail = f"{times}{f' and {left} more' if left > 0 else ''}"
        shown = name if kind in (MODE, HEALTH) else f"{kind}: {name}"
        keys.append(replace(group[0], name=shown, detail=detail))
    return keys


def stretch(band: Band) -> str:
    """When a band is, in words."""
    if band.end_s - band.start_s < _MOMENT_S:
        return f"at {band.start_s:.2f} s"
    return f"{band.start_s:.2f} to {band.end_s:.2f} s"


def runs(time_s: np.ndarray, names: np.ndarray) -> Iterator[tuple[float, float, str]]:
    """Start and end, s, and name of each stretch over which (N,) names stay the same.

    A stretch ends where the next one begins.
    """
    first = np.concatenate([[0], np.nonzero(names[1:] != names[:-1])[0] + 1])
    ends = [*first[1:].tolist(), len(names) - 1]
    for begin, end in zip(first.tolist(), ends, strict=True):
        yield float(time_s[begin]), float(time_s[end]), str(names[begin])


def _modes(record: FlightRecord) -> Iterator[Band]:
    """Modes, where there was more than one."""
    if record.mode is None or np.unique(record.mode).size < 2:
        return
    for start_s, end_s, name in runs(record.time_s, record.mode):
        yield Band(start_s, end_s, MODE, name, MODE_ROLES.get(name, "muted"), "told by outer_loop")


def _failsafes(record: FlightRecord) -> Iterator[Band]:
    if record.failsafe is None:
        return
    for start_s, end_s, name in runs(record.time_s, record.failsafe):
        if name != Action.NONE.name:
            known = name in Action.__members__
            detail = Action[name].words if known else "told by outer_loop"
            yield Band(start_s, end_s, FAILSAFE, name, _ROLES[FAILSAFE], detail)


def _faults(settings: Settings, remarks: Iterable[Remark], end_s: float) -> list[Band]:
    """Faults that were ordered, and those given or taken back in flight."""
    ordered = [
        Band(fault.start_s, fault.end_s, FAULT, _without_times(fault.words), _ROLES[FAULT],
             "ordered by the flight's parameters", fault.what)
        for fault in flown_faults(settings)
    ]  # fmt: skip
    for name, start_s, stop_s, cleared_s in given_in_flight(remarks):
        detail, what = "given in flight, told by plant", name.partition(" ")[0]
        band = Band(start_s, stop_s, FAULT, name, _ROLES[FAULT], detail, what)
        same = [i for i, old in enumerate(ordered) if (old.name, old.start_s) == (name, start_s)]
        if cleared_s is not None:
            band = replace(band, end_s=cleared_s, detail=f"taken back at {cleared_s:g} s")
        if same:
            ordered[same[0]] = replace(ordered[same[0]], end_s=band.end_s, detail=band.detail)
        else:
            ordered.append(band)
    return [replace(band, end_s=min(band.end_s, end_s)) for band in ordered]


def _without_times(words: str) -> str:
    """A fault's words without when it acts: that stands beside them."""
    return re.sub(r" (?:from .*|at [\d.e+-]+ s)$", "", words)


def given_in_flight(
    remarks: Iterable[Remark],
) -> list[tuple[str, float, float, float | None]]:
    """Name, start, end (inf: none), when taken back (None: not) of faults that the plant told of.

    `heli_dynamics_sim.faults` writes the words; what is not such words is left out.
    """
    reports = [
        r.facts[_FACT_FAULTS] for r in remarks if r.node == _PLANT and _FACT_FAULTS in r.facts
    ]
    faults = []
    for line in reports[-1].split("; ") if reports else ():
        match = _WORDS.fullmatch(line)
        if match is None:
            continue
        try:
            times = [None if match[key] is None else float(match[key]) for key in _TIMES]
        except ValueError:
            continue
        start_s, stop_s, cleared_s = times
        faults.append((match["name"], start_s or 0.0, stop_s or np.inf, cleared_s))
    return faults


_TIMES = ("start", "end", "cleared")


def _health(events: Sequence[DiagnosticEvent], end_s: float) -> Iterator[Band]:
    """What nodes complained of."""
    shown = 0
    for node in dict.fromkeys(event.node for event in events):
        node_events = [event for event in events if event.node == node]
        after = [*(event.time_s for event in node_events[1:]), end_s]
        for event, until in zip(node_events, after, strict=True):
            started = event.time_s < _START_UP_S and until < _START_UP_S
            has_band = node == _PLANT and event.message.startswith(_ACTS)
            if event.level == 0 or started or has_band or shown >= _MOST_HEALTH:
                continue
            shown += 1
            level = min(event.level, len(LEVELS) - 1)
            name = f"{node} {LEVELS[level]}"
            yield Band(event.time_s, until, HEALTH, name, _LEVEL_ROLES[level], event.message)
