# SPDX-License-Identifier: Apache-2.0
"""The report's page: one HTML file that needs no network."""

import html
import json
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources

from plotly.offline import get_plotlyjs

from heli_flight.loop.result import versions
from heli_flight.loop.scenario import NODE_NAME, TABLE
from heli_flight.loop.settings import NODES
from heli_flight.report.chart import PALETTE, Chart
from heli_flight.report.data import Report
from heli_flight.report.design import Design
from heli_flight.report.paper_charts import LAWS
from heli_flight.report.plotly_json import figure, with_indices
from heli_flight.report.tables import event_table, margin_table, parameter_table, result_table
from heli_flight.report.words import NOT_SIMULATED, SIMULATED

_TITLES = {
    "result": "Result",
    "paper": "The paper's figures, from this flight",
    "flight": "Wind, actuators, attitude",
    "estimate": "Estimates against truth",
    "design": "The design that flew",
    "timeline": "Timeline",
    "scope": "What is simulated, and what is not",
    "parameters": "Parameters, seed, versions",
}


def render(report: Report, charts: Sequence[Chart], design: Design | None) -> str:
    """The page as text.

    Parameters
    ----------
    report : Report
    charts : sequence of Chart
    design : Design, optional
        None if the flown law has no such analysis.
    """
    sections = _sections(report, charts, design)
    present = {key: body for key, body in sections.items() if body}
    body = "".join(
        f'<section id="{key}"><h2>{_TITLES[key]}</h2>\n{text}</section>\n'
        for key, text in present.items()
    )
    heading = f"{report.kind.capitalize()} test in wind"
    head = Head(
        kind="Flight report · simulation",
        title=f"{heading}, seed {report.settings.seed}",
        heading=heading,
        verdict=_verdict(report),
        facts=list(_facts(report)),
        links={key: _TITLES[key] for key in present},
    )
    return filled(head, body, charts)


@dataclass(frozen=True)
class Head:
    """What stands on top of a page; texts are HTML.

    Attributes
    ----------
    kind, title, heading : str
    verdict : tuple of str
        Mark, class ("good", "bad" or "") and sentence.
    facts : sequence of (str, str)
    links : mapping
        Anchor to title of each section.
    """

    kind: str
    title: str
    heading: str
    verdict: tuple[str, str, str]
    facts: Sequence[tuple[str, str]]
    links: Mapping[str, str]


def filled(head: Head, body: str, charts: Sequence[Chart]) -> str:
    """The page's template with head, body and charts in it."""
    mark, kind, verdict = head.verdict
    parts = {
        "kind": head.kind,
        "title": head.title,
        "heading": head.heading,
        "verdict_class": kind,
        "verdict_mark": mark,
        "verdict": verdict,
        "facts": "".join(f"<div><dt>{k}</dt><dd>{v}</dd></div>" for k, v in head.facts),
        "links": " ".join(f'<a href="#{key}">{title}</a>' for key, title in head.links.items()),
        "body": body,
        "footer": f"Written {time.strftime('%Y-%m-%d %H:%M')}. Charts: Plotly.js (MIT license).",
        "charts": _json([figure(chart) for chart in charts]),
        "palette": _json(PALETTE),
        "plotly": get_plotlyjs().replace("</script", "<\\/script"),
        "css": _asset("report.css"),
        "script": _asset("report.js"),
    }
    # The template's names stand between at-signs: every second piece.
    pieces = _asset("report.html").split("@")
    return "".join(parts[piece] if i % 2 else piece for i, piece in enumerate(pieces))


def _asset(name: str) -> str:
    folder = resources.files("heli_flight.report") / "page"
    return (folder / name).read_text(encoding="utf-8")


def _json(value: object) -> str:
    return json.dumps(value, separators=(",", ":")).replace("</", "<\\/")


