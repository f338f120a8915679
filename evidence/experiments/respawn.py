# SPDX-License-Identifier: Apache-2.0
"""Hovers in real time in which nodes are killed or paused: noticed, back, metres lost; JSON.

Usage: ./heli python -m evidence.experiments.respawn [--seeds 1..10]

Each flight has all of it, one after the other. What is lost is how far the aircraft, by truth, gets
from where it was; what it wanders by itself in as long a time without a fault stands beside it.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from evidence.files import Results
from evidence.registry import NOT_COMPARED, produces, table
from evidence.sweep import Options, over, print_result
from evidence.tables import grid
from heli_bags.reader import Bag, read_bag
from heli_core.errors import FlightError
from heli_core.rows import PLANT
from heli_core.ticks import NS_PER_S
from heli_msgs_bridge.diagnostics import NodeState, state_of

WORLD = "honest"
NODES = ("observer", "inner_loop", "outer_loop")
PAUSE_S, APART_S, LOOK_S = 0.5, 8.0, 6.0
FIRST_S = 8.0
EVENTS = tuple((node, kind) for kind in ("kill", "pause") for node in NODES)
END_S = FIRST_S + APART_S * len(EVENTS)
_SOUND_S = FIRST_S - LOOK_S - 0.5
_PARAMS = f"""\
/**/scenario:
  ros__parameters:
    duration_s: {END_S}
    climb: {{start_s: 200.0, end_s: 202.0}}
