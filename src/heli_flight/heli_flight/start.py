# SPDX-License-Identifier: Apache-2.0
"""What `hover_test.sh` and `heli` start: python -m heli_flight.start hover_test|heli ARGUMENT..."""

import sys
from collections.abc import Callable

from heli_flight import interrupts


def _load_hover_test() -> Callable[[], int]:
    from heli_flight.cli import hover_test

    return lambda: hover_test.main(sys.argv[1:])


def _load_heli() -> Callable[[], int]:
    from heli_flight.cli import app

    return lambda: app.main(sys.argv[1:])


def heli() -> int:
    """Entry point of the command `heli`; returns the exit code."""
    return interrupts.run(_load_heli)


def main() -> int:
    """Run the command that the first argument names."""
    name = sys.argv.pop(1)
    return interrupts.run({"hover_test": _load_hover_test, "heli": _load_heli}[name])


if __name__ == "__main__":
    sys.exit(main())
