# SPDX-License-Identifier: Apache-2.0
"""What else is known of a recorded flight: touch-down, gusts, restarts, and how it ended."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from heli_bags.reader import Stream
from heli_dynamics_sim.ground import GroundKernel, ground_contact
from heli_flight.loop.settings import Settings
from heli_live_view.happenings import FAULT, GROUND, GUST, HEALTH, Happening
from heli_math.rows import PLANT
from heli_math.ticks import NS_PER_S

# Shorter stretches without contact are hops.
_BRIEF_NS = NS_PER_S


def touching(truth: Stream, ground: GroundKernel) -> np.ndarray:
    """Mask (N,) of the messages of ground truth at which the gear touches."""
    touches, x = np.zeros(len(truth.rows), bool), np.zeros(PLANT.size)
    for i, row in enumerate(truth.rows):
        x[PLANT.rigid] = row
        touches[i] = ground_contact(x, ground)[1]
    return touches


def of_ground(truth: Stream, ground: GroundKernel, start_ns: int) -> list[Happening]:
    """Lift-off and touch-down, out of ground truth and the plant's own gear."""
    touches = touching(truth, ground)
    edges = np.flatnonzero(np.diff(touches.astype(np.int8)))
    stamps = truth.stamp_ns
    found: list[Happening] = []
    kept: list[int] = []
    for i in edges.tolist():
        # Contact that comes back at once, and the hop before it, are one.
        if kept and touches[i + 1] and stamps[i + 1] - stamps[kept[-1] + 1] < _BRIEF_NS:
            kept.pop()
        else:
            kept.append(i)
    for i in kept:
        time_s = float((stamps[i + 1] - start_ns) / NS_PER_S)
        if touches[i + 1]:
            speed = _down_mps(truth.rows[i])
            found.append(Happening(time_s, GROUND, 0, "ground", f"touch-down at {speed:.2f} m/s"))
        else:
            found.append(Happening(time_s, GROUND, 0, "ground", "lift-off"))
    return found


def _down_mps(row: np.ndarray) -> float:
    """Speed downwards of a row of ground truth."""
    w, x, y, z = row[PLANT.quat]
    u, v, down = row[PLANT.vel]
    return float(
        2 * (x * z - w * y) * u + 2 * (y * z + w * x) * v + (1 - 2 * (x * x + y * y)) * down
    )


def of_result(told: Mapping[str, Any]) -> Iterator[Happening]:
    """What result.json has a time of and nobody said in flight; it may hold anything."""
    for gust in _entries(told, "random_gusts", "start_s"):
        peak = gust.get("peak_ned_mps")
        known = isinstance(peak, list) and all(isinstance(v, int | float) for v in peak)
        speed = f" of {math.hypot(*peak):.1f} m/s" if known and peak else ""
        yield Happening(gust["start_s"], GUST, 0, "wind", f"gust{speed} begins")
    for fault in _entries(told, "process_faults_done", "begun_s"):
        yield Happening(fault["begun_s"], FAULT, 1, str(fault.get("what")), f"{fault.get('kind')}")
    for restart in _entries(told, "restarts", "noticed_s"):
        node, why = restart.get("node"), restart.get("why")
        yield Happening(restart["noticed_s"], HEALTH, 2, str(node), f"{why}; started again")


def _entries(told: Mapping[str, Any], key: str, time: str) -> list[dict[str, Any]]:
    """Entries of a list that have a finite time."""
    given = told.get(key)
    return [
        one
        for one in (given if isinstance(given, list) else [])
        if isinstance(one, dict)
        and isinstance(one.get(time), int | float)
        and math.isfinite(one[time])
    ]


def ended(told: Mapping[str, Any], figures: str) -> str:
    """How the flight ended, by its result.json: one or two sentences; empty: it says nothing.

    Parameters
    ----------
    told : mapping
        Content of result.json; it may hold anything.
    figures : str
        What a flight of this kind is judged by.
    """
    if told.get("forged"):
        return f"Forged: {told['forged']}"
    if told.get("partial"):
        return f"Partial: {told['partial']}"
    flown, lost = told.get("flown_s"), told.get("lost")
    after = f" after {flown:.2f} s" if isinstance(flown, int | float) else ""
    if lost:
        return f"Lost{after}: {lost}"
    rows = told.get("verdicts")
    if not isinstance(rows, dict):
        return ""
    judged = [v for v in rows.values() if isinstance(v, dict) and v.get("decides")]
    return f"Flown to its end{after}. " + " ".join(_verdict(v, figures) for v in judged)


def _verdict(row: Mapping[str, Any], figures: str) -> str:
    stretch = str(row.get("stretch", "")).capitalize()
    where = f"{stretch} ({row.get('when')})"
    if row.get("inside") is None:
        return f"{where}: not scored."
    outside = row.get("outside")
    if row["inside"] or not isinstance(outside, list):
        return f"{where}: inside {figures}."
    return f"{where}: outside in {', '.join(map(str, outside))}."


def gear_of(settings: Settings) -> GroundKernel | None:
    """The gear, of a flight that begins or ends on the ground."""
    gear = settings.scenario.gear
    return None if gear is None else gear.ground
