# SPDX-License-Identifier: Apache-2.0
"""While a bag is read the search for cyclic garbage pauses; afterwards it is as it was before."""

import gc

import numpy as np
import pytest

from heli_bags import opening
from heli_bags.reader import read_bag
from heli_bags.writer import BagError, BagRecorder
from heli_core.ticks import TICK_NS
from heli_msgs_bridge import topics
from heli_msgs_bridge.layouts import CHANNELS
from heli_msgs_bridge.messages import Encoder

TICKS = 10


@pytest.fixture
def bag(tmp_path):
    written, encoder = BagRecorder(tmp_path / "bag", [topics.ACTUATORS]), Encoder(topics.ACTUATORS)
    row = np.zeros(CHANNELS[topics.ACTUATORS].size)
    for tick in range(TICKS):
        written.write(topics.ACTUATORS, encoder.encode(row, tick * TICK_NS))
    written.close()
    return tmp_path / "bag"


@pytest.fixture
def collecting(monkeypatch):
    """Whether garbage was searched for at each message."""
    states = []

    def watched(path, items, guarded=opening.guarded):
        for item in guarded(path, items):
            states.append(gc.isenabled())
            yield item

    monkeypatch.setattr(opening, "guarded", watched)
    return states


@pytest.fixture(params=[True, False])
def before(request):
    was = gc.isenabled()
    (gc.enable if request.param else gc.disable)()
    yield request.param
    (gc.enable if was else gc.disable)()


def test_it_pauses_and_is_as_before(bag, collecting, before):
    assert read_bag(bag).streams[topics.ACTUATORS].stamp_ns.size == TICKS
    assert collecting == [False] * TICKS and gc.isenabled() == before


def test_it_is_as_before_when_reading_fails(bag, before, monkeypatch):
    def broken(*_):
        raise BagError("broken")

    monkeypatch.setattr(opening, "guarded", broken)
    with pytest.raises(BagError, match="broken"):
        read_bag(bag)
    assert gc.isenabled() == before
