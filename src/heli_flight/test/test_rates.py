# SPDX-License-Identifier: Apache-2.0
"""Flights at 400 Hz: every part against itself at 100 Hz, the hover test, what is refused."""

import numpy as np
import pytest

from heli_core.rcl_yaml import ParameterError
from heli_core.rows import ACTUATOR, MEAS, PLANT
from heli_dynamics_sim import plant
from heli_dynamics_sim.noise import NOISE
from heli_flight.loop import simulate
from heli_flight.result import Result
from heli_flight.scoring import score
from heli_flight.settings import resolve
from heli_inner_hinf.design import AttitudeConfig, attitude_params
from heli_inner_hinf.loops import flown_plant
from heli_observer.observer import ObserverConfig

SLOW, FAST = 100, 400
FOLD = FAST // SLOW


def flown_by_hand(rate_hz, seconds):
    """State and arrivals of a plant in still air, its pedal and cyclic moved every 10 ms."""
    still = {"wind.turbulence": False, "wind.profile_speed_mps": [0.0] * 3}
    settings = resolve("hover", "rtk", 1, rate_hz=rate_hz, overrides={"plant": still})
    config = plant.PlantConfig.from_parameters(settings.nodes["plant"])
    state, k, y = plant.initial_state(config, 1), config.params, np.zeros(MEAS.size)
    u, fold, fixes = state.pilot[1:].copy(), rate_hz // SLOW, []
    for tick in range(seconds * rate_hz):
        plant.measure(state, tick, np.zeros(NOISE.size), k, y)
        if y[MEAS.gps_valid]:
            fixes.append((tick / rate_hz, y[MEAS.gps_tick] / rate_hz))
        if tick % fold == 0:
            u[ACTUATOR.lat] += 1e-4 * np.sin(tick / rate_hz)
            u[ACTUATOR.ped] += 1e-4 * np.cos(tick / rate_hz)
        plant.advance(state, u, k)
    return state.x, fixes


def test_the_plant_of_shorter_ticks_flies_the_same_way():
    """The same commands at the same times: only the length of the integration step differs."""
    (slow, slow_fixes), (fast, fast_fixes) = (flown_by_hand(hz, 3) for hz in (SLOW, FAST))
    assert np.abs(slow[PLANT.rate]).max() > 0.01
    np.testing.assert_allclose(fast, slow, atol=2e-6)
    assert fast_fixes == slow_fixes


def test_noise_keeps_its_density_and_walks_their_speed():
    slow, fast = (
        plant.PlantConfig.from_parameters(resolve(rate_hz=hz).nodes["plant"]).params.sensors
        for hz in (SLOW, FAST)
    )
    assert fast.imu.gyro_white**2 / FAST == pytest.approx(slow.imu.gyro_white**2 / SLOW)
    assert fast.imu.accel_white**2 / FAST == pytest.approx(slow.imu.accel_white**2 / SLOW)
    assert fast.imu.gyro_walk**2 * FAST == pytest.approx(slow.imu.gyro_walk**2 * SLOW)
    assert (fast.gps.decay, fast.baro.decay) == (slow.gps.decay, slow.baro.decay)


def test_observer_and_plant_of_the_law_are_discretised_for_their_ticks():
    """Four steps of 2.5 ms with held input are one of 10 ms."""
    nodes = [resolve(rate_hz=hz).nodes for hz in (SLOW, FAST)]
    slow, fast = (ObserverConfig(values["observer"]).params for values in nodes)
    Phi = np.linalg.matrix_power(fast.rotor.Phi, FOLD)
    np.testing.assert_allclose(Phi, slow.rotor.Phi, atol=1e-12)
    held = sum(np.linalg.matrix_power(fast.rotor.Phi, i) @ fast.rotor.Gu for i in range(FOLD))
    np.testing.assert_allclose(held, slow.rotor.Gu, atol=1e-12)
    assert fast.rotor.u_delay_ticks == FOLD * slow.rotor.u_delay_ticks
    assert fast.ekf.var_att_step * FOLD == pytest.approx(slow.ekf.var_att_step)
    assert fast.ekf.drift_decay**FOLD == pytest.approx(slow.ekf.drift_decay)

    states = []
    for values, hz in zip(nodes, (SLOW, FAST), strict=True):
        config = AttitudeConfig.from_parameters(values["inner_loop"])
        A, B = flown_plant(config.A, config.B, config.actuation)
        x = np.zeros(A.shape[0])
        for _ in range(30 * hz // SLOW):
            x = A @ x + B @ [0.1, -0.2, 0.3]
        states.append(x[:15])
    np.testing.assert_allclose(*states, atol=1e-12)


@pytest.mark.parametrize("controller", ["hinf_output", "hinf", "lqr", "lqg", "pid"])
def test_a_law_keeps_its_margins(controller):
    """Shorter ticks take 3.75 ms of hold out of the loop: no law loses a tenth of its margin."""
    slow, fast = (
        AttitudeConfig.from_parameters(
            resolve(controller=controller, rate_hz=hz).nodes["inner_loop"]
        ).judgement
        for hz in (SLOW, FAST)
    )
    assert fast.stable
    assert fast.disk_input > 0.9 * slow.disk_input
    assert fast.disk_output > 0.9 * slow.disk_output


@pytest.mark.parametrize(("gps", "seed"), [("rtk", 1), ("rtk", 2), ("standalone", 1)])
def test_the_hover_test_at_400_hz_is_inside_the_papers_figures(gps, seed):
    settings = resolve("hover", gps, seed, world="honest", rate_hz=FAST)
    flight = simulate(settings)
    assert flight.status == plant.PlantStatus.OK
    assert len(flight.record) == 60 * FAST
    assert flight.record.time_s[-1] == 60.0 - 1.0 / FAST
    result = Result(score(flight.record, settings.scenario), flight.sentence, 60.0, 1.0)
    assert result.figures.windows and result.exit_code(gps) == 0, result.outside()
    # every command stands for the 20 ms of the outer loop
    changes = np.flatnonzero(np.any(np.diff(flight.record.setpoint, axis=0) != 0.0, axis=1)) + 1
    assert changes.size > 1000 and not np.any(changes % 8)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"rate_hz": 300}, "--rate: rate_hz: 300"),
        ({"rate_hz": 400, "controller": "matrices"}, "controller: matrices"),
        ({"rate_hz": 400, "scenario_name": "attitude"}, "scenario: kind: attitude"),
        ({"rate_hz": 400, "scenario_name": "takeoff_land"}, "start.on_ground"),
        ({"rate_hz": 400, "scenario_name": "identify_gusts"}, "rate_hz: 400 does not go with"),
        ({"overrides": {"plant": {"rate_hz": 400}}}, "does not agree with observer: rate_hz: 100"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_sentence(arguments, words):
    with pytest.raises(ParameterError) as refused:
        resolve(**arguments)
    assert words in str(refused.value) and "\n" not in str(refused.value)


def test_a_kernel_of_one_rate_is_not_taken_for_another():
    slow, fast = (attitude_params(resolve(rate_hz=hz).nodes["inner_loop"]) for hz in (SLOW, FAST))
    assert (slow.tick_s, fast.tick_s) == (0.01, 0.0025)
    assert fast.law.A.shape[0] == slow.law.A.shape[0] + 3 * (FOLD - 1)
