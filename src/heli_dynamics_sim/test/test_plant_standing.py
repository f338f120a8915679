# SPDX-License-Identifier: Apache-2.0
"""A flight that begins on the skids: in equilibrium, on slopes, with the rotor at rest."""

import math

import numpy as np
import pytest

from heli_core.errors import ParameterCause, PlantConfigError
from heli_core.rotations import euler_from_quat
from heli_core.rows import MEAS, PLANT
from heli_dynamics_sim.aircraft import ModelOptions
from heli_dynamics_sim.airframe import make_state, to_ned
from heli_dynamics_sim.ground import apply_slip, ground_loads, plane_of
from heli_dynamics_sim.helicopter import same_air, specific_force
from heli_dynamics_sim.noise import NOISE
from heli_dynamics_sim.plant import PlantStatus, advance, initial_state, measure, status
from heli_dynamics_sim.trim import NoStandError

ALL_TERMS = {f"terms__{name}": True for name in ModelOptions._fields}
CALM = {"wind__turbulence": False, "wind__profile_speed_mps": [0.0, 0.0, 0.0]}
SLOPE = math.tan(math.radians(5.0))


def stand(plant_config, **changes):
    config = plant_config(start__on_ground=True, **changes)
    return config, initial_state(config, 1)


def hold(config, state, seconds):
    """Fly with the start's command held; the states (n, 42) after each tick, the forces felt."""
    u, y, still = state.pilot[1:].copy(), np.zeros(MEAS.size), np.zeros(NOISE.size)
    states, forces = [], []
    for tick in range(round(100 * seconds)):
        measure(state, tick, still, config.params, y)
        advance(state, u, config.params)
        states.append(state.x.copy())
        forces.append(y[MEAS.force].copy())
    assert PlantStatus(status(state, config.params)) is PlantStatus.OK
    return np.array(states), np.array(forces)


@pytest.mark.parametrize(
    "changes",
    [
        CALM,
        {},
        {"ground__slope": [SLOPE, 0.0], "initial__psi_deg": 30.0},
        {"ground__slope": [0.0, -SLOPE]},
        ALL_TERMS,
    ],
    ids=["calm", "wind", "nose_up", "side", "all_terms"],
)
def test_it_begins_in_equilibrium(plant_config, changes):
    changes = {"wind__turbulence": False, **changes}
    config, state = stand(plant_config, **changes)
    x = state.x.copy()
    assert x[:2] == pytest.approx(config.pos_ned_m[:2], abs=0.0)
    assert euler_from_quat(x[PLANT.quat])[2] == pytest.approx(config.psi, abs=2e-3)
    states, _ = hold(config, state, 5.0)
    assert np.abs(states[:, PLANT.pos] - x[PLANT.pos]).max() < 1e-4
    assert np.abs(states[:, PLANT.quat] - x[PLANT.quat]).max() < 1e-4
    assert np.abs(states[:, PLANT.rate]).max() < 1e-3


@pytest.mark.parametrize("slope", [(0.0, 0.0), (SLOPE, 0.0), (0.03, -0.06)])
def test_the_ground_carries_weight_less_thrust(plant_config, slope):
    """Statics: what gear and friction give is the weight less the rotor's and tail's force."""
    changes = {"ground__slope": list(slope), "ground__idle_collective": 0.4}
    config, state = stand(plant_config, **CALM, **changes)
    k, x = config.params.aircraft, state.x
    push, _ = ground_loads(x, k.ground)
    push_ned = np.array(to_ned(tuple(x[PLANT.quat]), *push))
    force = np.empty(3)
    specific_force(x, same_air(np.zeros(3)), k, force)
    weight = k.body.mass * k.body.gravity
    # All forces but gravity hold the weight, ...
    felt = k.body.mass * np.array(to_ned(tuple(x[PLANT.quat]), *force))
    assert felt == pytest.approx([0.0, 0.0, -weight], abs=1e-3)
    # ... most of it the ground; the rotor what momentum theory gives at idle, 2 %.
    kappa = k.rotor.thrust_slope / k.rotor.disc
    blades = k.rotor.blade_speed * (k.main.pitch_gain * 0.4 + k.main.pitch_offset)
    inflow = math.sqrt(0.25 * kappa**2 + kappa * blades) - 0.5 * kappa
    thrust = k.rotor.thrust_slope * (blades - inflow)
    assert thrust == pytest.approx(0.022 * weight, rel=0.02)
    assert -push_ned[2] == pytest.approx(weight - thrust, abs=0.3)
    into = plane_of(slope)[0]
    normal = -push_ned @ into
    along = np.linalg.norm(push_ned + normal * into)
    assert normal == pytest.approx((weight - thrust) * into[2], rel=0.01)
    # Coulomb: friction holds the downhill part of the weight, and the tail rotor's 3.6 N.
    assert along < k.ground.friction * normal
    assert along == pytest.approx(weight * math.sqrt(1.0 - into[2] ** 2), abs=7.0)


