# SPDX-License-Identifier: Apache-2.0
"""A campaign's spec: what it means, and one sentence for each that means nothing."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from heli_core.rcl_yaml import ParameterError
from heli_studies.campaign.spec import correlated, distribution_of, spec_of, unit_points

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "campaign_small.yaml"


@pytest.fixture
def spec(tmp_path):
    def made(text):
        path = tmp_path / "spec.yaml"
        path.write_text(text)
        return spec_of(path)

    return made


# --- distributions -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("distribution", "frozen"),
    [
        ({"uniform": [2.0, 5.0]}, stats.uniform(2.0, 3.0)),
        ({"normal": [1.0, 0.25]}, stats.norm(1.0, 0.25)),
        ({"truncated_normal": [1.0, 0.5, 0.5, 2.5]}, stats.truncnorm(-1.0, 3.0, 1.0, 0.5)),
    ],
)
def test_values_are_distributed_as_told(distribution, frozen):
    values = distribution_of(distribution, "double", "here").values(
        np.random.default_rng(1).random(4000)
    )
    assert stats.kstest(values, frozen.cdf).pvalue > 0.01


def test_whole_numbers_and_choices_are_equally_likely():
    share = (np.arange(600) + 0.5) / 600
    whole = distribution_of({"uniform": [1, 3]}, "int", "here").values(share)
    named = distribution_of({"choice": ["a", "b", "c"]}, "string", "here").values(share)
    assert [whole.count(n) for n in (1, 2, 3)] == [200] * 3 and isinstance(whole[0], int)
    assert [named.count(n) for n in "abc"] == [200] * 3
    assert whole[-1] == 3 and distribution_of({"uniform": [1, 3]}, "int", "").levels(9) == [1, 2, 3]


def test_no_share_makes_an_infinite_value():
    values = distribution_of({"normal": [0.0, 1.0]}, "double", "here").values(np.array([0.0, 1.0]))
    assert np.isfinite(values).all()


# --- sampling ------------------------------------------------------------------------------------


def test_each_stratum_of_a_latin_hypercube_holds_one_point():
    points = unit_points("latin_hypercube", 50, 3, 7)
    assert all(sorted((column * 50).astype(int)) == list(range(50)) for column in points.T)


def test_sobol_points_are_more_even_than_random_ones():
    even, random = (unit_points(name, 256, 2, 3) for name in ("sobol", "random"))
    miss = [stats.qmc.discrepancy(points) for points in (even, random)]
    assert miss[0] < 0.2 * miss[1]
    with pytest.raises(ParameterError, match="allowed: 64, 128"):
        unit_points("sobol", 100, 2, 3)


def test_a_seed_makes_the_same_points_and_another_one_others():
    a, b, c = (unit_points("random", 8, 2, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert not np.allclose(a, c)


@pytest.mark.parametrize("rho", [-0.9, 0.5, 0.8])
def test_columns_correlate_as_told_and_stay_uniform(rho):
    points = correlated(unit_points("random", 8000, 3, 5), [(0, 2, rho)])
    correlation = stats.spearmanr(points[:, 0], points[:, 2]).statistic
    assert correlation == pytest.approx(6.0 / math.pi * math.asin(rho / 2.0), abs=0.02)
    assert abs(stats.spearmanr(points[:, 0], points[:, 1]).statistic) < 0.03
    assert all(stats.kstest(column, "uniform").pvalue > 0.01 for column in points.T)


# --- specs ---------------------------------------------------------------------------------------


def test_the_example_says_what_each_flight_is(tmp_path):
    spec = spec_of(EXAMPLE)
    assert len(spec.inputs) == 32 and len(spec.names) == 5
    settings = spec.settings(3)
    row = dict(zip(spec.names, spec.inputs[3], strict=True))
    assert settings.nodes["plant"]["scale.mass"] == row["plant.scale.mass"]
    assert settings.nodes["plant"]["wind.w20_mps"] == 5.0 and settings.seed == 4
    assert spec.aircraft(3)["flapping.flap_back_radpmps"] == row[spec.names[-1]]
    assert {row[2] for row in spec.inputs} == {1, 2, 3}


def test_a_grid_is_the_product_of_its_levels(spec):
    grid = spec(
        "sampling: grid\nlevels: 3\nflight_seeds: 7\ndisperse:\n"
        "  plant.scale.mass: {uniform: [0.8, 1.2]}\n  plant.delay_ticks: {uniform: [0, 1]}\n"
        "  inner_loop.controller: {choice: [hinf, pid]}\n"
    )
    assert len(grid.inputs) == 12 and grid.inputs[0] == [0.8, 0, "hinf"]
    assert grid.inputs[-1] == [1.2, 1, "pid"] and grid.flight_seed(5) == 7


def test_an_element_of_an_array_is_dispersed_alone(spec):
    made = spec(
        "flights: 2\nsampling: random\nset: {'plant.wind.profile_speed_mps[0]': 2.5}\n"
        "disperse: {'plant.wind.profile_speed_mps[2]': {uniform: [6.0, 7.0]}}\n"
    )
    speeds = made.settings(1).nodes["plant"]["wind.profile_speed_mps"]
    assert np.ravel(speeds)[0] == 2.5 and 6.0 < np.ravel(speeds)[2] < 7.0
    assert np.ravel(speeds)[1] == np.ravel(made.base.nodes["plant"]["wind.profile_speed_mps"])[1]


def test_another_number_is_another_campaign(spec):
    text = "flights: 2\ndisperse: {{plant.scale.mass: {{uniform: [0.8, {}]}}}}\nchunk: {}\n"
    first, tasks, other = (spec(text.format(*n)).identity for n in ((1.2, 4), (1.2, 8), (1.3, 4)))
    assert first == tasks != other


MASS = "disperse: {plant.scale.mass: "


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("flight: 3", ["flight: unknown key", "did you mean flights?"]),
        ("flights: 2.5", ["flights: 2.5", "an integer from 0"]),
        ("sampling: random", ["flights: missing"]),
        ("flights: 2\nsampling: lattice", ["sampling: 'lattice'", "latin_hypercube"]),
        ("flights: 2\nworld: moon", ["moon", "paper"]),
        ("flights: 2\ngps: dgps", ["gps: 'dgps'", "standalone, rtk"]),
        ("flights: 2\nscenario: hovr", ["hovr", "unknown scenario"]),
        (f"flights: 2\n{MASS}{{uniform: [1.2, 0.8]}}}}", ["[1.2, 0.8]", "low < high"]),
        (f"flights: 2\n{MASS}{{normal: [1.0, .nan]}}}}", ["normal: [1.0, nan]", "sigma > 0"]),
        (f"flights: 2\n{MASS}{{gauss: [1.0, 0.1]}}}}", ["gauss", "uniform, normal"]),
        (f"flights: 2\n{MASS}{{uniform: [0.8, 99.0]}}}}", ["scale.mass", "0.2", "5"]),
        ("flights: 2\ndisperse: {plant.scale.mas: {uniform: [1, 2]}}", ["scale.mass?"]),
        ("flights: 2\ndisperse: {plnt.scale.mass: {uniform: [1, 2]}}", ["plant?"]),
        ("flights: 2\ndisperse: {aircraft.body.mas: {uniform: [1, 2]}}", ["body.mass_kg?"]),
        ("flights: 2\ndisperse: {plant.delay_ticks: {uniform: [0.5, 2]}}", ["whole numbers"]),
        ("flights: 2\ndisperse: {plant.delay_ticks: {normal: [1, 1]}}", ["uniform, choice"]),
        ("flights: 2\ndisperse: {inner_loop.controller: {choice: [hinf, lqx]}}", ["lqx"]),
        ("flights: 2\ndisperse: {inner_loop.controller: {uniform: [0, 1]}}", ["choice"]),
        ("flights: 2\ndisperse: {plant.wind.profile_speed_mps: {uniform: [0, 1]}}", ["[0]"]),
        ("flights: 2\ndisperse: {'plant.wind.profile_speed_mps[9]': {uniform: [0, 1]}}", ["[2]"]),
        (f"flights: 2\n{MASS}{{uniform: [0.8, 1.2]}}}}\ncorrelate: [[a, b, 2]]", ["between -1"]),
        (f"flights: 2\n{MASS}{{uniform: [0.8, 1.2]}}}}\ncorrelate: [[a, b, 0.2]]", ["a: unknown"]),
        ("flights: 100\nsampling: sobol\n" + MASS + "{uniform: [0.8, 1.2]}}", ["64, 128"]),
        (f"sampling: grid\nflights: 7\n{MASS}{{uniform: [0.8, 1.2]}}}}", ["5"]),
        ("flights: 2\nset: {'plant.wind.profile_speed_mps[1]': [1, 2]}", ["allowed: a number"]),
        ("flights: 2\nset: {'plant.wind.profile_speed_mps[9]': 1.0}", ["[0] to [2]"]),
        ("flights: 2\nset: {'plant.nope[1]': 1.0}", ["set: plant.nope: unknown key"]),
        ("flights: 2\nset: {'plnt.wind[1]': 1.0}", ["set: plnt", "plant?"]),
        ("flights: 2\nset: {'plant.aircraft_file[0]': 1}", ["allowed: plant.aircraft_file"]),
        ("flights: 2\nfaults: nowhere.yaml", ["nowhere.yaml", "cannot read faults"]),
        ("flights: [", ["flow"]),
        ("- 1", ["holds no keys"]),
    ],
)
def test_a_spec_that_cannot_be_flown_is_one_sentence(spec, text, words):
    with pytest.raises(ParameterError) as error:
        spec(text)
    assert "\n" not in str(error.value)
    assert all(word in str(error.value) for word in ["spec.yaml", *words]), str(error.value)


def test_correlations_that_nothing_has_are_told(spec):
    keys = ("plant.scale.mass", "plant.scale.inertia", "plant.scale.thrust")
    disperse = "".join(f"  {key}: {{uniform: [0.9, 1.1]}}\n" for key in keys)
    pairs = [(0, 1, 0.9), (0, 2, 0.9), (1, 2, -0.9)]
    correlations = ", ".join(f"[{keys[a]}, {keys[b]}, {rho}]" for a, b, rho in pairs)
    with pytest.raises(ParameterError, match="positive definite"):
        spec(f"flights: 4\ndisperse:\n{disperse}correlate: [{correlations}]\n")
