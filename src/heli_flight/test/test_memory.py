# SPDX-License-Identifier: Apache-2.0
"""What flies takes no memory: not a byte a tick, whatever the law and whether on the ground."""

import dataclasses

import pytest
from numba.core.runtime import _nrt_python

from heli_flight.loop import build, fly_loop
from heli_flight.settings import resolve


def _allocated(settings):
    loop = build(settings)
    before = _nrt_python.memsys_get_stats_alloc()
    fly_loop(loop, settings)
    return _nrt_python.memsys_get_stats_alloc() - before


@pytest.mark.parametrize(
    ("scenario", "laws"), [("hover", "hinf"), ("hover", "pid"), ("takeoff_land", "packaged")]
)
def test_a_longer_flight_allocates_no_more(scenario, laws):
    """Calls of compiled code from Python may take some; so it is asked of two lengths."""
    _nrt_python.memsys_enable_stats()
    settings = resolve(scenario, "rtk", 1, world="honest", laws=laws)
    short, longer = (
        dataclasses.replace(
            settings, scenario=dataclasses.replace(settings.scenario, n_ticks=ticks)
        )
        for ticks in (400, 1200)
    )
    assert _allocated(longer) == _allocated(short)
