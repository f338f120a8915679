# SPDX-License-Identifier: Apache-2.0
"""Worlds: what is drawn per seed and what is not, files, and that a flight says its world."""

import json

import numpy as np
import pytest

from heli_core.command_line import config_folder
from heli_core.rcl_yaml import ParameterError
from heli_core.rows import REFERENCE
from heli_dynamics_sim.config import PlantConfig
from heli_flight.layers import hover_test_world
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_flight.worlds import DRAWN, HOVER_TEST_WORLD, WORLDS, Draw
from heli_studies.campaign.run import fly_seeds

SEEDS = range(400)


def drawn(settings):
    return {key: settings.nodes["plant"][key] for key in DRAWN}


@pytest.mark.parametrize("number", range(5))
def test_scales_are_uniform_over_their_range(number):
    """Mean, spread and extremes of the uniform distribution on 0.7 to 1.3; four sigma of 400."""
    scales = np.array([Draw(DRAWN[number], 1.0, 0.3).value(seed) for seed in SEEDS])
    sigma = 0.6 / np.sqrt(12.0)
    assert scales.min() >= 0.7 and scales.max() <= 1.3
    assert scales.min() < 0.72 and scales.max() > 1.28
    assert scales.mean() == pytest.approx(1.0, abs=4.0 * sigma / np.sqrt(400.0))
    assert scales.std() == pytest.approx(sigma, rel=0.12)


def test_delays_are_whole_ticks_each_as_likely():
    delays = [Draw("delay_ticks", 1, 1).value(seed) for seed in SEEDS]
    assert all(isinstance(value, int) for value in delays)
    counts = [delays.count(ticks) for ticks in (0, 1, 2)]
    assert sum(counts) == 400 and min(counts) > 95
    assert {Draw("delay_ticks", 1, 3).value(seed) for seed in SEEDS} == {0, 1, 2, 3, 4}


def test_draws_are_independent_of_each_other():
    table = np.array([[Draw(key, 1.0, 0.1).value(seed) for key in DRAWN[:5]] for seed in SEEDS])
    assert np.abs(np.corrcoef(table.T) - np.eye(5)).max() < 0.2
    values = [Draw(key, 1.0, 0.1).value(3) for key in DRAWN[:5]]
    assert len(set(values)) == 5


def test_the_papers_world_draws_nothing_and_changes_nothing():
    paper = resolve(seed=3, world="paper")
    assert paper.drawn == {} and set(drawn(paper).values()) == {1.0}
    np.testing.assert_equal(dict(paper.nodes), dict(resolve(seed=3).nodes))


@pytest.mark.parametrize(("world", "width"), [("honest", 0.1), ("hard", 0.3)])
def test_the_aircraft_is_drawn_and_the_controllers_keep_theirs(world, width):
    settings, paper = resolve(seed=3, world=world), resolve(seed=3)
    for key in DRAWN[:5]:
        assert 0.0 < abs(settings.nodes["plant"][key] - 1.0) <= width
    for name in ("inner_loop", "outer_loop"):
        changed = {
            key for key, value in settings.nodes[name].items()
            if not np.array_equal(value, paper.nodes[name][key])
        }  # fmt: skip
        assert changed <= {"reference_anchor"}
    assert settings.nodes["observer"]["u_delay_ticks"] == 1
    flown = PlantConfig.from_parameters(settings.nodes["plant"]).helicopter
    assert flown.mass_kg == pytest.approx(9.75 * settings.nodes["plant"]["scale.mass"])


def test_another_seed_is_another_aircraft_in_a_campaign_too():
    first = resolve(seed=1, world="hard")
    for seed in (2, 5):
        again = first.with_seed(seed)
        assert drawn(again) == drawn(resolve(seed=seed, world="hard")) != drawn(first)
    short = resolve(seed=1, duration_s=8.0, world="honest")
    (flight,) = fly_seeds(short, [4])
    alone = resolve(seed=4, duration_s=8.0, world="honest")
    (same,) = fly_seeds(alone, [4])
    assert flight == same


