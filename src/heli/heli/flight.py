# SPDX-License-Identifier: Apache-2.0
"""A flight that has been flown: its signals, its metrics, its pictures."""

from __future__ import annotations

import os
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from heli.metrics import Metrics
from heli.signals import Signals, groups_of
from heli_flight.loop.flight_file import NAME, sections, write_parameters
from heli_flight.loop.laws import own_words
from heli_flight.loop.record_file import write_record
from heli_flight.loop.result import verdict, write_result
from heli_flight.loop.scoring import DECIDES
from heli_flight.report.from_bag import Recorded

if TYPE_CHECKING:
    import pyarrow
    from matplotlib.figure import Figure

    from heli_live_view.page_server import PageServer

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


class Flight:
    """A flight: what `heli.fly` and `heli.load` give.

    Attributes
    ----------
    time_s : (N,) ndarray
        Flight time at each tick.
    truth, nav : Signals
        How the aircraft really moved, and what it knew of itself on board: `truth.phi_rad`,
        `truth.pos_ned_m`, `nav.vel_ned_mps` ... (print a group: all its names and units).
    reference, setpoint, u, wind : Signals
        Where it should be; the commanded attitude; the actuators (`u.delta_lat` ...); the air.
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

    def __init__(self, flown: Recorded, folder: Path | None = None) -> None:
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
        """As of `heli hover`: 0 inside the paper's figures, 1 outside, or lost."""
        return self._flown.result.exit_code(self.settings.gps)

    @property
    def verdict(self) -> str:
        """One sentence: inside the paper's figures in the scored windows, or what is not."""
        forged = self._flown.result.forged
        return self.lost or forged or verdict(self._flown.result, self.settings, DECIDES)

    def __len__(self) -> int:
        return int(self.time_s.size)

    def _title(self) -> str:
        s = self.settings
        law = own_words(s) or s.nodes["inner_loop"]["controller"]
        return (
            f"Flight: {s.scenario_name}, {s.gps} GPS, world {Path(s.world).stem}, laws "
            f"{Path(s.laws).stem}, {law}, seed {s.seed}; {self._flown.how}"
        )

    def _length(self) -> str:
        n, end = len(self), float(self.time_s[-1]) if len(self) else 0.0
        where = f"; in {self.folder}" if self.folder else ""
        return f"{n} ticks, to {end:.2f} s{where}"

    def __repr__(self) -> str:
        parts = [self._title(), self._length()]
        parts += [f"LOST: {self.lost}"] if self.lost else []
        parts += [repr(self.metrics), *(f"note: {note}" for note in self.notes)]
        return "\n".join(parts)

    def _repr_html_(self) -> str:
        lost = f"<p><b>LOST: {escape(self.lost)}</b></p>" if self.lost else ""
        notes = "".join(f"<p>note: {escape(note)}</p>" for note in self.notes)
        head = f"<p><b>{escape(self._title())}</b><br>{escape(self._length())}</p>"
        return head + lost + self.metrics._repr_html_() + notes

    # --- elsewhere -------------------------------------------------------------------------------

    def columns(self) -> dict[str, NDArray]:
        """Every signal of one number per tick by `group_name`, `time_s` first."""
        found: dict[str, NDArray] = {"time_s": self.time_s}
        for group in (self.truth, self.nav, self.reference, self.setpoint, self.u, self.wind):
            found |= group.columns()
        return found if self.mode is None else found | {"mode": self.mode}

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

    def plot(self) -> Figure:
        """Altitude, track, attitude and actuators in one figure of matplotlib."""
        from heli.picture import draw

        return draw(self, self._title())

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
        from heli_flight.studies.flight import free_name
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
        from heli_flight.studies.replay.opened import replay_of
        from heli_flight.studies.replay.serving import server_of

        shown, beside = replay_of(self.save())
        server = server_of(shown, port, beside, ("", "port"))
        server.start()
        return server

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
        """
        from heli_flight.report import write_report

        path = self.save() if folder is None else Path(folder)
        path.mkdir(parents=True, exist_ok=True)
        f = self._flown
        return write_report(
            f.record, f.settings, f.result, path, f.how, f.events, f.missing, f.assumed, figures
        )
