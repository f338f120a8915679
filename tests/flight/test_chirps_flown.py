# SPDX-License-Identifier: Apache-2.0
"""Eq. (10) from a chirp on each actuator, flown on the nonlinear helicopter by a law in Python.

No line, no period; the collective is the position loop's.
"""

import importlib.util

import numpy as np
import pytest
from scipy.signal import chirp

import heli
from evidence.files import checkout
from heli_analysis.identification import AperiodicRecord, fit_record
from heli_core.rotations import euler_angles, quat_to_R_nb
from heli_core.rows import IMU
from heli_core.ticks import TICK_S
from heli_flight.record import NAME, read_record

_spec = importlib.util.spec_from_file_location("my_law", checkout() / "examples" / "my_law.py")
my_law = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(my_law)

RUN_S, QUIET_S, AMPLITUDE = 80.0, 25.0, (0.03, 0.03, 0.05)
_T = np.arange(round(RUN_S / TICK_S)) * TICK_S
_FADE = np.clip(np.minimum(_T, _T[::-1]) / 4.0, 0.0, 1.0)
ONE = _FADE * chirp(_T, 0.15, RUN_S, 8.0, method="logarithmic", phi=-90.0)


class Swept(my_law.MyLaw):
    """The example's LQR, and on top of it a chirp on one actuator after the other."""

    def added(self, t):
        """Of the chirps (3,) at flight time t."""
        run, since = divmod(round((t - QUIET_S) / TICK_S), ONE.size)
        return AMPLITUDE[run] * ONE[since] * np.eye(3)[run] if 0 <= run < 3 else np.zeros(3)

    def step(self, x, r, t):
        return super().step(x, r, t) + self.added(t)


@pytest.mark.slow
def test_main_entries_are_within_5_percent_of_the_linearised_helicopter(tmp_path):
    length_s = 2.0 * QUIET_S + 3.0 * RUN_S
    heli.fly(
        "hover", out=tmp_path / "f", gps="rtk", seed=2, world="paper", law=Swept,
        duration_s=length_s,
        params={"plant": {"wind.profile_speed_mps": [0.0, 0.0, 0.0]}},
    )  # fmt: skip
    record = read_record(tmp_path / "f" / NAME)
    law = Swept()
    added = np.zeros((record.time_s.size, 4))
    added[:, :3] = [law.added(t) for t in record.time_s]
    R_nb = np.array([quat_to_R_nb(np.ascontiguousarray(q)) for q in record.nav_q_nb])
    first = round(QUIET_S / TICK_S) - 1000
    found = fit_record(
        AperiodicRecord(
            record.u, added, record.imu[:, IMU.rate],
            np.einsum("nji,nj->ni", R_nb, record.nav_vel_ned_mps),
            euler_angles(record.nav_q_nb)[:, :2], ((first, record.time_s.size),),
        )
    )  # fmt: skip
    true = heli.linearize()
    n = heli.NINE
    for row, column in ((n.p, n.b_s), (n.q, n.a_s), (n.r, n.r), (n.r, n.d_int), (n.b_s, n.a_s)):
        assert found.A[row, column] == pytest.approx(true.A[row, column], rel=0.05), (row, column)
    for row, column in ((n.a_s, 1), (n.b_s, 0), (n.r, 2), (n.d_int, 2), (n.p, 2)):
        assert found.B[row, column] == pytest.approx(true.B[row, column], rel=0.05), (row, column)
