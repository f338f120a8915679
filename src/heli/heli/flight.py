# SPDX-License-Identifier: Apache-2.0
"""A flight that has been flown: its signals, its metrics, its pictures."""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from heli.arguments import in_python, refused
from heli_core.rcl_yaml import ParameterError
from heli_core.rows import NAV, NINE, SHAPED
from heli_flight.flight_file import NAME, sections, write_parameters
from heli_flight.record import write_record
from heli_flight.report.write import RecordedFlight
from heli_flight.result import verdict, write_result
from heli_flight.scoring import DECIDES
from heli_flight.settings import own_words
from heli_flight.terminal import told_when_long

if TYPE_CHECKING:
    import pyarrow
    from matplotlib.figure import Figure

    from heli_flight.record import FlightRecord
    from heli_flight.scoring import Figures
    from heli_live_view.server import PageServer


# -------------------------------------------------------------------------------------------------
# Signals of a flight: arrays with a name, a unit and a meaning, in groups.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Signal:
    """One signal.

    Attributes
    ----------
    values : (N,) or (N, k) ndarray
        One row per tick; cannot be written.
    unit : str
        Empty for none.
    meaning : str
        A few words: frame, sign.
    """

    values: NDArray
    unit: str
    meaning: str


class Signals(Mapping[str, NDArray]):
    """A group of signals: `group.phi_rad`, `group["phi_rad"]`, `group.unit("phi_rad")`.

    Parameters
    ----------
    name : str
        Of the group, as in `flight.truth`.
    signals : mapping of name to Signal
    """

    def __init__(self, name: str, signals: Mapping[str, Signal]) -> None:
        self._name, self._signals = name, dict(signals)
        for signal in self._signals.values():
            signal.values.setflags(write=False)

    def __getitem__(self, name: str) -> NDArray:
        return self._lookup(name, KeyError).values

    def __getattr__(self, name: str) -> NDArray:
        if name.startswith("_"):
            raise AttributeError(name)
        return self._lookup(name, AttributeError).values

    def __iter__(self) -> Iterator[str]:
        return iter(self._signals)

    def __len__(self) -> int:
        return len(self._signals)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._signals]

    def unit(self, name: str) -> str:
        """Unit of a signal, empty for none."""
        return self._lookup(name, KeyError).unit

    def meaning(self, name: str) -> str:
        """What a signal is, in a few words."""
        return self._lookup(name, KeyError).meaning

    def columns(self) -> dict[str, NDArray]:
        """The signals of one number per tick, by `group_name`."""
        signals = self._signals.items()
        return {f"{self._name}_{n}": s.values for n, s in signals if s.values.ndim == 1}

    def _lookup(self, name: str, error: type[Exception]) -> Signal:
        if name in self._signals:
            return self._signals[name]
        near = difflib.get_close_matches(str(name), self._signals, n=1, cutoff=0.4)
        hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(self._signals)}"
        raise error(f"{self._name} has no signal {name!r}; {hint}")

    def _rows(self) -> list[tuple[str, str, str, str]]:
        return [
            (f"{self._name}.{name}", " x ".join(map(str, s.values.shape)), s.unit, s.meaning)
            for name, s in self._signals.items()
        ]

    def __repr__(self) -> str:
        rows = self._rows()
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        return "\n".join(
            "  ".join(cell.ljust(n) for cell, n in zip(row, widths, strict=True)).rstrip()
            for row in rows
        )

    def _repr_html_(self) -> str:
        return html_table(("signal", "shape", "unit", ""), self._rows())


def html_table(head: Sequence[str], rows: Sequence[Sequence[str]], title: str = "") -> str:
    """A table for a notebook; every cell is text."""
    caption = f"<caption>{escape(title)}</caption>" if title else ""
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table>{caption}<thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"


_AXES = ("north", "east", "down")


def _scalar(values: NDArray, unit: str, meaning: str) -> Signal:
    return Signal(np.ascontiguousarray(values), unit, meaning)


