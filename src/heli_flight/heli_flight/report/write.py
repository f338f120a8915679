# SPDX-License-Identifier: Apache-2.0
"""Writes report.html of a flight, and figures/ where they are asked for."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from heli_bags.reader import Remark
from heli_flight.loop import closed_loop
from heli_flight.loop.commit import sources_commit
from heli_flight.loop.laws import without_own
from heli_flight.loop.record import FlightRecord
from heli_flight.loop.result import Result
from heli_flight.loop.scoring import score
from heli_flight.loop.settings import Settings
from heli_flight.report.bands import bands_of
from heli_flight.report.chart import with_bands
from heli_flight.report.data import Event, Report, Rival
from heli_flight.report.design import flown_design
from heli_flight.report.page import render
from heli_flight.report.paper_charts import paper_charts
from heli_flight.report.path_charts import path_charts
from heli_flight.report.spectrum_charts import spectra_of, spectrum_charts
from heli_flight.report.system_charts import design_charts, flight_charts, timeline_charts

PAGE = "report.html"
FIGURES = "figures"


def write_report(
    record: FlightRecord,
    settings: Settings,
    result: Result,
    folder: Path,
    how: str = "one process",
    events: Sequence[Event] = (),
    missing: Sequence[str] = (),
    assumed: bool = False,
    figures: bool = False,
    commit: str | None = None,
    remarks: Sequence[Remark] = (),
    drawn: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Write report.html, and if asked for figures/*.png, *.svg, into a folder.

    Parameters
    ----------
    record : FlightRecord
        NaN stands for what was not recorded.
    settings : Settings
        Resolved parameters of the flight.
    result : Result
    folder : Path
        Must exist.
    how : str
        How it was flown, a few words.
    events : sequence of Event
        Changes of the nodes' health.
    missing : sequence of str
        Sentences: what is not in the record, and what was taken instead.
    assumed : bool
        True if the settings are not known to be those of the flight.
    figures : bool
        True: the page's charts also as files for a paper, which takes far longer than the page.
    commit : str, optional
        Of the sources that flew, empty if it was not recorded; default: of these.
    remarks : sequence of Remark
        What the nodes said, for the faults that were given in flight.
    drawn : callable, optional
        Told how many figures are drawn, and of how many; the page is written before the first.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    OSError
        The folder cannot be written.
    """
    rival = _rival(settings) if settings.scenario.kind == "attitude" else None
    commit = sources_commit() if commit is None else commit
    bands = bands_of(record, settings, remarks, events)
    report = Report(
        record, settings, result, how, events, rival, tuple(missing), assumed, commit, bands
    )
    design = flown_design(settings)
    charts = [*paper_charts(report), *path_charts(report), *flight_charts(report)]
    if design is not None:
        charts += design_charts(design)
    charts += timeline_charts(report)
    spectra = spectra_of(report)
    charts += spectrum_charts(report, spectra, design)
    charts = with_bands([chart for chart in charts if chart.has_data], bands)
    page = folder / PAGE
    text = render(report, charts, design, spectra, files=figures)
    page.write_text(text, encoding="utf-8")
    if figures:
        # matplotlib takes half a second to import.
        from heli_flight.report.figures import write_figures

        write_figures(charts, report.conditions, folder / FIGURES, drawn)
    return page


def _rival(settings: Settings) -> Rival:
    """The same flight in one process under PID; if PID has flown under output feedback."""
    inner = settings.nodes["inner_loop"]
    law = "hinf_output" if inner["controller"] == "pid" else "pid"
    nodes = {**settings.nodes, "inner_loop": {**inner, "controller": law}}
    flight = closed_loop.simulate(without_own(replace(settings, nodes=nodes)))
    figures = score(flight.record, settings.scenario)
    return Rival(law, flight.record, figures, flight.sentence)
