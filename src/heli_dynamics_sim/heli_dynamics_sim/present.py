# SPDX-License-Identifier: Apache-2.0
"""The aircraft's numbers at the rotor's present speed and with the fuel it has left.

Thrust and induced velocity of both rotors by their blades' speed, the tail's stall by its square,
profile power by momentum theory; 1/tau of the flapping grows with the speed, as gamma Omega / 16
does; the disc's tilt per air speed falls with it. So do the couplings, eq. (7) over tau, down to
0.9 of the governed speed. Below that they keep their ratio to 1/tau: those of `helion.yaml` are
identified at full speed and of one sign, so that the law would make the disc of a rotor that turns
slower than 0.83 of it diverge, which none does. The tank is near the c.g.: inertia and c.g. stay.
"""

from heli_dynamics_sim.aircraft_kernel import HelicopterKernel
from heli_dynamics_sim.flap_back import FlapBackKernel
from heli_dynamics_sim.rigid_body import BodyKernel
from heli_dynamics_sim.rotor import FlappingKernel, MainRotorKernel, RotorKernel
from heli_math.jit import njit_inlined
from heli_math.rows import PLANT

_SLOWEST = 0.05
"""Rotor speed over the governed one below which the numbers are those of this ratio."""
_COUPLED = 0.9
"""That below which the couplings of flapping keep their ratio to its rate."""


@njit_inlined
def _rotor(k, ratio):
    return RotorKernel(k.thrust_slope * ratio, k.blade_speed * ratio, k.disc)


@njit_inlined
def _main(k, ratio):
    return MainRotorKernel(
        k.hub_stiffness,
        k.hub_height,
        k.speed * ratio,
        k.profile_power * ratio,
        k.tip_speed * ratio,
        k.pitch_gain,
        k.pitch_offset,
    )


@njit_inlined
def _flapping(k, ratio):
    falls = ratio if ratio >= _COUPLED else _COUPLED * _COUPLED / ratio
    return FlappingKernel(
        k.rate * ratio,
        k.a_bs / falls,
        k.b_as / falls,
        k.lon_from_lon,
        k.lon_from_lat,
        k.lat_from_lat,
        k.lat_from_lon,
        k.flap_back / ratio,
    )


@njit_inlined
def _flap_back(k, ratio):
    return FlapBackKernel(k.blade_rate * ratio, k.coning, k.bar_gain, k.bar_radius_sq, k.bar_inflow)


@njit_inlined
def present(x, k):
    """The HelicopterKernel at a plant state; k itself while rotor_speed and fuel are off."""
    ratio, body = 1.0, k.body
    if not (k.terms.rotor_speed or k.terms.fuel):
        return k
    if k.terms.rotor_speed:
        ratio = max(x[PLANT.omega] / k.engine.speed, _SLOWEST)
    if k.terms.fuel:
        mass = body.mass - x[PLANT.fuel]
        body = BodyKernel(mass, body.j_xx, body.j_yy, body.j_zz, body.gravity)
    return HelicopterKernel(
        body,
        _rotor(k.rotor, ratio),
        _main(k.main, ratio),
        _flapping(k.flapping, ratio),
        _rotor(k.tail, ratio),
        k.tail_arm,
        k.tail_height,
        k.gyro,
        k.fuselage,
        k.horizontal_fin,
        k.vertical_fin,
        k.servo,
        k.ground,
        k.climb_power,
        k.tail_stall * ratio * ratio,
        k.engine,
        k.terms,
        _flap_back(k.flap_back, ratio),
        k.inflow,
        k.ground_effect,
    )
