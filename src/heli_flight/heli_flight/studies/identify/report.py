# SPDX-License-Identifier: Apache-2.0
"""report.html and figures of an identification, with the flight report's look."""

import html
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from heli_flight.loop.result import versions
from heli_flight.report.chart import Chart
from heli_flight.report.figures import write_figures
from heli_flight.report.page import Head, figure_block, filled
from heli_flight.report.tables import table
from heli_flight.report.words import NOT_SIMULATED
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
    sections = dict.fromkeys(_TITLES, "")
    for chart in drawn:
        sections[chart.section] += figure_block(chart, "")
    sections["result"] = _result(outcome)
    sections["ground"] = _ground(outcome)
    items = "".join(f"<li>{html.escape(item)}</li>" for item in NOT_SIMULATED)
    sections["scope"] = f"<ul>{items}</ul>"
    body = "".join(
        f'<section id="{key}"><h2>{_TITLES[key]}</h2>\n{text}</section>\n'
        for key, text in sections.items()
    )
    head = Head(
        kind="Identification report · simulation",
        title="Identification of the hover model",
        heading="Identification of the hover model",
        verdict=_verdict(outcome),
        facts=_facts(outcome),
        links=_TITLES,
    )
    return filled(head, body, drawn)


def _verdict(outcome: Outcome) -> tuple[str, str, str]:
    judged = [row for row in outcome.rows if row.met is not None]
    missed = misses(outcome.rows)
    if outcome.truth is None:
        return "–", "", "No aircraft file to compare with: see the standard deviations."
    if missed:
        names = html.escape(", ".join(row.name for row in missed))
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
        ("Lines", html.escape(f"{lines_of(found.actuators)}; {lines_of(found.gusts)}")),
        ("Compared with", html.escape(outcome.truth.basis.source if outcome.truth else "nothing")),
        ("GPS", html.escape(settings.gps)),
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
    name = html.escape(row.name)
    dull = row.met is None and not row.significant
    spread = _number(2.0 * row.sigma, 2) if row.sigma > 0.0 else "–"
    cells = [f'<span class="dull">{name}</span>' if dull else name, _number(row.value), spread]
    if known:
        deviation = row.deviation
        percent = "–" if not np.isfinite(deviation) else f"{100.0 * deviation:+.1f} %"
        cells += [_number(row.truth), percent.replace("-", "−")]
    share = "" if np.isnan(row.share) else f"{100.0 * row.share:.3g} %"
    return [*cells, share, *([marks[row.met]] if known else [])]


def _result(outcome: Outcome) -> str:
    known = outcome.truth is not None
    head = ["", "identified", "± 2σ", *(["truth", "deviation"] if known else []), "effect in row"]
    head += [""] if known else []
    parts = [f"<p>{html.escape(_DEFINITION)}</p>"]
    for group, title in _GROUPS.items():
        rows = [_cells(row, known) for row in outcome.rows if row.group == group]
        if rows:
            parts.append(f"<h3>{title}</h3>" + table(head, rows, ""))
    zero = outcome.zeros
    if zero:
        names = html.escape(", ".join(zero))
        parts.append(f'<p class="note">Not told from zero, and taken for zero: {names}.</p>')
    return "".join(parts)


def _ground(outcome: Outcome) -> str:
    given = outcome.found.given
    rows = [[html.escape(name), _number(float(value))] for name, value in given.ground.items()]
    used = ", ".join(html.escape(f"{name} {version}") for name, version in versions().items())
    return (
        table(["constant", "value, SI"], rows, "By scale, ruler, rpm counter, or from a table "
              f"({given.source}); all else comes from the two flights.")
        + "<p>PID law and position loop of another design held the aircraft in the experiments. "
        f"Versions: {used}</p>"
    )  # fmt: skip
