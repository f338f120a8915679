# SPDX-License-Identifier: Apache-2.0
"""A sample of a campaign's flights flown in another way: what counts as the same flight."""

import math
from dataclasses import replace

import pyarrow as pa
import pytest
from rich.console import Console

from heli_flight.fly import fly_and_write
from heli_flight.layers import LOCKSTEP, ONE_PROCESS
from heli_flight.record import NAME, read_record
from heli_flight.scoring import score
from heli_studies.campaign.run import as_list, check, print_compared, sample
from heli_studies.campaign.spec import COVERAGE, fly_rows, spec_of
from support.record_bag import rows_of

TEXT = """flights: 3
world: paper
gps: rtk
duration_s: 6.0
set: {scenario.score.windows_s: [2.0, -1.0]}
disperse: {aircraft.main_rotor.hub_stiffness_nmprad: {uniform: [100.0, 130.0]}}
"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    file = tmp_path_factory.mktemp("campaign") / "spec.yaml"
    file.write_text(TEXT)
    spec = spec_of(file)
    return spec, fly_rows(spec, range(3))


def in_one_process(order):
    """The order as it is, but without the graph's seconds."""
    assert (order.mode, order.report) == (LOCKSTEP, False)
    return fly_and_write(replace(order, mode=ONE_PROCESS))


def checked(flown, rows, count, folder):
    return check(flown[0], pa.Table.from_pylist(rows), count, folder, in_one_process)


def test_the_files_of_a_sample_fly_what_the_rows_say(flown, tmp_path):
    compared = checked(flown, flown[1], 2, tmp_path)
    assert [(one.number, one.difference) for one in compared] == [(0, 0.0), (2, 0.0)]
    assert (tmp_path / "graph" / "flight_2" / "flight" / "result.json").is_file()
    again = checked(flown, flown[1], 2, tmp_path)
    assert again == compared, "what was there is flown anew"
    assert as_list(compared)[0]["same"] is True


def test_one_that_was_recorded_in_part_is_not_the_same(flown, tmp_path):
    def in_part(order):
        outcome = in_one_process(order)
        flight = read_record(outcome.folder / NAME)
        held = rows_of(flight, flight.time_s < 5.0)
        figures = score(held, outcome.settings.scenario)
        return replace(outcome, result=replace(outcome.result, figures=figures))

    (one,) = check(flown[0], pa.Table.from_pylist(flown[1][:1]), 1, tmp_path, in_part)
    assert (one.figure, one.difference) == (COVERAGE, math.inf)


def test_a_figure_that_differs_is_named(flown, tmp_path, capsys):
    rows = [dict(row) for row in flown[1]]
    rows[1]["max.v_x (truth)"] += 2e-6
    (one,) = checked(flown, rows[1:2], 5, tmp_path)
    assert (one.figure, one.same) == ("max.v_x (truth)", False)
    assert one.difference == pytest.approx(2e-6, rel=1e-6)
    print_compared(Console(width=200), [one])
    printed = capsys.readouterr().out
    assert "DIFFERS" in printed and "0 of 1 flights" in printed


def test_what_was_lost_alone_differs(flown, tmp_path):
    rows = [flown[1][0] | {"cause": "lost", "sentence": "It fell."}]
    (one,) = checked(flown, rows, 1, tmp_path)
    assert (one.figure, one.difference) == ("cause", math.inf)
    rows = [{k: v for k, v in flown[1][0].items() if k != "max.v_z (truth)"}]
    (one,) = checked(flown, rows, 1, tmp_path)
    assert (one.figure, one.difference) == ("max.v_z (truth)", math.inf)


def test_a_sample_is_spread_over_the_flights_that_flew(capsys):
    causes = ["flown"] * 6 + ["parameters refused", "lost", "threw", "flown"]
    rows = pa.table({"flight": list(range(10)), "cause": causes})
    assert sample(rows, 2) == [2, 7]  # of 0 1 2 3 4 5 7 9
    assert sample(rows, 1) == [4]
    assert sample(rows, 99) == [0, 1, 2, 3, 4, 5, 7, 9]
    assert sample(rows.slice(6, 1), 3) == []
    print_compared(Console(), [])
    (line,) = capsys.readouterr().out.splitlines()  # no table, but not silence
    assert line
