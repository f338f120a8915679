# SPDX-License-Identifier: Apache-2.0
"""report.html and figures of a campaign's folder, with the flight report's look."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from heli_flight.loop.scoring import figures_of
from heli_flight.report.figures import write_figures
from heli_flight.report.page import Head, filled
from heli_flight.studies.dispersion.explain import influences
from heli_flight.studies.dispersion.report_charts import (
    distribution_charts,
    failure_chart,
    margin_chart,
    scatter_charts,
)
from heli_flight.studies.dispersion.report_tables import (
    causes_table,
    correlations_table,
    dispersed_table,
    percent,
    quantiles_table,
    worst_table,
)
from heli_flight.studies.dispersion.told import Told
from heli_parameters.parameters import ParameterError

PAGE, FIGURES = "report.html", "figures"
STEPS = 3
_DIGITS = 12
_TITLES = {
    "result": "Result",
    "margin": "How near to the bounds",
    "distributions": "Distributions beside the bounds",
    "spread": "What explains the spread",
    "worst": "Worst cases",
    "dispersed": "What was dispersed",
}
_AGAIN = (
    "Each command flies the same flight through the graph of nodes, recorded in full, with a "
    "report of its own. A flight whose parameters were refused has none."
)


def write_page(told: Told, folder: Path, progress: Callable[[int], None]) -> Path:
    """Write report.html and figures/ into a folder; returns the page.

    Raises
    ------
    ParameterError
        The folder cannot be written.
    """
    strongest = {name: influences(told.inputs, v) for name, (_, v) in told.figures.items()}
    kind, failed = told.about["flown"]["kind"], [case.failed for case in told.cases]
    charts = [
        margin_chart(told.cases, kind),
        *distribution_charts(told.table, kind),
        failure_chart(told.inputs, failed),
        *scatter_charts(told.inputs, told.figures, strongest, failed),
    ]
    charts = [chart for chart in charts if chart.has_data]
    progress(1)
    links = dict(_TITLES)
    for key in ("margin", "distributions"):
        if key not in {chart.section for chart in charts}:
            links.pop(key)
    text = filled(
        "campaign.html",
        _head(told, links),
        charts,
        quantiles=quantiles_table(told),
        causes=causes_table(told),
        conditions=_conditions(told),
        correlations=correlations_table(told, strongest),
        worst=worst_table(told),
        again=told.why_not or _AGAIN,
        dispersed=dispersed_table(told),
    )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / PAGE).write_text(text, encoding="utf-8")
        progress(2)
        write_figures(charts, _conditions(told), folder / FIGURES)
    except OSError as error:
        raise ParameterError(f"{folder}: cannot be written: {error.strerror or error}") from None
    progress(STEPS)
    return folder / PAGE


def _head(told: Told, links: Mapping[str, str]) -> Head:
    flown = told.about["flown"]
    return Head(
        kind="Campaign report · simulation",
        title=f"Campaign: {flown['scenario']}, {told.table.num_rows} flights",
        heading=f"Campaign of {told.table.num_rows} flights: {flown['scenario']}",
        verdicts=_verdicts(told),
        facts=_facts(told),
        links=links,
    )


def _verdicts(told: Told) -> list[tuple[str, str, str]]:
    found = told.summary
    low, high = found.interval
    bounds = figures_of(told.about["flown"]["kind"])
    sure = f"95 % confidence: {percent(low)} to {percent(high)} (Clopper, Pearson)"
    if found.failed:
        mark, tone = "✗", "bad"
        words = (
            f"{found.failed} of {found.flights} flights outside {bounds} or not flown to the end: "
            f"{percent(found.failed / found.flights)}; {sure}."
        )
    else:
        mark, tone = "✓", "good"
        words = f"All {found.flights} flights inside {bounds}; of failing, {sure}."
    told_first = [(mark, tone, words)]
    if told.missing:
        words = f"{told.missing} of {told.about['flights']} flights have no row yet."
        told_first.append(("–", "", f"{words} `heli campaign ... --resume` flies them."))
    return told_first


def _facts(told: Told) -> list[tuple[str, str]]:
    flown = told.about["flown"]
    return [
        ("Scenario", f"{flown['scenario']}, {flown['duration_s']:g} s"),
        ("World", Path(flown["world"]).stem),
        ("Laws", Path(flown["laws"]).stem),
        ("GPS", flown["gps"]),
        ("Sampling", flown["sampling"].replace("_", " ")),
        ("Dispersed", f"{len(told.about['disperse'])} parameters"),
        ("Not lost", told.summary.survived.words),
        ("Sources", told.about["commit"][:_DIGITS]),
    ]


def _conditions(told: Told) -> str:
    flown = told.about["flown"]
    return (
        f"simulated: {told.table.num_rows} flights of {flown['scenario']}, "
        f"{flown['duration_s']:g} s, world {Path(flown['world']).stem}, GPS {flown['gps']}, "
        f"{flown['sampling'].replace('_', ' ')} sampling; sources {told.about['commit'][:_DIGITS]}"
    )


def as_dict(told: Told, page: Path) -> dict[str, Any]:
    """For --json."""
    return {
        "report": str(page),
        "figures": sorted(str(path) for path in (page.parent / FIGURES).iterdir()),
        "flights": told.summary.flights,
        "missing": told.missing,
        "failed": told.summary.failed,
        "interval": list(told.summary.interval),
        "worst": {str(number): str(path) for number, path in told.again.items()},
    }
