# SPDX-License-Identifier: Apache-2.0
"""docs/failsafes.md out of the table of failsafes.

Usage: python scripts/failsafe_page.py            write the page
       python scripts/failsafe_page.py --check    exit code 1 if it is stale
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from heli_outer_pd.failsafes import FAILSAFES, Action

PAGE = Path(__file__).resolve().parents[1] / "docs" / "failsafes.md"
_HEAD = """\
# Failsafes of navigation and of links
What goes wrong, how it is found, and what the aircraft does by itself; the same in one process and
in the graph, as detection stands in the kernels of observer, loops and actuator side. Drawn from
`heli_outer_pd/failsafes.py` by `./heli python scripts/failsafe_page.py`; each row is flown in
`tests/flight/test_failsafes*.py`. Of several actions the one further down in the second table wins.
Nodes that are gone are of the graph alone, flown in `tests/graph/test_respawn.py`.

"""


def page() -> str:
    """The whole page."""
    lines = ["| condition | detected by | within | action | recovery | what a user sees |",
             "|---|---|---|---|---|---|"]  # fmt: skip
    for row in FAILSAFES:
        cells = (row.condition, row.detected, f"{row.within_s:g} s", row.action.words, row.recovery,
                 row.status)  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    lines += ["", "| action | what the aircraft does |", "|---|---|"]
    lines += [f"| {action.name} | {action.words} |" for action in Action]
    return _HEAD + "\n".join(lines) + "\n"


def main(args: Sequence[str] | None = None) -> int:
    """Write or check the page."""
    parser = argparse.ArgumentParser(description="docs/failsafes.md out of its table")
    parser.add_argument("--check", action="store_true", help="do not write, compare")
    if parser.parse_args(args).check:
        return int(PAGE.read_text(encoding="utf-8") != page())
    PAGE.write_text(page(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