def _motion(
    pos: NDArray, vel: NDArray, q: NDArray, rate: NDArray, rotor: NDArray
) -> dict[str, Signal]:
    """What ground truth and navigation share."""
    from heli_core.rotations import euler_angles

    euler = euler_angles(q)
    signals = {
        "pos_ned_m": Signal(pos.view(), "m", "position: north, east, down"),
        "vel_ned_mps": Signal(vel.view(), "m/s", "velocity over the ground: north, east, down"),
        "q_nb": Signal(q.view(), "", "attitude quaternion w, x, y, z, body to NED"),
        "rate_body_radps": Signal(rate.view(), "rad/s", "p, q, r: forward, right, down"),
    }
    for i, axis in enumerate(_AXES):
        signals[f"{axis}_m"] = _scalar(pos[:, i], "m", f"position, {axis}")
    signals["altitude_m"] = _scalar(-pos[:, 2], "m", "position, up")
    for i, axis in enumerate(_AXES):
        signals[f"vel_{axis}_mps"] = _scalar(vel[:, i], "m/s", f"velocity over the ground, {axis}")
    for i, (name, words) in enumerate(
        (("phi", "roll, right side down"), ("theta", "pitch, nose up"), ("psi", "heading"))
    ):
        signals[f"{name}_rad"] = _scalar(euler[:, i], "rad", words)
    for i, name in enumerate(("p", "q", "r")):
        signals[f"{name}_radps"] = _scalar(rate[:, i], "rad/s", f"body rate {name}")
    for i, (name, words) in enumerate(
        (
            ("a_s", "disc tilted backwards"),
            ("b_s", "disc tilted to the right"),
            ("d_int", "integrator of the yaw gyro"),
        )
    ):
        signals[f"{name}_rad"] = _scalar(rotor[:, i], "rad", words)
    return signals


def groups_of(record: FlightRecord) -> dict[str, Signals]:
    """The groups of a `heli_flight` FlightRecord: truth, nav, reference, setpoint, u, wind."""
    r = record
    nav = _motion(r.nav_pos_ned_m, r.nav_vel_ned_mps, r.nav_q_nb, r.nav_rate_body_radps,
                  r.nav_rotor)  # fmt: skip
    sigmas = (
        ("sigma_pos_m", r.nav_sigma_pos_m, "m", "standard deviation of the position, NED"),
        ("sigma_vel_mps", r.nav_sigma_vel_mps, "m/s", "standard deviation of the velocity, NED"),
        ("sigma_att_rad", r.nav_sigma_att_rad, "rad", "of the attitude, about north, east, down"),
    )
    nav |= {n: Signal(a.view(), unit, words) for n, a, unit, words in sigmas if a is not None}
    truth = _motion(r.truth_pos_ned_m, r.truth_vel_ned_mps, r.truth_q_nb,
                    r.truth_rate_body_radps, r.truth_rotor)  # fmt: skip
    return {
        "truth": Signals("truth", truth),
        "nav": Signals("nav", nav),
        "reference": Signals("reference", _reference(r.reference)),
        "setpoint": Signals("setpoint", _setpoint(r.setpoint)),
        "u": Signals("u", _actuators(r.u)),
        "wind": Signals("wind", _wind(r.wind_ned_mps)),
    }


def _reference(rows: NDArray) -> dict[str, Signal]:
    from heli_core.rows import REFERENCE

    pos, vel = rows[:, REFERENCE.pos], rows[:, REFERENCE.vel]
    signals = {
        "pos_ned_m": Signal(pos.view(), "m", "where it should be: north, east, down"),
        "vel_ned_mps": Signal(vel.view(), "m/s", "how it should move: north, east, down"),
    }
    for i, axis in enumerate(_AXES):
        signals[f"{axis}_m"] = _scalar(pos[:, i], "m", f"position, {axis}")
    signals["altitude_m"] = _scalar(-pos[:, 2], "m", "position, up")
    return signals | {"psi_rad": _scalar(rows[:, REFERENCE.psi], "rad", "heading")}