"""


def _faults() -> str:
    lines = ["faults:"]
    for i, (node, kind) in enumerate(EVENTS):
        lasts = f", duration_s: {PAUSE_S}" if kind == "pause" else ""
        start_s = FIRST_S + i * APART_S
        lines.append(
            f"  - {{what: process, node: {node}, kind: {kind}, start_s: {start_s}{lasts}}}"
        )
    return "\n".join(lines) + "\n"


def _flown(seed: int, folder: Path) -> tuple[dict[str, Any], Bag]:
    """result.json and bag of a flight."""
    faults, params, out = folder / "faults.yaml", folder / "params.yaml", folder / f"seed{seed}"
    faults.write_text(_faults(), encoding="utf-8")
    params.write_text(_PARAMS, encoding="utf-8")
    words = ["--realtime", "--respawn", "--no-report", "--world", WORLD, "--seed", str(seed)]
    words += ["--faults", str(faults), "--params", str(params), "--out", str(out)]
    done = subprocess.run(
        [sys.executable, "-m", "heli_flight.cli.app", "hover", *words],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode not in (0, 1):
        raise FlightError(f"seed {seed}: {done.stderr.strip()}")
    return json.loads((out / "result.json").read_text(encoding="utf-8")), read_bag(out / "bag")


class _Times:
    """Flight times of a bag."""

    def __init__(self, bag: Bag) -> None:
        truth = bag.streams["ground_truth/odom"]
        self._zero_ns = truth.stamp_ns[0]
        self.time_s, self.pos = (
            (truth.stamp_ns - self._zero_ns) / NS_PER_S,
            truth.rows[:, PLANT.pos],
        )
        remarks = [r for r in bag.remarks if r.node == "plant"]
        self.plant = [
            ((r.stamp_ns - self._zero_ns) / NS_PER_S, state_of(r.facts, r.message)) for r in remarks
        ]

    def lost_m(self, from_s: float) -> float:
        """How far it gets from where it was, within `LOOK_S`."""
        window = (self.time_s >= from_s) & (self.time_s <= from_s + LOOK_S)
        return float(np.linalg.norm(self.pos[window] - self.pos[window][0], axis=1).max())

    def fell_back(self, from_s: float) -> list[float]:
        """When the actuator side began, and when it ceased, to fly by itself within `LOOK_S`."""
        times: list[float] = []
        for time_s, state in self.plant:
            silent = state == NodeState.WITHOUT_INPUT
            if from_s <= time_s <= from_s + LOOK_S and silent != bool(len(times) % 2):
                times.append(time_s)
        return times


def _event(done: dict[str, Any], restarts: list[dict[str, Any]], times: _Times) -> dict[str, Any]:
    """Figures of one kill or pause: after how long noticed and back, and what it cost."""
    begun_s = done["begun_s"]
    noticed, back = times.fell_back(begun_s), times.fell_back(begun_s)[1::2]
    events = [r for r in restarts if r["node"] == done["node"] and r["noticed_s"] >= begun_s - 0.05]
    if done["kind"] == "kill":
        restart = events[0]
        noticed_s = restart["noticed_s"]
        again = [restart["back_s"], *back] if restart["back_s"] is not None else []
    else:
        noticed_s = noticed[0] if noticed else None
        again = back
    return {
        "node": done["node"], "kind": done["kind"],
        "noticed_s": None if noticed_s is None else max(noticed_s - begun_s, 0.0),
        "back_s": max(again) - begun_s if again else None,
        "lost_m": times.lost_m(begun_s),
    }  # fmt: skip


@over()
def flight(seed: int) -> dict[str, Any]:
    """All figures of a seed."""
    with tempfile.TemporaryDirectory() as folder:
        result, bag = _flown(seed, Path(folder))
        times = _Times(bag)
    events = [_event(d, result["restarts"], times) for d in result["process_faults_done"]]
    whole = len(times.time_s) == round(END_S * 100)
    return {"seed": seed, "lost": bool(result["lost"]), "bag_whole": whole,
            "sound_m": times.lost_m(_SOUND_S), "events": events}  # fmt: skip


def experiment(options: Options) -> dict[str, Any]:
    """All that the table shows; in real time one flies after the other."""
    before = os.getloadavg()[0]
    (place,) = flight.places(replace(options, workers=1))
    content = {"seeds": options.seeds, "world": WORLD, "pause_s": PAUSE_S, "look_s": LOOK_S,
               "end_s": END_S,
               "machine": {"cores": os.cpu_count(), "load_before": before,
                           "load_after": os.getloadavg()[0]}}  # fmt: skip
    return content | {"flights": place.flights}


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "respawn",
    "./heli python -m evidence.experiments.respawn --seeds 1..10",
    "Hovers in real time in which nodes are killed or paused, with --respawn.",
    tuple(range(1, 11)),
    loose={key: NOT_COMPARED for key in ("machine", "flights")},
)


_GOALS: Mapping[str, Mapping[str, float | None]] = {
    "kill": {"noticed_s": 0.2, "back_s": 1.5, "lost_m": 3.0},
    "pause": {"noticed_s": None, "back_s": None, "lost_m": 1.0},
}


def _cell(events: Sequence[Mapping[str, Any]], key: str, goal: float | None) -> str:
    """Median and worst, and how many miss the goal."""
    known = [event[key] for event in events if event[key] is not None]
    if not known:
        return "–"
    cell = f"{np.median(known):.2f} / {max(known):.2f}"
    if goal is None:
        return cell
    missed = len(events) - sum(value <= goal for value in known)
    return f"{cell}; goal {goal:g}" + (f" missed on {missed}" if missed else "")


@table("respawn")
def respawn(results: Results) -> str:
    """Node by node: after how long noticed and back, and metres lost."""
    record = results["respawn"]
    flights = record["flights"]
    every = [event for flight in flights for event in flight["events"]]
    head = ["what", "node", "noticed after, s", "back after, s", "lost, m"]
    rows = []
    for node, kind in dict.fromkeys((event["node"], event["kind"]) for event in every):
        events = [e for e in every if (e["node"], e["kind"]) == (node, kind)]
        what = "SIGKILL" if kind == "kill" else f"SIGSTOP for {record['pause_s']:g} s"
        cells = [_cell(events, key, goal) for key, goal in _GOALS[kind].items()]
        rows.append([what, node, *cells])
    machine, sound = record["machine"], [flight["sound_m"] for flight in flights]
    whole = sum(flight["bag_whole"] for flight in flights)
    lost = sum(flight["lost"] for flight in flights)
    return (
        f"{grid(head, rows)}\n\nMedian / worst of {len(flights)} hovers in real time (seeds "
        f"{flights[0]['seed']} to {flights[-1]['seed']}), world {record['world']}, --respawn, each "
        f"with all six, {lost} lost; bags with every tick of ground truth: {whole}. Back: the new "
        f"node steps, and the actuator side has commands for the last time within "
        f"{record['look_s']:g} s that it lacked them, so that what other work stops meanwhile "
        f"counts, too. Lost: how far from its place within {record['look_s']:g} s, by truth; "
        f"without a fault it wanders {np.median(sound):.2f} / {max(sound):.2f} m. On "
        f"{machine['cores']} cores with other work on them: load {machine['load_before']:.1f} at "
        f"the beginning, {machine['load_after']:.1f} at the end."
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..10"))
