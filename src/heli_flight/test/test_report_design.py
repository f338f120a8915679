# SPDX-License-Identifier: Apache-2.0
"""The report names and draws the bound of the law that flew, not of another one."""

import numpy as np
import pytest

from heli_flight.report.charts import design_charts, flown_design
from heli_flight.report.tables import margin_table
from heli_flight.settings import resolve
from heli_flight.worlds import LAWS


def _design(law: str):
    settings = resolve(params=[LAWS.file(law)])
    design = flown_design(settings)
    assert design is not None
    lines = [trace.label for trace in design_charts(design)[0].panels[0].traces]
    return settings.nodes["inner_loop"], design, lines, str(margin_table(design).caption)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "key", "whose"),
    [("hinf_output", "output.gamma", "output feedback"), ("hinf", "gamma", "state feedback")],
)
def test_the_bound_is_that_of_the_law_that_flew(law, key, whose):
    values, design, lines, caption = _design(law)
    assert design.controller == law
    assert design.bound.gamma == values[key] > design.bound.gamma_star > 0.0
    # What bounds another norm is no level of the chart of wind -> h.
    assert (f"γ = {values[key]:.4f}" in lines) == (law == "hinf") == design.bound.is_wind_to_h
    assert f"γ = {values[key]:.4f}" in caption and f"of {whose}" in caption


def test_a_law_without_a_bound_has_none_drawn():
    _, design, lines, caption = _design("pid")
    assert design.bound is None
    assert not [line for line in lines if "γ" in line]
    assert "without a bound" in caption


def test_the_chart_reaches_above_what_it_draws():
    _, design, _, _ = _design("pid")
    panel = design_charts(design)[0].panels[0]
    assert panel.y_range[1] > np.max(design.wind_to_h[-1])