def _setpoint(rows: NDArray) -> dict[str, Signal]:
    words = ("commanded roll", "commanded pitch", "commanded heading")
    names = ("phi_rad", "theta_rad", "psi_rad")
    pairs = enumerate(zip(names, words, strict=True))
    return {name: _scalar(rows[:, i], "rad", meaning) for i, (name, meaning) in pairs}


def _actuators(rows: NDArray) -> dict[str, Signal]:
    words = {
        "delta_lat": "lateral cyclic, -1 to 1",
        "delta_lon": "longitudinal cyclic, -1 to 1",
        "delta_ped": "pedal, -1 to 1",
        "delta_col": "collective, -1 to 1",
    }
    return {
        name: _scalar(rows[:, i], "", meaning) for i, (name, meaning) in enumerate(words.items())
    }


def _wind(rows: NDArray) -> dict[str, Signal]:
    signals = {"ned_mps": Signal(rows.view(), "m/s", "velocity of the air: north, east, down")}
    for i, axis in enumerate(_AXES):
        signals[f"{axis}_mps"] = _scalar(rows[:, i], "m/s", f"velocity of the air, {axis}")
    return signals


# -------------------------------------------------------------------------------------------------
# What a flight is measured by: value, unit, and the paper's figure beside it.
# -------------------------------------------------------------------------------------------------

WINDOWS, WHOLE = "windows", "whole"
NAVIGATION = "navigation"


@dataclass(frozen=True)
class Metric:
    """One metric of a flight.

    Attributes
    ----------
    name, label : str
        Its key, such as `altitude`, and in words.
    value, rms : float
        Largest magnitude and rms, in `unit`: of no sign, so that neither up nor down matters.
    unit : str
    paper : float
        Its bound: the largest that the paper shows; of a path, a goal; of a mission of one's own
        `score.bounds`, or infinite.
    inside : bool
        Whether the value is inside it.
    source : str
        Measured from: `navigation`, `truth`, `truth_less_drift`.
    stretch : str
        Over: `windows` (the scored ones), `whole` (the flight).
    """

    name: str
    label: str
    value: float
    rms: float
    unit: str
    paper: float
    inside: bool
    source: str
    stretch: str

    def __str__(self) -> str:
        if not math.isfinite(self.paper):
            return f"{self.value:.3g} {self.unit}"
        word = "inside" if self.inside else "outside"
        return f"{self.value:.3g} {self.unit}, {word} {self.paper:g} {self.unit}"

    @property
    def _judged(self) -> tuple[str, str]:
        """The bound and the word for it."""
        if not math.isfinite(self.paper):
            return "-", "-"
        return f"{self.paper:g} {self.unit}", "inside" if self.inside else "OUTSIDE"


def unknown_metric(name: Any, known: Iterable[str]) -> str:
    """What is said where no metric has a name."""
    names = list(known)
    near = difflib.get_close_matches(str(name), names, n=1, cutoff=0.4)
    meant = f"did you mean {near[0]}? " if near else ""
    all_names = ", ".join(names) or "none: the flight ended before what is scored"
    return f"no metric {name!r}; {meant}known: {all_names}"


_Named = TypeVar("_Named")


class MetricsByName(Mapping[str, _Named]):
    """`metrics["altitude"]` and `metrics.altitude`; another name is answered by those there are."""

    _by_name: Mapping[str, _Named]

    def __getitem__(self, name: str) -> _Named:
        if name not in self._by_name:
            raise KeyError(unknown_metric(name, self._by_name))
        return self._by_name[name]

    def __getattr__(self, name: str) -> _Named:
        if name.startswith("_"):
            raise AttributeError(name)
        if name not in self._by_name:
            raise AttributeError(unknown_metric(name, self._by_name))
        return self._by_name[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._by_name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._by_name)

    def __len__(self) -> int:
        return len(self._by_name)


