# SPDX-License-Identifier: Apache-2.0
"""Main rotor in its air: thrust and induced velocity with the terms that are on, and states."""

import math

from heli_dynamics_sim.flap_back import flap_back_rates
from heli_dynamics_sim.ground_effect import induced_share
from heli_dynamics_sim.inflow import inflow_rates
from heli_dynamics_sim.rotor import RotorKernel, ring_term, solve_inflow
from heli_dynamics_sim.vortex_ring import mass_flow, solve_descent
from heli_math.jit import njit_inlined
from heli_math.rows import PLANT


@njit_inlined
def rotor_flow(x, at_main, k):
    """Thrust (N), induced velocity and air speed through the disc (m/s), blade pitch (rad).

    at_main: air speed (3 floats) of the rotor, body, m/s. The speed through the disc is positive in
    descent.
    """
    u_a, v_a, w_a = at_main
    w_r = w_a + x[PLANT.a_s] * u_a - x[PLANT.b_s] * v_a
    pitch = k.main.pitch_gain * x[PLANT.servo_col] + k.main.pitch_offset
    w_bl = w_r + k.rotor.blade_speed * pitch
    in_plane_sq = u_a * u_a + v_a * v_a
    rotor, share = k.rotor, 1.0
    if k.terms.ground_effect:
        # The disc pays `share` of momentum theory's velocity: the same law with scaled numbers.
        share = induced_share(-x[PLANT.down], in_plane_sq, k.ground_effect)
        rotor = RotorKernel(share * rotor.thrust_slope, rotor.blade_speed, rotor.disc)
        w_bl /= share
    if k.terms.inflow:
        v_i = x[PLANT.inflow_mean]
        thrust = rotor.thrust_slope * (w_bl - v_i)
    elif k.terms.vortex_ring and w_r * w_bl > 0.0:
        v_i, thrust = solve_descent(abs(w_r), abs(w_bl), in_plane_sq, rotor)
        v_i, thrust = math.copysign(v_i, w_bl), math.copysign(thrust, w_bl)
    else:
        v_i, thrust, _ = solve_inflow(w_r, w_bl, in_plane_sq, rotor)
    return thrust, share * v_i, w_r, pitch


@njit_inlined
def resultant_flow(v_i, thrust, w_r, in_plane_sq, k):
    """Speed (m/s) of the air that the disc takes part in, where the mean inflow v_i is a state."""
    if k.terms.vortex_ring and w_r * thrust > 0.0:
        return mass_flow(abs(thrust) / k.rotor.disc, abs(w_r), in_plane_sq)
    ring = ring_term(w_r, thrust, k.rotor.thrust_slope / k.rotor.disc)
    return math.sqrt(in_plane_sq + ring + (v_i - w_r) * (v_i - w_r))


@njit_inlined
def rotor_term_rates(x, at_main, flow, k, out):
    """Add flap-back and dynamic inflow to the disc's rates in `out`, and fill their states' rates.

    flow is that of `rotor_flow`; `out` has the disc's rates without the two.
    """
    thrust, v_i, w_r, pitch = flow
    u_a, v_a, _ = at_main
    if k.terms.flap_back and k.flapping.flap_back == 0.0:
        flap_back_rates(x, u_a, v_a, v_i, w_r, pitch, k.main, k.flapping.rate, k.flap_back, out)
    if not k.terms.inflow:
        return
    v = x[PLANT.inflow]
    # More downwash on one side is a cyclic pitch of the blades there, at every radius alike.
    out[PLANT.a_s] += k.flapping.rate * v[1] / k.main.tip_speed
    out[PLANT.b_s] -= k.flapping.rate * v[2] / k.main.tip_speed
    # What turns the disc against its inertia is lift: on the left for a_s, at the rear for b_s.
    gain = 0.5 * k.rotor.thrust_slope / k.rotor.disc * k.main.tip_speed / k.flap_back.blade_rate
    left = gain * (out[PLANT.a_s] + x[PLANT.q] - k.flapping.a_bs * x[PLANT.b_s])
    rear = gain * (out[PLANT.b_s] + x[PLANT.p] - k.flapping.b_as * x[PLANT.a_s])
    speed = resultant_flow(v[0], thrust, w_r, u_a * u_a + v_a * v_a, k)
    loads = (2.0 * thrust / k.rotor.disc, -left, rear)
    rates = inflow_rates(v, (u_a, v_a), speed, loads, k.inflow)
    for i in range(3):
        out[PLANT.inflow.start + i] = rates[i]
