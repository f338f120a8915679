# SPDX-License-Identifier: Apache-2.0
"""The rms that `heli design` predicts for the position loop against flights of the nonlinear
aircraft."""

import numpy as np

from heli_flight.loop.closed_loop import simulate
from heli_flight.loop.settings import resolve
from heli_flight.studies.design.make import make_design

SEEDS = (101, 102, 103)
SETTLED_S, LENGTH_S = 60.0, 360.0


def test_predicted_rms_is_that_of_flights():
    """Hover at the start's altitude, exact navigation, three times 300 s; 25 %.

    Nose north, so that forward, right and down are north, east and down. The prediction is linear
    and the correlation time of the turbulence is up to 20 s: 20 % are expected from 900 s alone.
    """
    hover = {"duration_s": LENGTH_S, "climb.start_s": 0.0, "climb.end_s": 0.0}
    squares = []
    for seed in SEEDS:
        settings = resolve("hover", "rtk", seed, overrides={"scenario": hover})
        record = simulate(settings, true_navigation=True).record
        settled = record.time_s > SETTLED_S
        error = (record.truth_pos_ned_m - record.reference[:, 0:3])[settled]
        squares.append([error.var(axis=0), record.truth_vel_ned_mps[settled].var(axis=0)])
    position, speed = np.sqrt(np.mean(squares, axis=0))
    reports = make_design().outer
    np.testing.assert_allclose([r.position_rms_m for r in reports], position, rtol=0.25)
    np.testing.assert_allclose([r.speed_rms_mps for r in reports], speed, rtol=0.25)
