# SPDX-License-Identifier: Apache-2.0
"""Identify aircraft on many seeds, fly the hover test with what was found, print JSON.

Usage: python scripts/identify_seeds.py [--seeds 1..20] [--aircraft helion.yaml,logo600.yaml]

Each row is `heli identify --one-process --hover` of one aircraft and seed, beside the linearised
truth. Takes about 15 s each.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from seeds_option import parser_with_seeds

from heli_flight.loop.result import RESULT, conditions
from heli_flight.loop.settings import resolve
from heli_flight.studies.identify.command import HOVER, SCENARIOS
from heli_flight.terminal import steps

DEFAULT = "helion.yaml"
GROUPS = {"A": "A", "B": "B", "E": "E", "": "servos", "norm": "norms"}


def identify(aircraft: str, seed: int, folder: Path) -> dict[str, Any]:
    """What the command says of one aircraft and seed, and the hover test's metrics.

    Raises
    ------
    SystemExit
        The command failed; its last line.
    """
    command = [sys.executable, "-m", "heli_flight.cli.app", "identify", "--one-process", "--hover"]
    command += ["--json", "--seed", str(seed), "--out", str(folder)]
    if aircraft != DEFAULT:
        command += ["--aircraft", aircraft]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise SystemExit(f"identify_seeds: {aircraft}, seed {seed}: {done.stderr.splitlines()[-1]}")
    hover = json.loads((folder / HOVER / RESULT).read_text(encoding="utf-8"))
    return row_of(aircraft, seed, json.loads(done.stdout), hover)


def row_of(
    aircraft: str, seed: int, found: dict[str, Any], hover: dict[str, Any]
) -> dict[str, Any]:
    """Per group the significant number that is furthest from the truth; what missed its target."""
    judged = [entry for entry in found["entries"] if entry["met"] is not None]
    return {
        "aircraft": aircraft,
        "seed": seed,
        "judged": len(judged),
        "worst": {name: _worst(judged, group) for group, name in GROUPS.items()},
        "missed": [_short(entry) for entry in judged if not entry["met"]],
        "delay_ticks": found["delay_ticks"],
        "trim_phi_rad": _error(found["entries"], "trim phi, rad"),
        "hover_exit_code": hover["exit_code"],
    }


def _worst(judged: Sequence[dict[str, Any]], group: str) -> dict[str, Any]:
    members = [entry for entry in judged if entry["group"] == group]
    return _short(max(members, key=lambda entry: abs(entry["deviation"])))


def _short(entry: dict[str, Any]) -> dict[str, Any]:
    return {key: entry[key] for key in ("name", "deviation", "target")}


def _error(entries: Sequence[dict[str, Any]], name: str) -> float:
    entry = next(entry for entry in entries if entry["name"] == name)
    return float(entry["identified"] - entry["truth"])


def main() -> int:
    """Identify all; 0."""
    parser = parser_with_seeds(__doc__)
    parser.add_argument("--aircraft", default=DEFAULT, help="names, with commas between")
    options = parser.parse_args()
    wanted = [(a, s) for a in options.aircraft.split(",") for s in options.seeds]
    rows = []
    with (
        tempfile.TemporaryDirectory() as name,
        steps("identified", len(wanted)) as progress,
    ):
        for aircraft, seed in wanted:
            rows.append(identify(aircraft, seed, Path(name) / f"{aircraft}_{seed}"))
            progress(len(rows))
    flown_in = {
        name: conditions(resolve(name)).splitlines() for name in (*SCENARIOS.values(), "hover")
    }
    print(json.dumps({"conditions": flown_in, "rows": rows}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