def test_what_a_file_or_an_override_says_is_not_drawn(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("/**/plant:\n  ros__parameters:\n    scale.mass: 1.2\n")
    settings = resolve(seed=1, world="hard", params=[file])
    assert settings.nodes["plant"]["scale.mass"] == 1.2
    assert settings.with_seed(2).nodes["plant"]["scale.mass"] == 1.2
    overridden = resolve(seed=1, world="hard", overrides={"plant": {"delay_ticks": 3}})
    assert (
        overridden.nodes["plant"]["delay_ticks"]
        == overridden.with_seed(8).nodes["plant"]["delay_ticks"]
    )


def test_what_an_override_of_the_world_draws_is_flown_and_which_sensors_it_has():
    """Not reported alone: the plant has it, another seed draws another one, the grade is flown."""
    width = {"draw.mass": 0.3, "sensors.rtk": "industrial"}
    settings = resolve("hover", "rtk", seed=5, world="honest", overrides={"world": width})
    asked = Draw("scale.mass", 1.0, 0.3)
    for seed in (5, 6):
        flown = settings.with_seed(seed)
        assert flown.nodes["plant"]["scale.mass"] == asked.value(seed)
        config = PlantConfig.from_parameters(flown.nodes["plant"])
        assert config.helicopter.mass_kg == pytest.approx(9.75 * asked.value(seed))
    none = {f"draw.{key.removeprefix('scale.')}": 0.0 for key in DRAWN[:5]}
    none["draw.delay_ticks"] = 0
    still = resolve("hover", "rtk", seed=5, world="honest", overrides={"world": none})
    assert still.drawn == {} and set(drawn(still).values()) == {1.0}
    grade = config_folder("heli_dynamics_sim") / "sensors_industrial.yaml"
    named = resolve("hover", "rtk", seed=5, params=[grade]).nodes
    for node, section in (("plant", "sensors."), ("observer", "ekf.imu")):
        same = {key for key in named[node] if key.startswith(section)}
        for key in same:
            assert np.array_equal(settings.nodes[node][key], named[node][key]), key


def test_a_world_of_ones_own_says_only_what_differs(tmp_path):
    file = tmp_path / "my_world.yaml"
    file.write_text("/**/world:\n  ros__parameters:\n    draw.mass: 0.2\n"
                    "/**/plant:\n  ros__parameters:\n    wind.turbulence: false\n")  # fmt: skip
    settings = resolve("attitude", seed=6, world=str(file))
    assert set(settings.drawn) == {"scale.mass"}
    assert settings.world == str(file)
    # The scenario says that there is turbulence, and is stronger.
    assert settings.nodes["plant"]["wind.turbulence"] is True


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("/**/world:\n  ros__parameters:\n    draw.mas: 0.2\n", "did you mean 'draw.mass'"),
        ("/**/world:\n  ros__parameters:\n    draw.mass: 0.9\n", "allowed: a double in [0, 0.8]"),
        ("/**/plants:\n  ros__parameters:\n    seed: 2\n", "plants"),
    ],
)
def test_a_world_that_cannot_be_used_is_named(tmp_path, text, expected):
    file = tmp_path / "bad.yaml"
    file.write_text(text)
    with pytest.raises(ParameterError) as error:
        resolve(world=str(file))
    assert expected in str(error.value) and "bad.yaml" in str(error.value)


def test_an_unknown_world_is_refused_with_those_that_are_known():
    with pytest.raises(ParameterError, match=f"--world heavy: .*: {', '.join(WORLDS.names())}"):
        resolve(world="heavy")


def test_a_flight_says_its_world_and_what_was_drawn_and_flies_again(fly, tmp_path, capsys):
    code, first = fly(tmp_path / "a", "--one-process", "--world", "honest", "--seed", 3, "--json")
    out, err = capsys.readouterr()
    settings = resolve(seed=3, world="honest")
    assert json.loads(out) == first
    assert first["world"] == "honest" and first["draw"] == drawn(settings)
    assert "honest" in first["conditions"][0]
    assert f"mass {first['draw']['scale.mass']:.3f}" in " ".join(err.split())
    assert first["changed"] == []
    # Again, from its own file, and with another seed: then that one draws.
    params = ("--params", tmp_path / "a" / "params.yaml")
    code_again, again = fly(tmp_path / "b", *params)
    assert code_again == code
    same = ["world", "draw", "metrics", "changed", "conditions", "seed"]
    assert {k: again[k] for k in same} == {k: first[k] for k in same}
    files = [(tmp_path / name / "params.yaml").read_bytes() for name in "ab"]
    assert files[0] == files[1]
    _, other = fly(tmp_path / "c", *params, "--seed", 4, "--duration", 6)
    assert other["draw"] == drawn(resolve(seed=4, world="honest"))
    # And in another world: what the first one had packaged stays behind.
    _, elsewhere = fly(tmp_path / "d", *params, "--world", "paper", "--duration", 6)
    assert (elsewhere["world"], elsewhere["draw"], elsewhere["changed"]) == ("paper", {}, [])


def test_the_hover_test_alone_has_a_default_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setattr("heli_flight.layers.HOVER_TEST_WORLD", "hard")
    assert hover_test_world(None, None, []) == hover_test_world(None, "hover", []) == "hard"
    assert hover_test_world("paper", None, []) == "paper"
    assert hover_test_world(None, "attitude", []) is None
    file = tmp_path / "told.yaml"
    for text, world in (("world: honest", None), ("commit: abc", None), ("gps: rtk", "hard"),
                        ("scenario: attitude", None)):  # fmt: skip
        file.write_text(f"/**/flight:\n  ros__parameters:\n    {text}\n")
        assert hover_test_world(None, None, [file]) == world
    assert HOVER_TEST_WORLD in WORLDS.names()


def test_in_an_honest_world_hover_begins_where_the_aircraft_is():
    """Not with a step by the receiver's first error, 1.61 m of seed 1: flown off faster than the
    paper's 0.3 m/s, which the following of that receiver's noise stays below."""
    stepped, begun = (simulate(resolve(seed=1, duration_s=5.0, world="paper", overrides=change))
                      .record for change in
                      ({}, {"outer_loop": {"reference_anchor": "engagement"}}))  # fmt: skip
    first = [r.nav_pos_ned_m[0] - r.reference[0, REFERENCE.pos] for r in (stepped, begun)]
    assert np.abs(first[0][0]) > 1.5
    np.testing.assert_allclose(first[1], 0.0, atol=1e-12)
    speeds = [np.abs(r.truth_vel_ned_mps[:, 0]).max() for r in (stepped, begun)]
    assert speeds[0] > 2.0 * speeds[1] and speeds[1] < 0.3