def _verdict(report: Report) -> tuple[str, str, str]:
    """Mark, class and sentence."""
    result = report.result
    if result.lost:
        return "✗", "bad", f"Lost after {result.flown_s:.2f} s: {html.escape(result.lost)}"
    judged = result.judged(report.settings.gps)
    if not result.scores:
        return "–", "", "Not scored: nothing was recorded in a scored phase."
    if judged:
        names = ", ".join(f"{s.metric.label} ({s.source})" for s in judged)
        return "✗", "bad", f"Outside the paper's figures: {html.escape(names)}."
    words = "Inside the paper's figures, measured as in the paper from the navigation record"
    beyond = [s.metric.label for s in result.outside]
    if beyond:
        words += (
            f". By ground truth outside: {', '.join(beyond)}; a {report.settings.gps} receiver's "
            "drift cannot be seen on board"
        )
    elif report.has_truth:
        words += ", and by ground truth"
    return "✓", "good", html.escape(words) + "."


def _facts(report: Report) -> Iterable[tuple[str, str]]:
    settings, plant = report.settings, report.settings.nodes["plant"]
    speeds = [float(v) for v in plant["wind.profile_speed_mps"]]
    low, high = min(speeds), max(speeds)
    wind = f"{low:g} m/s" if low == high else f"{low:g} to {high:g} m/s"
    more = "Dryden turbulence" if plant["wind.turbulence"] else "no turbulence"
    return [
        ("Scenario", html.escape(settings.scenario_name)),
        ("Flown", f"{report.result.flown_s:.2f} s, {html.escape(report.how)}"),
        ("Attitude law", LAWS.get(report.controller, html.escape(report.controller))),
        ("Wind", f"{wind}, {more}"),
        ("GPS", html.escape(settings.gps)),
        ("Seed", "not recorded" if report.assumed else str(settings.seed)),
    ]


def _sections(report: Report, charts: Sequence[Chart], design: Design | None) -> dict[str, str]:
    condition = html.escape(report.conditions)
    drawn = {key: "" for key in _TITLES}
    for chart in charts:
        drawn[chart.section] += figure_block(chart, condition)
    notes = [*report.result.notes, *report.missing]
    drawn["result"] = result_table(report) + "".join(
        f'<p class="note">{html.escape(note)}</p>' for note in notes
    )
    if design is not None:
        drawn["design"] = margin_table(design) + drawn["design"]
    drawn["timeline"] += event_table(report)
    drawn["scope"] = _scope()
    drawn["parameters"] = _parameters(report)
    return drawn


def figure_block(chart: Chart, condition: str) -> str:
    """A chart's place on the page, with title, caption and links to its files."""
    origin = f"<span>redraws {chart.paper} of the paper</span>" if chart.paper else ""
    files = " ".join(
        f'<a href="figures/{chart.key}.{ending}">{ending.upper()}</a>' for ending in ("svg", "png")
    )
    compared = f'<p class="conditions">{condition}</p>' if chart.section == "paper" else ""
    return (
        f'<figure id="{chart.key}"><figcaption><div class="head"><h3>{html.escape(chart.title)}'
        f"</h3>{origin}<span>{files}</span></div><p>{with_indices(chart.caption)}</p></figcaption>"
        f'<div class="chart" id="chart-{chart.key}" role="img" '
        f'aria-label="{html.escape(chart.title)}"></div>{compared}</figure>\n'
    )


def _scope() -> str:
    columns = (("Simulated", SIMULATED), ("Not simulated", NOT_SIMULATED))
    return '<div class="columns">' + "".join(
        f"<div><h3>{title}</h3><ul>{''.join(f'<li>{html.escape(x)}</li>' for x in rows)}</ul></div>"
        for title, rows in columns
    ) + "</div>"  # fmt: skip


def _parameters(report: Report) -> str:
    settings = report.settings
    used = ", ".join(html.escape(f"{name} {version}") for name, version in versions().items())
    groups = [(node.name, node.table, settings.nodes[node.name]) for node in NODES]
    groups.append((NODE_NAME, TABLE, settings.scenario_parameters))
    blocks = "".join(
        f"<details><summary>{html.escape(name)}: {len(values)} parameters</summary>"
        f"{parameter_table(rows, values)}</details>"
        for name, rows, values in groups
    )
    return f"<p>Seed {settings.seed}. Versions: {used}</p>{blocks}"
