# SPDX-License-Identifier: Apache-2.0
"""The aircraft of examples/paper_trim.yaml has the trim of the paper's Table 1."""

import pytest

from evidence.experiments.paper_trim import AIRCRAFT, SOLVED
from evidence.experiments.trim_table import PAPER, trim_of
from heli_dynamics_sim.aircraft import HelicopterParameters


def test_its_trim_is_table_1_to_the_digits_printed():
    """He Miaolei, He Jilin, Table 1: four digits behind the point."""
    trim = trim_of(HelicopterParameters.from_yaml(AIRCRAFT))
    assert {name: round(value, 4) for name, value in trim.items()} == pytest.approx(PAPER)


def test_it_is_helion_but_for_what_was_solved():
    ours, theirs = (HelicopterParameters.from_yaml(f) for f in ("helion.yaml", AIRCRAFT))
    other = {name for name, value in vars(ours).items() if value != getattr(theirs, name)}
    assert other - {"name"} == set(SOLVED)
