# SPDX-License-Identifier: Apache-2.0
"""The pages as a site: the repository's Markdown, and the reference that is made from the code.

Usage: python scripts/build_docs.py [--out FOLDER]

Exit code 1: a link or an anchor leads nowhere, or a page is not in the contents; each is named.
"""

import argparse
import logging
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from docs_notebooks import notebook_page, with_page_links
from docs_reference import command_page, in_order, names_page

ROOT = Path(__file__).resolve().parents[1]
CONFIG = "docs/site/mkdocs.yml"
PAGES = ("*.md", "docs/**/*.md", "src/*/README.md", "benchmarks/*.md", "examples/**/*.md")
NOTEBOOKS = "examples/**/*.ipynb"
ASSETS = ("docs/site/*.css", "docs/site/*.js", "docs/site/vendor/*.js")
REFERENCE = "reference"
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)#\s]+)(#[^)\s]*)?\)")
_FENCE = re.compile(r"^\s*```")
_LIST = re.compile(r"^(?:[-*]|\d+\.) ")


def pages(root: Path) -> list[Path]:
    """Markdown files that become pages, relative to the checkout."""
    found = {path for pattern in PAGES for path in root.glob(pattern)}
    return sorted(path.relative_to(root) for path in found)


def outside_code(text: str) -> Iterator[tuple[str, bool]]:
    """Lines, and whether each is text rather than code of a fenced block."""
    fenced = False
    for line in text.splitlines():
        fence = bool(_FENCE.match(line))
        yield line, not (fenced or fence)
        fenced ^= fence


def as_on_github(text: str) -> str:
    """Markdown as the generator reads it: a list that follows a paragraph gets its empty line."""
    lines: list[str] = []
    before = ""
    for line, is_text in outside_code(text):
        begins = is_text and _LIST.match(line) and before.strip()
        if begins and not _LIST.match(before) and not before.startswith(" "):
            lines.append("")
        lines.append(line)
        before = line if is_text else ""
    return "\n".join(lines) + "\n"


def linked_files(text: str, page: Path, root: Path) -> Iterator[Path]:
    """Files of the checkout that a page links and that are no pages, relative to the checkout."""
    for _, _, target, _ in _LINK.findall(text):
        if not re.match(r"[a-z]+:", target):
            path = Path(os.path.normpath(page.parent / target))
            if path.suffix != ".md" and (root / path).is_file():
                yield path


def lay_out(root: Path, folder: Path) -> list[Path]:
    """Put pages, the files that they link and what is made from the code below a folder.

    Returns the pages that were made, relative to the folder.
    """
    files = {path.relative_to(root) for pattern in ASSETS for path in root.glob(pattern)}
    for page in pages(root):
        text = (root / page).read_text(encoding="utf-8")
        files |= set(linked_files(text, page, root))
        _write(folder / page, as_on_github(with_page_links(text)))
    for file in root.glob(NOTEBOOKS):
        page = file.relative_to(root).with_suffix(".md")
        text, pictures = notebook_page(file)
        files |= set(linked_files(text, page, root))
        # The one link to the notebook itself leads to the file.
        text = with_page_links(text).replace(f"({page.name})", f"({file.name})")
        _write(folder / page, as_on_github(text))
        for name, content in pictures.items():
            (folder / page).with_name(name).write_bytes(content)
    for file in files:
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(root / file, folder / file)
    made = {Path(REFERENCE, "commands.md"): command_page()}
    packages = in_order(path.parent.name for path in root.glob("src/*/setup.py"))
    made |= {Path(REFERENCE, f"{name}.md"): names_page(name) for name in packages}
    for page, text in made.items():
        _write(folder / page, text)
    return list(made)


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def contents(nav: list[Any], made: Sequence[Path], root: Path) -> list[Any]:
    """The contents with packages, and with what was made from the code, before the last section."""
    packages = in_order(path.parent.name for path in root.glob("src/*/README.md"))
    details = root.glob("docs/packages/*.md")
    # What people call first: the commands, then the names for Python, then topics and parameters.
    commands, *names = map(str, made)
    return [
        *nav[:-1],
        {"Reference": [commands, *names[:1], "docs/ros.md", {"Public names": names[1:]}]},
        {"Packages": [{name: f"src/{name}/README.md"} for name in packages]},
        {"Packages, in detail": sorted(f"docs/packages/{path.name}" for path in details)},
        nav[-1],
    ]


def github_anchor(title: str, separator: str) -> str:
    """The anchor of a heading as GitHub makes it."""
    plain = re.sub(r"<[^>]+>", "", title).strip().lower()
    return re.sub(r"[^\w\- ]", "", plain).replace(" ", separator)


class Complaints(logging.Handler):
    """Keeps the generator's warnings, a line each."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a record."""
        self.lines.append(" ".join(record.getMessage().split()))


def build(root: Path, out: Path) -> list[str]:
    """Build the site into a folder; returns what is wrong, a line each."""
    os.environ.setdefault("NO_MKDOCS_2_WARNING", "1")
    from mkdocs.commands.build import build as build_site
    from mkdocs.config import load_config

    complaints = Complaints()
    log = logging.getLogger("mkdocs")
    log.addHandler(complaints)
    log.propagate = False
    try:
        with tempfile.TemporaryDirectory() as folder:
            made = lay_out(root, Path(folder))
            config = load_config(str(root / CONFIG), docs_dir=folder, site_dir=str(out))
            config["nav"] = contents(config["nav"], made, root)
            config["mdx_configs"]["toc"]["slugify"] = github_anchor
            config["markdown_extensions"].append("pymdownx.superfences")
            config["mdx_configs"]["pymdownx.superfences"] = {"custom_fences": [_mermaid()]}
            build_site(config)
    finally:
        log.removeHandler(complaints)
    return complaints.lines


def _mermaid() -> dict[str, Any]:
    from pymdownx.superfences import fence_code_format

    return {"name": "mermaid", "class": "mermaid", "format": fence_code_format}


def main(arguments: Sequence[str] | None = None) -> int:
    """Build; returns the exit code."""
    parser = argparse.ArgumentParser(description="Build the site of the documentation.")
    parser.add_argument("--out", type=Path, default=Path("build/site"), help="default: build/site")
    out = parser.parse_args(arguments).out.resolve()
    try:
        wrong = build(ROOT, out)
    except ModuleNotFoundError as missing:
        print(f"error: {missing.name} is missing; ./run_tests.sh installs it", file=sys.stderr)
        return 2
    for line in wrong:
        print(f"error: {line}", file=sys.stderr)
    if not wrong:
        print(f"written: {out / 'index.html'}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
