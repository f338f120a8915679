# SPDX-License-Identifier: Apache-2.0
"""Sends what a joystick or a keyboard does, at a steady rate, until the pilot ends or it goes."""

import time
from collections.abc import Callable

from heli_flight.errors import BrokenFlightError
from heli_sticks.devices import Device, DeviceError, Reading


def send(
    device: Device,
    publish: Callable[[Reading], None],
    period_s: float,
    told: Callable[[Reading], None],
    now_s: Callable[[], float] = time.monotonic,
    pause: Callable[[float], None] = time.sleep,
) -> None:
    """Read and publish in turn, until the pilot ends.

    Parameters
    ----------
    device : Device
    publish : callable
        Sends a reading.
    period_s : float
        Steady time from one reading to the next; what is missed is left out.
    told : callable
        Shows it to people.
    now_s, pause : callable, optional
        The steady clock, s, and what waits so many seconds.

    Raises
    ------
    BrokenFlightError
        The device has gone.
    """
    due_s = now_s()
    while True:
        try:
            reading = device.read(now_s())
        except DeviceError as error:
            raise BrokenFlightError(f"{error}; nothing is sent any more") from None
        if reading is None:
            return
        publish(reading)
        told(reading)
        due_s = max(due_s + period_s, now_s())
        pause(max(due_s - now_s(), 0.0))


def in_words(reading: Reading) -> str:
    """One line: axes by number, numbers of the buttons that are down."""
    axes = " ".join(f"{i}:{value:+.2f}" for i, value in enumerate(reading.axes))
    down = " ".join(str(i) for i, pressed in enumerate(reading.buttons) if pressed)
    return f"axes {axes}  buttons {down or '-'}"