class Metrics(MetricsByName[Metric]):
    """Metrics by name: `metrics["altitude"]`, `metrics.altitude`; others by `of`.

    From the state estimate over the scored windows.

    Parameters
    ----------
    figures : Figures
    source, stretch : str
        Which of them this mapping shows.
    """

    def __init__(self, figures: Figures, source: str = NAVIGATION, stretch: str = WINDOWS) -> None:
        self._figures, self.source, self.stretch = figures, source, stretch
        self._by_name = {
            s.metric.key: Metric(
                s.metric.key, s.metric.label, float(s.max), float(s.rms), s.metric.unit,
                s.metric.paper, s.inside, s.source, s.stretch,
            )
            for s in figures.of(stretch)
            if s.source == source
        }  # fmt: skip

    def of(self, source: str = NAVIGATION, stretch: str = WINDOWS) -> Metrics:
        """The same flight measured from another record, or over another stretch.

        Parameters
        ----------
        source : {"navigation", "truth", "truth_less_drift"}
        stretch : {"windows", "whole"}

        Raises
        ------
        ParameterError
        """
        from heli_flight.scoring import SOURCE_NAMES, STRETCHES

        for what, name, known in (
            ("source", source, SOURCE_NAMES),
            ("stretch", stretch, STRETCHES),
        ):
            if name not in tuple(known):
                raise refused(what, name, ", ".join(known))
        return Metrics(self._figures, source, stretch)

    def rows(self) -> list[tuple[str, ...]]:
        """Each metric as text: name, label, value, rms, bound, verdict."""
        return [
            (
                m.name, m.label, f"{m.value:.3f} {m.unit}", f"{m.rms:.3f} {m.unit}",
                *m._judged,
            )
            for m in self.values()
        ]  # fmt: skip

    @property
    def _title(self) -> str:
        stretch = "scored windows" if self.stretch == WINDOWS else "whole flight"
        return f"largest magnitude, {self.source.replace('_', ' ')}, {stretch}"

    def __repr__(self) -> str:
        rows = [("metric", "", "value", "rms", "bound", ""), *self.rows()]
        if len(rows) == 1:
            return f"{self._title}: nothing was scored"
        widths = [max(len(row[i]) for row in rows) for i in range(6)]
        lines = (
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        )
        return "\n".join([self._title, *lines])

    def _repr_html_(self) -> str:
        head = ("metric", "", "value", "rms", "bound", "")
        return html_table(head, self.rows(), self._title)


# -------------------------------------------------------------------------------------------------
# Tables elsewhere.
# -------------------------------------------------------------------------------------------------

_NO_PANDAS = (
    "pandas is not installed here: pip install pandas brings it; to_arrow() gives the same table "
    "without it"
)


def as_dataframe(table: pyarrow.Table) -> Any:
    """A table of pyarrow as a DataFrame of pandas; ImportError says how to get that."""
    try:
        return table.to_pandas()
    except ImportError:
        raise ImportError(_NO_PANDAS) from None


def write_table(table: pyarrow.Table, path: str | os.PathLike[str]) -> Path:
    """Write a table of pyarrow as its file's name ends: .csv or .parquet.

    Raises
    ------
    ParameterError
        It ends otherwise, or cannot be written.
    """
    from pyarrow import csv, parquet

    target = Path(path)
    writers = {".csv": csv.write_csv, ".parquet": parquet.write_table}
    if target.suffix not in writers:
        raise refused("path", str(target), "a name in .csv or .parquet")
    try:
        writers[target.suffix](table, os.fspath(target))
    except OSError as error:
        raise ParameterError(
            f"path {target}: cannot be written: {os.strerror(error.errno or 0)}"
        ) from None
    return target


# -------------------------------------------------------------------------------------------------
# Flight.
# -------------------------------------------------------------------------------------------------


