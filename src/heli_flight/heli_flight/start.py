# SPDX-License-Identifier: Apache-2.0
"""What `hover_test.sh` and `heli` start: python -m heli_flight.start hover_test|heli ARGUMENT..."""

import sys
from collections.abc import Callable
from importlib.util import find_spec

from heli_flight import interrupts

_TYPER = (
    "needs typer 0.29 or newer, which Ubuntu's packages are not: use ./heli or ./hover_test.sh, or "
    "activate .venv-ros first (CONTRIBUTING.md)"
)


def _refuse_old_typer(name: str) -> None:
    """One sentence and exit code 2 instead of a traceback."""
    if find_spec("typer") is None or find_spec("typer.exceptions") is None:
        sys.stderr.write(f"{name}: {_TYPER}\n")
        sys.exit(2)


def _load_hover_test() -> Callable[[], int]:
    _refuse_old_typer("hover_test")
    from heli_flight.cli import hover_test

    return lambda: hover_test.main(sys.argv[1:])


def _load_heli() -> Callable[[], int]:
    _refuse_old_typer("heli")
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
