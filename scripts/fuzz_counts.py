# SPDX-License-Identifier: Apache-2.0
"""Count what becomes of damaged messages and files: taken, refused in a sentence, failed; JSON.

Usage: ./heli python scripts/fuzz_counts.py [--cases 10000]
Slow targets (whole commands, files that are resolved) get a share of the cases. Each case follows
from its target and number alone.
"""

import argparse
import json
import os
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from heli_flight.terminal import steps
from heli_flight.testing import fuzz_files, fuzz_messages
from heli_flight.testing.fuzzing import tally

TARGETS = {target.name: target for target in (*fuzz_messages.TARGETS, *fuzz_files.TARGETS)}
LEAST = 3


def count(name: str, cases: int) -> dict[str, Any]:
    """What became of a target's cases."""
    target = TARGETS[name]
    with tempfile.TemporaryDirectory(prefix="heli_fuzz_") as folder:
        found = tally(target, range(max(round(cases * target.share), LEAST)), Path(folder))
    return {
        "target": name,
        "cases": found.cases,
        "taken": found.taken,
        "refused": found.refused,
        "sentences": len(found.sentences),
        "failed": found.failed,
        "failures": found.failures,
    }


def main() -> int:
    """Print the counts; exit code 1 if a case failed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cases", type=int, default=10_000, metavar="N", help="of a fast target")
    cases = parser.parse_args().cases
    workers = len(os.sched_getaffinity(0))
    with ProcessPoolExecutor(workers) as pool, steps("targets", len(TARGETS)) as progress:
        rows = []
        for row in pool.map(count, TARGETS, [cases] * len(TARGETS)):
            rows.append(row)
            progress(len(rows))
    print(json.dumps({"cases": cases, "rows": rows}, indent=2))
    return int(any(row["failed"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
