# SPDX-License-Identifier: Apache-2.0
"""Operations are counted as a formula has them, and numbers rounded as a processor would."""

import json
import os
import subprocess
import sys

import numpy as np

from evidence.counting import STAGES, Counted, counting
from evidence.experiments.dsp_budget import fixed, float32
from heli_flight.settings import resolve
from heli_inner_hinf.design import attitude_params


def test_counted_numbers_are_the_same_numbers():
    a, b = counting(np.array([3.0, 4.0]))
    assert isinstance(a, Counted)
    assert float(2.0 * a + b / 2.0 - 1.0) == 7.0
    assert a < b
    assert float(-abs(a)) == -3.0


def test_attitude_law_counts_what_its_matrices_ask_for():
    """x+ = A x + B v + L cut and u = C x + D v, of order n with 8 inputs and 3 outputs."""
    law = attitude_params(resolve("hover", "rtk").nodes["inner_loop"]).law
    n, m, k = len(law.A), law.B.shape[1], len(law.C)
    products = n * (n + m + k) + k * (n + m)
    done = subprocess.run(
        [sys.executable, "-m", "evidence.counting", "packaged", "8"],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    counts = json.loads(done.stdout)
    assert set(counts) == set(STAGES)
    # Besides: turning two errors by the bank, and the fading of an offset.
    assert products <= counts["control"][-1]["multiply"] <= products + n + 20


def test_numbers_are_rounded_to_what_a_processor_holds():
    values = np.array([1.0 / 3.0, -200.0, 1e-9])
    assert np.array_equal(float32(values), np.float32(values).astype(float))
    assert np.array_equal(fixed(values, 32, 24)[1:], [-128.0, 0.0])
    # 16 bit with a scale of its own: -200 needs 8 bits before the point, 7 are left behind it.
    assert np.array_equal(fixed(values, 16), [43.0 / 128.0, -200.0, 0.0])
    assert np.array_equal(fixed(np.zeros(2), 16), np.zeros(2))
