# SPDX-License-Identifier: Apache-2.0
"""Rows that every node has: no node says them a second time with bounds of its own."""

import importlib

import pytest

from heli_core import ticks
from heli_core.parameters import COMMON_TABLE, with_common
from heli_msgs_bridge.frames import datum

TABLES = ("heli_dynamics_sim", "heli_observer", "heli_inner_hinf", "heli_outer_pd")


@pytest.mark.parametrize("package", TABLES)
def test_a_node_has_the_bounds_of_all_nodes(package):
    """A start or an origin that one node takes and the next refuses would stop the flight."""
    of_node = {row.name for row in importlib.import_module(f"{package}.parameters").TABLE}
    common = {row.name: row for row in COMMON_TABLE}
    table = with_common(importlib.import_module(f"{package}.parameters").TABLE)
    assert of_node & set(common) <= {"lockstep"}
    for row in table:
        if row.name in common:
            assert (row.lower, row.upper) == (common[row.name].lower, common[row.name].upper)


def test_the_origin_takes_what_its_parameters_allow():
    latitude = next(row for row in COMMON_TABLE if row.name == "origin.latitude_deg")
    assert (latitude.lower, latitude.upper) == (-ticks.LATITUDE_DEG, ticks.LATITUDE_DEG)
    datum(latitude.upper, ticks.LONGITUDE_DEG, 0.0)
    with pytest.raises(ValueError, match=f" {ticks.LATITUDE_DEG:g} deg"):
        datum(latitude.upper + 0.1, 0.0, 0.0)
