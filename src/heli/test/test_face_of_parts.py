# SPDX-License-Identifier: Apache-2.0
"""Objects that fly in the place of plant, wind and estimator; what they do wrong is said."""

import numpy as np
import pytest

import heli
from heli_core.rows import MEAS, NAV, TRUTH
from heli_flight.parts import Parts

FLIGHT = {"scenario": "attitude", "duration_s": 4.0, "world": "paper", "quiet": True}


class Part:
    """Keeps what it was begun with."""

    def reset(self, rng, tick_s, nodes):
        self.rng, self.tick_s, self.nodes = rng, tick_s, nodes


class SteadyWind(Part):
    def step(self, tick, time_s, pos_ned_m):
        assert pos_ned_m.shape == (3,) and time_s == pytest.approx(tick * self.tick_s)
        return [3.0, -2.0, 0.0]


class Spoiled(Part):
    """A barometer that drifts by 100 Pa/s; says nothing of its own."""

    def step(self, tick, time_s, truth, y):
        if y[MEAS.baro_valid]:
            y[MEAS.baro] += 100.0 * time_s


class Perfect(Part):
    """An estimator that is told the truth by a sensor."""

    def step(self, tick, time_s, y, u, readings):
        nav = np.zeros(NAV.size)
        nav[NAV.motion] = readings["Truth"][TRUTH.motion]
        nav[NAV.rotor] = readings["Truth"][TRUTH.rotor]
        return nav


class Gale(Part):
    def step(self, tick, time_s, pos_ned_m):
        return [np.nan if tick == 5 else 1.0, 0.0, 0.0]


class Talks(Part):
    def step(self, tick, time_s, truth, y):
        return "north" if tick == 3 else None


class Truth(Part):
    def step(self, tick, time_s, truth, y):
        return truth


class Recorded(Part):
    """A plant that stands still in the air."""

    def measure(self, tick, y, truth):
        y[:], truth[:] = 0.0, 0.0
        y[MEAS.force], truth[TRUTH.quat], truth[TRUTH.pos] = (
            [0, 0, -9.81],
            [1, 0, 0, 0],
            [0, 0, -10],
        )
        y[MEAS.mag], y[MEAS.mag_valid] = [2e-5, 0, 4e-5], 1.0

    def step(self, tick, u):
        assert np.isfinite(u).all()


class Late(Part):
    def step(self, tick, time_s, y, u, readings):
        if tick == 7:
            raise RuntimeError("out of memory")
        return np.full(NAV.size, np.nan)


class Short(Part):
    def step(self, tick, time_s, y, u, readings):
        return [1.0, 2.0]


def test_the_packaged_observer_as_an_object_flies_the_same_flight():
    compiled, as_object = (heli.fly(seed=2, estimator=e, **FLIGHT) for e in (None, heli.Observer()))
    for name in ("pos_ned_m", "vel_ned_mps", "q_nb"):
        for group in ("truth", "nav"):
            value, wanted = getattr(as_object, group)[name], getattr(compiled, group)[name]
            np.testing.assert_array_equal(value, wanted)


def test_a_wind_of_ones_own_is_flown_in():
    flight = heli.fly(seed=2, wind=SteadyWind(), **FLIGHT)
    assert (flight._flown.record.wind_ned_mps == [3.0, -2.0, 0.0]).all()


def test_a_sensor_that_spoils_another_is_believed():
    spoiled, plain = (heli.fly(seed=2, sensors=s, **FLIGHT) for s in ([Spoiled()], []))
    assert len(spoiled) == 400 and spoiled.nav.down_m[-1] != plain.nav.down_m[-1]


def test_an_estimator_reads_what_a_sensor_says():
    flight = heli.fly(seed=2, sensors=[Truth()], estimator=Perfect(), **FLIGHT)
    np.testing.assert_array_equal(flight.nav.pos_ned_m, flight.truth.pos_ned_m)


def test_a_plant_of_ones_own_is_flown():
    flight = heli.fly(seed=2, plant=Recorded(), **FLIGHT)
    assert len(flight) == 400
    assert (flight.truth.pos_ned_m == [0.0, 0.0, -10.0]).all()


def test_a_part_that_raises_ends_the_flight_with_a_sentence():
    flight = heli.fly(seed=2, estimator=Late(), **FLIGHT)
    assert len(flight) == 8
    assert "Late failed at tick 7" in flight.lost and "out of memory" in flight.lost


def test_an_answer_of_another_shape_is_none():
    flight = heli.fly(seed=2, estimator=Short(), **FLIGHT)
    assert len(flight) == 1
    assert "(2,)" in flight.lost and f"({NAV.size},)" in flight.lost


@pytest.mark.parametrize(
    ("parts", "tick", "named"),
    [({"wind": Gale()}, 5, "nan"), ({"sensors": [Talks()]}, 3, "str")],
)
def test_what_is_no_number_goes_no_further(parts, tick, named):
    flight = heli.fly(seed=2, **parts, **FLIGHT)
    assert len(flight) == tick + 1
    assert f"failed at tick {tick}" in flight.lost and named in flight.lost
    assert np.isfinite(flight.truth.pos_ned_m).all()


def test_each_part_has_random_numbers_of_its_own_of_the_flights_seed():
    first, again = (SteadyWind(), Spoiled()), (SteadyWind(), Spoiled())
    for wind, sensor in (first, again):
        heli.fly(seed=5, wind=wind, sensors=[sensor], **FLIGHT | {"duration_s": 0.1})
    drawn = [[part.rng.random() for part in parts] for parts in (first, again)]
    assert drawn[0] == drawn[1] and drawn[0][0] != drawn[0][1]
    assert first[0].nodes["plant"]["seed"] == 5


@pytest.mark.parametrize(
    ("parts", "named"),
    [
        ({"wind": object()}, "reset"),
        ({"plant": SteadyWind()}, "measure"),
        ({"plant": Recorded(), "wind": SteadyWind()}, "wind"),
        ({"sensors": [Truth(), Truth()]}, "Truth, Truth"),
    ],
)
def test_what_cannot_fly_is_refused(parts, named):
    with pytest.raises(heli.PartError, match=named):
        heli.fly(**parts, **FLIGHT)


def test_the_graph_takes_no_objects():
    with pytest.raises(heli.PartError, match="graph"):
        heli.fly(estimator=heli.Observer(), graph=True, **FLIGHT)
    assert not Parts()
