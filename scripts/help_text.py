# SPDX-License-Identifier: Apache-2.0
"""Write scripts/help.txt: what commands answer to --help, for a checkout without environment.

    ./heli python scripts/help_text.py            write it; --check: say whether it is so

`./heli COMMAND --help` and `./hover_test.sh --help` print from it (scripts/help_text.sh) until
set-up has been made; from then on the commands answer themselves. A test compares the two.
"""

import argparse
import contextlib
import io
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

FILE = Path(__file__).resolve().with_name("help.txt")
HEAD = (
    "Written by scripts/help_text.py: what commands answer to --help. A line that begins with a "
    "form feed names one.\n"
)
MARK = "\f"
COLUMNS = 80


def commands(words: tuple[str, ...], command: Any) -> Iterator[tuple[str, ...]]:
    """Names of a command and of all below it."""
    yield words
    for name, inner in command.commands.items() if hasattr(command, "commands") else ():
        if not inner.hidden:
            yield from commands((*words, name), inner)


def said(main: Callable[[Sequence[str]], int], words: Sequence[str]) -> str:
    """What a command prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        code = main([*words, "--help"])
    if code:
        raise SystemExit(f"help_text: {' '.join(words)} --help: exit code {code}")
    return out.getvalue()


def text() -> str:
    """The whole file."""
    os.environ["COLUMNS"] = str(COLUMNS)
    from typer.main import get_command

    from heli_flight.cli import app, hover_test

    parts = [HEAD, f"{MARK}hover_test\n", said(hover_test.main, [])]
    for words in commands((), get_command(app.app)):
        parts += [f"{MARK}{' '.join(('heli', *words))}\n", said(app.main, words)]
    return "".join(parts)


def main() -> int:
    """Write, or compare; returns the exit code."""
    parser = argparse.ArgumentParser(description="Write scripts/help.txt.")
    parser.add_argument("--check", action="store_true", help="write nothing; code 1 if it differs")
    check = parser.parse_args().check
    found = text()
    if not check:
        FILE.write_text(found, encoding="utf-8")
    elif found != FILE.read_text(encoding="utf-8"):
        print("error: scripts/help.txt is not what the commands say", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
