#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Proof-read what people read: spelling by codespell, and phrases for which there is a better one.

    ./heli python scripts/proofread.py [FILE ...]

Without files: Markdown pages, the notebooks' text, docstrings' summaries and the strings of the
packages. Each finding is one line, with the better word. Exit code 0: none; 1: some; 2: bad input.
"""

import ast
import json
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from codespell_lib import main as codespell

ROOT = Path(__file__).resolve().parents[1]
BETTER = {
    r"navigation records?": "state estimate",
    r"truth less (the receiver's )?drift": "drift-corrected",
    r"less (the receiver's )?drift at engagement": "drift-corrected",
    r"stand-offs?": "steady-state error",
    r"\bas dear\b|\bdearer\b|\bhow dear\b": "weight, heavy",
    r"flown over that of the controllers": "true aircraft / design model",
    r"by thrust( alone)?\b": "on fixed thrust (open-loop)",
    r"sensors that can be bought|a bought sensor": "off-the-shelf sensors",
    r"what flies, plainly": "which controllers fly by default",
    r"a word unknown": "unfamiliar term",
    r"for who (learns|designs|works)": "for students, engineers, users",
    r"(law|controller) of default": "default controller",
    r"says? else\b": "says otherwise",
    r"back, forth\b": "back / forward",
    r"refuses? .{0,40}\baloud\b": "rejects with a warning",
    r"\bto and fro\b": "back and forth",
    r"\bwere not at hand\b": "not tested with",
    r"\bfiles? of laws\b": "control preset",
    r"\b(attitude|position|altitude|inner|outer|packaged|default) laws?\b": "controller",
    r"\blaws? (of your own|in python)\b": "your own controller",
    r"\bsoft flight\b": "degraded mode",
    r"\bheld against\b": "compared with",
    r"\bin the place of\b": "in place of",
    r"\btells what each\b": "describes each",
    r"\bhow it comes out\b": "results",
    r"\b(is|are|was|were|be) broken off\b": "aborted, interrupted",
}
"""What is written -> what the field says."""
WORDS = {"ned", "nees", "parm", "sitl", "statics"}
"""Names and units that codespell takes for misspelt words."""
_FENCE = re.compile(r"```.*?```|^ {4}[^\n]*$|`[^`\n]*`|\]\([^)\n]*\)|<[^>\n]+>", re.M | re.S)
_SKIPPED = {"docs/results", "docs/ros.md"}
_PATTERNS = [
    (re.compile(words.replace(" ", r"\s+"), re.IGNORECASE), better)
    for words, better in BETTER.items()
]
_ANY = re.compile("|".join(f"(?:{pattern.pattern})" for pattern, _ in _PATTERNS), re.IGNORECASE)
_JOINT = re.compile(r'"?\s+f?"?')  # between the lines of a string


def files() -> list[Path]:
    """All that is read without an argument."""
    found = [ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
    for pattern in ("docs/**/*.md", "src/*/README.md", "examples/**/*.md", "examples/**/*.ipynb"):
        found += sorted(ROOT.glob(pattern))
    found += sorted(ROOT.glob("src/*/heli*/**/*.py"))
    return [p for p in found if not any(str(p.relative_to(ROOT)).startswith(s) for s in _SKIPPED)]


def _blank(match: re.Match[str]) -> str:
    return re.sub(r"[^\n]", " ", match[0])


def _strings(text: str) -> Iterator[tuple[int, str]]:
    """First line and text of each string of a module; of docstrings the summary alone."""
    tree = ast.parse(text)
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    nodes = [node for node in ast.walk(tree) if isinstance(node, documented) and node.body]
    summaries = {id(node.body[0].value) for node in nodes if isinstance(node.body[0], ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            summary = node.value.partition("\n\n")[0]
            yield node.lineno, summary if id(node) in summaries else node.value


def passages(path: Path) -> Iterator[tuple[int, str]]:
    """Line and text of what people read of a file, without code."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        yield from _strings(text)
    elif path.suffix == ".ipynb":
        for cell in json.loads(text)["cells"]:
            if cell["cell_type"] == "markdown":
                yield 1, _FENCE.sub(_blank, "".join(cell["source"]))
    else:
        yield 1, _FENCE.sub(_blank, text)


def phrases(path: Path) -> list[str]:
    """Findings of a file, one line each: where, what, and what is better."""
    found: list[str] = []
    if not _ANY.search(_JOINT.sub(" ", path.read_text(encoding="utf-8"))):
        return found
    for line, text in passages(path):
        for pattern, better in _PATTERNS:
            for match in pattern.finditer(text):
                at = line + text.count("\n", 0, match.start())
                found.append(f"{path}:{at}: {match[0]!r}: better {better!r}")
    return found


def main(arguments: Sequence[str]) -> int:
    """Print all findings."""
    given = [Path(name) for name in arguments]
    for path in given:
        if path.suffix not in (".md", ".py", ".ipynb") or not path.is_file():
            print(
                f"proofread: {path} is no page, notebook or module that there is", file=sys.stderr
            )
            return 2
    read = given or files()
    found = [line for path in read for line in phrases(path)]
    print(*found, sep="\n", end="\n" if found else "")
    prose = [str(path) for path in read if path.suffix == ".md"]
    misspelt = codespell(*prose, "-L", ",".join(sorted(WORDS))) if prose else 0
    return 1 if found or misspelt else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
