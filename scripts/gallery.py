#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The pictures of docs/gallery, drawn by the code that the page shows.

Usage: ./heli python scripts/gallery.py [PICTURE ...]

Without names all examples are run; `hover mpc` runs those that draw hover.png and mpc.png.
"""

import os
import re
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs/gallery/README.md"
_FENCE = re.compile(r"(?ms)^```(py|text)\n(.*?)^```")
_PICTURE = re.compile(r"!\[[^\]]+\]\(([\w-]+)\.png\)")


@dataclass(frozen=True)
class Example:
    """A section of the page.

    Attributes
    ----------
    picture : str
        Name of its picture, without `.png`.
    title : str
    commands : tuple of str
        Commands of `heli` that come before the code.
    code : str
    """

    picture: str
    title: str
    commands: tuple[str, ...]
    code: str


def examples(page: Path = PAGE) -> dict[str, Example]:
    """The examples of the page, by picture."""
    found = {}
    for section in re.split(r"(?m)^## ", page.read_text(encoding="utf-8"))[1:]:
        title = section.splitlines()[0]
        blocks = dict.fromkeys(("py", "text"), "") | dict(_FENCE.findall(section))
        (picture,) = _PICTURE.findall(section)
        commands = tuple(blocks["text"].splitlines())
        found[picture] = Example(picture, title, commands, blocks["py"])
    return found


@contextmanager
def _inside(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def run(example: Example, folder: Path) -> dict[str, Any]:
    """Run an example in a folder, where its picture is then; returns its names.

    Raises
    ------
    SystemExit
        A command failed, or the code drew no picture.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot

    from heli_flight.cli import app

    names: dict[str, Any] = {"__name__": example.picture}
    with _inside(folder):
        for command in example.commands:
            program, *words = shlex.split(command)
            if program != "./heli" or app.main(words):
                raise SystemExit(f"gallery: {example.title}: {command}: failed")
        try:
            exec(compile(example.code, f"{PAGE.name}, {example.title}", "exec"), names)
        finally:
            pyplot.close("all")
    if not (folder / f"{example.picture}.png").is_file():
        raise SystemExit(f"gallery: {example.title}: drew no {example.picture}.png")
    return names


def main(words: Sequence[str] | None = None) -> int:
    """Draw the pictures; returns the exit code."""
    known = examples()
    wanted = list(sys.argv[1:] if words is None else words) or list(known)
    if unknown := [name for name in wanted if name not in known]:
        print(f"gallery: no {unknown[0]}; there are {', '.join(known)}", file=sys.stderr)
        return 2
    for name in wanted:
        with tempfile.TemporaryDirectory() as folder:
            run(known[name], Path(folder))
            shutil.copyfile(Path(folder, f"{name}.png"), PAGE.with_name(f"{name}.png"))
        print(f"written: {PAGE.with_name(f'{name}.png')}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
