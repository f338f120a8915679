# SPDX-License-Identifier: Apache-2.0
"""A joystick through SDL itself: SDL's own virtual devices, moved by its functions."""

import ctypes
from pathlib import Path

import pytest

from heli_outer_pd import DeviceError, SdlJoystick
from heli_outer_pd.joystick import _sdl, joystick_names

GAME_CONTROLLER, FLIGHT_STICK = 1, 4  # SDL_JoystickType


class Virtual:
    """Joysticks that are plugged in by SDL_JoystickAttachVirtual."""

    def __init__(self):
        self.pygame = _sdl()
        maps = Path("/proc/self/maps").read_text().splitlines()
        libraries = {line.split()[-1] for line in maps if "/libSDL2-" in line}
        self.sdl = ctypes.CDLL(libraries.pop())
        self.sdl.SDL_JoystickFromInstanceID.restype = ctypes.c_void_p
        self.sdl.SDL_JoystickSetVirtualAxis.argtypes = [
            ctypes.c_void_p,
            ctypes.c_int,
            ctypes.c_int16,
        ]
        self.sdl.SDL_JoystickSetVirtualButton.argtypes = [
            ctypes.c_void_p,
            ctypes.c_int,
            ctypes.c_uint8,
        ]
        self.plugged = []

    def plug(self, kind, axes, buttons):
        number = self.sdl.SDL_JoystickAttachVirtual(kind, axes, buttons, 0)
        assert number >= 0
        self.plugged.append(number)
        self.pygame.event.pump()
        return number

    def unplug(self):
        assert self.sdl.SDL_JoystickDetachVirtual(self.plugged.pop()) == 0

    def handle(self, joystick):
        return self.sdl.SDL_JoystickFromInstanceID(joystick._stick.get_instance_id())

    def move(self, joystick, axis, value):
        assert self.sdl.SDL_JoystickSetVirtualAxis(self.handle(joystick), axis, value) == 0

    def press(self, joystick, button, down=1):
        assert self.sdl.SDL_JoystickSetVirtualButton(self.handle(joystick), button, down) == 0


@pytest.fixture
def virtual():
    joysticks = Virtual()
    yield joysticks
    while joysticks.plugged:
        joysticks.unplug()
    joysticks.pygame.event.pump()


def test_a_joystick_comes_as_ros_has_it(virtual):
    """Left and forward positive, where SDL has them negative; each end is 1."""
    joystick = SdlJoystick(virtual.plug(FLIGHT_STICK, 4, 3))
    assert (joystick.layout, joystick.name) == ("own", joystick_names()[-1])
    assert joystick.read(0.0) == ((0.0,) * 4, (0,) * 3)
    virtual.move(joystick, 0, -32768)
    virtual.move(joystick, 1, 32767)
    virtual.move(joystick, 3, 8192)
    virtual.press(joystick, 2)
    reading = joystick.read(0.0)
    assert reading.axes == pytest.approx((1.0, -1.0, 0.0, -0.25), abs=1e-4)
    assert reading.buttons == (0, 0, 1)
    virtual.press(joystick, 2, 0)
    assert joystick.read(0.0).buttons == (0, 0, 0)


def test_a_gamepad_comes_in_the_layout_of_all_gamepads(virtual):
    joystick = SdlJoystick(virtual.plug(GAME_CONTROLLER, 6, 15))
    assert joystick.layout == "game controller"
    virtual.move(joystick, 1, -32768)  # left stick forward
    virtual.move(joystick, 2, 16384)  # right stick to the right
    virtual.press(joystick, 3)
    reading = joystick.read(0.0)
    assert reading.axes[:4] == pytest.approx((0.0, 1.0, -0.5, 0.0), abs=1e-4)
    assert [i for i, down in enumerate(reading.buttons) if down] == [3]


def test_one_that_is_unplugged_is_said(virtual):
    joystick = SdlJoystick(virtual.plug(FLIGHT_STICK, 4, 3))
    joystick.read(0.0)
    virtual.unplug()
    with pytest.raises(DeviceError, match=joystick.name):
        joystick.read(0.0)


def test_a_number_that_is_not_there_names_those_that_are(virtual):
    virtual.plug(FLIGHT_STICK, 4, 3)
    with pytest.raises(DeviceError, match=r"joystick 77; .*0 \("):
        SdlJoystick(77)


def test_no_joystick_at_all(monkeypatch):
    monkeypatch.setattr("heli_outer_pd.joystick.joystick_names", lambda: [])
    with pytest.raises(DeviceError, match="--keyboard"):
        SdlJoystick()


def test_without_sdl(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pygame", None)
    with pytest.raises(DeviceError, match="pygame .*"):
        SdlJoystick()
