# SPDX-License-Identifier: Apache-2.0
"""Pages that need no network: one HTML file each, made from the templates in `page/`."""

import base64
import hashlib
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from heli_core.rcl_yaml import ParameterError
from heli_flight.flight_file import changes
from heli_flight.layers import NODES
from heli_flight.report import first_screen
from heli_flight.report.charts import LAWS, DesignNumbers
from heli_flight.report.data import PALETTE, Chart, Report, legend
from heli_flight.report.plotly import page_data, with_indices
from heli_flight.report.spectra import FlightSpectra, loop_tables, spectrum_table
from heli_flight.report.tables import (
    ReportTable,
    band_table,
    event_table,
    margin_table,
    parameter_table,
    result_tables,
    scope,
)
from heli_flight.result import fault_words, mean_wind, versions
from heli_flight.scenario import NODE_NAME, TABLE
from heli_flight.settings import laws_words

# -------------------------------------------------------------------------------------------------
# Page.
# -------------------------------------------------------------------------------------------------

_TITLES = {
    "result": "Every figure: scored windows, whole flight, climb",
    "paper": "The paper's figures, from this flight",
    "path": "The path",
    "flight": "Wind, actuators, attitude",
    "estimate": "Estimates against truth",
    "design": "The design that flew",
    "spectra": "Spectra",
    "timeline": "Timeline",
    "scope": "What is simulated, and what is not",
    "parameters": "Parameters, seed, versions",
}
_DIGITS = 10
_PLOTLY = "plotly-basic.min.js"
_FOLDER = Path(__file__).with_name("page")
_TEMPLATES = Environment(
    loader=FileSystemLoader(_FOLDER),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_TEMPLATES.globals["colours"] = PALETTE
_TEMPLATES.filters["legend"] = legend
_TEMPLATES.filters["with_indices"] = lambda text: Markup(with_indices(text))


@dataclass(frozen=True)
class PageHeader:
    """What stands on top of a page.

    Attributes
    ----------
    kind, title, heading : str
    verdicts : sequence of tuple of str
        Mark, class ("good", "bad" or "") and sentence of each.
    facts : sequence of (str, str)
    links : mapping
        Anchor to title of each section.
    files : bool
        Whether figures/ beside the page holds each chart as PNG and SVG.
    """

    kind: str
    title: str
    heading: str
    verdicts: Sequence[tuple[str, str, str]]
    facts: Sequence[tuple[str, str]]
    links: Mapping[str, str]
    files: bool = True


def render(
    report: Report,
    charts: Sequence[Chart],
    design: DesignNumbers | None,
    spectra: FlightSpectra | None = None,
    files: bool = False,
    folder: Path | None = None,
) -> str:
    """The flight's page as text.

    Parameters
    ----------
    report : Report
    charts : sequence of Chart
    design : DesignNumbers, optional
        None if the flown controller has no such analysis.
    spectra : FlightSpectra, optional
        None if there are none.
    files : bool
        True if figures/ beside the page holds each chart as PNG and SVG.
    folder : Path, optional
        Where the page will lie, whose data it links to.
    """
    drawn = {chart.section for chart in charts}
    always = {"result", "scope", "parameters"}
    events, margins = event_table(report), margin_table(design) if design else None
    tables = {"timeline": events, "design": margins}
    heading = f"{report.kind.capitalize()} test in wind"
    if report.result.aircraft:
        heading += f": {report.result.aircraft}"
    head = PageHeader(
        kind="Flight report · simulation",
        title=f"{heading}, seed {report.settings.seed}",
        heading=heading,
        verdicts=[first_screen.verdict_of(report)],
        facts=_facts(report),
        links={k: v for k, v in _TITLES.items() if k in drawn | always or tables.get(k)},
        files=files,
    )
    return filled(
        "flight.html",
        head,
        charts,
        numbers=first_screen.numbers_of(report) if len(report.record) else [],
        told=first_screen.told_of(report) if len(report.record) else "",
        folder=folder or "",
        beside=first_screen.data_beside(folder) if folder else {},
        results=result_tables(report),
        conditions=report.conditions,
        notes=[*report.result.notes, *report.missing],
        margins=margins,
        spectra=_spectrum_tables(spectra, design),
        bands=band_table(report),
        events=events,
        scope=scope(report.settings.nodes["plant"]),
        seed=report.settings.seed,
        parameters=_parameters(report),
    )


def _spectrum_tables(
    spectra: FlightSpectra | None, design: DesignNumbers | None
) -> list[ReportTable]:
    """What the flight's spectra say, and what the design does; nothing without spectra."""
    measured = spectrum_table(spectra) if spectra else None
    if measured is None:
        return []
    return [measured, *(loop_tables(design) if design else [])]


def filled(template: str, head: PageHeader, charts: Sequence[Chart], **content: Any) -> str:
    """A template with head, charts and content in it.

    The page may run its own two scripts and nothing else, load nothing and send nothing: its
    security policy names the scripts by their hashes.
    """
    plotly = (_FOLDER / _PLOTLY).read_text(encoding="utf-8").replace("</script", "<\\/script")
    script = (_FOLDER / "report.js").read_text(encoding="utf-8")
    return _TEMPLATES.get_template(template).render(
        head=head,
        charts=charts,
        versions=versions(),
        written=time.strftime("%Y-%m-%d %H:%M"),
        data=_json(page_data(charts)),
        palette=_json(PALETTE),
        css=Markup((_FOLDER / "report.css").read_text(encoding="utf-8")),
        plotly=Markup(plotly),
        script=Markup(script),
        hashes=[_hash(plotly), _hash(script)],
        **content,
    )


def _hash(script: str) -> str:
    """A script's name in a content security policy."""
    return f"sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}"


def _json(value: object) -> Markup:
    """JSON that can stand in a script: no text in it can end that, nor begin a comment."""
    return Markup(json.dumps(value, separators=(",", ":")).replace("<", "\\u003c"))


def _facts(report: Report) -> list[tuple[str, str]]:
    settings, plant = report.settings, report.settings.nodes["plant"]
    more = "Dryden turbulence" if plant["wind.turbulence"] else "no turbulence"
    faults = fault_words(settings)
    return [
        ("Scenario", settings.scenario_name),
        ("World", Path(settings.world).stem),
        ("Flown", f"{report.result.flown_s:.2f} s, {report.how}"),
        ("Control preset", laws_words(settings)),
        ("Attitude controller", LAWS.get(report.controller, report.controller)),
        ("Wind", f"{mean_wind(plant)}, {more}"),
        ("GPS", settings.gps),
        ("Seed", "not recorded" if report.assumed else str(settings.seed)),
        *([("Faults", faults)] if faults else []),
        ("Changed", _changed(report)),
        ("Commit", _short(report.commit) or "not recorded"),
    ]


def _changed(report: Report) -> str:
    """Names of the parameters that are not the packaged ones."""
    if report.assumed:
        return "not recorded"
    return ", ".join(change.name for change in changes(report.settings)) or "nothing"


def _short(commit: str) -> str:
    """A commit's first digits, and what is said beside it."""
    number, blank, more = commit.partition(" ")
    return f"{number[:_DIGITS]}{blank}{more}"


def _parameters(report: Report) -> Iterable[tuple[str, Any]]:
    """Name and table of each node's parameters."""
    settings = report.settings
    groups = [(node.name, node.table, settings.nodes[node.name]) for node in NODES]
    groups.append((NODE_NAME, TABLE, settings.scenario_parameters))
    return [(name, parameter_table(rows, values)) for name, rows, values in groups]


# -------------------------------------------------------------------------------------------------
# A page as PDF, by a Chromium that is there already: it prints the page as a user would.
# -------------------------------------------------------------------------------------------------

NAMES = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome",
    "microsoft-edge",
)  # fmt: skip
"""Programs that can print a page, in the order in which they are looked for on PATH."""
_LIMIT_S = 120.0
_FLAGS = (
    "--headless=new", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-quic", "--hide-scrollbars", "--no-pdf-header-footer",
)  # fmt: skip


