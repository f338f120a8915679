# SPDX-License-Identifier: Apache-2.0
"""Integrator: measured order, and agreement with SciPy's DOP853 over a manoeuvre."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from heli_core.rows import PLANT
from heli_dynamics_sim.aircraft import CLIMB_POWER_OFF, HelicopterParameters
from heli_dynamics_sim.helicopter import WORK_ROWS, derivative_kernel, rk4_step, same_air
from heli_dynamics_sim.trim import trim

WIND = np.array([-6.0, 1.0, 0.3])
AIR = same_air(WIND)


@pytest.fixture(scope="module")
def start():
    """Hover in wind, kicked: rates, flapping and servos in motion."""
    params = HelicopterParameters.from_yaml("helion.yaml")
    hover = trim(params, WIND)
    x = hover.x.copy()
    x[2] = -1000.0
    x[10:13] += 1.0, -0.8, 0.5
    x[16:20] += 0.03, -0.02, 0.02, 0.01
    return params, x, hover.u


def rk4(x, u, kernel, seconds, dt_s):
    x, work = x.copy(), np.zeros((WORK_ROWS, PLANT.size))
    for _ in range(round(seconds / dt_s)):
        rk4_step(x, u, AIR, kernel, dt_s, work)
    return x


def dop853(x, u, kernel, seconds):
    def rates(_, z):
        out = np.empty(PLANT.size)
        derivative_kernel(z, u, AIR, kernel, out)
        return out

    end = solve_ivp(rates, (0.0, seconds), x, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    end[6:10] /= np.linalg.norm(end[6:10])
    return end


def test_order_is_four(start):
    """Kicked aircraft in wind over 1 s, 4 to 0.5 ms; DOP853; order 4 +- 0.2."""
    params, x, u = start
    kernel = params.params._replace(climb_power=CLIMB_POWER_OFF)  # a kink has no order
    exact = dop853(x, u, kernel, 1.0)
    steps = np.array([0.004, 0.002, 0.001, 0.0005])
    errors = [np.linalg.norm(rk4(x, u, kernel, 1.0, h) - exact) for h in steps]
    order = np.diff(np.log(errors)) / np.diff(np.log(steps))
    assert order == pytest.approx([4.0] * 3, abs=0.2)


def test_two_milliseconds_agree_with_dop853_over_ten_seconds(start):
    """Open-loop manoeuvre of 10 s, forces, kinks, large angles; DOP853; 1e-10, position 1e-7."""
    params, x, u = start
    exact = dop853(x, u, params.params, 10.0)
    mine = rk4(x, u, params.params, 10.0, 0.002)
    assert np.abs(exact[0:3] - x[0:3]).max() > 5.0  # it did move
    assert np.abs(mine - exact)[6:20].max() < 1e-10
    assert np.abs(mine - exact)[0:6].max() < 1e-7


def test_derivative_is_a_pure_function(start):
    """Called alone or after other states, in any order; the same bits."""
    params, x, u = start
    a, b, out = np.empty(PLANT.size), np.empty(PLANT.size), np.empty(PLANT.size)
    derivative_kernel(x, u, AIR, params.params, a)
    for scale in (0.1, 5.0, -3.0):
        derivative_kernel(x * scale, u, AIR * scale, params.params, out)
    derivative_kernel(x, u, AIR, params.params, b)
    assert a.tobytes() == b.tobytes()
