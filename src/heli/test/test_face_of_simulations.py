# SPDX-License-Identifier: Apache-2.0
"""A flight step by step is that of `heli.fly`, at every level, and goes on from any moment."""

import pickle

import numpy as np
import pytest

import heli
from heli.simulating import TRUTH_FIELDS
from heli_core.rows import NAV, TRUTH
from heli_dynamics_sim.local_model import LOCAL
from heli_flight.stepping import SteppedFlight

FLIGHT = {"scenario": "hover", "world": "honest", "seed": 3, "quiet": True}


@pytest.fixture(scope="module")
def flight():
    return heli.fly(duration_s=12.0, **FLIGHT)


def begun(**arguments):
    sim = heli.Simulation(**(FLIGHT | arguments))
    return sim, sim.reset()


def truth_of(flight, tick):
    t = flight.truth
    return np.concatenate([t.pos_ned_m[tick], t.vel_ned_mps[tick], t.q_nb[tick]])


def commands_of(flight):
    u = np.column_stack([flight.u[name] for name in heli.simulating.U_FIELDS])
    angles = [flight.setpoint[name] for name in ("phi_rad", "theta_rad", "psi_rad")]
    return u, np.column_stack([*angles, u[:, 3]])


@pytest.mark.parametrize("level", ["none", "actuators", "attitude"])
def test_it_is_the_flight_of_fly_bit_for_bit(flight, level):
    u, attitude = commands_of(flight)
    commands = {
        "none": lambda n: {},
        "actuators": lambda n: {"actuators": u[n]},
        "attitude": lambda n: {"attitude": attitude[n]},
    }[level]
    sim, obs = begun()
    for n in range(len(u) - 1):
        assert obs.truth.row[:10].tobytes() == truth_of(flight, n).tobytes()
        obs = sim.step(**commands(n))
        assert obs.u.row.tobytes() == u[n].tobytes()
    assert obs.nav.pos_ned_m.tobytes() == flight.nav.pos_ned_m[-1].tobytes()


def test_a_flight_with_phases_is_that_of_fly_too():
    arguments = {"scenario": "takeoff_land", "world": "paper", "seed": 2, "quiet": True}
    flight = heli.fly(**arguments)
    sim = heli.Simulation(**arguments)
    obs = sim.reset()
    for _ in range(len(flight.time_s) - 1):
        obs = sim.step()
    assert obs.truth.row[:10].tobytes() == truth_of(flight, -1).tobytes()
    assert flight.truth.altitude_m.max() > obs.truth.altitude_m + 5.0


LINKS = """
faults:
  - {what: link, topic: odom, from: any, to: any, kind: loss, value: 0.3, start_s: 1.0}
"""


@pytest.mark.slow
def test_links_with_faults_are_those_of_fly_and_are_saved_too(tmp_path):
    (tmp_path / "links.yaml").write_text(LINKS)
    arguments = {"world": "paper", "seed": 2, "quiet": True, "faults": tmp_path / "links.yaml"}
    flight = heli.fly("hover", duration_s=4.0, **arguments)
    sim = heli.Simulation(scenario="hover", **arguments)
    obs = sim.reset()
    for n in range(len(flight.time_s) - 1):
        if n == 200:
            state = sim.save()
            for _ in range(10):
                sim.step()
            sim.restore(state)
        obs = sim.step()
    assert obs.truth.row[:10].tobytes() == truth_of(flight, -1).tobytes()


def test_a_restored_run_is_the_same_at_every_level():
    sim, _ = begun(world="paper")
    for _ in range(250):
        sim.step()
    levels = (
        {}, {"velocity": [1.0, 0.5, 0.0, 0.1]}, {"attitude": [0.05, 0.01, 0.1]},
        {"actuators": sim.step().u.row}, {},
    )  # fmt: skip

    def fly_on():
        rows = []
        for command in levels:
            rows += [sim.step(**command).truth.row for _ in range(60)]
        return np.array(rows)

    state = sim.save()
    first = fly_on()
    sim.restore(state)
    assert fly_on().tobytes() == first.tobytes()
    # Over a file, into another simulation with the same arguments.
    sim, _ = begun(world="paper")
    sim.restore(pickle.loads(pickle.dumps(state)))
    assert fly_on().tobytes() == first.tobytes()


def test_the_same_seed_gives_the_same_bytes_and_another_one_others():
    sim, first = begun()
    after = [sim.step().measured.row for _ in range(20)]
    again = sim.reset()
    assert again.measured.row.tobytes() == first.measured.row.tobytes()
    assert [sim.step().measured.row.tobytes() for _ in range(20)] == [a.tobytes() for a in after]
    other = sim.reset(seed=4)
    assert sim.seed == 4 and other.measured.row.tobytes() != first.measured.row.tobytes()
    assert other.measured.row.tobytes() == begun(seed=4)[1].measured.row.tobytes()


def test_it_flies_at_a_velocity_and_halts_after_actuators():
    sim, obs = begun(world="paper")
    for _ in range(1000):
        obs = sim.step(velocity=[2.0, 0.0, -0.5])
    assert np.allclose(obs.truth.vel_ned_mps, [2.0, 0.0, -0.5], atol=0.3)
    for _ in range(100):
        obs = sim.step(actuators=obs.u.row)
    for _ in range(1500):
        obs = sim.step()
    assert not obs.lost and np.abs(obs.truth.vel_ned_mps).max() < 0.3


def test_an_attitude_is_held():
    sim, obs = begun(world="paper")
    for _ in range(200):
        obs = sim.step(attitude=[0.1, 0.0, 0.3])
    assert obs.truth.phi_rad == pytest.approx(0.1, abs=0.02)
    assert obs.truth.psi_rad == pytest.approx(0.3, abs=0.03)


