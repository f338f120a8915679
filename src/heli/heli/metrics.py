# SPDX-License-Identifier: Apache-2.0
"""What a flight is measured by: value, unit, and the paper's figure beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from heli.signals import html_table

if TYPE_CHECKING:
    from heli_flight.loop.scoring import Figures

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
        Largest magnitude and rms, in `unit`.
    unit : str
    paper : float
        The largest that the paper shows; of a path, a goal.
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
        word = "inside" if self.inside else "outside"
        return f"{self.value:.3g} {self.unit}, {word} {self.paper:g} {self.unit}"


class Metrics(Mapping[str, Metric]):
    """Metrics by name, from the navigation record over the scored windows; others by `of`.

    Parameters
    ----------
    figures : Figures
    source, stretch : str
        Which of them this mapping shows.
    """

    def __init__(self, figures: Figures, source: str = NAVIGATION, stretch: str = WINDOWS) -> None:
        self._figures, self.source, self.stretch = figures, source, stretch
        self._found = {
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
        from heli_flight.loop.scoring import SOURCE_NAMES, STRETCHES
        from heli_parameters.parameters import ParameterError

        for what, given, known in (
            ("source", source, SOURCE_NAMES),
            ("stretch", stretch, STRETCHES),
        ):
            if given not in known:
                raise ParameterError(
                    f"{what} {given!r} is not allowed; allowed: {', '.join(known)}"
                )
        return Metrics(self._figures, source, stretch)

    def __getitem__(self, name: str) -> Metric:
        if name not in self._found:
            known = ", ".join(self._found) or "none: the flight ended before what is scored"
            raise KeyError(f"no metric {name!r}; known: {known}")
        return self._found[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)

    def rows(self) -> list[tuple[str, ...]]:
        """Each metric as text: name, label, value, rms, paper, verdict."""
        return [
            (
                m.name, m.label, f"{m.value:.3f} {m.unit}", f"{m.rms:.3f} {m.unit}",
                f"{m.paper:g} {m.unit}", "inside" if m.inside else "OUTSIDE",
            )
            for m in self.values()
        ]  # fmt: skip

    @property
    def _title(self) -> str:
        stretch = "scored windows" if self.stretch == WINDOWS else "whole flight"
        return f"largest magnitude, {self.source.replace('_', ' ')}, {stretch}"

    def __repr__(self) -> str:
        rows = [("metric", "", "value", "rms", "paper", ""), *self.rows()]
        if len(rows) == 1:
            return f"{self._title}: nothing was scored"
        widths = [max(len(row[i]) for row in rows) for i in range(6)]
        lines = (
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        )
        return "\n".join([self._title, *lines])

    def _repr_html_(self) -> str:
        head = ("metric", "", "value", "rms", "paper", "")
        return html_table(head, self.rows(), self._title)
