# SPDX-License-Identifier: Apache-2.0
"""The sweep over processor types finds what depends on them; flights differ by rounding only."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from evidence.cpu_types import CpuTypeError, chosen, combinations

ROOT = Path(__file__).resolve().parents[2]
SWEEP = "evidence.sweep_cpu_types"
COMPARE = "evidence.experiments.cpu_types"

# Passes on the BLAS kernels of every processor but one.
DEPENDENT = """
import numpy
from threadpoolctl import threadpool_info

def test_of_kernels():
    assert "Nehalem" not in {row["architecture"] for row in threadpool_info()}

def test_of_nothing():
    pass
"""


def run(script, *words, limit_s=250):
    return subprocess.run(
        [sys.executable, "-m", script, *map(str, words)],
        cwd=ROOT, capture_output=True, text=True, timeout=limit_s,
    )  # fmt: skip


def sweep_of(folder, *names):
    (folder / "test_dependent.py").write_text(DEPENDENT)
    only = [word for name in names for word in ("--only", name)]
    return run(SWEEP, *only, folder / "test_dependent.py", "--json")


@pytest.mark.slow
def test_a_test_that_depends_on_the_processor_is_named(tmp_path):
    done = sweep_of(tmp_path, "native", "Nehalem")
    assert done.returncode == 1, done.stdout + done.stderr
    native, nehalem = json.loads(done.stdout)
    assert (native["passed"], native["failed"]) == (2, [])
    assert nehalem["chose"]["blas"] == "Nehalem" and nehalem["passed"] == 1
    (name,) = nehalem["failed"]
    assert name.endswith("::test_of_kernels")


def test_what_was_chosen_before_is_not_run_again(tmp_path):
    """The wheels know Zen by Haswell's kernels."""
    done = sweep_of(tmp_path, "Haswell", "Zen")
    assert done.returncode == 0, done.stdout + done.stderr
    haswell, zen = json.loads(done.stdout)
    assert not haswell["broken"] and not zen["broken"]
    if haswell["remark"]:
        # This processor cannot imitate it: nothing was chosen, nothing was run.
        assert (haswell["chose"], haswell["passed"], haswell["skipped"]) == (None, 0, 0)
    else:
        assert haswell["passed"] == 2
        again = zen["chose"] == haswell["chose"]
        assert (zen["passed"], bool(zen["remark"])) == ((0, True) if again else (2, False))


def test_bad_input_is_one_line(tmp_path):
    done = run(SWEEP, "--only", "Z80")
    assert (done.returncode, done.stdout) == (2, "")
    with pytest.raises(CpuTypeError) as caught:
        chosen(["Z80"], combinations())
    assert done.stderr == f"--only: {caught.value}\n"
    assert "'Z80'" in done.stderr and all(one.name in done.stderr for one in combinations())
    assert len(done.stderr.splitlines()) == 1
    done = run(SWEEP, "--only", "native", tmp_path / "nothing.py", "--json")
    (native,) = json.loads(done.stdout)
    assert (done.returncode, native["broken"]) == (1, True)
    assert (native["passed"], native["failed"]) == (0, [])
    assert f"code {pytest.ExitCode.USAGE_ERROR:d}:" in native["remark"]


@pytest.mark.slow
def test_flights_differ_by_rounding_only():
    """One seed, the two factors that change most: far below anything that is measured."""
    words = ("--seeds", "3", "--only", "Prescott", "--only", "NumPy baseline", "--json")
    done = run(COMPARE, *words)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = [row for row in json.loads(done.stdout)["rows"] if not row["why_not"]]
    assert rows
    for row in rows:
        # A processor that is one of them itself has nothing to differ by.
        assert bool(row["differing"]) == (row["same_ticks"] < 6000)
        assert row["position_m"] < 1e-9 and row["attitude_rad"] < 1e-9, row


@pytest.mark.nightly
@pytest.mark.timeout(3600)
def test_numerical_tests_pass_on_every_processor():
    done = run(SWEEP, "--quick", limit_s=3500)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.nightly
@pytest.mark.timeout(1800)
@pytest.mark.skipif(shutil.which("qemu-x86_64") is None, reason="needs qemu-user")
@pytest.mark.skipif(os.uname().machine != "x86_64", reason="of x86-64")
def test_an_older_processor_flies_the_same_numbers():
    """With the choice taken away, an emulated processor gives this one's bits."""
    fixed = ("--only", "fixed to x86-64-v3", "--only", "fixed to x86-64-v2")
    done = run(COMPARE, "--seeds", "2", *fixed, "--json", limit_s=1700)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = json.loads(done.stdout)["rows"]
    compared = [row for row in rows if row["name"].startswith("emulated")]
    assert len(compared) == 2
    for row in compared:
        assert (row["why_not"], row["differing"], row["same_ticks"]) == ("", 0, 6000)
