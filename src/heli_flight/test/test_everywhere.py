# SPDX-License-Identifier: Apache-2.0
"""`heli compare laws`: its numbers against the studies of single laws, what is lost, its tables."""

import json
from dataclasses import replace

import numpy as np
import pytest

from evidence.experiments.laws_everywhere import laws_everywhere
from heli_core.rcl_yaml import ParameterError
from heli_flight.cli.app import main
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_flight.worlds import LAWS
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import sampled_plant
from heli_inner_hinf.tuning import model_of
from heli_studies import compare as robustness
from heli_studies import compare as single
from heli_studies import compare_flights
from heli_studies.compare import Margins, loop_as_flown, margins_as_flown
from heli_studies.compare_flights import FlightCondition, LawMatrix, LawRun

SEEDS = (1, 2)
LONG_S = 16.0


@pytest.fixture(scope="module")
def study():
    where = compare_flights.test_conditions(["paper"], SEEDS, 2)
    return compare_flights.compare_laws(("hinf", "pid"), where, LONG_S)


def test_how_many_fly_at_a_time_changes_nothing(study):
    (place, *_), counts = study.seeds, []
    again = compare_flights.compare_laws(("pid", "hinf"), {place: SEEDS}, LONG_S, 2, counts.append)
    for law in ("pid", "hinf"):
        for one, other in zip(study.runs[place, law], again.runs[place, law], strict=True):
            assert all(map(np.array_equal, vars(one).values(), vars(other).values()))
    assert counts == [2, 4]


def test_errors_are_those_of_the_study_of_single_laws(study):
    """The same seeds through `heli compare attitude`, RTK and ideal navigation."""
    settings = resolve("attitude_gusts", "rtk", duration_s=LONG_S)
    known = compare_flights.compare_attitude(
        settings, single.parse_laws("hinf,pid"), SEEDS, ideal=True
    )
    for navigation, source in (("rtk", "truth"), ("ideal", "ideal")):
        for law in ("hinf", "pid"):
            flights = known.of(law, source)
            for seed, run in zip(
                SEEDS, study.runs[FlightCondition("paper", navigation), law], strict=True
            ):
                np.testing.assert_allclose(run.max_deg, flights[seed].max_deg, rtol=1e-12)
                np.testing.assert_allclose(run.rms_deg, flights[seed].rms_deg, rtol=1e-12)
        for axis, name in enumerate(single.AXES):
            (row,) = [
                r for r in study.summary()
                if (r["place"], r["law"], r["axis"])
                == (FlightCondition("paper", navigation).name, "hinf", name)
            ]  # fmt: skip
            assert row["won_over_pid"] == known.wins("hinf", source, axis)


def test_aircraft_are_those_of_the_study_of_robustness(study):
    settings = resolve("attitude_gusts", "rtk", duration_s=LONG_S)
    campaign = robustness.RobustnessSetup(settings, single.parse_laws("hinf,pid"))
    place = FlightCondition("paper", "rtk", compare_flights.AIRCRAFT_PARTS)
    for i, seed in enumerate(study.seeds[place]):
        for law, error in campaign.fly(compare_flights.AIRCRAFT_PARTS, seed).items():
            assert study.runs[place, law][i].max_deg.max() == pytest.approx(error, rel=1e-12)


def test_travel_is_the_way_of_the_actuators(study):
    settings = resolve("attitude_gusts", "rtk", 2, LONG_S, laws="pid")
    record = simulate(settings).record
    u = record.u[record.time_s >= 5.0, :3]
    way = sum(np.abs(b - a) for a, b in zip(u[:-1], u[1:], strict=True))
    seconds = (len(u) - 1) * 0.01
    run = study.runs[FlightCondition("paper", "rtk"), "pid"][1]
    np.testing.assert_allclose(run.travel_per_s, way / seconds, rtol=1e-9)


def of(errors, travel=0.1):
    return [LawRun(np.full(2, e), np.full(2, 0.5 * e), np.full(3, travel)) for e in errors]


