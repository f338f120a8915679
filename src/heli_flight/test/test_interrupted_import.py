# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C in the middle of an import, or of a step that must be done as a whole: both end first."""

import subprocess
import sys

import pytest

from heli_flight.interrupts import EXIT_CODE, LINE

COMMAND = """
import signal, sys, time
from heli_flight import interrupts

def command():
    with open("part_made.txt", "w") as file:
        try:
            {step}
            time.sleep(60.0)
        except KeyboardInterrupt:
            file.write("undone")
            raise
    return 0

sys.exit(interrupts.run(lambda: command))
"""
MODULE = """
import signal
import time
signal.raise_signal(signal.SIGINT)
time.sleep(0.05)  # longer than until the interrupt is raised anew
print("imported")
"""
HELD = """
            with interrupts.held_back():
                interrupts._raise_soon()
                time.sleep(0.05)
                print("held")
"""


def run(folder, step):
    (folder / "a_module.py").write_text(MODULE)
    return subprocess.run(
        [sys.executable, "-c", COMMAND.format(step=step)],
        cwd=folder, capture_output=True, text=True, timeout=60,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("step", "printed"),
    [("import a_module", ["imported"]), (HELD.strip(), ["held"])],
    ids=["import", "held back"],
)
def test_what_is_under_way_ends_first(tmp_path, step, printed):
    done = run(tmp_path, step)
    assert (done.returncode, done.stderr) == (EXIT_CODE, f"{LINE}\n")
    assert done.stdout.split() == printed
    assert (tmp_path / "part_made.txt").read_text() == "undone"


def test_an_interrupt_that_comes_too_late_changes_nothing(tmp_path):
    """Put off in the last step: the command is done, and so is its code."""
    step = "interrupts._raise_soon(); return 0"
    ended = COMMAND.format(step=step).replace(
        "sys.exit(interrupts.run(lambda: command))",
        "code = interrupts.run(lambda: command); time.sleep(0.05); sys.exit(code)",
    )
    done = subprocess.run(
        [sys.executable, "-c", ended], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stderr) == (0, "")
