# SPDX-License-Identifier: Apache-2.0
"""report.html and figures of an identification, with the flight report's look."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup

from heli_flight.report.chart import Chart
from heli_flight.report.figures import write_figures
from heli_flight.report.page import Head, filled
from heli_flight.report.tables import Table
from heli_flight.report.words import scope
from heli_flight.studies.identify.charts import charts, lines_of
from heli_flight.studies.identify.command import Outcome
from heli_flight.studies.identify.compare import Row, misses

PAGE, FIGURES = "report.html", "figures"
_TITLES = {
    "result": "Identified numbers",
    "actuators": "Responses to the actuators",
    "gusts": "Responses to the gusts",
    "residuals": "Residuals",
    "experiments": "The experiments",
    "ground": "Measured on the ground",
    "scope": "What is not simulated",
}
_GROUPS = {
    "A": "A, eq. (10)", "B": "B, eq. (10)", "E": "E, eq. (10)", "": "Servos, delay, trim, thrust",
    "norm": "Norm wind to h of the closed loop",
}  # fmt: skip
_DEFINITION = (
    "An entry is significant if its effect, |true entry| times the rms (over the excited lines) of "
    "the state or input that it multiplies, is above 1 % of the largest such effect in its row; "
    "grey rows are not. The truth is the linearised aircraft file: for comparison only, no number "
    "of it is used. E(r,w) is that of rising air (the power of climb makes a kink at w = 0)."
)


def write_page(outcome: Outcome, folder: Path) -> Path:
    """Write report.html and figures/ into a folder; returns the page.

    Raises
    ------
    OSError
        The folder cannot be written.
    """
    drawn = charts(outcome.found, outcome.truth)
    page = folder / PAGE
    page.write_text(render(outcome, drawn), encoding="utf-8")
    write_figures(drawn, _conditions(outcome), folder / FIGURES)
    return page


def render(outcome: Outcome, drawn: Sequence[Chart]) -> str:
    """The page as text."""
    head = Head(
        kind="Identification report · simulation",
        title="Identification of the hover model",
        heading="Identification of the hover model",
        verdicts=[_verdict(outcome)],
        facts=_facts(outcome),
        links=_TITLES,
    )
    groups = {title: _group(outcome, group) for group, title in _GROUPS.items()}
    return filled(
        "identification.html",
        head,
        drawn,
        definition=_DEFINITION,
        groups={title: table for title, table in groups.items() if table.rows},
        zeros=outcome.zeros,
        ground=_ground(outcome),
        not_simulated=scope(outcome.settings.nodes["plant"])["Not simulated"],
    )


def _verdict(outcome: Outcome) -> tuple[str, str, str]:
    judged = [row for row in outcome.rows if row.met is not None]
    missed = misses(outcome.rows)
    if outcome.truth is None:
        return "–", "", "No aircraft file to compare with: see the standard deviations."
    if missed:
        names = ", ".join(row.name for row in missed)
        return (
            "✗",
            "bad",
            (
                f"{len(judged) - len(missed)} of {len(judged)} significant numbers meet their "
                f"target (A, B, servos, norms 5 %, E 10 %); missed: {names}."
            ),
        )
    return (
        "✓",
        "good",
        (
            f"All {len(judged)} significant numbers meet their target: A, B, servos and norms "
            "within 5 % of the linearised truth, E within 10 %."
        ),
    )


def _facts(outcome: Outcome) -> list[tuple[str, str]]:
    found, settings = outcome.found, outcome.settings
    given = found.given
    return [
        ("Experiments", f"2, {given.periods} periods of {given.period_s:g} s each"),
        ("Lines", f"{lines_of(found.actuators)}; {lines_of(found.gusts)}"),
        ("Compared with", outcome.truth.basis.source if outcome.truth else "nothing"),
        ("GPS", settings.gps),
        ("Seed", str(settings.seed)),
        ("gamma", f"{found.design.attitude.gamma:.4g}"),
    ]


def _conditions(outcome: Outcome) -> str:
    given = outcome.found.given
    return (
        f"Simulated flight: turbulence of MIL-F-8785C and sensor noise on; {given.periods} periods "
        f"of {given.period_s:g} s; seed {outcome.settings.seed}"
    )


def _number(value: float, digits: int = 5) -> str:
    return "–" if np.isnan(value) else f"{value:.{digits}g}".replace("-", "−")


def _cells(row: Row, known: bool) -> list[str]:
    marks = {True: "✓", False: "✗", None: ""}
    dull = row.met is None and not row.significant
    name = Markup('<span class="dull">{}</span>').format(row.name) if dull else row.name
    spread = _number(2.0 * row.sigma, 2) if row.sigma > 0.0 else "–"
    cells = [name, _number(row.value), spread]
    if known:
        cells += [_number(row.truth), row.deviation_text.replace("-", "−") or "–"]
    share = "" if np.isnan(row.share) else f"{100.0 * row.share:.3g} %"
    return [*cells, share, *([marks[row.met]] if known else [])]


def _group(outcome: Outcome, group: str) -> Table:
    """The identified numbers of one group."""
    known = outcome.truth is not None
    head = ["", "identified", "± 2σ", *(["truth", "deviation"] if known else []), "effect in row"]
    rows = [_cells(row, known) for row in outcome.rows if row.group == group]
    return Table(head + ([""] if known else []), rows)


def _ground(outcome: Outcome) -> Table:
    given = outcome.found.given
    return Table(
        ["constant", "value, SI"],
        [[name, _number(float(value))] for name, value in given.ground.items()],
        "By scale, ruler, rpm counter, or from a table "
        f"({given.source}); all else comes from the two flights.",
    )
