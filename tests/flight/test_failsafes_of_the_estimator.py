# SPDX-License-Identifier: Apache-2.0
"""The row ESTIMATOR_DIVERGED, flown: a filter whose state is spoilt in flight goes on by itself.

Nothing in a flight spoils it, so the test does, between two ticks.
"""

import numpy as np
import pytest

from heli_flight.loop import build, fly, fly_loop
from heli_flight.settings import resolve
from heli_observer import layout as L
from heli_observer.fault_detection import forget, is_state
from heli_observer.layout import ObserverStatus
from heli_observer.observer import status
from heli_outer_pd.failsafes import Condition, of

AT, N_TICKS = 1503, 3000


def nan_state(state):
    state.nominal[L.NOMINAL.vel] = np.nan


def nan_covariance(state):
    state.P[L.ERROR.att, L.ERROR.att] = np.nan


def negative(state):
    state.P[L.ERROR.pos + 2, L.ERROR.pos + 2] *= -1.0


def no_covariance(state):
    state.P[L.ERROR.att, L.ERROR.vel] = state.P[L.ERROR.vel, L.ERROR.att] = 1e3


def no_quaternion(state):
    state.nominal[L.NOMINAL.quat : L.NOMINAL.quat + 4] = 0.0


def absurd(state):
    state.nominal[L.NOMINAL.vel + 1] = 1e6


def nan_rotor(state):
    state.rotor[0] = np.nan


class Flown:
    """A hover; before tick AT the observer's state is spoilt."""

    def __init__(self, seed, *spoil, tick=AT):
        settings = resolve("hover", "standalone", seed, 0.01 * N_TICKS, world="paper")
        self.loop, self.late = build(settings), []
        self._spoil, self._tick = spoil, tick
        flight = fly_loop(self.loop, settings, ticks=self._ticks)
        assert flight.status == 0, flight.sentence
        self.record, self.count = flight.record, self.loop.observer_s.count

    def _ticks(self, loop, first, count, rows, *rest):
        before = self._tick - first
        if not 0 <= before < count:
            return fly(loop, first, count, rows, *rest)
        if before:
            assert fly(loop, first, before, rows[:before], *rest) == (before, 0)
        for spoil in self._spoil:
            spoil(loop.observer_s)
        # Tick by tick: how long nothing is known.
        for number in range(before, count):
            flown, code = fly(loop, first + number, 1, rows[number : number + 1], *rest)
            if status(loop.observer_s, loop.observer_k) == ObserverStatus.NOT_FINITE:
                self.late.append(first + number)
            if (flown, code) != (1, 0):
                return number + flown, code
        return count, 0


@pytest.fixture(scope="module")
def sound():
    return {seed: Flown(seed) for seed in (1, 2)}


SPOILT = [nan_state, nan_covariance, negative, no_covariance, no_quaternion, absurd]


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("spoil", SPOILT)
def test_it_goes_on_in_the_same_tick_from_what_it_knew(sound, spoil, seed):
    """Found at once, no tick without an estimate, and the set-point hardly feels it."""
    flown = Flown(seed, spoil)
    assert flown.count[L.COUNT.recovered] == 1 and flown.count[L.COUNT.realigned] == 0
    assert of(Condition.ESTIMATOR_DIVERGED).within_s >= 0.01 and not flown.late
    before, after = sound[seed].record, flown.record
    np.testing.assert_array_equal(before.truth_pos_ned_m[:AT], after.truth_pos_ned_m[:AT])
    for name, most in (("nav_pos_ned_m", 0.05), ("nav_vel_ned_mps", 0.05), ("setpoint", 0.02)):
        step = np.abs(getattr(after, name)[AT] - getattr(before, name)[AT])
        assert step.max() < most, name
    apart = np.linalg.norm(after.truth_pos_ned_m - before.truth_pos_ned_m, axis=1)
    assert apart.max() < 0.3


@pytest.mark.parametrize("seed", [1, 2])
def test_without_what_it_knew_it_is_aligned_anew(sound, seed):
    """The last command is held until the sensors allow it."""
    flown = Flown(seed, lambda state: forget(state.window), nan_state)
    assert flown.count[L.COUNT.recovered] == 0 and flown.count[L.COUNT.realigned] == 1
    assert 0 < len(flown.late) < 100
    apart = flown.record.truth_pos_ned_m - sound[seed].record.truth_pos_ned_m
    assert np.linalg.norm(apart, axis=1).max() < 6.0
    assert status(flown.loop.observer_s, flown.loop.observer_k) == ObserverStatus.OK


def test_the_rotor_s_states_begin_anew(sound):
    flown = Flown(1, nan_rotor)
    rotor, as_sound = flown.loop.observer_s.rotor, sound[1].loop.observer_s.rotor
    np.testing.assert_allclose(rotor, as_sound, atol=1e-3)
    apart = flown.record.truth_pos_ned_m - sound[1].record.truth_pos_ned_m
    assert np.linalg.norm(apart, axis=1).max() < 0.5


def test_a_sound_flight_never_recovers(sound):
    for flown in sound.values():
        assert not flown.count[[L.COUNT.recovered, L.COUNT.realigned, L.COUNT.not_finite]].any()
        assert is_state(flown.loop.observer_s.nominal, flown.loop.observer_s.P)