class Flight:
    """A flight: what `heli.fly` and `heli.load` give.

    Attributes
    ----------
    time_s : (N,) ndarray
        Flight time at each tick.
    truth, nav : Signals
        How the aircraft really moved, and what it knew of itself on board: `truth.phi_rad`,
        `truth.pos_ned_m`, `nav.vel_ned_mps` ... (print a group: all its names and units). A name
        in `ned` or `down` has z **down**, `altitude_m` is **up**.
    reference, setpoint, u, wind : Signals
        Where it should be (as `truth`); the commanded attitude; the actuators (`u.delta_lat` ...);
        the air's velocity: north, east, **down**.
    mode : (N,) ndarray of str, or None
        Mode that was flown; None where it only followed its reference.
    metrics : Metrics
        By name: value, unit, the paper's figure, whether it is inside.
    lost : str
        Why the aircraft was lost, one sentence; empty if it was not.
    parameters : mapping of node to mapping of parameter to value
        All that was flown with.
    settings : heli_flight.Settings
        The same as the stack has them.
    folder : Path or None
        Where it lies, if it lies anywhere.
    """

    truth: Signals
    nav: Signals
    reference: Signals
    setpoint: Signals
    u: Signals
    wind: Signals

    def __init__(self, flown: RecordedFlight, folder: Path | None = None) -> None:
        self._flown, self.folder = flown, folder
        self.time_s: NDArray[np.float64] = flown.record.time_s.view()
        self.time_s.setflags(write=False)
        self.mode = flown.record.mode
        for name, group in groups_of(flown.record).items():
            setattr(self, name, group)
        self.metrics = Metrics(flown.result.figures)

    # --- what it was -----------------------------------------------------------------------------

    @property
    def settings(self) -> Any:
        """Resolved parameters, as `heli_flight.resolve` gives them."""
        return self._flown.settings

    @property
    def parameters(self) -> Mapping[str, Mapping[str, Any]]:
        """Parameters by node, and of the sections scenario, world, recorder."""
        return sections(self.settings)

    @property
    def seed(self) -> int:
        """Seed of wind, sensors, and what the world draws of the aircraft."""
        return int(self.settings.seed)

    @property
    def lost(self) -> str:
        """Why the aircraft was lost; empty if it was not."""
        return self._flown.result.lost

    @property
    def notes(self) -> list[str]:
        """What to know of it: what nodes complained of, what is not in the record."""
        return [*self._flown.result.notes, *self._flown.missing]

    @property
    def exit_code(self) -> int:
        """As of `heli hover`: 0 inside the paper's figures, 1 outside, lost, or partial."""
        return self._flown.result.exit_code(self.settings.gps)

    @property
    def verdict(self) -> str:
        """One sentence: inside the paper's figures in the scored windows, or what is not."""
        forged = self._flown.result.forged
        return (
            self.lost
            or forged
            or self.partial
            or verdict(self._flown.result, self.settings, DECIDES)
        )

    @property
    def coverage(self) -> float:
        """Share of what is judged that was recorded, 0 to 1."""
        return self._flown.result.coverage(self.settings.gps).share

    @property
    def partial(self) -> str:
        """Why only a part of the flight can be judged, one sentence; empty if all can."""
        return self._flown.result.partial(self.settings.gps)

    def __len__(self) -> int:
        return int(self.time_s.size)

    def _title(self) -> str:
        s = self.settings
        law = own_words(s) or s.nodes["inner_loop"]["controller"]
        return (
            f"Flight: {s.scenario_name}, {s.gps} GPS, world {Path(s.world).stem}, control preset "
            f"{Path(s.laws).stem}, {law}, seed {s.seed}; {self._flown.how}"
        )

    def _length(self) -> str:
        n, end = len(self), float(self.time_s[-1]) if len(self) else 0.0
        where = f"; in {self.folder}" if self.folder else ""
        return f"{n} ticks, to {end:.2f} s{where}"

    def __repr__(self) -> str:
        parts = [self._title(), self._length()]
        parts += [f"LOST: {self.lost}"] if self.lost else []
        parts += [f"PARTIAL: {self.partial}"] if self.partial else []
        parts += [repr(self.metrics), *(f"note: {note}" for note in self.notes)]
        return "\n".join(parts)

    def _repr_html_(self) -> str:
        lost = f"<p><b>LOST: {escape(self.lost)}</b></p>" if self.lost else ""
        lost += f"<p><b>PARTIAL: {escape(self.partial)}</b></p>" if self.partial else ""
        notes = "".join(f"<p>note: {escape(note)}</p>" for note in self.notes)
        head = f"<p><b>{escape(self._title())}</b><br>{escape(self._length())}</p>"
        return head + lost + self.metrics._repr_html_() + notes

    # --- elsewhere -------------------------------------------------------------------------------

    def columns(self) -> dict[str, NDArray]:
        """Every signal of one number per tick by `group_name`, `time_s` first."""
        columns: dict[str, NDArray] = {"time_s": self.time_s}
        for group in (self.truth, self.nav, self.reference, self.setpoint, self.u, self.wind):
            columns |= group.columns()
        return columns if self.mode is None else columns | {"mode": self.mode}

    def to_arrow(self) -> pyarrow.Table:
        """The signals as a table of pyarrow, one row per tick."""
        import pyarrow

        return pyarrow.table(self.columns())

    def to_dataframe(self) -> Any:
        """The signals as a DataFrame of pandas, one row per tick.

        Raises
        ------
        ImportError
            There is no pandas; the sentence says how to get it.
        """
        return as_dataframe(self.to_arrow())

    @in_python
    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the signals into a file, one row per tick: .csv or .parquet.

        Raises
        ------
        ParameterError
            The name ends otherwise, or it cannot be written.
        """
        return write_table(self.to_arrow(), path)

    def plot(self) -> Figure:
        """Altitude, track, attitude and actuators in one figure of matplotlib."""

        return draw(self, self._title())

    @in_python
    def save(self, folder: str | os.PathLike[str] | None = None) -> Path:
        """Write the flight into a folder: parameters, result, record; `heli.load` reads it.

        Parameters
        ----------
        folder : path, optional
            Must not exist; default: the folder that it lies in, or a new one under `flights/`.

        Returns
        -------
        Path

        Raises
        ------
        ParameterError
            The folder exists, or cannot be written.
        """
        from heli_flight.fly import free_name
        from heli_flight.terminal import being_filled

        if folder is None and self.folder is not None:
            return self.folder
        path = free_name(self.settings) if folder is None else Path(folder)
        with being_filled(path):
            write_parameters(self.settings, path / NAME)
            write_result(self._flown.result, self.settings, path, {"mode": self.settings.mode})
            write_record(self._flown.record, path)
        if self.folder is None:
            self.folder = path
        return path

    @in_python
    def replay(self, port: int = 0) -> PageServer:
        """Serve the flight's replay to browsers of this machine, as `heli replay` does.

        Parameters
        ----------
        port : int
            0: any free one.

        Returns
        -------
        PageServer
            Serves until the program ends or `stop()`; its `url` is where the page is. The flight is
            saved first if it lies nowhere.

        Raises
        ------
        PortError
            The port is in use; one line.
        """
        from heli_flight.replay import replay_of, server_of

        shown, beside = replay_of(self.save())
        server = server_of(shown, port, beside, ("", "port"))
        server.start()
        return server

    @in_python
    def report(self, folder: str | os.PathLike[str] | None = None, figures: bool = False) -> Path:
        """Write the HTML report, the same as the commands'.

        Parameters
        ----------
        folder : path, optional
            Made if it is missing; default: the flight's, which is saved first if it lies nowhere.
        figures : bool
            Whether to write each chart as PNG and SVG, too.

        Returns
        -------
        Path
            The page.

        Raises
        ------
        ParameterError
            The folder cannot be made.
        """
        from heli_flight.report.write import write_report

        path = self.save() if folder is None else Path(folder)
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError:
            raise refused("folder", str(path), "a folder that can be written") from None
        f = self._flown
        with told_when_long("flight.report") as tell:
            tell("page")
            return write_report(
                f.record, f.settings, f.result, path, f.how, f.events, f.missing, f.assumed,
                figures, drawn=lambda done, total: tell(f"figures, {done} of {total}"),
            )  # fmt: skip


# -------------------------------------------------------------------------------------------------
# A flight in one figure.
# -------------------------------------------------------------------------------------------------

_TIME = "time (s)"
# Okabe and Ito: told apart by the colour-blind.
_BLUE, _ORANGE, _GREEN, _RED = "#0072B2", "#E69F00", "#009E73", "#D55E00"


def draw(flight: Flight, title: str) -> Figure:
    """Altitude, track, attitude, actuators; the figure is shown by who has it."""
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(10.0, 7.0), layout="constrained")
    # A notebook would show it a second time at the end of the cell.
    plt.close(figure)
    figure.suptitle(title, fontsize=9, wrap=True)
    _altitude(axes[0, 0], flight)
    _track(axes[0, 1], flight)
    _attitude(axes[1, 0], flight)
    _picture_actuators(axes[1, 1], flight)
    for axis in axes.flat:
        axis.grid(True, color="#dddddd", linewidth=0.5)
        axis.legend(fontsize=8)
    return figure


def _sources(flight: Flight) -> list[tuple[Signals, str, str, str]]:
    """What is drawn of a place: signals, name, style and colour, as in report and live view."""
    from heli_flight.report.data import PALETTE

    styles = (("truth", "-"), ("nav", ":"), ("reference", "--"))
    return [
        (getattr(flight, name), {"nav": "navigation"}.get(name, name), style, PALETTE[name][0])
        for name, style in styles
    ]


def _altitude(axis: Any, flight: Flight) -> None:
    for group, label, style, color in _sources(flight):
        axis.plot(flight.time_s, group.altitude_m, style, color=color, label=label)
    axis.set(xlabel=_TIME, ylabel="altitude (m)", title="Altitude")


def _track(axis: Any, flight: Flight) -> None:
    for group, label, style, color in _sources(flight):
        axis.plot(group.east_m, group.north_m, style, color=color, label=label)
    axis.set(xlabel="east (m)", ylabel="north (m)", title="Track")
    axis.set_aspect("equal", adjustable="datalim")


def _attitude(axis: Any, flight: Flight) -> None:
    angles = (("phi", "roll", _BLUE), ("theta", "pitch", _ORANGE), ("psi", "heading", _GREEN))
    for name, words, color in angles:
        truth, wanted = (
            np.degrees(np.unwrap(group[f"{name}_rad"])) for group in (flight.truth, flight.setpoint)
        )
        axis.plot(flight.time_s, truth, color=color, label=words)
        axis.plot(flight.time_s, wanted, "--", color=color, linewidth=0.8)
    axis.set(xlabel=_TIME, ylabel="angle (deg)", title="Attitude (dashed: commanded)")


def _picture_actuators(axis: Any, flight: Flight) -> None:
    for name, color in zip(flight.u, (_BLUE, _ORANGE, _GREEN, _RED), strict=True):
        axis.plot(flight.time_s, flight.u[name], color=color, label=name)
    axis.set(xlabel=_TIME, ylabel="actuator (-1 to 1)", title="Actuators")


# -------------------------------------------------------------------------------------------------
# Places of what a controller reads: `x[NINE.phi]`, `x[NAV.pos]`, `r[SHAPED.vel]`.
# -------------------------------------------------------------------------------------------------

__all__ = ["NAV", "NINE", "SHAPED"]
