# SPDX-License-Identifier: Apache-2.0
"""Whether the rotor is slow, by samples alone, and what is commanded without an engine."""

import math

import numpy as np
import pytest

from heli_core.rows import NAV, SETPOINT
from heli_flight.settings import resolve
from heli_outer_pd.disturbance import hear_rotor, watch_rotor
from heli_outer_pd.parameters import outer_params
from heli_outer_pd.position_law import autorotate, wanted_sink
from heli_outer_pd.state import (
    BY_HAND,
    MACHINE,
    MEMORY,
    ROTOR_AUTOROTATES,
    ROTOR_DRIVEN,
    ROTOR_LANDED,
    STANDS,
    initial_state,
)

K = outer_params(resolve().nodes["outer_loop"])
PERIOD_S = 0.02
NOISE = np.random.default_rng(1).normal(0.0, 0.001, 1000)


def heard(shares, state=None, at_s=0.0, ground=None):
    """State after samples at 50 Hz, shares of the governed speed; judged after each second one."""
    state = initial_state(K) if state is None else state
    if ground is not None:
        state.machine[MACHINE.guidance] = ground
    for i, share in enumerate(shares):
        hear_rotor(state, at_s + i * PERIOD_S, share * K.rotor.omega, K)
        if i % 2:
            watch_rotor(-10.0, 0.0, K, state)
    return state


def falls(rate, before=20, after=20):
    """A steady speed, then a fall by so much a second, with the noise of the sensor."""
    shares = np.concatenate([np.ones(before), 1.0 - rate * PERIOD_S * np.arange(1, after + 1)])
    return shares + NOISE[: len(shares)]


@pytest.mark.parametrize("rate", [0.13, 0.3, 0.55])
def test_a_rotor_that_loses_its_speed_is_slow(rate):
    assert heard(falls(rate, after=40)).machine[MACHINE.rotor] == ROTOR_AUTOROTATES


@pytest.mark.parametrize(
    "shares",
    [
        np.concatenate([np.ones(20), np.full(50, 0.8)]) + NOISE[:70],
        np.concatenate([np.ones(20), np.zeros(50)]),
        falls(1.5, after=15),
        np.concatenate([np.ones(20) + NOISE[:20], [0.9], np.ones(20) + NOISE[20:40]]),
        np.concatenate([falls(0.13, after=17), np.full(40, 0.96)]),
        np.full(60, 0.8) + NOISE[:60],
        [],
    ],
    ids=["jump", "zero", "too fast", "one sample", "frozen above", "never usual", "silent"],
)
def test_what_no_rotor_does_is_not_believed(shares):
    assert heard(shares).machine[MACHINE.rotor] == ROTOR_DRIVEN


def test_a_gap_is_not_bridged():
    state = heard(falls(0.0))
    heard(np.full(20, 0.9) + NOISE[:20], state, at_s=1.0)
    assert state.machine[MACHINE.rotor] == ROTOR_DRIVEN and state.x[MEMORY.rotor_sound] == 0.0


def test_an_older_sample_changes_nothing():
    state = heard(falls(0.0))
    before = state.copy()
    hear_rotor(state, 0.1, 0.5 * K.rotor.omega, K)
    np.testing.assert_array_equal(state.x, before.x)
    np.testing.assert_array_equal(state.machine, before.machine)


@pytest.mark.parametrize("ground", [STANDS, BY_HAND])
def test_nothing_is_judged_on_the_ground_nor_by_hand(ground):
    assert heard(falls(0.13, after=40), ground=ground).machine[MACHINE.rotor] == ROTOR_DRIVEN


def test_zero_means_never():
    state, k = initial_state(K), K._replace(rotor_slow_share=0.0)
    for i, share in enumerate(falls(0.3, after=100)):
        hear_rotor(state, i * PERIOD_S, share * K.rotor.omega, k)
        watch_rotor(-10.0, 0.0, k, state)
    assert state.machine[MACHINE.rotor] == ROTOR_DRIVEN


def test_down_is_what_sinks_no_more_near_the_ground():
    state = heard(falls(0.13, after=40))
    for _ in range(20):
        watch_rotor(-10.0, 0.0, K, state)
    assert state.machine[MACHINE.rotor] == ROTOR_AUTOROTATES, "too high"
    for _ in range(20):
        watch_rotor(-1.0, 0.7, K, state)
    assert state.machine[MACHINE.rotor] == ROTOR_AUTOROTATES, "it sinks"
    for _ in range(20):
        watch_rotor(-1.0, 0.0, K, state)
    assert state.machine[MACHINE.rotor] == ROTOR_LANDED


def test_the_profile_slows_down_steadily_and_ends_at_the_ground():
    heights = np.linspace(-2.0, 30.0, 3201)
    sinks = np.array([wanted_sink(h)[0] for h in heights])
    assert (np.diff(sinks) >= 0.0).all()
    assert sinks[0] == wanted_sink(0.0)[0] == pytest.approx(0.7) and sinks[-1] == 9.0
    # v dv/dh: never more than a thrust of twice the weight can do.
    braking = sinks[1:] * np.diff(sinks) / np.diff(heights)
    assert braking.max() < K.g
    for h in (0.3, 1.5, 4.0):
        slope = (wanted_sink(h + 1e-6)[0] - wanted_sink(h - 1e-6)[0]) / 2e-6
        assert wanted_sink(h)[1] == pytest.approx(slope, rel=1e-4)


def command(height_m, sink_mps, share):
    state, nav, out = initial_state(K), np.zeros(NAV.size), K.trim.copy()
    state.x[MEMORY.rotor_known] = share
    nav[NAV.pos][2], nav[NAV.down_vel] = -height_m, sink_mps
    out[SETPOINT.phi] = 1.0
    autorotate(nav, K, state, out)
    np.testing.assert_array_equal(state.x[MEMORY.command], out)
    return out


def test_the_collective_falls_at_once_and_rises_as_rotor_and_height_go():
    """A negative collective lifts on this aircraft."""
    entry, flare = command(10.0, 0.0, 0.95), command(1.0, 4.0, 0.8)
    assert entry[SETPOINT.col] > K.trim[SETPOINT.col] + 0.2
    assert flare[SETPOINT.col] < K.trim[SETPOINT.col]
    assert command(1.0, 2.2, 0.6)[SETPOINT.col] < command(1.0, 2.2, 0.8)[SETPOINT.col]
    assert abs(command(0.0, 9.0, 0.2)[SETPOINT.col]) <= 0.98
    assert entry[SETPOINT.phi] == pytest.approx(K.trim[SETPOINT.phi] + math.radians(20.0))
