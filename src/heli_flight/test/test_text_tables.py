# SPDX-License-Identifier: Apache-2.0
"""Tables at a terminal: no number is cut, whatever the width; marks are explained."""

import io
import re

import numpy as np
import pytest
from rich.console import Console

from heli_core.metrics import METRICS
from heli_flight.result import Result, print_table
from heli_flight.scoring import SOURCES, Figures, Score
from heli_flight.settings import resolve
from heli_flight.terminal import table
from heli_studies.campaign import run
from heli_studies.compare import LAWS, PERTURBATIONS, PerturbedFlight, print_outcomes
from heli_studies.compare_flights import AttitudeComparison, AttitudeFlight, print_attitude
from heli_studies.design.make import aircraft_basis, design_of
from heli_studies.design.report import print_design

WIDTHS = (60, 80, 100, 140, 250)


def terminal(width):
    # Without a height a terminal that calls itself dumb is 80 wide, whatever is said.
    return Console(file=io.StringIO(), width=width, height=25, force_terminal=True,
                   color_system=None, highlight=False)  # fmt: skip


def printed(width, show):
    out = terminal(width)
    show(out)
    text = out.file.getvalue()
    assert "\N{HORIZONTAL ELLIPSIS}" not in text
    assert max(map(len, text.splitlines())) <= width
    return text


def matrix(out, rows=3, columns=9):
    shown = table("gains", out)
    shown.add_column("")
    for j in range(columns):
        shown.add_column(f"state {j}", justify="right")
    for i in range(rows):
        shown.add_row(f"input {i}", *(f"{-1.2345 - i - 10 * j:.4f}" for j in range(columns)))
    out.print(shown)


@pytest.mark.parametrize("width", [20, 30, *WIDTHS])
def test_every_cell_stands_whole_at_every_width(width):
    text = printed(width, matrix)
    for i in range(3):
        for j in range(9):
            assert f"{-1.2345 - i - 10 * j:.4f}" in text


def test_rows_and_columns_change_places_before_the_table_falls_apart():
    wide, narrow, least = (printed(width, matrix) for width in (140, 60, 24))
    assert re.search(r"input 0 .*-1\.2345.*-81\.2345", wide)
    assert re.search(r"state 8 .*-81\.2345.*-82\.2345.*-83\.2345", narrow)
    assert "state 8: -81.2345" in " ".join(least.split())


def test_where_there_is_no_terminal_it_is_markdown():
    out = Console(file=io.StringIO(), width=250)
    matrix(out)
    assert "|---" in out.file.getvalue() and "-81.2345" in out.file.getvalue()


@pytest.fixture(scope="module")
def design():
    """Of the state feedback, which has gains F to print."""
    settings = resolve(laws="hinf")
    return design_of(aircraft_basis(settings, None), settings)


@pytest.mark.parametrize("width", WIDTHS)
def test_the_designs_gains_are_never_cut(width, design):
    text = printed(width, lambda out: print_design(design, out))
    words = set(re.findall(r"-?\d+\.\d{4}", text))
    for matrix_ in (design.attitude.synthesis.F, design.observer.K):
        assert {f"{value + 0.0:.4f}" for value in np.ravel(matrix_)} <= words
    for report in design.reports:
        assert f"{report.norm:.4f}" in words


def test_the_designs_tables_fit_into_80_columns_where_there_is_no_terminal(design):
    out = Console(file=io.StringIO(), width=250)
    print_design(design, out)
    rows = [line for line in out.file.getvalue().splitlines() if line.startswith("|")]
    assert len(rows) > 30 and max(map(len, rows)) <= 80


def flown(gps, navigation, truth):
    scores = [
        Score(metric, source, value * metric.paper, 0.1)
        for source, value in zip(SOURCES, (navigation, truth), strict=True)
        for metric in METRICS["hover"]
    ]
    return Result(Figures(windows=scores), "", 60.0, 1.0), resolve(gps=gps)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("gps", ["standalone", "rtk"])
def test_a_mark_in_the_flights_table_is_explained(width, gps):
    result, settings = flown(gps, 0.5, 2.63)
    text = printed(width, lambda out: print_table(result, settings, out))
    words = " ".join(text.split())
    assert "1.71 (0.10) m !" in words
    assert words.count("! ") > words.count("m !")
    if gps == "standalone":
        assert "inside" in words and "OUTSIDE" not in words
        assert "estimate decides" in words
    else:
        assert "OUTSIDE" in words and "truth decide" in words


def test_without_a_mark_there_is_nothing_to_explain():
    result, settings = flown("standalone", 0.5, 0.5)
    assert "!" not in printed(100, lambda out: print_table(result, settings, out))


@pytest.mark.parametrize("width", WIDTHS)
def test_the_campaigns_table(width):
    result, _ = flown("rtk", 0.5, 2.63)
    columns = {gps: [run.FlownSeed(1, result.figures, "")] for gps in ("standalone", "rtk")}
    text = printed(width, lambda out: out.print(run.seeds_table(columns, "hover", out)))
    assert text.count("1.71") == 2 and text.count("0.51") == 2


@pytest.mark.parametrize("width", WIDTHS)
def test_the_comparisons_tables(width):
    settings = resolve("attitude")
    laws = tuple(LAWS)
    flights = [
        AttitudeFlight(law.key, 1, source, (0.123 + i, 1.456), (0.021, 0.032), "")
        for i, law in enumerate(laws)
        for source in ("navigation", "truth", "ideal")
    ]
    result = AttitudeComparison(settings, laws, [1], flights=flights)
    text = printed(width, lambda out: print_attitude(result, out))
    assert " ".join(text.split()).count("1.46 (0.03)") == 3 * len(laws)
    outcomes = [
        PerturbedFlight(PERTURBATIONS[0].key, law.key, 7, 40, 3, 1.234, 5.678) for law in laws
    ]
    text = printed(width, lambda out: print_outcomes(outcomes, laws, settings, out))
    assert " ".join(text.split()).count("17.5 % (1.23 / 5.68), 3 lost") == len(laws)
