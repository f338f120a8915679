# SPDX-License-Identifier: Apache-2.0
"""Print A, B, E of the linearised default aircraft beside the published ones, entry by entry.

Usage: ./heli python -m evidence.experiments.deviations [--all] [--json]

Entries that are zero in both are left out, and without --all those of pure kinematics too (they are
exact). A deviation beyond 0.6 % and half a unit of the last published digit is explained; the tests
(tests/verification/test_linear_model.py) hold the same list.
"""

import argparse
import json
import sys
from pathlib import Path

import yaml

from evidence.files import Results
from evidence.registry import produces, table
from evidence.tables import grid
from heli_core.rows import INPUT_NAMES, STATE_NAMES, WIND_NAMES
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_dynamics_sim.trim import LinearModel, linearize, trim

DATA = Path(__file__).resolve().parents[2] / "tests/verification/data"
COLUMNS = {"A": STATE_NAMES, "B": INPUT_NAMES, "E": WIND_NAMES}
RELATIVE, LAST_DIGIT = 0.006, 0.5e-4
_KINEMATIC = ("phi", "theta", "psi", "d_int")


def rows(model: LinearModel, every: bool = False) -> list[tuple[str, float, float, str, str]]:
    """(entry, published, ours, deviation, remark) of all entries that say something.

    Parameters
    ----------
    model : LinearModel
    every : bool
        With the rows of pure kinematics.
    """
    published = yaml.safe_load((DATA / "nus_linear_model.yaml").read_text(encoding="utf-8"))
    known = yaml.safe_load((DATA / "known_deviations.yaml").read_text(encoding="utf-8"))
    entries = []
    for name, columns in COLUMNS.items():
        for i, row in enumerate(STATE_NAMES):
            for j, column in enumerate(columns):
                theirs, ours = float(published[name][i][j]), float(getattr(model, name)[i, j])
                empty = theirs == 0.0 and abs(ours) <= LAST_DIGIT
                if empty or (row in _KINEMATIC and not every):
                    continue
                entry = f"{name}({row}, {column})"
                beyond = abs(ours - theirs) > RELATIVE * abs(theirs) + LAST_DIGIT
                remark = known[entry]["why"] if entry in known else ""
                if beyond and not remark:
                    remark = "UNEXPLAINED"
                share = f"{100.0 * (ours / theirs - 1.0):+.2f} %" if theirs else "-"
                entries.append((entry, theirs, ours, share, remark))
    return entries


def main() -> int:
    """Print the table as Markdown; 0 if every deviation beyond the bound is explained."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--all", action="store_true", help="with the rows of pure kinematics")
    parser.add_argument("--json", action="store_true", help="print JSON instead of Markdown")
    options = parser.parse_args()
    aircraft = HelicopterParameters.from_yaml("helion.yaml")
    table = rows(linearize(aircraft, trim(aircraft)), options.all)
    if options.json:
        keys = ("entry", "published", "ours", "deviation", "remark")
        print(json.dumps({"rows": [dict(zip(keys, row, strict=True)) for row in table]}))
    else:
        print("| entry | published | ours | deviation | remark |\n|---|---|---|---|---|")
        for entry, theirs, ours, share, remark in table:
            print(f"| {entry} | {theirs:.4f} | {ours:.4f} | {share} | {remark} |")
    return int(any(row[4] == "UNEXPLAINED" for row in table))


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "deviations",
    "./heli python -m evidence.experiments.deviations --json",
    "A, B, E of the linearised aircraft beside the published ones.",
)


@table("deviations")
def deviations(results: Results) -> str:
    """Entries of A, B, E that are not the published ones."""
    rows = results["deviations"]["rows"]
    explained = [
        [row["entry"], f"{row['published']:.4f}", f"{row['ours']:.4f}", row["remark"]]
        for row in rows
        if row["remark"]
    ]
    return (
        f"{grid(['entry', 'published', 'ours', 'why'], explained)}\n\nThe other "
        f"{len(rows) - len(explained)} of {len(rows)} entries that are not zero or pure kinematics "
        "are within 0.6 % of the published ones or half a unit of their last digit."
    )


if __name__ == "__main__":
    sys.exit(main())
