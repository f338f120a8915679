# SPDX-License-Identifier: Apache-2.0
"""Curves and map: odd, rising, without a step, full at the stops; what cannot be is refused."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from heli_core.rows import STICKS as ROW
from heli_outer_pd import Presses, StickCause, StickError, StickMap, Sticks, expo, without_dead_zone
from heli_outer_pd.joystick import BUTTONS, NO_BUTTON, STICKS, Stick

deflections = st.floats(-1.0, 1.0)
dead_zones = st.floats(0.0, 0.9)
expos = st.floats(0.0, 1.0)


def values(**changed):
    """Parameters of a layout without dead zone and expo: stick i on axis i, no buttons."""
    parameters = {f"joy.button.{name}": NO_BUTTON for name in BUTTONS}
    for i, name in enumerate(STICKS):
        parameters |= {f"joy.{name}.axis": i, f"joy.{name}.reversed": False}
        parameters |= {f"joy.{name}.dead_zone": 0.0, f"joy.{name}.expo": 0.0}
    return parameters | {key.replace("__", "."): value for key, value in changed.items()}


def layout(**changed):
    return StickMap.from_parameters(values(**changed))


@given(deflections, dead_zones, expos)
def test_a_stick_is_odd(x, d, e):
    stick = Stick(0, False, d, e)
    assert stick.value(-x) == -stick.value(x)
    assert Stick(0, True, d, e).value(x) == -stick.value(x)


@given(deflections, deflections, dead_zones, expos)
def test_more_deflection_is_never_less(x, y, d, e):
    stick = Stick(0, False, d, e)
    low, high = sorted((x, y))
    assert stick.value(low) <= stick.value(high) + 1e-15


@given(dead_zones, expos)
def test_the_stops_stay_the_stops(d, e):
    assert Stick(0, False, d, e).value(1.0) == pytest.approx(1.0, abs=1e-15)
    assert Stick(0, False, d, e).value(1.0005) == Stick(0, False, d, e).value(1.0)


@given(st.floats(0.01, 0.9), expos)
def test_there_is_no_step_at_the_edge_of_the_dead_zone(d, e):
    """Just outside the slope is (1 - e) / (1 - d): so small a deflection gives no more."""
    stick, beyond = Stick(0, False, d, e), 1e-9
    assert stick.value(d) == 0.0
    assert abs(stick.value(d + beyond)) <= 1.1 * beyond / (1.0 - d) + 1e-15


@pytest.mark.parametrize(
    ("x", "d", "e", "expected"),
    [
        (0.5, 0.0, 0.0, 0.5),
        (0.5, 0.0, 1.0, 0.125),
        (0.5, 0.0, 0.4, 0.35),  # 0.6 * 0.5 + 0.4 * 0.125
        (0.6, 0.2, 0.0, 0.5),  # (0.6 - 0.2) / 0.8
        (-0.6, 0.2, 0.4, -0.35),
        (0.1, 0.1, 0.4, 0.0),
    ],
)
def test_by_hand(x, d, e, expected):
    assert expo(without_dead_zone(x, d), e) == pytest.approx(expected, abs=1e-15)


@given(expos)
def test_slopes_of_expo(e):
    """In the centre 1 - e, at the stops 1 + 2 e: by differences."""
    h = 1e-6
    assert (expo(h, e) - expo(-h, e)) / (2 * h) == pytest.approx(1.0 - e, abs=1e-9)
    assert (expo(1.0, e) - expo(1.0 - h, e)) / h == pytest.approx(1.0 + 2.0 * e, abs=1e-5)


def test_sticks_stand_in_the_order_of_the_row():
    assert Sticks._fields == STICKS
    assert [getattr(ROW, name) for name in Sticks._fields] == list(range(ROW.size))


def test_each_stick_is_read_from_its_axis():
    stick_map = layout(joy__roll__axis=3, joy__climb__axis=0, joy__pitch__reversed=True)
    sticks, down = stick_map.read([0.1, 0.2, 0.3, 0.4, 9.0], [])
    assert sticks == pytest.approx((0.4, -0.2, 0.3, 0.1))
    assert down == frozenset()


def test_single_precision_and_minus_zero():
    axes = np.array([0.1, -1.0, 1.0000001, -0.0], dtype=np.float32).tolist()
    sticks, _ = layout().read(axes, [])
    assert sticks == pytest.approx((0.1, -1.0, 1.0, 0.0), abs=1e-7)
    assert max(map(abs, sticks)) <= 1.0


@pytest.mark.parametrize(
    ("axes", "buttons", "cause", "words"),
    [
        (
            [0.0, math.nan, 0.0, 0.0],
            [0] * 5,
            StickCause.NOT_FINITE,
            ["axis 1 (pitch)", "nan", "-1 to 1"],
        ),
        ([0.0, 0.0, -math.inf, 0.0], [0] * 5, StickCause.NOT_FINITE, ["axis 2 (yaw)", "-inf"]),
        (
            [0.0, 0.0, 0.0, 1.5],
            [0] * 5,
            StickCause.OUT_OF_RANGE,
            ["axis 3 (climb)", "1.5", "-1 to 1"],
        ),
        ([0.0, 0.0], [0] * 5, StickCause.TOO_FEW_AXES, ["yaw", "axis 2", "2 axes", "at least 3"]),
        ([], [0] * 5, StickCause.TOO_FEW_AXES, ["roll", "axis 0", "0 axes"]),
        ([0.0] * 4, [0] * 4, StickCause.TOO_FEW_BUTTONS, ["land", "button 4", "4 buttons"]),
        ([0.0] * 4, [0, 0, 0, 0, 7], StickCause.OUT_OF_RANGE, ["button 4 (land)", "7", "0 or 1"]),
    ],
)
def test_a_reading_that_cannot_be_is_refused(axes, buttons, cause, words):
    with pytest.raises(StickError) as refused:
        layout(joy__button__land=4).read(axes, buttons)
    sentence = str(refused.value)
    assert refused.value.cause is cause
    assert "\n" not in sentence and "allowed: " in sentence
    for word in words:
        assert word in sentence


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"joy__yaw__axis": 1}, ["pitch and yaw", "axis 1"]),
        ({"joy__button__land": 4, "joy__button__hold": 4}, ["land and hold", "button 4"]),
    ],
)
def test_a_layout_that_cannot_be_is_refused(changed, words):
    with pytest.raises(StickError) as refused:
        layout(**changed)
    assert refused.value.cause is StickCause.TAKEN_TWICE
    for word in words:
        assert word in str(refused.value)


class TestPresses:
    def test_a_button_is_obeyed_once_for_each_press(self):
        presses = Presses()
        commands = [
            presses.pressed(frozenset(names.split()))
            for names in ("", "hold", "hold", "", "hold", "hold land", "land", "")
        ]
        assert commands == [None, "hold", None, None, "hold", "land", None, None]

    def test_what_is_down_at_first_is_no_press(self):
        presses = Presses()
        assert presses.pressed(frozenset({"takeoff"})) is None
        assert presses.pressed(frozenset({"takeoff", "hold"})) == "hold"
        presses.forget()
        assert presses.pressed(frozenset({"land"})) is None

    def test_two_at_once_are_none(self):
        presses = Presses()
        presses.pressed(frozenset())
        with pytest.raises(StickError, match="hold .* land") as refused:
            presses.pressed(frozenset({"land", "hold"}))
        assert refused.value.cause is StickCause.SEVERAL_BUTTONS
        assert presses.pressed(frozenset({"land", "hold"})) is None
