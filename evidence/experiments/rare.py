# SPDX-License-Identifier: Apache-2.0
"""A rare failure and a worst case of real flights: examples/campaign_rare.yaml.

Usage: ./heli python -m evidence.experiments.rare [--per-level N] [--flights N]

What `heli campaign rare` and `heli campaign worst` find, their rows not kept. Prints JSON. The
lateral error's bound is taken nearer than the paper's, which none of 20 000 flights would reach.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from evidence.files import Results
from evidence.registry import NOT_COMPARED, produces, table
from evidence.tables import grid
from heli_flight.terminal import json_text

ROOT = Path(__file__).resolve().parents[2]
SPEC = "examples/campaign_rare.yaml"
RARE, BEYOND_M = "lateral (truth)", 0.15
WORST = "altitude (truth)"


def outcome_of(folder: str, word: str, *options: str) -> dict[str, Any]:
    """What the command says with --json; raises CalledProcessError."""
    out = f"{folder}/{word}"
    command = [str(ROOT / "heli"), "campaign", word, SPEC, "--out", out, "--json", *options]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    content: dict[str, Any] = json.loads(done.stdout)
    return content


def main() -> int:
    """Exit code of the command that fails, if one does."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--per-level", default="2500")
    parser.add_argument("--flights", default="300", help="of each search for the worst")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="heli_rare_") as folder:
        try:
            rare = outcome_of(
                folder, "rare", "--of", RARE, "--beyond", str(BEYOND_M),
                "--per-level", asked.per_level,
            )  # fmt: skip
            worst = outcome_of(folder, "worst", "--of", WORST, "--flights", asked.flights)
        except subprocess.CalledProcessError as error:
            return error.returncode
    print(json_text({"spec": SPEC, "rare": rare, "worst": worst}), end="")
    return 0


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "rare",
    "./heli python -m evidence.experiments.rare",
    "How rarely a hover leaves a bound, and the worst case within 3 sigma.",
    (1,),
    # Which flights a level keeps hangs on rounding: elsewhere it is another sample.
    relative=NOT_COMPARED,
)


@table("rare")
def rare(results: Results) -> str:
    """Level by level how probable it is to be beyond."""
    record = results["rare"]["rare"]
    rows = [
        [f"{level['threshold']:.3f}", f"{level['probability']:.2g}", f"{level['cov']:.2f}",
         str(level["flights"])]
        for level in record["levels"]
    ]  # fmt: skip
    head = [f"{record['metric']} beyond, {record['unit']}", "probability",
            "coefficient of variation",
            "flights"]  # fmt: skip
    causes = ", ".join(f"{count} {cause}" for cause, count in record["causes"].items())
    if record["probability"] is None:
        answer = f"{record['ended']}; beyond {record['bound']:g} {record['unit']} is rarer"
    else:
        low, high = record["interval"]
        answer = (
            f"P(beyond {record['bound']:g} {record['unit']}) = {record['probability']:.2g}, "
            f"95 %: {low:.2g} to {high:.2g}"
        )
    return (
        f"{grid(head, rows)}\n\n{answer}. {record['flights']} flights ({causes}); paper's bound "
        f"{record['paper']:g} {record['unit']}; `{results['rare']['spec']}`, search's seed "
        f"{record['seed']}."
    )


@table("worst_case")
def worst_case(results: Results) -> str:
    """The largest figure that each search found, and where."""
    record = results["rare"]["worst"]
    searches = record["searches"]
    rows = [
        ["largest", *(_largest(one, record["unit"]) for one in searches.values())],
        ["found by flight", *(f"{s['after']} of {s['flights']}" for s in searches.values())],
        *(
            [f"`{name}`", *(f"{one['inputs'][name]:.3f}" for one in searches.values())]
            for name in record["dispersed"]
        ),
    ]
    return (
        f"{grid([record['metric'], *searches], rows)}\n\nWithin {record['sigma']:g} sigma of each; "
        f"bound (paper) {record['paper']:g} {record['unit']}; `{results['rare']['spec']}`, wind "
        f"and "
        f"sensors of seed {record['flight_seed']}, search's seed {record['seed']}."
    )


def _largest(search: Mapping[str, Any], unit: str) -> str:
    return "not flown to the end" if search["lost"] else f"{search['value']:.3f} {unit}"


if __name__ == "__main__":
    sys.exit(main())
