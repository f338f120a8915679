# SPDX-License-Identifier: Apache-2.0
"""Keys of a terminal as sticks, through a pseudo-terminal; no window, no X."""

import os
import pty
import termios

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heli_outer_pd import DeviceError, KeyboardSticks, TerminalKeys
from heli_outer_pd.joystick import AXES, CENTRE_S, HELP, KEY_BUTTONS, STEP, split_keys

UP, DOWN, RIGHT, LEFT = (f"\x1b[{letter}" for letter in "ABCD")


@pytest.fixture
def terminal():
    """A terminal's keys, and what types into it."""
    typist, fd = pty.openpty()
    keys = TerminalKeys(fd)
    yield keys, lambda text: os.write(typist, text.encode()), fd
    keys.close()
    os.close(typist)
    os.close(fd)


def axes(sticks, now_s):
    return sticks.read(now_s).axes


def test_a_key_moves_its_stick_and_lets_it_go():
    sticks = KeyboardSticks()
    sticks.press("w", 10.0)
    sticks.press("w", 10.1)
    assert axes(sticks, 10.1) == (0.0, 2 * STEP, 0.0, 0.0)
    assert axes(sticks, 10.1 + CENTRE_S) == (0.0, 2 * STEP, 0.0, 0.0)
    assert axes(sticks, 10.2 + CENTRE_S) == (0.0, 0.0, 0.0, 0.0)


def test_the_other_way_goes_through_the_centre():
    sticks = KeyboardSticks()
    for key, expected in ((LEFT, STEP), (LEFT, 2 * STEP), (RIGHT, 0.0), (RIGHT, -STEP)):
        sticks.press(key, 1.0)
        assert axes(sticks, 1.0)[2] == expected


def test_space_centres_all_of_them():
    sticks = KeyboardSticks()
    for key in ("a", "s", UP, RIGHT, " "):
        sticks.press(key, 0.0)
    assert axes(sticks, 0.0) == (0.0,) * 4


def test_a_button_is_down_for_one_reading():
    sticks = KeyboardSticks()
    sticks.press("l", 0.0)
    first, second = sticks.read(0.0).buttons, sticks.read(0.0).buttons
    assert [i for i, down in enumerate(first) if down] == [KEY_BUTTONS["l"]]
    assert not any(second)


@given(st.lists(st.sampled_from([*AXES, *KEY_BUTTONS, " ", "x"])))
def test_no_axis_leaves_its_range(keys):
    sticks = KeyboardSticks()
    for key in keys:
        sticks.press(key, 0.0)
    reading = sticks.read(0.0)
    assert all(-1.0 <= value <= 1.0 for value in reading.axes)
    assert set(reading.buttons) <= {0, 1}


def test_an_arrow_may_come_in_pieces():
    assert split_keys(f"w{UP}\x1bOC") == (["w", UP, RIGHT], "")
    assert split_keys("a\x1b") == (["a"], "\x1b")
    assert split_keys("\x1b[") == ([], "\x1b[")


def test_keys_come_without_enter_and_the_terminal_is_given_back(terminal):
    keys, typed, fd = terminal
    flags = termios.tcgetattr(fd)[3]
    assert not flags & (termios.ICANON | termios.ECHO)
    assert flags & termios.ISIG  # Ctrl-C still ends
    typed(f"w{RIGHT[:2]}")
    assert keys.read(0.0).axes == (0.0, STEP, 0.0, 0.0)
    typed(f"{RIGHT[2]}h")
    reading = keys.read(0.0)
    assert reading.axes == (0.0, STEP, -STEP, 0.0)
    assert reading.buttons[KEY_BUTTONS["h"]] == 1
    keys.close()
    assert termios.tcgetattr(fd)[3] & termios.ICANON


@pytest.mark.parametrize("end", ["q", "wq", "\x04"])
def test_the_pilot_ends(terminal, end):
    keys, typed, _ = terminal
    typed(end)
    assert keys.read(0.0) is None


def test_a_terminal_that_goes_ends_it():
    typist, fd = pty.openpty()
    keys = TerminalKeys(fd)
    os.close(typist)
    assert keys.read(0.0) is None
    keys.close()
    os.close(fd)


def test_a_file_is_no_keyboard(tmp_path):
    with (tmp_path / "f").open("w") as file, pytest.raises(DeviceError, match="no terminal"):
        TerminalKeys(file.fileno())


def test_the_help_names_every_key():
    for key in [*AXES, *KEY_BUTTONS]:
        assert "arrows" in HELP if key.startswith("\x1b") else f"{key}" in HELP.replace(":", " ")
