# SPDX-License-Identifier: Apache-2.0
"""Commands that are interrupted, or fail, while they fill a folder leave nothing half-made."""

import signal

import numpy as np
import pytest

from heli_bags.writer import BagRecorder
from heli_flight.cli import app as cli
from heli_flight.interrupts import EXIT_CODE
from heli_msgs_bridge import topics
from heli_msgs_bridge.messages import Encoder

STUDIES = "heli_studies"


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A bag of one pressure."""
    folder = tmp_path_factory.mktemp("flight") / "bag"
    recorder = BagRecorder(folder, [topics.BARO])
    recorder.write(topics.BARO, Encoder(topics.BARO).encode(np.ones(1), 0))
    recorder.close()
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    ("error", "code"), [(KeyboardInterrupt(), EXIT_CODE), (OSError("No space left on device"), 2)]
)
@pytest.mark.parametrize(
    ("words", "step"),
    [
        (["design"], f"{STUDIES}.design.report.draw_all"),
        (["compare", "attitude", "--seeds", "1"], f"{STUDIES}.compare_flights.compare_attitude"),
        (["bag", "csv", "BAG"], "heli_bags.tools.write_csv"),
        (["identify", "--one-process"], f"{STUDIES}.identify_report.run"),
    ],
    ids=["design", "compare", "csv", "identify"],
)
def test_a_folder_that_is_not_whole_goes(
    capsys, tmp_path, monkeypatch, bag, words, step, error, code
):
    def fails(*_):
        assert (tmp_path / "new/folder").is_dir(), "too early to be a test of this"
        raise error

    monkeypatch.setattr(step, fails)
    arguments = [str(bag) if word == "BAG" else word for word in words]
    assert cli.main([*arguments, "--out", str(tmp_path / "new/folder")]) == code
    assert list(tmp_path.iterdir()) == []
    assert len([line for line in capsys.readouterr().err.splitlines() if ": 1 of" not in line]) == 1


@pytest.mark.parametrize("flown", [True, False], ids=["bags", "one process"])
def test_an_identification_that_is_being_written_is_written_whole(tmp_path, monkeypatch, flown):
    """Ctrl-C waits for the page; what was identified from no bag is cheap, and goes."""
    folder = tmp_path / "out"

    def run(*_):
        if flown:
            (folder / "gusts/bag").mkdir(parents=True)

    def write(*_):
        # To this thread: another test's library may have some that would take it later.
        signal.raise_signal(signal.SIGINT)
        (folder / "report.html").touch()

    monkeypatch.setattr(f"{STUDIES}.identify_report.run", run)
    monkeypatch.setattr(f"{STUDIES}.identify_report.write", write)
    words = ["identify", "--one-process", "--out", str(folder)]
    assert cli.main(words) == EXIT_CODE
    assert (folder / "report.html").exists() == folder.exists() == flown