def test_the_packaged_idle_presses_it_on(plant_config):
    """The blades at -1.4 deg; with 2 % of the weight as thrust, gusts down a slope push it away."""
    config, state = stand(plant_config, **CALM)
    k, x = config.params.aircraft, state.x
    pitch = k.main.pitch_gain * config.idle_collective + k.main.pitch_offset
    assert math.degrees(pitch) == pytest.approx(-1.375, abs=0.01)
    down = -to_ned(tuple(x[PLANT.quat]), *ground_loads(x, k.ground)[0])[2]
    assert 0.08 < down / (k.body.mass * k.body.gravity) - 1.0 < 0.15
    gusty = {"ground__slope": [0.0, SLOPE], "wind__profile_speed_mps": [13.0, 13.0, 13.0],
             "wind__turbulence": False, "wind__towards_deg": 270.0}  # fmt: skip
    stand(plant_config, **gusty)
    with pytest.raises(NoStandError):
        stand(plant_config, **gusty, ground__idle_collective=0.4)


def test_it_does_not_creep(plant_config):
    """Steady wind of 5 m/s on a slope of 5 deg for 20 s: less than a tenth of a millimetre."""
    wind = {"wind__profile_speed_mps": [5.0, 5.0, 5.0], "wind__turbulence": False}
    config, state = stand(plant_config, ground__slope=[0.0, SLOPE], **wind)
    x = state.x.copy()
    states, _ = hold(config, state, 20.0)
    assert np.abs(states[-1, PLANT.pos] - x[PLANT.pos]).max() < 1e-4


@pytest.mark.parametrize(("slope_deg", "slides"), [(25.0, False), (28.0, True)])
def test_it_slides_beyond_the_friction_angle(vacuum, fly, slope_deg, slides):
    """atan(0.5) = 26.6 deg; beyond, a = g (sin - mu cos)."""
    slope = math.tan(math.radians(slope_deg))
    ground = vacuum.ground._replace(plane=plane_of((slope, 0.0)))
    k = vacuum._replace(ground=ground)
    tilt = math.radians(slope_deg)
    x = make_state((0.0, 0.0, -0.245 / math.cos(tilt)), theta=tilt)
    x = fly(x, np.zeros(4), k, 0.5)  # the gear settles
    u = x[PLANT.u]
    x = fly(x, np.zeros(4), k, 1.0)
    if slides:
        slip = -9.781 * (math.sin(tilt) - 0.5 * math.cos(tilt))
        assert x[PLANT.u] - u == pytest.approx(slip, rel=0.02)
    else:
        assert abs(x[PLANT.u]) < 1e-4


def test_a_slope_that_is_too_steep_is_refused(plant_config):
    with pytest.raises(NoStandError):
        stand(plant_config, **CALM, ground__slope=[0.0, 0.7])


