# SPDX-License-Identifier: Apache-2.0
"""The first screen of the README, and the glossary: what a newcomer needs stands there."""

import re
from pathlib import Path

import pytest

from evidence import files

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
FIRST_SCREEN = "\n".join(README.splitlines()[:40])
GLOSSARY = (ROOT / "docs/glossary.md").read_text(encoding="utf-8")
TERMS = dict(re.findall(r"(?m)^### (.+)\n\n(.+)$", GLOSSARY))
PAGES = {
    path: path.read_text(encoding="utf-8")
    for pattern in ("*.md", "docs/*.md", "docs/howto/*.md", "docs/packages/*.md", "src/*/README.md")
    for path in ROOT.glob(pattern)
    if path.name != "glossary.md"
}


def test_the_first_screen_has_for_whom_picture_commands_time_and_disk():
    assert "**For whom.**" in FIRST_SCREEN
    (picture,) = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", FIRST_SCREEN)
    assert (ROOT / picture).is_file()
    for command in ("./hover_test.sh", "./run_tests.sh"):
        assert f"\n    {command} " in FIRST_SCREEN
    setup = files.read(ROOT, "setup")["found"]
    assert "<!-- results: setup -->" in FIRST_SCREEN
    assert f"after {setup['total_s']:.0f} s" in FIRST_SCREEN
    size = files.read(ROOT, "setup_size")["found"]
    assert f"takes {size['disk_mb']} MB of disk" in FIRST_SCREEN
    assert f"downloads {size['download_mb']} MB" in FIRST_SCREEN


def test_the_first_screen_has_platforms_and_paper():
    assert re.search(r"\*\*Platforms\.\*\* Linux on x86_64 with CPython 3\.11", FIRST_SCREEN)
    assert "not tried" in FIRST_SCREEN
    paper = FIRST_SCREEN.split("**The paper.**")[1].split("\n\n")[0]
    for words in ("He Miaolei", "He Jilin", "MIMO System*", "no journal, no year and no DOI"):
        assert words in paper


def test_the_contents_name_every_section_after_them():
    contents = FIRST_SCREEN.split("**Contents.**")[1].split("\n\n")[0]
    titles = re.findall(r"(?m)^## (.+)$", README)
    assert titles[0] == "Two commands"
    assert re.findall(r"\[([^\]]+)\]\(#", contents) == titles[1:]
    for page in ("docs/tutorial.md", "docs/glossary.md"):
        assert page in contents


def test_what_falls_short_stands_right_after_the_first_screen():
    plainly = README.split("## Which controllers fly by default")[1].split("\n## ")[0]
    for sentence in ("differ from the paper's.**", "is not the best in every respect.**"):
        assert sentence in plainly


def test_the_glossary_has_what_newcomers_stumble_over_in_order():
    heads = [name for term in TERMS for name in term.split(", ")]
    assert list(TERMS) == re.findall(r"(?m)^### (.+)$", GLOSSARY)
    assert list(TERMS) == sorted(TERMS, key=str.casefold)
    needed = "H-infinity norm, gamma, gamma*, RTK, Standalone, Dryden turbulence, Trim, Lockstep"
    needed += ", Flap-back, NED, FRD, ENU, FLU, Tick, W20, World, DRB, Disk margin, Lifecycle"
    assert set(needed.split(", ")) <= set(heads)


@pytest.mark.parametrize("term", TERMS)
def test_a_term_has_two_sentences_and_is_used(term):
    plain = re.sub(r"\]\([^)]*\)", "]", TERMS[term])
    assert len(re.findall(r"[.](?= |$)", re.sub(r"\(eq\. ", "(", plain))) == 2, plain
    words = [re.escape(name).replace("\\ ", "[ -]") for name in term.split(", ")]
    text = "\n".join(PAGES.values())
    for word in words:
        assert re.search(rf"(?i)(?<!\w){word}", text), word
