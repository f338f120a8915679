# SPDX-License-Identifier: Apache-2.0
"""`heli report --pdf` where there is no Chromium, or one that does not print."""

import pytest

from heli_flight.cli import app as cli
from heli_flight.flight_file import write_parameters
from heli_flight.loop import simulate
from heli_flight.record import write_record
from heli_flight.settings import resolve


@pytest.fixture
def flown(tmp_path):
    folder = tmp_path / "flight"
    folder.mkdir()
    settings = resolve(duration_s=1.0)
    write_parameters(settings, folder / "params.yaml")
    write_record(simulate(settings).record, folder)
    return folder


def refused(capsys, *words):
    assert cli.main([*map(str, words)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    return [line for line in err.splitlines() if not line.startswith("report: ")]


def test_without_a_chromium_nothing_is_written(capsys, flown, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    (sentence,) = refused(capsys, "report", flown, "--pdf")
    assert sentence.startswith("heli: --pdf: ") and "Chromium" in sentence
    assert not (flown / "report.html").exists()


@pytest.mark.parametrize(
    ("does", "sentence"),
    [
        ("echo what is wrong >&2; exit 7", "ended with 7, no PDF: what is wrong"),
        ("exit 0", "ended with 0, no PDF"),
    ],
)
def test_one_that_does_not_print_is_named(capsys, flown, monkeypatch, tmp_path, does, sentence):
    fake = tmp_path / "chromium"
    fake.write_text(f"#!/bin/sh\n{does}\n")
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    (line,) = refused(capsys, "report", flown, "--pdf")
    assert line == f"heli: --pdf: {fake} {sentence}"
    # The page was written all the same.
    assert (flown / "report.html").is_file() and not (flown / "report.pdf").exists()