def test_friction_stays_in_its_cone_and_gives_no_energy(vacuum, fly):
    """Thrown onto the ground with slip, spin and bounce: energy of body and springs only falls."""
    k = vacuum.ground
    rng = np.random.default_rng(7)
    inertia = np.array([vacuum.body.j_xx, vacuum.body.j_yy, vacuum.body.j_zz])

    def energy(x):
        body = 0.5 * vacuum.body.mass * (x[PLANT.vel] @ x[PLANT.vel])
        body += 0.5 * x[PLANT.rate] @ (inertia * x[PLANT.rate])
        body -= vacuum.body.mass * vacuum.body.gravity * x[PLANT.down]
        depths = [x[PLANT.down] + to_ned(tuple(x[PLANT.quat]), *point)[2] for point in k.points]
        springs = sum(max(depth, 0.0) ** 2 for depth in depths) + np.sum(x[PLANT.stick] ** 2)
        return body + 0.5 * k.stiffness * springs

    for _ in range(10):
        x = make_state((0.0, 0.0, -0.3), *rng.uniform(-0.15, 0.15, 3))
        x[PLANT.vel] = rng.uniform(-1.0, 1.0, 3)
        x[PLANT.rate] = rng.uniform(-1.0, 1.0, 3)
        before = energy(x)
        for _ in range(100):
            x = fly(x, np.zeros(4), vacuum, 0.02)
            after = energy(x)
            assert after < before + 2e-3
            before = after
            push, _ = ground_loads(x, k)
            n, e, d = to_ned(tuple(x[PLANT.quat]), *push)
            if np.all(np.abs(x[PLANT.quat][1:3]) < 0.1):  # on the skids alone
                assert math.hypot(n, e) <= k.friction * -d + 1e-9


def test_bristles_rest_in_the_air(helicopter):
    x = make_state((0.0, 0.0, -10.0))
    x[PLANT.stick] = 1e-3
    apply_slip(x, helicopter.params.ground)
    assert not x[PLANT.stick].any()


def test_steps_of_2_ms_are_small_enough(vacuum, fly):
    """A landing with slip, at 2 ms and at 0.1 ms: the same place, and still."""
    x = make_state((0.0, 0.0, -0.27), 0.05, -0.03, 0.4)
    x[PLANT.vel] = 0.3, 0.2, 0.4
    coarse, fine = (fly(x, np.zeros(4), vacuum, 2.0, dt_s=dt) for dt in (0.002, 0.0001))
    assert coarse[PLANT.pos] == pytest.approx(fine[PLANT.pos], abs=5e-4)
    assert np.abs(coarse[PLANT.vel]).max() < 1e-3


@pytest.mark.parametrize("terms", [{}, ALL_TERMS], ids=["paper", "all_terms"])
def test_the_rotor_spools_up_on_the_ground(plant_config, helicopter, terms):
    config, state = stand(plant_config, wind__turbulence=False, start__spool_up_s=4.0, **terms)
    x = state.x.copy()
    assert x[PLANT.omega] == 0.0
    states, forces = hold(config, state, 8.0)
    speed, full = states[:, PLANT.omega], helicopter.main_speed_radps
    assert speed[:400] == pytest.approx(full * np.arange(1, 401) / 400, rel=1e-9)
    assert speed[400:] == pytest.approx(full, rel=2e-3)
    # The skids hold the torque that drives the rotor; it settles where one stands at full speed.
    assert np.abs(states[:, PLANT.pos] - x[PLANT.pos]).max() < 2e-3
    assert abs(euler_from_quat(states[-1, PLANT.quat])[2]) < math.radians(0.5)
    _, turning = stand(plant_config, wind__turbulence=False, **terms)
    assert states[-1, PLANT.down] == pytest.approx(turning.x[PLANT.down], abs=1e-4)
    assert np.linalg.norm(forces, axis=1) == pytest.approx(9.781, rel=0.03)


def test_spool_up_in_the_air_is_refused(plant_config):
    with pytest.raises(PlantConfigError) as caught:
        plant_config(start__spool_up_s=3.0)
    assert (caught.value.cause, caught.value.key) == (ParameterCause.CONFLICT, "start.spool_up_s")


def test_the_same_flight_again(plant_config):
    first, second = (hold(*stand(plant_config), 0.5)[0] for _ in range(2))
    assert np.array_equal(first, second)