def test_a_crash_ends_it_and_reset_begins_again():
    sim, obs = begun(world="paper")
    while not obs.lost:
        obs = sim.step(actuators=[0.0, 0.9, 0.0, -0.2])
        assert obs.time_s < 20.0
    with pytest.raises(heli.FlightError, match="over"):
        sim.step()
    assert sim.reset().tick == 0 and not sim.step().lost


def test_the_linear_model_tells_what_follows():
    sim, obs = begun(world="paper")
    for _ in range(300):
        obs = sim.step()
    model, state = sim.linearize(), sim.save()
    x, y = model.x, []
    assert x[LOCAL.pos].tobytes() == obs.truth.pos_ned_m.tobytes()
    assert x[LOCAL.phi] == pytest.approx(obs.truth.phi_rad)
    delay, du = round(model.delay_s / sim.dt_s), np.array([0.02, -0.01, 0.01, 0.02])
    for command in (model.u, model.u + du):
        sim.restore(state)
        for _ in range(delay + 10):
            obs = sim.step(actuators=command)
        y.append(np.concatenate([obs.truth.rate_body_radps, obs.truth.vel_ned_mps]))
    Phi, Gamma, _ = model.held(sim.dt_s)
    moved = np.zeros(LOCAL.size)
    for _ in range(10):
        moved = Phi @ moved + Gamma @ du
    told = np.concatenate([moved[LOCAL.rate], moved[LOCAL.vel]])
    assert np.allclose(told, y[1] - y[0], rtol=0.05, atol=2e-3)


class Air:
    """Wind that remembers."""

    def reset(self, rng, tick_s, nodes):
        self.rng, self.wind = rng, np.zeros(3)

    def step(self, tick, time_s, pos_ned_m):
        self.wind = 0.99 * self.wind + 0.1 * self.rng.standard_normal(3)
        return self.wind


def test_parts_of_ones_own_fly_and_are_saved_too():
    flight = heli.fly(duration_s=3.0, wind=Air(), **FLIGHT)
    sim, obs = begun(wind=Air())
    for _ in range(150):
        obs = sim.step()
    state, ends = sim.save(), []
    for _ in range(2):
        for _ in range(149):
            obs = sim.step()
        ends.append(obs.truth.row)
        sim.restore(state)
    assert ends[0][:10].tobytes() == truth_of(flight, 299).tobytes() == ends[1][:10].tobytes()
    for command in ({"attitude": [0.0, 0.0, 0.0]}, {"actuators": obs.u.row}):
        assert not sim.step(**command).lost


def test_another_aircraft_flies_by_its_own_design():
    sim, obs = begun(aircraft="xcell60", world="paper")
    for _ in range(300):
        obs = sim.step()
    assert not obs.lost and np.linalg.norm(obs.truth.pos_ned_m - [0.0, 0.0, -10.0]) < 3.0


@pytest.mark.parametrize(
    ("command", "named"),
    [
        ({"actuators": [0.0, 0.0]}, "actuators"),
        ({"actuators": [0.0, 0.0, 0.0, 1.5]}, "actuators"),
        ({"attitude": [0.0, np.nan, 0.0]}, "attitude"),
        ({"attitude": [0.0, 0.0, 0.0, 2.0]}, "collective"),
        ({"velocity": "fast"}, "velocity"),
        ({"velocity": [1.0, 0.0, 0.0], "attitude": [0.0, 0.0, 0.0]}, "one of"),
    ],
)
def test_what_is_no_command_is_named(command, named):
    sim, _ = begun()
    with pytest.raises(heli.ParameterError, match=named):
        sim.step(**command)
    assert sim.step().tick == 1


def test_what_is_no_simulation_is_named():
    with pytest.raises(heli.ParameterError, match="aircraft"):
        heli.Simulation(aircraft="boeing")
    sim = heli.Simulation(**FLIGHT)
    with pytest.raises(heli.FlightError, match="reset"):
        sim.step()
    sim.reset()
    state = sim.save()
    sim.reset(seed=5)
    with pytest.raises(heli.FlightError, match="seed 3"):
        sim.restore(state)
    ground = heli.Simulation(scenario="takeoff_land", world="paper", seed=1, quiet=True)
    ground.reset()
    with pytest.raises(heli.FlightError, match="ground"):
        for _ in range(20):
            ground.step(velocity=[1.0, 0.0, 0.0])


def test_what_has_not_come_is_none_and_names_tell_units():
    sim, obs = begun()
    fixes = [sim.step().measured.gps_pos_ned_m for _ in range(30)]
    assert any(fix is None for fix in fixes) and any(fix is not None for fix in fixes)
    assert "truth.pos_ned_m" in repr(obs) and set(TRUTH_FIELDS) == set(obs.truth)
    with pytest.raises(AttributeError, match="pos_ned_m"):
        _ = obs.truth.pos
    assert obs.truth.row.shape == (TRUTH.size,) and obs.nav.row.shape == (NAV.size,)


def test_an_observation_stays_as_it_was():
    sim, obs = begun()
    before = repr(obs)
    for _ in range(5):
        sim.step()
    assert repr(obs) == before


def test_most_steps_are_one_call_of_the_kernel(monkeypatch):
    """The phases are asked only where something may follow."""
    asked, ask = [], SteppedFlight._ask
    monkeypatch.setattr(SteppedFlight, "_ask", lambda *a: asked.append(a) or ask(*a))
    sim, _ = begun(world="paper")
    for _ in range(200):
        sim.step()
    assert len(asked) == 1