def test_what_was_lost_is_counted_and_wins_nothing():
    place = FlightCondition("hard", "rtk")
    runs = {(place, "a"): of([1.0, np.inf, 3.0]), (place, "pid"): of([2.0, 2.0, 2.0])}
    result = LawMatrix(("a", "pid"), {place: (1, 2, 3)}, "a", {place: "calm; seed 1\nGPS"}, runs,
                        {"a": None, "pid": Margins(0.5, 0.25, 0.0801)})  # fmt: skip
    row, *_ = result.summary()
    assert (row["lost"], row["won_over_pid"], row["worst_deg"]) == (1, 1, 3.0)
    assert row["median_deg"] == 3.0 and row["rms_deg"] == pytest.approx(0.5 * np.sqrt(5.0))
    text = laws_everywhere({"laws_everywhere": result.as_dict()})
    cells = {
        tuple(cell.strip() for cell in line.strip("| ").split("|")[1:])
        for line in text.splitlines()
    }
    assert {
        ("a (default)", "pid"),
        ("3.00 / 3.00, 1.12; 1; 1 lost", "**2.00** / **2.00**, **1.00**"),
        ("0 / 0, 0", "2 / 2, 2"),
        ("–", "0.50 / 0.25; 80 ms"),
        ("0.10 to 0.10", "0.10 to 0.10"),
    } <= cells
    json.dumps(result.as_dict(), allow_nan=False)


def test_laws_that_print_the_same_are_both_the_best():
    place = FlightCondition("hard", "rtk")
    runs = {(place, "a"): of([1.001]), (place, "b"): of([1.004]), (place, "c"): of([1.006])}
    result = LawMatrix(("a", "b", "c"), {place: (1,)}, "", {place: "calm\nGPS"}, runs,
                        dict.fromkeys("abc"))  # fmt: skip
    text = laws_everywhere({"laws_everywhere": result.as_dict()})
    assert "| 2 / 2, 2 | 2 / 2, 2 | 0 / 0, 2 |" in text


@pytest.mark.parametrize("name", ["pid", "hinf_output", "hinf"])
def test_margins_are_those_that_the_law_is_judged_by(name):
    """And a loop slower by what it survives of further delay is at the brink, by its poles."""
    nodes = resolve("attitude_gusts", "rtk", laws=name).nodes
    config = AttitudeConfig.from_parameters(nodes["inner_loop"])
    margins = margins_as_flown(nodes)
    if name != "hinf":  # which is judged without the observer
        assert margins.input == pytest.approx(config.judgement.disk_input, rel=0.01)
        assert margins.output == pytest.approx(config.judgement.disk_output, rel=0.01)
    loop, actuation = loop_as_flown(nodes), config.actuation
    for share, stable in ((0.99, True), (1.01, False)):
        later = replace(actuation, delay_s=actuation.delay_s + share * margins.delay_s)
        slower = replace(loop, plant=sampled_plant(model_of(config), later))
        assert bool(np.abs(slower.closed.poles()).max() < 1.0) == stable


def test_laws_that_fly_the_same_are_flown_once():
    laws = compare_flights.parse_laws("all")
    assert len(laws) == len(LAWS.names()) - 1
    assert "packaged" not in laws  # one of the others by its own name
    assert len(compare_flights.parse_laws("packaged,hinf,hinf_output")) == 3


@pytest.mark.parametrize(
    ("laws", "expected"),
    [("pid,mpc", "--control-preset mpc: unknown control preset"), ("pid,pid", "twice")],
)
def test_laws_that_are_none_are_refused(laws, expected, capsys):
    assert main(["compare", "laws", "--control-preset", laws]) == 2
    assert expected in capsys.readouterr().err
    with pytest.raises(ParameterError):
        compare_flights.parse_laws(laws)


def test_the_command_draws_and_writes(tmp_path, capsys):
    words = [
        "--control-preset",
        "pid",
        "--worlds",
        "paper",
        "--seeds",
        "1",
        "--n",
        "0",
        "--duration",
        "8",
    ]
    assert main(["compare", "laws", *words, "--out", str(tmp_path / "laws")]) == 0
    assert (tmp_path / "laws" / "laws.png").stat().st_size > 10000
    assert json.loads((tmp_path / "laws" / "laws.json").read_text())["laws"] == ["pid"]
    assert "(1), pitch" in " ".join(capsys.readouterr().out.split())
