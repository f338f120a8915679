# SPDX-License-Identifier: Apache-2.0
"""Draw docs/laws_everywhere.png from what `heli compare laws` found.

Usage: ./heli python -m evidence.draw_laws    after `./heli results make laws_everywhere`
"""

import sys

from evidence.files import checkout, read
from heli_core.errors import FlightError
from heli_studies.compare_flights import draw_law_matrix


def main() -> int:
    """Exit code 2, with a sentence, if the file is not made yet."""
    root = checkout()
    try:
        matrix = read(root, "laws_everywhere")["found"]
    except FlightError as exc:
        print(f"error: {exc}", file=sys.stderr)
        return 2
    draw_law_matrix(matrix, root / "docs" / "laws_everywhere.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
