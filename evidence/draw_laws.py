# SPDX-License-Identifier: Apache-2.0
"""Draw docs/laws_everywhere.png and docs/laws_hover.png from what was found of the controllers.

Usage: ./heli python -m evidence.draw_laws    after `./heli results make laws_everywhere laws_hover`
"""

import sys

from evidence.experiments import laws_hover
from evidence.files import checkout, read
from heli_core.errors import FlightError
from heli_studies.compare_flights import draw_law_matrix


def main() -> int:
    """Exit code 2, with a sentence, if the file is not made yet."""
    root = checkout()
    try:
        matrix, hover = (read(root, name)["found"] for name in ("laws_everywhere", "laws_hover"))
    except FlightError as exc:
        print(f"error: {exc}", file=sys.stderr)
        return 2
    draw_law_matrix(matrix, root / "docs" / "laws_everywhere.png")
    laws_hover.draw(hover, root / "docs" / "laws_hover.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
