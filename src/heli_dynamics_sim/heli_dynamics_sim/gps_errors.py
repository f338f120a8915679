# SPDX-License-Identifier: Apache-2.0
"""Errors of a GPS receiver besides noise and drift: multipath, satellites, outages, jumps, timing.

Stepped once per fix, each exactly, from standard normals:

- Multipath is a first-order Gauss-Markov process per axis, as integrity studies bound it (Gallon,
  Joerger, Pervan, NAVIGATION 69(1) 2022: sigma 0.5 m of code, 5 mm of carrier at the zenith, time
  constant 10 to 900 s).
- Satellites are blocked one by one, at a constant rate, each for an exponential time: the chain's
  stationary distribution is Poisson's (M/M/inf queue; Kleinrock, Queueing Systems 1, 1975, sec.
  3.4), cut off at the number in the open. White error, multipath and velocity error grow as
  sqrt(open / used), the least-squares law for ranges of equal quality in an unchanged geometry
  (Langley, Dilution of Precision, GPS World 10(5), 1999). Fewer than 4 give no fix.
- Outages begin and end at constant rates: a two-state Markov chain.
- Jumps: at the instants of a Poisson process the position gets another constant error, drawn anew
  (other satellites, a wrong set of ambiguities).
- Timing: the fix was true a little before or after its stamp. That is how jitter of the latency
  enters where the receiver's pulse does not set the host's clock: the host takes the nominal age
  (PX4's EKF2_GPS_DELAY, ArduPilot's GPS1_DELAY_MS).
"""

import math
from typing import NamedTuple

import numpy as np

from heli_dynamics_sim.noise import NOISE
from heli_math.jit import njit

FEWEST_SATELLITES = 4
"""Three coordinates and the receiver's clock."""


class GpsErrorKernel(NamedTuple):
    """Per fix, not per second."""

    on: bool
    multipath_m: np.ndarray  # (3,) NED, sigma with all satellites in the open
    multipath_decay: float
    satellites: int  # in the open
    blocked: float  # of them on average
    block: float  # probability that one more is blocked
    release: float  # probability per blocked one that it comes back
    outage_begin: float  # probability
    outage_end: float  # probability
    jump: float  # probability
    jump_m: np.ndarray  # (3,) NED, sigma
    latency_s: float  # sigma of the instant of validity about the stamp


class GpsErrorState(NamedTuple):
    """What stays from fix to fix."""

    multipath: np.ndarray  # (3,) NED, m, with all satellites in the open
    jump: np.ndarray  # (3,) NED, m
    blocked: np.ndarray  # (1,) satellites
    out: np.ndarray  # (1,) 1.0 in an outage


@njit
def uniform(n):
    """Number uniform in (0, 1) of a standard normal."""
    return 0.5 * math.erfc(-n / math.sqrt(2.0))


@njit
def dilution(state, k):
    """How many times larger the errors are than with all satellites; infinite: no fix."""
    used = k.satellites - state.blocked[0]
    if used < FEWEST_SATELLITES or state.out[0] > 0.0:
        return math.inf
    return math.sqrt(k.satellites / used)


@njit
def step_gps_errors(state, noise, k):
    """Bring multipath, satellites, outage and jump to the next fix.

    Parameters
    ----------
    state : GpsErrorState
        In place.
    noise : (n,) array
        Standard normals of the tick, places of `noise.NOISE`.
    k : GpsErrorKernel
    """
    fresh, jumped = noise[NOISE.gps_multipath], noise[NOISE.gps_jump]
    kept = math.sqrt(1.0 - k.multipath_decay * k.multipath_decay)
    jumps = uniform(noise[NOISE.gps_jump_now]) < k.jump
    for i in range(3):
        state.multipath[i] *= k.multipath_decay
        state.multipath[i] += kept * k.multipath_m[i] * fresh[i]
        if jumps:
            state.jump[i] = k.jump_m[i] * jumped[i]
    draw, blocked = uniform(noise[NOISE.gps_satellites]), state.blocked[0]
    if draw < k.block:
        state.blocked[0] = min(blocked + 1.0, float(k.satellites))
    elif draw > 1.0 - k.release * blocked:
        state.blocked[0] = blocked - 1.0
    draw = uniform(noise[NOISE.gps_outage])
    if state.out[0] > 0.0:
        state.out[0] = 0.0 if draw < k.outage_end else 1.0
    else:
        state.out[0] = 1.0 if draw < k.outage_begin else 0.0


@njit
def spoil_fix(state, noise, gps, velocity, pos, vel):
    """Add these errors to a fix that has noise and drift already. False: there is none.

    Parameters
    ----------
    state : GpsErrorState
    noise : (n,) array
        Standard normals of the tick.
    gps : GpsKernel
    velocity : (float, float, float)
        True one, NED, m/s.
    pos, vel : (3,) array
        In place.
    """
    k, larger = gps.errors, dilution(state, gps.errors)
    if math.isinf(larger):
        return False
    white_pos, white_vel = noise[NOISE.gps_pos], noise[NOISE.gps_vel]
    late_s = k.latency_s * noise[NOISE.gps_clock]
    for i in range(3):
        pos[i] += (larger - 1.0) * gps.white_m[i] * white_pos[i]
        pos[i] += larger * state.multipath[i] + state.jump[i] + late_s * velocity[i]
        vel[i] += (larger - 1.0) * gps.velocity_mps * white_vel[i]
    return True