def printer() -> str:
    """Path of a Chromium.

    Raises
    ------
    ParameterError
        There is none.
    """
    chromium = next(filter(None, map(shutil.which, NAMES)), None)
    if chromium is None:
        raise ParameterError(
            "--pdf: no Chromium on this machine to print with; install chromium or Google Chrome, "
            "or open report.html in a browser and print it"
        )
    return chromium


def write_pdf(page: Path, program: str) -> Path:
    """Print a page into a PDF beside it.

    Parameters
    ----------
    page : Path
    program : str
        As `printer` found it.

    Returns
    -------
    Path

    Raises
    ------
    ParameterError
        The program did not print it; with its last words.
    """
    pdf = page.resolve().with_suffix(".pdf")
    pdf.unlink(missing_ok=True)
    # Root has no sandbox in Chromium; the page is our own, and its policy lets nothing in or out.
    as_root = ("--no-sandbox",) if os.geteuid() == 0 else ()
    with tempfile.TemporaryDirectory() as profile:
        command = [program, *_FLAGS, *as_root, f"--user-data-dir={profile}"]
        command += [f"--print-to-pdf={pdf}", page.resolve().as_uri()]
        try:
            done = subprocess.run(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE, timeout=_LIMIT_S,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise ParameterError(f"--pdf: {program} did not print in {_LIMIT_S:g} s") from None
        except OSError as error:
            raise ParameterError(f"--pdf: {program}: {error.strerror}") from None
    if done.returncode or not pdf.is_file():
        lines = done.stderr.decode(errors="replace").strip().splitlines()
        why = f": {lines[-1]}" if lines else ""
        raise ParameterError(f"--pdf: {program} ended with {done.returncode}, no PDF{why}")
    return page.with_suffix(".pdf")
