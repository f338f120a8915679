# SPDX-License-Identifier: Apache-2.0
"""What `heli log info` says of a real helicopter's record, and the same of ours; JSON.

Usage: ./heli python -m evidence.experiments.real_flight [--seeds 1]
"""

import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from evidence.files import Results
from evidence.registry import FIT, produces, table
from evidence.sweep import Options, over, print_result
from evidence.tables import grid
from heli_core.rows import IMU
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_studies.logs.info import info_of, vibration_of
from heli_studies.logs.read import read_log
from heli_studies.logs.signals import LoggedSignal

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "logs"
WORLDS = ("paper", "honest")
RATES = ("p", "q", "r")


@over(world=WORLDS)
def shaken(world: str, seed: int) -> list[dict[str, Any]]:
    """What our gyro shows above 10 Hz in the hover test of a world."""
    record = simulate(resolve("hover", "rtk", seed, world=world)).record
    assert record.imu is not None
    columns = record.imu[:, IMU.rate].T
    signals = {
        name: LoggedSignal(name, "imu", record.time_s, np.ascontiguousarray(column))
        for name, column in zip(RATES, columns, strict=True)
    }
    return [asdict(vibration) for vibration in vibration_of(signals)]


def experiment(options: Options) -> dict[str, Any]:
    """The record's facts, without the path of this machine, and ours."""
    info = info_of(read_log(FOLDER / "trex550.csv", FOLDER / "trex550.yaml"))
    said = info.as_dict()
    ours = {place.point["world"]: place.flights[0] for place in shaken.places(options)}
    keys = ("length_s", "inputs", "answers", "parts", "kinematics", "vibration")
    return {"seeds": options.seeds, "record": {key: said[key] for key in keys}, "ours": ours}


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "real_flight",
    "./heli python -m evidence.experiments.real_flight --seeds 1",
    "A real helicopter's record: kinematics, what identifies, vibration beside our sensors'.",
    (1,),
    relative=FIT,
)
_WORDS = {"YES": "identifies", "PARTLY": "partly", "NO": "not"}
_WHY = {"LOW_COHERENCE": "lost in noise", "NO_OUTPUT": "not recorded", "NARROW": "narrow", None: ""}


def _band(answer: Mapping[str, Any]) -> list[str]:
    low, high = answer["usable_hz"] or (None, None)
    return ["" if low is None else f"{low:.2f} to {high:.2f}"]


@table("real_flight_answers")
def answers(results: Results) -> str:
    """What identifies of the real record."""
    record = results["real_flight"]["record"]
    head = ["answer", "verdict", "why", "usable, Hz", "largest partial coherence"]
    rows = [
        [f"{a['output']} from {a['input']}", _WORDS[a["verdict"]],
         _WHY.get(a["cause"], str(a["cause"])), *_band(a),
         "" if a["coherence"] is None else f"{a['coherence']:.2f}"]
        for a in record["answers"]
    ]  # fmt: skip
    return grid(head, rows)


@table("real_flight_kinematics")
def kinematics(results: Results) -> str:
    """Angles beside the integral of the rates."""
    record = results["real_flight"]["record"]
    head = ["angle", "measured over integrated", "later by, ms", "something else"]
    rows = [
        [k["angle"], f"{k['scale']:.3f}", f"{1e3 * k['lag_s']:.0f}",
         f"{100.0 * k['unexplained']:.1f} %"]
        for k in record["kinematics"]
    ]  # fmt: skip
    return grid(head, rows)


@table("real_flight_vibration")
def vibration(results: Results) -> str:
    """Rates above 10 Hz: the real gyro's and ours."""
    found = results["real_flight"]
    head = ["rate", "T-REX 550, rad/s", "its lines, Hz", *(f"ours, world {w}" for w in WORLDS)]
    rows = []
    for k, name in enumerate(RATES):
        real = next(v for v in found["record"]["vibration"] if v["name"] == name)
        lines = ", ".join(f"{f:.1f}" for f in real["peaks_hz"])
        ours = [f"{found['ours'][world][k]['rms']:.4f}" for world in WORLDS]
        rows.append([name, f"{real['rms']:.4f}", lines, *ours])
    note = "Rms from 10 to 50 Hz, all sampled at 100 Hz: what is faster is folded into it."
    return f"{grid(head, rows)}\n\n{note}"


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1"))
