# SPDX-License-Identifier: Apache-2.0
"""Count what becomes of damaged messages and files: taken, refused in a sentence, failed; JSON.

Usage: ./heli python -m evidence.experiments.fuzz [--cases 10000] [--commands 10000]
Each case follows from its target and number alone. A command on a damaged bag takes 40 ms, a report
200 ms: 10 000 of each are an hour and more of processor time.
"""

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from evidence.files import Results
from evidence.registry import produces, table
from evidence.tables import grid
from heli_flight.terminal import steps

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
from support import fuzz_files, fuzz_messages
from support.fuzzing import MANY, tally

TARGETS = {target.name: target for target in (*fuzz_messages.TARGETS, *fuzz_files.TARGETS)}
COMMAND = "heli "


def count(name: str, cases: int) -> dict[str, Any]:
    """What became of a target's cases."""
    target = TARGETS[name]
    with tempfile.TemporaryDirectory(prefix="heli_fuzz_") as folder:
        tallied = tally(target, range(cases), Path(folder))
    return {
        "target": name,
        "cases": tallied.cases,
        "taken": tallied.taken,
        "refused": tallied.refused,
        "sentences": len(tallied.sentences),
        "failed": tallied.failed,
        "failures": tallied.failures,
    }


def main() -> int:
    """Print the counts; exit code 1 if a case failed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cases", type=int, default=MANY, metavar="N", help="of a message or file")
    parser.add_argument("--commands", type=int, metavar="N", help="of a command, a tenth of these")
    asked = parser.parse_args()
    commands = max(asked.cases // 10, 1) if asked.commands is None else asked.commands
    cases = [commands if name.startswith(COMMAND) else asked.cases for name in TARGETS]
    workers = len(os.sched_getaffinity(0))
    with ProcessPoolExecutor(workers) as pool, steps("targets", len(TARGETS)) as progress:
        rows = []
        for row in pool.map(count, TARGETS, cases):
            rows.append(row)
            progress(len(rows))
    print(json.dumps({"cases": asked.cases, "rows": rows}, indent=2))
    return int(any(row["failed"] for row in rows))


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "fuzz",
    "./heli python -m evidence.experiments.fuzz --cases 10000",
    "Damaged messages and files: taken, refused in a sentence, failed.",
    (),
)


_FUZZED = {
    "message": "messages of every topic that is heard",
    "parameters": "parameter files",
    "scenario": "scenario files",
    "campaign": "campaign specs",
    "aircraft": "aircraft files",
    "heli": "commands on damaged bags and folders",
}


@table("fuzz")
def fuzz(results: Results) -> str:
    """Damaged input by kind: how many cases, and what became of them."""
    record = results["fuzz"]
    kinds: dict[str, list[Mapping[str, Any]]] = {}
    for row in record["rows"]:
        kinds.setdefault(row["target"].split()[0], []).append(row)
    rows = [
        [
            _FUZZED.get(kind, kind),
            str(len(counts)),
            *(str(sum(row[key] for row in counts)) for key in ("cases", "taken", "refused")),
            str(sum(row["sentences"] for row in counts)),
            str(sum(row["failed"] for row in counts)),
        ]
        for kind, counts in kinds.items()
    ]
    head = ["what", "targets", "cases", "taken", "refused", "beginnings of refusals", "failed"]
    return (
        f"{grid(head, rows)}\n\nFailed: a traceback, an output that is not finite or out of range, "
        f"or a refusal that is not one sentence."
    )


if __name__ == "__main__":
    sys.exit(main())
