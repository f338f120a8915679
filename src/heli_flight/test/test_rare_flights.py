# SPDX-License-Identifier: Apache-2.0
"""A metric as a function of normal scores: which flight it is, and what it is if none was flown."""

import numpy as np
import pytest
from scipy import stats

from heli_core.rcl_yaml import ParameterError
from heli_flight.loop import simulate
from heli_studies.campaign import spec as rows
from heli_studies.campaign.rare import LAST_SEED, Flights, Points, asked_of, check_reach
from heli_studies.campaign.run import Store
from heli_studies.campaign.spec import fly_rows, spec_of, write_rerun_files
from heli_studies.campaign.workers import fly_here

TEXT = """flights: 1
world: paper
gps: rtk
duration_s: 3.0
chunk: 2
set: {scenario.score.windows_s: [1.0, -1.0]}
disperse:
  plant.scale.mass: {uniform: [0.9, 1.1]}
  plant.scale.inertia: {truncated_normal: [1.0, 0.05, 0.5, 1.5]}
  aircraft.main_rotor.hub_stiffness_nmprad: {normal: [113.0, 5.0]}
"""
NAME = "altitude (truth)"


def spec_from(folder, text):
    path = folder / "spec.yaml"
    path.write_text(text)
    return spec_of(path)


@pytest.fixture
def spec(tmp_path):
    return spec_from(tmp_path, TEXT)


def test_scores_are_quantiles_of_the_distributions(spec):
    points = Points.of(spec, np.array([[0.0, 0.0, 0.0, 0.0], [1.0, -1.0, 2.0, 30.0]]))
    assert points.inputs[0] == pytest.approx([1.0, 1.0, 113.0])
    assert points.inputs[1] == pytest.approx([0.9 + 0.2 * stats.norm.cdf(1.0), 0.95, 123.0])
    assert [points.flight_seed(n) for n in (0, 1)] == [1 + LAST_SEED // 2, LAST_SEED]
    assert points.settings(1).nodes["plant"]["scale.mass"] == points.inputs[1][0]


def test_scores_keep_the_correlation_of_the_spec(tmp_path):
    text = TEXT + "correlate:\n  - [plant.scale.inertia, plant.scale.mass, 0.8]\n"
    points = Points.of(spec_from(tmp_path, text), np.array([[1.0, 0.5, 0.0]]))
    # Cholesky in the order of the spec: the second score becomes 0.8 of the first + 0.6 of its own.
    assert points.inputs[0][1] == pytest.approx(1.0 + 0.05 * (0.8 + 0.6 * 0.5))


def test_a_seed_of_its_own_is_one_more_score_and_a_given_one_none(spec, tmp_path):
    assert Points.of(spec, np.zeros((1, 3))).flight_seed(0) == 1
    seeded = spec_from(tmp_path, TEXT + "flight_seeds: 7\n")
    assert Points.of(seeded, np.ones((1, 3))).flight_seed(0) == 7


def test_a_value_is_the_metric_of_the_flight_that_flies_again(spec, tmp_path):
    store = Store.begin(tmp_path / "out", Points.of(spec), tmp_path / "spec.yaml", resumes=False)
    flights = Flights(spec, asked_of(spec, NAME), store.put, marks={"level": 3})
    scores = np.random.default_rng(1).standard_normal((5, 4))
    first, last = flights(scores[:3]), flights(scores[3:])
    table = store.table()
    assert table["flight"].to_pylist() == list(range(5)) and set(table["level"].to_pylist()) == {3}
    assert table[f"max.{NAME}"].to_pylist() == [*first, *last]
    points, values = flights.all()
    (path,) = write_rerun_files(points, [4], tmp_path / "worst")
    from heli_flight.settings import resolve

    settings = resolve(params=[path])
    assert settings.seed == table["seed"].to_pylist()[4]
    figures = rows.score(simulate(settings).record, settings.scenario).windows
    assert {s.name: s.max for s in figures}[NAME] == values[4] == last[1]
    with pytest.raises(ParameterError, match=str(tmp_path / "out")):
        Store.resume(tmp_path / "out", spec)


def flown(spec, numbers, lost=()):
    """Rows as of `fly_rows`, without flying: the metric is the mass."""
    flights = []
    for number in numbers:
        row = rows._begun(spec, number)
        if number in lost:
            flights.append(row | rows._end(rows.FlightEnding.LOST, "It fell."))
        else:
            row |= rows._end(rows.FlightEnding.FLOWN, "", 0)
            flights.append(row | {f"max.{NAME}": row["in.plant.scale.mass"]})
    return flights


def test_values_do_not_depend_on_who_flies_when(spec):
    def backwards(spec, todo):
        for numbers in reversed(list(todo)):
            yield flown(spec, list(reversed(numbers)))

    def ahead(spec, todo):
        for numbers in todo:
            yield flown(spec, numbers)

    scores = np.random.default_rng(2).standard_normal((37, 4))
    asked, kept = asked_of(spec, NAME), []
    values = [Flights(spec, asked, kept.append, fly)(scores) for fly in (ahead, backwards)]
    assert np.array_equal(values[0], values[1])
    assert values[0] == pytest.approx(0.9 + 0.2 * stats.norm.cdf(scores[:, 0]))


def test_what_did_not_fly_is_beyond_every_bound_with_its_cause(spec):
    def fly(spec, todo):
        for numbers in todo:
            yield flown(spec, numbers, lost={1})

    kept = []
    flights = Flights(spec, asked_of(spec, NAME), kept.extend, fly)
    assert np.isinf(flights(np.zeros((3, 4)))).tolist() == [False, True, False]
    assert flights.causes == {"flown": 2, "lost": 1}
    assert kept[1]["sentence"] == "It fell."


def test_a_flight_that_throws_is_beyond(spec, monkeypatch):
    def fly(settings):
        raise ZeroDivisionError("said")

    monkeypatch.setattr(rows, "simulate", fly)
    flights = Flights(spec, asked_of(spec, NAME), lambda rows: None)
    assert flights(np.zeros((1, 4))).tolist() == [np.inf] and flights.causes == {"threw": 1}
    assert fly_here.__module__.endswith("workers") and fly_rows(spec, [0])[0]["cause"] == "threw"


def test_a_metric_is_known_before_anything_flies(spec, tmp_path):
    assert asked_of(spec, NAME).bound == 0.4 and asked_of(spec, NAME, 0.7).bound == 0.7
    with pytest.raises(ParameterError, match=r" altitude \(truth\)\?"):
        asked_of(spec, "altitude (true)")
    with pytest.raises(ParameterError, match="--beyond: nan"):
        asked_of(spec, NAME, float("nan"))
    short = spec_from(tmp_path, TEXT.replace("[1.0, -1.0]", "[5.0, -1.0]"))
    with pytest.raises(ParameterError, match="duration_s"):
        asked_of(short, NAME)


def test_a_distribution_that_leaves_what_is_allowed_is_refused(tmp_path):
    check_reach(spec_from(tmp_path, TEXT))
    wide = spec_from(tmp_path, TEXT.replace("uniform: [0.9, 1.1]", "normal: [1.0, 0.2]"))
    with pytest.raises(ParameterError, match="scale.mass: -0.2.*6 sigma"):
        check_reach(wide)
    check_reach(wide, 3.0)
    with pytest.raises(ParameterError, match="disperse: nothing"):
        check_reach(spec_from(tmp_path, TEXT[: TEXT.index("disperse")]))
