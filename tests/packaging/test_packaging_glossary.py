# SPDX-License-Identifier: Apache-2.0
"""In a package's README a word of the trade leads to the glossary where it first stands."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
READMES = sorted((ROOT / "src").glob("*/README.md"))
GLOSSARY = (ROOT / "docs/glossary.md").read_text(encoding="utf-8")
# Anchor of the glossary -> what stands for it.
WORDS = {
    "h-infinity-norm": r"H-infinity",
    "gamma": r"(?<![\w.])[Gg]amma(?![\w*=]| function)",
    "rtk": r"\bRTK\b",
    "dryden-turbulence": r"\bDryden\b",
    "trim": r"\b[Tt]rim\b",
    "lockstep": r"\b[Ll]ockstep\b",
    "flap-back": r"\b[Ff]lap(?:s|-)back\b|\bflaps back\b",
    "disk-margin": r"\b[Dd]isk margins?\b",
    "drb": r"\bDRB\b",
    "w20": r"\bW20\b",
    "lqg-lqr": r"\bLQ[GR]\b",
    "frd-ned": r"\b(?:NED|FRD)\b",
    "enu-flu": r"\b(?:ENU|FLU)\b",
    "lifecycle": r"\b[Ll]ifecycle\b",
    "cyclic": r"\b[Cc]yclic\b",
}
# What is no running text: code, headings, what is rendered from results, links, comments.
NO_TEXT = re.compile(
    r"```.*?```|(?m:^#[^\n]*$)|(?m:^    [^\n]*$)|<!-- (?:results|value):.*?<!-- end -->"
    r"|`[^`\n]*`|\[[^\]\n]*\]\([^)\n]*\)|<[^>\n]+>",
    re.DOTALL,
)


def first_words(text):
    """Of each word that stands in running text: its anchor, and where it stands first."""
    running = NO_TEXT.sub(lambda markup: " " * len(markup[0]), text)
    for anchor, word in WORDS.items():
        match = re.search(word, running)
        if match:
            yield anchor, match


def test_every_anchor_is_in_the_glossary():
    titles = re.findall(r"(?m)^### (.+)$", GLOSSARY)
    known = {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}
    assert set(WORDS) <= known


def test_the_words_are_looked_for_in_running_text_alone():
    text = (
        "# RTK\n`trim` [trim](x) a\n\n```\nENU\n```\n\n    W20\n\nLockstep, then RTK. Gamma* trim\n"
    )
    assert {anchor for anchor, _ in first_words(text)} == {"lockstep", "rtk", "trim"}


@pytest.mark.parametrize("readme", READMES, ids=lambda path: path.parent.name)
def test_a_word_leads_to_the_glossary_where_it_first_stands(readme):
    text = readme.read_text(encoding="utf-8")
    bare = []
    for anchor, match in first_words(text):
        link = text.find(f"](../../docs/glossary.md#{anchor})")
        if not 0 <= link < match.start():
            bare.append(f"{match[0]} ({anchor}), line {text[: match.start()].count(chr(10)) + 1}")
    assert bare == []
