# SPDX-License-Identifier: Apache-2.0
"""From every flying mode into every other, in wind, in climb and in a bank: nothing jumps.

Flown with ideal navigation, so that what the law makes of a receiver's noise is no step here; the
wind is the hover test's with its turbulence.
"""

from copy import deepcopy
from dataclasses import replace
from functools import cache
from itertools import permutations, product

import numpy as np
import pytest

from heli_core.rotations import euler_angles, wrap_pi
from heli_core.rows import ACTUATOR, REFERENCE
from heli_flight.loop import build, fly_loop
from heli_flight.settings import resolve

MODES = {"hold": "hover", "goto": "trajectory", "velocity": "velocity", "attitude": "attitude",
         "manual": "manual", "asked": "attitude"}  # fmt: skip
"""What is commanded, and the mode that it leads to; asked: mode attitude by messages."""
# An attitude is roll, pitch, heading, deg, and a climb, m/s.
WHERE = {"goto": (3.0, 3.0, -14.0), "velocity": (-1.0, 2.0, -0.5), "asked": (4.0, -2.0, 20.0, 0.3)}
NEUTRAL = (0.0, 0.0, 0.0, 0.0)
# How each mode is brought into each condition: commands, sticks, and when it is left, s.
BEFORE = {
    ("wind", "hold"): ([(4, "hold")], NEUTRAL, 6.0),
    ("wind", "goto"): ([(4, "goto", (6.0, -3.0, -10.0))], NEUTRAL, 6.0),
    ("wind", "velocity"): ([(4, "velocity", (2.0, 1.0, -0.3))], NEUTRAL, 7.0),
    ("wind", "attitude"): ([(4, "attitude")], NEUTRAL, 6.0),
    ("wind", "manual"): ([(4, "manual")], NEUTRAL, 5.0),
    ("wind", "asked"): ([(4, "asked", (2.0, 0.0, 10.0, 0.0))], NEUTRAL, 6.0),
    ("climb", "hold"): ([(3, "velocity", (0.0, 0.0, -1.5)), (6, "hold")], NEUTRAL, 6.6),
    ("climb", "goto"): ([(4, "goto", (0.0, 0.0, -18.0))], NEUTRAL, 6.6),
    ("climb", "velocity"): ([(3, "velocity", (0.0, 0.0, -1.5))], NEUTRAL, 6.0),
    ("climb", "attitude"): ([(3, "attitude")], (0.0, 0.0, 0.0, 0.8), 6.0),
    ("climb", "manual"): ([(4, "manual")], (0.0, 0.0, 0.0, 0.12), 6.0),
    ("climb", "asked"): ([(3, "asked", (2.0, 0.0, 0.0, 1.2))], NEUTRAL, 6.0),
    ("bank", "hold"): ([(3, "velocity", (0.0, -3.0, 0.0)), (7, "hold")], NEUTRAL, 9.0),
    ("bank", "goto"): ([(4, "goto", (0.0, 15.0, -10.0))], NEUTRAL, 5.52),
    ("bank", "velocity"): ([(4, "velocity", (0.0, 3.0, 0.0))], NEUTRAL, 5.52),
    ("bank", "attitude"): ([(4, "attitude")], (0.55, 0.0, 0.0, 0.0), 6.0),
    ("bank", "manual"): ([(4, "manual")], (0.35, 0.0, 0.0, 0.0), 5.0),
    ("bank", "asked"): ([(4, "asked", (13.0, 0.0, -20.0, 0.0))], NEUTRAL, 6.0),
}
AFTER_S = 1.0
PERIOD = 2


@cache
def base():
    settings = resolve("hover", "rtk", 2)
    return settings, build(settings, true_navigation=True)


