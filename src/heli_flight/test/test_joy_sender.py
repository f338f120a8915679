# SPDX-License-Identifier: Apache-2.0
"""`heli joy` without a joystick: a device that is scripted, a clock that only pauses move."""

import pytest

from heli_core.errors import BrokenFlightError
from heli_flight.graph.nodes import in_words, send
from heli_outer_pd import DeviceError, Reading


class Scripted:
    """Readings one after the other; each takes `takes_s` of the clock."""

    name = "scripted"

    def __init__(self, readings, takes_s=0.0):
        self.readings, self.takes_s, self.time_s, self.read_at = list(readings), takes_s, 100.0, []

    def read(self, now_s):
        assert now_s == self.time_s
        self.read_at.append(now_s - 100.0)
        self.time_s += self.takes_s
        reading = self.readings.pop(0)
        if isinstance(reading, Exception):
            raise reading
        return reading

    def close(self):
        raise AssertionError("who opened it closes it")

    def pause(self, seconds):
        assert seconds >= 0.0
        self.time_s += seconds


def sent(device, period_s=0.02):
    published, shown = [], []
    try:
        send(device, published.append, period_s, shown.append, lambda: device.time_s, device.pause)
    finally:
        assert shown == published
    return published


READINGS = [Reading((0.1 * i, 0.0), (i % 2,)) for i in range(4)]


def test_every_reading_is_sent_until_the_pilot_ends():
    device = Scripted([*READINGS, None])
    assert sent(device) == READINGS
    assert device.read_at == pytest.approx([0.0, 0.02, 0.04, 0.06, 0.08])


def test_a_slow_device_is_not_hurried_afterwards():
    device = Scripted([*READINGS, None], takes_s=0.05)
    assert sent(device) == READINGS
    assert device.read_at == pytest.approx([0.0, 0.05, 0.1, 0.15, 0.2])


def test_one_that_goes_ends_it_in_a_sentence():
    device = Scripted([READINGS[0], DeviceError("the joystick 'x' has been unplugged")])
    with pytest.raises(BrokenFlightError, match="the joystick 'x'"):
        sent(device)


def test_a_reading_in_one_line():
    assert in_words(Reading((0.5, -1.0), (0, 1, 0, 1))) == "axes 0:+0.50 1:-1.00  buttons 1 3"
    assert in_words(Reading((0.0,), (0,))) == "axes 0:+0.00  buttons -"
