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

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "failsafes.md"
sys.path.insert(0, str(ROOT))
from evidence.markdown import rendered  # noqa: E402  (of the checkout, in no package)

_HEAD = """\
# Failsafes of navigation and of links
What goes wrong, how it is found, and what the aircraft does by itself; the same in one process and
in the graph, as detection stands in the kernels of observer, loops and actuator side. Drawn from
`heli_outer_pd/failsafes.py` by `./heli python scripts/failsafe_page.py`; each row is flown in
`tests/flight/test_failsafes*.py`. Of several actions the one further down in the second table wins.
Nodes that are gone are of the graph alone, flown in `tests/graph/test_respawn.py`.

"""

_TAIL = """
## A receiver that is lost for good
Without fixes the place is held by dead reckoning, whose error grows with the square of the time
and faster. What can be done about that is to be down before it is too much: where the error would
pass `failsafe.land_astray_m` by the time it stands, it lands, and quickly.

<!-- results: gps_lost -->

<!-- end -->

**What is possible** is said by the grade of the inertial sensors, and by how long there were fixes
to learn their errors by:

<!-- results: gps_lost_curve -->

<!-- end -->

Reading the drag, as PX4 and ArduPilot can, would move the time at which the worst of 40 is 10 m off
by a second or two, at its very best: read without error, and on both axes, while this aircraft's
drag forward is next to none. A landing that is over sooner is worth more, so drag is not read.
Flights that had to go on for 30 s would gain by it, and would still not stay within 10 m with a
standalone receiver.

Where the flight has begun in the air, and its reference is flown where it says, the receiver alone
tells where the ground is, by metres wrong: then it comes down at `failsafe.feel_mps` all the way
and touches down at that speed. Higher up the same landing takes longer, and from some tens of
metres on nothing keeps it within 10 m.
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
    return rendered(_HEAD + "\n".join(lines) + "\n" + _TAIL, PAGE, ROOT)


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
