# SPDX-License-Identifier: Apache-2.0
"""Node `observer` alone: what it says of its sensors."""

import numpy as np
import pytest

from heli_core.rows import MEAS
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of
from heli_observer.layout import COUNT
from heli_observer.node import ObserverNode
from support.synthetic_sensors import hover_path, synthesize

FIELD_OF_A_MAGNET = 3.0


@pytest.fixture
def observer(bench):
    made = bench(ObserverNode)
    made.fly()
    return made


def tick_of(observer, tick, y, magnet=1.0):
    """Measurements of one tick as messages; the magnetometer beside a magnet, if so wanted."""
    if y[MEAS.mag_valid]:
        observer.send(topics.MAG, tick, magnet * y[MEAS.mag])
    if y[MEAS.baro_valid]:
        observer.send(topics.BARO, tick, y[[MEAS.baro]])
    if y[MEAS.gps_valid]:
        stamp = int(y[MEAS.gps_tick])
        observer.send(topics.GPS_FIX, stamp, y[MEAS.gps_pos])
        observer.send(topics.GPS_VELOCITY, stamp, y[MEAS.gps_vel])
    if tick:
        observer.send(topics.ACTUATORS, tick - 1, np.zeros(4))
    observer.send(topics.IMU, tick, y[MEAS.imu])


def test_diagnostics_count_what_was_fused_and_what_was_rejected(observer):
    """A sensor that the filter does not follow is named with its count; what never was, is not."""
    y = np.ascontiguousarray(synthesize(hover_path(), observer.node.values, 4.0, seed=8).y)
    for tick in range(301):
        tick_of(observer, tick, y[tick], FIELD_OF_A_MAGNET if tick >= 100 else 1.0)
    facts, horizon = observer.node.health.facts, observer.node.values["ekf.horizon_ticks"]
    # One sample in two ticks, judged when the filter, which runs behind, has come to it.
    assert facts["mag_rejected"] == pytest.approx((301 - 100) / 2, abs=horizon)
    assert facts["mag_fused"] == pytest.approx(100 / 2, abs=horizon)
    assert facts["mag_rejected"] == observer.node.core.state.count[COUNT.mag_rejected]
    assert facts["gps_fused"] > 10 and facts["baro_fused"] > 40
    assert "gps_position_rejected" not in facts and "tick_gaps" not in facts


def test_while_it_aligns_it_says_so_and_sends_no_numbers(observer):
    """Each tick has its message: of what is known, or of that nothing is."""
    y = np.ascontiguousarray(synthesize(hover_path(), observer.node.values, 2.0, seed=8).y)
    y[:50, MEAS.gps_pos] = y[:50, MEAS.gps_vel] = np.nan  # no fix yet
    for tick in range(101):
        tick_of(observer, tick, y[tick])
    sent = observer.sent
    absent, rows = sent[topics.NO_ESTIMATE], sent[topics.ODOM]
    stamps = [stamp_of(raw) for raw in absent]
    assert stamps == [observer.node.stamp_ns(tick) for tick in range(len(absent))]
    assert 0 < len(absent) < 101 and len(absent) + len(rows) == 101
    assert len(sent[topics.ROTOR_STATE]) == len(rows)
    assert all(row is not None for row in (*rows, *sent[topics.ROTOR_STATE]))
    before = len(absent), len(rows)
    observer.again()
    tick_of(observer, 101, y[101])
    assert (len(sent[topics.NO_ESTIMATE]), len(sent[topics.ODOM])) == (before[0] + 1, before[1])


def test_a_receiver_without_a_fix_is_not_waited_for(observer):
    """Lockstep: a message that says "no fix" is the tick's; the filter steps on without one."""
    y = np.ascontiguousarray(synthesize(hover_path(), observer.node.values, 4.0, seed=8).y)
    y[101:, MEAS.gps_pos] = y[101:, MEAS.gps_vel] = np.nan
    for tick in range(301):
        tick_of(observer, tick, y[tick])
        assert observer.node.tick == tick
    facts = observer.node.health.facts
    assert 4 <= facts["gps_fused"] <= 6  # those of the first second
    assert np.isfinite(observer.node.core.out).all()
    assert " no fix" in observer.node.core.refused[topics.GPS_FIX]
