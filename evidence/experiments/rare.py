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
RARE, BEYOND_M = "lateral (truth)", 0.5
WORST = "altitude (truth)"


def found(folder: str, word: str, *options: str) -> dict[str, Any]:
    """What the command says with --json; raises CalledProcessError."""
    out = f"{folder}/{word}"
    command = [str(ROOT / "heli"), "campaign", word, SPEC, "--out", out, "--json", *options]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    said: dict[str, Any] = json.loads(done.stdout)
    return said


def main() -> int:
    """Exit code of the command that fails, if one does."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--per-level", default="2500")
    parser.add_argument("--flights", default="300", help="of each search for the worst")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="heli_rare_") as folder:
        try:
            rare = found(
                folder, "rare", "--of", RARE, "--beyond", str(BEYOND_M),
                "--per-level", asked.per_level,
            )  # fmt: skip
            worst = found(folder, "worst", "--of", WORST, "--flights", asked.flights)
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
    found = results["rare"]["rare"]
    rows = [
        [f"{level['threshold']:.3f}", f"{level['probability']:.2g}", f"{level['cov']:.2f}",
         str(level["flights"])]
        for level in found["levels"]
    ]  # fmt: skip
    head = [f"{found['metric']} beyond, {found['unit']}", "probability", "coefficient of variation",
            "flights"]  # fmt: skip
    causes = ", ".join(f"{count} {cause}" for cause, count in found["causes"].items())
    if found["probability"] is None:
        answer = f"{found['ended']}; beyond {found['bound']:g} {found['unit']} is rarer"
    else:
        low, high = found["interval"]
        answer = (
            f"P(beyond {found['bound']:g} {found['unit']}) = {found['probability']:.2g}, "
            f"95 %: {low:.2g} to {high:.2g}"
        )
    return (
        f"{grid(head, rows)}\n\n{answer}. {found['flights']} flights ({causes}); paper's bound "
        f"{found['paper']:g} {found['unit']}; `{results['rare']['spec']}`, search's seed "
        f"{found['seed']}."
    )


@table("worst_case")
def worst_case(results: Results) -> str:
    """The largest figure that each search found, and where."""
    found = results["rare"]["worst"]
    searches = found["searches"]
    rows = [
        ["largest", *(_largest(one, found["unit"]) for one in searches.values())],
        ["found by flight", *(f"{s['after']} of {s['flights']}" for s in searches.values())],
        *(
            [f"`{name}`", *(f"{one['inputs'][name]:.3f}" for one in searches.values())]
            for name in found["dispersed"]
        ),
    ]
    return (
        f"{grid([found['metric'], *searches], rows)}\n\nWithin {found['sigma']:g} sigma of each; "
        f"bound (paper) {found['paper']:g} {found['unit']}; `{results['rare']['spec']}`, wind and "
        f"sensors of seed {found['flight_seed']}, search's seed {found['seed']}."
    )


def _largest(search: Mapping[str, Any], unit: str) -> str:
    return "not flown to the end" if search["lost"] else f"{search['value']:.3f} {unit}"


if __name__ == "__main__":
    sys.exit(main())
