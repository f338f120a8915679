# SPDX-License-Identifier: Apache-2.0
"""Draw docs/laws_everywhere.png from what `heli compare laws` found.

Usage: ./heli python scripts/draw_laws.py    after `./heli results make laws_everywhere`
"""

import sys

from heli_flight.errors import FlightError
from heli_flight.studies.compare.everywhere_picture import draw
from heli_flight.studies.results.files import checkout, read


def main() -> int:
    """Exit code 2, with a sentence, if the file is not made yet."""
    root = checkout()
    try:
        found = read(root, "laws_everywhere")["found"]
    except FlightError as exc:
        print(f"error: {exc}", file=sys.stderr)
        return 2
    draw(found, root / "docs" / "laws_everywhere.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
