# SPDX-License-Identifier: Apache-2.0
"""A rare failure and a worst case of real flights: examples/campaign_rare.yaml.

Usage: ./heli python scripts/rare_table.py [--per-level N] [--flights N]

What `heli campaign rare` and `heli campaign worst` find, their rows not kept. Prints JSON. The
lateral error's bound is taken nearer than the paper's, which none of 20 000 flights would reach.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from heli_flight.terminal import json_text

ROOT = Path(__file__).resolve().parents[1]
SPEC = "examples/campaign_rare.yaml"
RARE, BEYOND_M = "lateral (truth)", 0.5
WORST = "altitude (truth)"


def found(folder: str, word: str, *options: str) -> dict[str, Any]:
    """What the command says with --json; raises CalledProcessError."""
    out = f"{folder}/{word}"
    command = [ROOT / "heli", "campaign", word, SPEC, "--out", out, "--json", *options]
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


if __name__ == "__main__":
    sys.exit(main())
