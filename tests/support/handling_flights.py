# SPDX-License-Identifier: Apache-2.0
"""Made-up flights of every manoeuvre: what is put in is known."""

import math
from collections.abc import Callable

import numpy as np

from heli_analysis.handling.definitions import FT, FULL_SCALE
from heli_analysis.handling.manoeuvres import MotionTrack, track_of
from heli_analysis.handling.scoring import score

STEP_S = 0.02
STILL_MPS = 0.5


def blend(share):
    """From 0 to 1 with the least jerk."""
    t = np.clip(share, 0.0, 1.0)
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2)


def blend_speed(share):
    """Slope of `blend`."""
    return 30.0 * share**2 * (1.0 - share) ** 2


def made(duration_s, north, east, height, yaw):
    """A track of four functions of time."""
    t = np.arange(0.0, duration_s, STEP_S)
    columns = [np.broadcast_to(f(t), t.shape) for f in (north, east, lambda t: -height(t))]
    pos = np.column_stack(columns)
    attitude = np.column_stack([0.0 * t, 0.0 * t, np.broadcast_to(yaw(t), t.shape)])
    return track_of(t, pos, np.gradient(pos, STEP_S, axis=0), attitude)


def bump(t, start_s, length_s, size):
    """From 0 to size and back, slowly."""
    share = np.clip((t - start_s) / length_s, 0.0, 1.0)
    return size * np.sin(np.pi * share) ** 2


def hover(drift=0.0, aside=0.0, up=0.0, turn_deg=0.0, braking_s=4.0, speed=4.0, track_deg=45.0):
    """10 s towards the origin, a constant deceleration, then 35 s over it."""

    def left_m(t):
        run, brake = np.clip(t, 0.0, 10.0), np.clip(t - 10.0, 0.0, braking_s)
        total = speed * (10.0 + 0.5 * braking_s)
        return total - speed * (run + brake - 0.5 * brake**2 / braking_s)

    begin, angle = 12.0 + braking_s, math.radians(track_deg)
    return made(
        45.0 + braking_s,
        lambda t: -left_m(t) * math.cos(angle) + bump(t, begin, 25.0, drift),
        lambda t: -left_m(t) * math.sin(angle) + bump(t, begin, 25.0, aside),
        lambda t: 5.0 + bump(t, begin, 25.0, up),
        lambda t: np.radians(bump(t, begin, 25.0, turn_deg)),
    )


def vertical(drift=0.0, left_m=0.0, turn_deg=0.0, move_s=5.0, rise_m=25.0 * FT, stay_s=3.0):
    """5 s of hover, up, at the top, down, 5 s of hover."""
    down = 5.0 + move_s + stay_s

    def height(t):
        up = rise_m * blend((t - 5.0) / move_s)
        return 4.6 + up - (rise_m - left_m) * blend((t - down) / move_s)

    return made(
        down + move_s + 5.0,
        lambda t: bump(t, 6.0, move_s, drift),
        lambda t: 0.0 * t,
        height,
        lambda t: np.radians(bump(t, 6.0, move_s, turn_deg)),
    )


def pirouette(around_s=42.0, off=0.0, up=0.0, nose_deg=0.0, creep_s=0.0):
    """Once around the origin, at constant speed but for the ends; then, maybe, creeping."""
    radius = 100.0 * FT

    def swept(t):
        ramp = 2.0
        u = np.clip(t - 5.0, 0.0, around_s)
        v = np.where(u < ramp, 0.5 * u**2 / ramp, u - 0.5 * ramp)
        late = np.clip(u - (around_s - ramp), 0.0, ramp)
        return 2.0 * np.pi * (v - 0.5 * late**2 / ramp) / (around_s - ramp)

    def distance(t):
        late = np.clip((t - 5.0 - around_s) / max(creep_s, 1e-9), 0.0, 1.0)
        return radius + off * np.sin(swept(t)) ** 2 + creep_s * late

    return made(
        around_s + creep_s + 20.0,
        lambda t: distance(t) * np.cos(swept(t)),
        lambda t: distance(t) * np.sin(swept(t)),
        lambda t: 3.0 + up * np.sin(0.5 * swept(t)) ** 2,
        lambda t: swept(t) + np.pi + np.radians(nose_deg) * np.sin(swept(t)) ** 2,
    )


def dash(
    length_m, yaw, move_s, off=0.0, up=0.0, turn_deg=0.0, beyond_m=0.0, back_s=8.0, height=8.0
):
    """From hover to hover, north; maybe beyond the end and back."""

    def north(t):
        there = (length_m + beyond_m) * blend((t - 5.0) / move_s)
        return there - beyond_m * blend((t - 5.0 - move_s) / back_s)

    return made(
        move_s + back_s + 12.0,
        north,
        lambda t: bump(t, 5.0, move_s, off),
        lambda t: height + bump(t, 5.0, move_s, up),
        lambda t: yaw + np.radians(bump(t, 5.0, move_s, turn_deg)),
    )


def depart_abort(move_s=19.75, **more):
    """To the north, nose ahead."""
    return dash(800.0 * FT, 0.0, move_s, **more)


def lateral_reposition(move_s=12.7, **more):
    """To the north, nose to the west."""
    return dash(400.0 * FT, -0.5 * math.pi, move_s, **more)


def slalom(speed=32.0, aside=22.0, height=20.0, up=0.0, apart=500.0 * FT):
    """Two turns to each side of a line to the north."""
    length = 4.0 * apart
    return made(
        length / speed + STEP_S,
        lambda t: speed * t,
        lambda t: aside * np.sin(np.pi * speed * t / apart),
        lambda t: height + bump(t, 1.0, 4.0, up),
        lambda t: 0.0 * t,
    )


FLIGHTS: dict[str, Callable[..., MotionTrack]] = {
    "hover": hover,
    "vertical": vertical,
    "pirouette": pirouette,
    "slalom": slalom,
    "lateral-reposition": lateral_reposition,
    "depart-abort": depart_abort,
}
TARGETS = {"hover": np.zeros(3) - [0, 0, 5.0], "pirouette": np.zeros(3)}


def scored(name, scale=FULL_SCALE, **knobs):
    """Score of a made-up flight."""
    return score(FLIGHTS[name](**knobs), name, scale, TARGETS.get(name))


def result(assessment, criterion):
    """A criterion's result of a score."""
    return next(r for r in assessment.results if r.criterion.name == criterion)
