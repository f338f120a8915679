# SPDX-License-Identifier: Apache-2.0
"""What stands between markers of a Markdown file is rendered from result files.

<!-- results: paper -->                     a table of `registry.TABLES`
<!-- end -->

<!-- value: speed loop.times .0f -->120<!-- end -->     one number: file, place, format
"""

import os
import re
from pathlib import Path
from typing import Any

from evidence.files import NotMadeError, Results, path_of, read
from evidence.registry import TABLES, load
from heli_core.errors import FlightError

_BLOCK = re.compile(r"(<!-- results: (\S+) -->\n).*?(<!-- end -->)", re.S)
_VALUE = re.compile(r"(<!-- value: (\S+) (\S+) (\S+) -->)[^`\n]*?(<!-- end -->)")


def markdown_files(root: Path) -> list[Path]:
    """Files that may hold rendered numbers."""
    folders = ("src/*/README.md", "benchmarks/*.md", "docs/**/*.md")
    paths = [root / "README.md", *(path for folder in folders for path in root.glob(folder))]
    return sorted(path for path in paths if path.is_file())


def rendered(text: str, file: Path, root: Path) -> str:
    """The text of a Markdown file with everything between markers rendered anew.

    Raises
    ------
    FlightError
        A marker names a table, a file or a place that does not exist.
    """
    load()

    def block(match: re.Match[str]) -> str:
        name = match[2]
        if name not in TABLES:
            raise FlightError(f"{file.name}: {match[1].strip()}: no such table")
        results = Results(root)
        try:
            body = f"{TABLES[name](results)}\n\n{_made_by(results, file)}"
        except NotMadeError as error:
            body = f"Not measured yet: `./heli results make {error.name}` does it."
        return f"{match[1]}\n{body}\n\n{match[3]}"

    def value(match: re.Match[str]) -> str:
        number: Any = read(root, match[2])["found"]
        try:
            for key in match[3].split("."):
                number = number[int(key) if isinstance(number, list) else key]
            text = format(number, match[4])
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise FlightError(f"{file.name}: {match[1]}: {error!r}") from None
        return f"{match[1]}{text.replace('%', ' %')}{match[5]}"

    return _VALUE.sub(value, _BLOCK.sub(block, text))


def _made_by(results: Results, file: Path) -> str:
    """A line: result files, commit, processor, and the command that makes them again."""
    links: list[str] = []
    made: dict[str, None] = {}
    for name, content in results.read.items():
        link = os.path.relpath(path_of(results.root, name), file.parent)
        links.append(f"[{name}]({link})")
        at = content["processor"]
        made[f"commit {content['commit'][:10]}, {at['name']} ({at['compiled_for']})"] = None
    names = " ".join(results.read)
    return f"Made by `./heli results make {names}`: {', '.join(links)}; {'; '.join(made)}."


def render_all(root: Path) -> list[Path]:
    """Render every Markdown file; returns those that changed."""
    changed = []
    for file in markdown_files(root):
        text = file.read_text(encoding="utf-8")
        new = rendered(text, file, root)
        if new != text:
            file.write_text(new, encoding="utf-8")
            changed.append(file)
    return changed
