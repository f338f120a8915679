# SPDX-License-Identifier: Apache-2.0
"""What scripts of results share: seeds that are none are refused, tables or JSON are printed."""

import importlib
import json
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


@pytest.fixture
def seeds_option(monkeypatch):
    monkeypatch.syspath_prepend(SCRIPTS)
    return importlib.import_module("seeds_option")


def test_what_is_found_is_printed_as_tables_or_as_json(seeds_option, monkeypatch, capsys):
    def printed(*words):
        monkeypatch.setattr("sys.argv", ["table.py", *words])
        seeds_option.print_tables("What.", lambda seeds: {"seeds": seeds}, lambda f: f"| {f} |")
        return capsys.readouterr().out

    assert printed("--seeds", "3,7..8") == "| {'seeds': [3, 7, 8]} |\n"
    assert json.loads(printed("--json")) == {"seeds": list(range(1, 21))}


def test_seeds_that_are_none_are_refused_in_a_sentence(seeds_option, capsys):
    with pytest.raises(SystemExit) as refused:
        seeds_option.parser_with_seeds("What.").parse_args(["--seeds", "5..2"])
    assert refused.value.code == 2
    assert (
        capsys.readouterr()
        .err.splitlines()[-1]
        .endswith("argument --seeds: 5..2: write 1..20, 7, 1,5,9 or 1..20,31..40")
    )
