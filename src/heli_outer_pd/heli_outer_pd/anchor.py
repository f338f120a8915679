# SPDX-License-Identifier: Apache-2.0
"""A reference that begins where the aircraft is and moves as it does. No ROS."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heli_guidance.flight_path import STEP_S
from heli_math.rotations import euler_from_quat, wrap_pi
from heli_math.rows import NAV, REFERENCE, SHAPED
from heli_math.ticks import NS_PER_S
from heli_math.trajectory import Trajectory, reference_at
from heli_outer_pd.disturbance import flown_acceleration_ned, flyable, hover_share
from heli_outer_pd.hand_law import collective_limits, hand_of
from heli_outer_pd.outer_state import OuterKernel
from heli_outer_pd.reference import foreseen_ns, shaped_reference_at, turn_rate_at

Array = NDArray[np.float64]

_STEP_NS = round(STEP_S * NS_PER_S)
GLIMPSE_NS = NS_PER_S
"""How far ahead a pilot's way is told."""


@dataclass
class Flown:
    """How something moves: rows position, velocity, acceleration (3, 3), NED; heading (3,), rad."""

    ned: Array
    psi: Array


def flown_now(nav: Array, k: OuterKernel, state: Array) -> Flown:
    """How the aircraft moves by its navigation and the law's own estimate of the forces."""
    acc = np.empty(3)
    flown_acceleration_ned(nav, k, state, acc)
    phi, theta, psi = euler_from_quat(nav[NAV.quat])
    rate = (nav[NAV.q] * np.sin(phi) + nav[NAV.r] * np.cos(phi)) / np.cos(theta)
    return Flown(np.array([nav[NAV.pos], nav[NAV.vel], acc]), np.array([psi, rate, 0.0]))


def led_now(way: Trajectory, now_ns: int, k: OuterKernel) -> Flown:
    """How the reference moves, as the law follows it."""
    shaped, row = np.empty(SHAPED.size), np.empty(REFERENCE.size)
    asked = now_ns - way.start_ns, way.times_ns, way.points
    shaped_reference_at(asked[0], k.shaping_ns, 0.0, *asked[1:], shaped)
    reference_at(*asked, row)
    ned = np.array([shaped[SHAPED.pos], shaped[SHAPED.vel], shaped[SHAPED.acc]])
    return Flown(ned, np.array([row[REFERENCE.psi], turn_rate_at(*asked), 0.0]))


def warm_up(k: OuterKernel, state: Array) -> None:
    """Load the compiled parts of a change of modes before a flight needs them."""
    nav = np.zeros(NAV.size)
    nav[NAV.quat] = 1.0, 0.0, 0.0, 0.0
    flown_now(nav, k, state)
    led_now(Trajectory.hover(np.zeros(3), 0.0), 0, k)
    hand_of(state, np.empty(3))
    collective_limits(k)
    hover_share(0.0, k)
    flyable(nav)


def anchored(flown: Flown, now_ns: int, start_ns: int, k: OuterKernel) -> Trajectory:
    """A reference that moves so about now, as far as the law averages it, to be diverted from.

    Parameters
    ----------
    flown : Flown
    now_ns, start_ns : int
        Stamps of now and of flight time 0.
    """
    window_s = k.shaping_ns / NS_PER_S
    behind = -(-k.shaping_ns // _STEP_NS) + 1
    ahead = foreseen_ns(k.shaping_ns) // _STEP_NS + 3
    steps = np.arange(-behind, ahead + 1)
    t = (steps * STEP_S)[:, None]
    pos, vel, acc = flown.ned
    points = np.zeros((steps.size, REFERENCE.size))
    # An average over the window is that much ahead of a parabola.
    points[:, REFERENCE.pos] = pos - acc * window_s**2 / 24.0 + vel * t + 0.5 * acc * t * t
    points[:, REFERENCE.vel] = vel + acc * (t + 0.5 * STEP_S)
    psi, rate, _ = flown.psi
    points[:, REFERENCE.psi] = [wrap_pi(psi + rate * float(at)) for at in t[:, 0]]
    return Trajectory(start_ns, now_ns - start_ns + steps * _STEP_NS, points)


def glimpse(flown: Flown, now_ns: int, start_ns: int) -> Trajectory:
    """Where a pilot seems to go: straight on for a second. Nothing follows it."""
    pos, vel, _ = flown.ned
    psi = flown.psi[0]
    points = np.array([np.r_[pos, vel, psi], np.r_[pos + vel, np.zeros(3), psi]])
    points[1, REFERENCE.pos] = pos + vel * GLIMPSE_NS / NS_PER_S
    return Trajectory(start_ns, now_ns - start_ns + np.array([0, GLIMPSE_NS]), points)
