# SPDX-License-Identifier: Apache-2.0
"""Tables of flights whose processes are killed or paused."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from heli_flight.studies.results.files import Results
from heli_flight.studies.results.grid import grid

_GOALS: Mapping[str, Mapping[str, float | None]] = {
    "kill": {"noticed_s": 0.2, "back_s": 1.5, "lost_m": 3.0},
    "pause": {"noticed_s": None, "back_s": None, "lost_m": 1.0},
}


def _cell(events: Sequence[Mapping[str, Any]], key: str, goal: float | None) -> str:
    """Median and worst, and how many miss the goal."""
    known = [event[key] for event in events if event[key] is not None]
    if not known:
        return "–"
    said = f"{np.median(known):.2f} / {max(known):.2f}"
    if goal is None:
        return said
    missed = len(events) - sum(value <= goal for value in known)
    return f"{said}; goal {goal:g}" + (f" missed on {missed}" if missed else "")


def respawn(results: Results) -> str:
    """Node by node: after how long noticed and back, and metres lost."""
    found = results["respawn"]
    flights = found["flights"]
    every = [event for flight in flights for event in flight["events"]]
    head = ["what", "node", "noticed after, s", "back after, s", "lost, m"]
    rows = []
    for node, kind in dict.fromkeys((event["node"], event["kind"]) for event in every):
        events = [e for e in every if (e["node"], e["kind"]) == (node, kind)]
        what = "SIGKILL" if kind == "kill" else f"SIGSTOP for {found['pause_s']:g} s"
        cells = [_cell(events, key, goal) for key, goal in _GOALS[kind].items()]
        rows.append([what, node, *cells])
    machine, sound = found["machine"], [flight["sound_m"] for flight in flights]
    whole = sum(flight["bag_whole"] for flight in flights)
    lost = sum(flight["lost"] for flight in flights)
    return (
        f"{grid(head, rows)}\n\nMedian / worst of {len(flights)} hovers in real time (seeds "
        f"{flights[0]['seed']} to {flights[-1]['seed']}), world {found['world']}, --respawn, each "
        f"with all six, {lost} lost; bags with every tick of ground truth: {whole}. Back: the new "
        f"node steps, and the actuator side has commands for the last time within "
        f"{found['look_s']:g} s that it lacked them, so that what other work stops meanwhile "
        f"counts, too. Lost: how far from its place within {found['look_s']:g} s, by truth; "
        f"without a fault it wanders {np.median(sound):.2f} / {max(sound):.2f} m. On "
        f"{machine['cores']} cores with other work on them: load {machine['load_before']:.1f} at "
        f"the beginning, {machine['load_after']:.1f} at the end."
    )
