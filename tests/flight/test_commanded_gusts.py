# SPDX-License-Identifier: Apache-2.0
"""What the live view says of gusts before it sends one: which push the hover off, and how far."""

import re
from pathlib import Path

import numpy as np
import pytest

from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_live_view.commands import Gust

WEB = Path(__file__).resolve().parents[2] / "src/heli_live_view/web"
START_S = 8.0


def strong_mps():
    code = (WEB / "consequences.js").read_text(encoding="utf-8")
    return float(re.search(r"const STRONG_GUST_MPS = ([\d.]+);", code)[1])


def pushed_m(tmp_path, gust):
    """Largest horizontal distance from the reference after a gust, m, from truth."""
    file = tmp_path / "gust.yaml"
    file.write_text(
        "/**/plant: {ros__parameters: {wind: {gust: {frame: ned, "
        f"start_s: [{START_S}], duration_s: [{gust.duration_s}], "
        f"amplitude_mps: {gust.amplitude_ned_mps()}}}}}}}}}\n"
    )
    flight = simulate(resolve("hover", "rtk", params=[file], duration_s=40.0))
    assert flight.sentence == ""
    record = flight.record
    error = (record.truth_pos_ned_m - record.reference[:, :3])[record.time_s > START_S]
    return float(np.hypot(error[:, 0], error[:, 1]).max())


@pytest.mark.parametrize("from_deg", [45.0, 135.0])
def test_only_a_strong_gust_pushes_the_hover_a_decimetre_off(tmp_path, from_deg):
    below = Gust(strong_mps() - 3.0, from_deg, 5.0)
    assert pushed_m(tmp_path, below) < 0.075
    assert pushed_m(tmp_path, Gust(10.0, from_deg, 5.0)) == pytest.approx(0.09, abs=0.02)
    assert pushed_m(tmp_path, Gust(10.0, from_deg, 20.0)) == pytest.approx(0.07, abs=0.02)