def flown(commands, sticks, n_ticks):
    settings, loop = base()
    asked = [(c[0], *c[2]) for c in commands if c[1] == "asked"] or [(-1.0, 0.0, 0.0, 0.0, 0.0)]
    commands = [c for c in commands if c[1] != "asked"]
    orders = {
        "commands.attitude_at_s": np.array(asked)[:, 0],
        "commands.attitude_deg": np.array(asked)[:, 1:4],
        "commands.climb_mps": np.array(asked)[:, 4],
        "commands.at_s": np.array([float(c[0]) for c in commands]),
        "commands.what": tuple(c[1] for c in commands),
        "commands.goto_ned_m": np.array([c[2] for c in commands if c[1] == "goto"]),
        "commands.velocity_ned_mps": np.array([c[2] for c in commands if c[1] == "velocity"]),
        "commands.sticks_at_s": np.array([1.0]),
        "commands.sticks": np.array([sticks]),
    }
    nodes = settings.nodes | {"outer_loop": settings.nodes["outer_loop"] | orders}
    scenario = replace(settings.scenario, n_ticks=n_ticks)
    settings = replace(settings, nodes=nodes, scenario=scenario)
    flight = fly_loop(deepcopy(loop), settings)
    assert flight.status == 0, flight.sentence
    return flight.record


@cache
def unchanged(condition, source):
    """The flight that goes on in the mode it is in."""
    commands, sticks, at_s = BEFORE[condition, source]
    return flown([*commands, (90.0, "hold")], sticks, round((at_s + AFTER_S) * 100))


def tilt_deg(record, i):
    phi, theta, _ = euler_angles(record.truth_q_nb[i : i + 1])[0]
    return np.degrees(np.hypot(phi - 0.039, theta - 0.001))


PAIRS = [
    (condition, source, target)
    for condition, (source, target) in product(("wind", "climb", "bank"), permutations(MODES, 2))
    if MODES[source] != MODES[target]
]


@pytest.mark.parametrize(("condition", "source", "target"), PAIRS)
def test_from_every_mode_into_every_other_nothing_jumps(condition, source, target):
    commands, sticks, at_s = BEFORE[condition, source]
    change = (at_s, target, *([WHERE[target]] if target in WHERE else []))
    i = round(at_s * 100)
    r = flown([*commands, change], sticks, i + round(AFTER_S * 100))
    # It is as it is called, in the mode that it is called, and then in the other.
    assert (r.mode[i - 1], r.mode[-1]) == (MODES[source], MODES[target])
    assert condition != "climb" or -r.truth_vel_ned_mps[i, 2] > 1.0
    assert condition != "bank" or tilt_deg(r, i) > 9.0
    first = i + PERIOD
    # Both the step to the first command of the new mode, and what the old one would have commanded
    # instead: a law that goes on unchanged answers a gust, which is no step of the change.
    still = unchanged(condition, source)

    def change_of(row):
        return np.minimum(abs(row(r, first) - row(r, i)), abs(row(r, first) - row(still, first)))

    attitude = np.degrees(wrap_pi_all(change_of(lambda a, j: a.setpoint[j, :3])))
    assert attitude.max() < 0.5
    assert change_of(lambda a, j: a.u[j, ACTUATOR.col]) < 0.01
    # The actuators, which the attitude law moves on every tick.
    for j in range(i, first + 2):
        u = np.abs(r.u[j, :3] - r.u[j - 1, :3])
        assert np.minimum(u, np.abs(r.u[j, :3] - still.u[j, :3])).max() < 0.02
    # The reference goes on where it was, or where the aircraft is, with its velocity.
    pos, vel = r.reference[:, REFERENCE.pos], r.reference[:, REFERENCE.vel]
    here, moves = r.truth_pos_ned_m[i + 1], r.truth_vel_ned_mps[i + 1]
    held = np.linalg.norm(pos[i + 1] - pos[i]) < 0.04 + 0.02 * np.linalg.norm(moves)
    assert held or np.linalg.norm(pos[i + 1] - here) < 0.1
    assert np.linalg.norm(np.diff(pos[i + 1 :], axis=0), axis=1).max() < 0.05
    assert np.linalg.norm(vel[i + 1] - vel[i]) < 0.15 or np.linalg.norm(vel[i + 1] - moves) < 0.3
    # And no later bump: what it flies in the second after, but for a hand that keeps banking.
    later = np.degrees(np.abs(np.diff(r.setpoint[first::PERIOD, :2], axis=0)))
    assert later.max() < 1.0


def wrap_pi_all(angles):
    return np.array([abs(wrap_pi(float(angle))) for angle in angles])
