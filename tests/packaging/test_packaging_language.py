# SPDX-License-Identifier: Apache-2.0
"""Pages, notebooks and strings are proof-read: spelling, and the field's terms."""

import runpy
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "scripts/proofread.py"


@pytest.fixture(scope="module")
def proofread():
    return runpy.run_path(str(SCRIPT))


def test_nothing_is_misspelt_or_has_a_better_word(proofread, capfd):
    code = proofread["main"]([])
    assert (code, capfd.readouterr().out) == (0, "")


def test_a_phrase_and_a_misspelt_word_are_found_outside_code(proofread, tmp_path, capfd):
    page = tmp_path / "page.md"
    page.write_text("By the navigation record.\n\n`stand-off` is code.\n\nOf teh wind.\n")
    assert proofread["main"]([str(page)]) == 1
    out = capfd.readouterr().out
    assert f"{page}:1: 'navigation record': better 'state estimate'" in out
    assert "stand-off" not in out
    assert "teh ==> the" in out


def test_a_summary_is_read_and_an_attribute_is_not(proofread, tmp_path):
    module = tmp_path / "module.py"
    module.write_text('"""Of the stand-off.\n\nstand-off\n"""\nstand_off = "its stand-off"\n')
    assert [line.split(": ")[0] for line in proofread["phrases"](module)] == [
        f"{module}:1",
        f"{module}:5",
    ]


def test_a_file_that_is_none_is_refused(proofread, tmp_path):
    assert proofread["main"]([str(tmp_path / "no.md")]) == 2
