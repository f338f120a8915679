# SPDX-License-Identifier: Apache-2.0
"""The environments are what Gymnasium asks for, and many aircraft fly as each would alone."""

import subprocess
import sys
import warnings

import numpy as np
import pytest

import heli

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402

import heli.gym  # noqa: E402
from heli.environments import TASKS  # noqa: E402

NAMES = sorted(heli.gym.ENVIRONMENTS)


@pytest.mark.parametrize("name", NAMES)
def test_gymnasium_finds_nothing_wrong(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # No limit of what is observed is known, which it warns of.
        warnings.filterwarnings("ignore", message=".*Box observation space.*")
        check_env(gymnasium.make(name).unwrapped, skip_render_check=True)


def many(name="heli/Hover-v0", n=3, **options):
    mode = {"vectorization_mode": "vector_entry_point"}
    return gymnasium.make_vec(name, num_envs=n, **mode, **options)


@pytest.mark.parametrize("name", NAMES)
def test_many_fly_as_each_would_alone(name):
    envs, alone = many(name), gymnasium.make(name)
    rows, _ = envs.reset(seed=7)
    row, _ = alone.reset(seed=8)
    random = np.random.default_rng(1)
    for _ in range(150):
        assert rows[1].tobytes() == row.tobytes()
        actions = 0.02 * random.standard_normal(envs.action_space.shape).astype(np.float32)
        rows, rewards, over, _, _ = envs.step(actions)
        row, reward, ended, _, _ = alone.step(actions[1])
        assert rewards[1] == reward and over[1] == ended
        if over.any():
            break


@pytest.mark.parametrize("threads", [1, 2])
def test_an_episode_ends_and_begins_anew(threads):
    envs = many(max_episode_steps=60, threads=threads)
    first, _ = envs.reset(seed=1)
    actions = np.zeros(envs.action_space.shape, np.float32)
    actions[0, 1] = 1.0  # tips over
    ended = []
    for _ in range(125):
        rows, rewards, terminated, truncated, _ = envs.step(actions)
        ended.append(terminated | truncated)
        assert np.isfinite(rows).all() and not (terminated & truncated).any()
    ended = np.array(ended)
    assert list(np.flatnonzero(ended[:, 1])) == [59, 120]
    assert ended[:59, 0].any()
    assert envs.reset(seed=1)[0].tobytes() == first.tobytes()


def test_its_flight_is_that_of_the_simulation():
    env = gymnasium.make("heli/Hover-v0", flights=1)
    _, info = env.reset(seed=3)
    assert info["names"] == TASKS["hover"].names
    fleet = env.unwrapped._fleet
    sim = heli.Simulation(scenario="hover", world="paper", seed=int(fleet._seeds[0, 0]), quiet=True)
    obs = sim.reset()
    u = obs.u.row
    for _ in range(20):
        row = env.step(np.zeros(4, np.float32))[0]
        for _ in range(2):
            obs = sim.step(actuators=u)
    north, east, down = obs.truth.pos_ned_m
    assert row[:3] == pytest.approx([north, east, down + 10.0], abs=1e-6)


def test_attitudes_and_navigation_fly_too():
    envs = many(command="attitude", observe="nav", ticks=4)
    envs.reset(seed=2)
    for _ in range(100):
        rows, rewards, over, _, _ = envs.step(np.zeros((3, 4), np.float32))
    assert not over.any() and np.abs(rows[:, 6:8]).max() < 0.2 and rewards.shape == (3,)


@pytest.mark.parametrize(
    ("name", "options", "named"),
    [
        ("heli/Hover-v0", {"command": "thrust"}, "command"),
        ("heli/Hover-v0", {"observe": "all"}, "observe"),
        ("heli/Hover-v0", {"ticks": 0}, "ticks"),
        ("heli/Hover-v0", {"aircraft": "boeing"}, "aircraft"),
        ("heli/Attitude-v0", {"command": "attitude"}, "command"),
    ],
)
def test_what_is_no_option_is_named(name, options, named):
    with pytest.raises(heli.ParameterError, match=named):
        gymnasium.make(name, **options)


def test_without_gymnasium_a_sentence_says_what_to_install():
    code = "import sys; sys.modules['gymnasium'] = None; import heli.gym"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1 and "pip install 'heli-hover[gym]'" in done.stderr
