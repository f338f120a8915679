# SPDX-License-Identifier: Apache-2.0
"""Identify aircraft on many seeds, fly the hover test with what was found, print JSON.

Usage: ./heli python -m evidence.experiments.identification [--seeds 1..20] [--aircraft FILE,FILE]

Each row is `heli identify --one-process --hover` of one aircraft and seed, beside the linearised
truth. Takes about 15 s each.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from evidence.files import Results
from evidence.registry import FIT, TWENTY, produces, table
from evidence.sweep import Options, over, print_result
from evidence.tables import grid, world
from heli_core.errors import FlightError
from heli_flight.result import RESULT, conditions
from heli_flight.settings import resolve
from heli_studies.identify import HOVER, SCENARIOS

DEFAULT = "helion.yaml"
GROUPS = {"A": "A", "B": "B", "E": "E", "": "servos", "norm": "norms"}


@over(aircraft=(DEFAULT,))
def identify(aircraft: str, seed: int) -> dict[str, Any]:
    """What the command says of one aircraft and seed, and the hover test's metrics.

    Raises
    ------
    FlightError
        The command failed; its last line.
    """
    with tempfile.TemporaryDirectory() as name:
        return _identified(aircraft, seed, Path(name) / "identified")


def _identified(aircraft: str, seed: int, folder: Path) -> dict[str, Any]:
    command = [sys.executable, "-m", "heli_flight.cli.app", "identify", "--one-process", "--hover"]
    command += ["--json", "--seed", str(seed), "--out", str(folder)]
    if aircraft != DEFAULT:
        command += ["--aircraft", aircraft]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise FlightError(f"identify: {aircraft}, seed {seed}: {done.stderr.splitlines()[-1]}")
    hover = json.loads((folder / HOVER / RESULT).read_text(encoding="utf-8"))
    return row_of(aircraft, seed, json.loads(done.stdout), hover)


def row_of(
    aircraft: str, seed: int, identified: dict[str, Any], hover: dict[str, Any]
) -> dict[str, Any]:
    """Per group the significant number that is furthest from the truth; what missed its target."""
    judged = [entry for entry in identified["entries"] if entry["met"] is not None]
    return {
        "aircraft": aircraft,
        "seed": seed,
        "judged": len(judged),
        "worst": {name: _worst(judged, group) for group, name in GROUPS.items()},
        "missed": [_short(entry) for entry in judged if not entry["met"]],
        "delay_ticks": identified["delay_ticks"],
        "trim_phi_rad": _error(identified["entries"], "trim phi, rad"),
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


def identified(options: Options, aircraft: Sequence[str]) -> dict[str, Any]:
    """All that the tables show."""
    points = [{"aircraft": name} for name in aircraft]
    rows = [row for place in identify.places(options, points) for row in place.flights]
    flown_in = {
        name: conditions(resolve(name)).splitlines() for name in (*SCENARIOS.values(), "hover")
    }
    return {"conditions": flown_in, "rows": rows}


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "identification",
    "./heli python -m evidence.experiments.identification --seeds 1..20",
    "The default aircraft identified from flight, then flown with what was found.",
    TWENTY,
    FIT,
)
produces(
    "identification_others",
    "./heli python -m evidence.experiments.identification "
    "--seeds 1 --aircraft xcell60.yaml,logo600.yaml",
    "Two other aircraft identified from flight, then flown with what was found.",
    (1,),
    FIT,
)


_GROUPS = ("A", "B", "servos", "E", "norms")


@table("identification")
def identification(results: Results) -> str:
    """Furthest from the truth over seeds, by kind of number, aircraft by aircraft."""
    head = ["aircraft", "seeds", *_GROUPS, "missed", "hover tests with exit code 0"]
    rows: list[list[str]] = []
    flown: dict[str, list[Any]] = {}
    for file in ("identification", "identification_others"):
        record = results[file]
        flown |= {test: [lines] for test, lines in record["conditions"].items()}
        for aircraft in dict.fromkeys(row["aircraft"] for row in record["rows"]):
            rows_of_aircraft = [row for row in record["rows"] if row["aircraft"] == aircraft]
            good = sum(row["hover_exit_code"] == 0 for row in rows_of_aircraft)
            rows.append(
                [
                    aircraft.removesuffix(".yaml"),
                    results.seeds(file).removeprefix("seeds ").removeprefix("seed "),
                    *(
                        _furthest([row["worst"][group] for row in rows_of_aircraft])
                        for group in _GROUPS
                    ),
                    f"{sum(len(row['missed']) for row in rows_of_aircraft)} of "
                    f"{sum(row['judged'] for row in rows_of_aircraft)}",
                    f"{good} of {len(rows_of_aircraft)}",
                ]
            )
    missed = [
        f"{row['aircraft'].removesuffix('.yaml')}, seed {row['seed']}: {entry['name']} is off by "
        f"{100.0 * abs(entry['deviation']):.2f} % ({100.0 * entry['target']:.0f} % allowed)"
        for file in ("identification", "identification_others")
        for row in results[file]["rows"]
        for entry in row["missed"]
    ]
    return (
        f"{grid(head, rows)}\n\nSignificant number of each kind that is furthest from the "
        f"linearised truth over all seeds. Missed: {'; '.join(missed) or 'none'}. Flown in one "
        f"process.\n{world(flown)}"
    )


def _furthest(entries: Sequence[Mapping[str, Any]]) -> str:
    worst = max(entries, key=lambda entry: abs(entry["deviation"]))
    return f"{100.0 * worst['deviation']:+.1f} % {worst['name']}"


if __name__ == "__main__":
    sys.exit(print_result(__doc__, identified, aircraft=DEFAULT))
