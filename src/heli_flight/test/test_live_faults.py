# SPDX-License-Identifier: Apache-2.0
"""Faults from browser and terminal: what they offer is what the plant has; the plant's own text."""

import math

import pytest

from heli_core.errors import ParameterError
from heli_core.faults import KINDS, begun, faults_of, forms
from heli_dynamics_sim.faults import ACTUATORS, SENSORS
from heli_flight.graph.nodes import fault_text
from heli_live_view.commands import (
    CommandError,
    CommandLimits,
    judge_fault,
    listed,
    with_fault,
)

WHAT = forms()
LIMITS = CommandLimits(2.0, 100.0, 100.0, 2.0, 1.0, 10.0, 10.0, 20.0)
OFFERED = [(what, kind) for what, kinds in WHAT.items() for kind in kinds]


def test_the_page_offers_every_fault_of_the_plant():
    assert tuple(WHAT) == (*SENSORS, *ACTUATORS, "wind", "engine")
    assert {kind for _, kind in OFFERED} == set(KINDS)


@pytest.mark.parametrize(("what", "kind"), OFFERED)
def test_the_plant_takes_each_as_its_example_has_it(what, kind):
    form = WHAT[what][kind]
    # An engine that has stopped stays off: that has no duration.
    given_s, lasts_s = (None, math.inf) if what == "engine" else (2.0, 2.0)
    args = {"what": what, "kind": kind, "value": form["example"], "duration_s": given_s}
    (text,) = begun([judge_fault(args, LIMITS)], 5.0)
    (fault,) = faults_of([text])
    assert (fault.what, fault.kind, fault.start_s, fault.duration_s) == (what, kind, 5.0, lasts_s)
    assert list(fault.value) == form["example"]
    words = [str(v) for v in form["example"]]
    assert begun([fault_text(what, kind, words, given_s)], 5.0) == (text,)
    if form["optional"]:
        assert faults_of(begun([judge_fault({"what": what, "kind": kind}, LIMITS)], 5.0))


@pytest.mark.parametrize(
    ("args", "expected"),
    [
        ({"what": "gps, kind: x}", "kind": "loss"}, "what: "),
        ({"what": "gps", "kind": None}, "kind: None"),
        ({"what": "gps", "kind": "bias", "value": "1"}, "a list of at most 6"),
        ({"what": "gps", "kind": "bias", "value": [1.0] * 7}, "a list of at most 6"),
        ({"what": "gps", "kind": "bias", "value": [float("nan")]}, "nan is not allowed"),
        ({"what": "gps", "kind": "bias", "value": [True]}, "True is not allowed"),
        ({"what": "gps", "kind": "loss", "duration_s": -1}, "-1 is not allowed"),
        ({"what": "wind", "kind": "gust", "value": [9, 9, 0], "duration_s": 1}, "12.7 m/s"),
        ({"what": "wind", "kind": "gust", "value": [1, 0, 0], "duration_s": 99}, "0.01 to 20"),
    ],
)
def test_what_a_browser_may_not_say_is_refused_in_a_sentence(args, expected):
    with pytest.raises(CommandError, match="allowed") as caught:
        judge_fault(args, LIMITS)
    assert expected in str(caught.value) and "\n" not in str(caught.value)


def test_faults_are_added_and_listed():
    assert with_fault(["none"], "a") == ["a"] and with_fault(["a"], "b") == ["a", "b"]
    assert listed({}) == listed({"faults": ""}) == []
    names = ["gps loss", "baro loss"]
    assert listed({"faults": "; ".join(names)}) == names


def test_a_duration_that_is_no_number_is_not_taken_for_one_without_end():
    with pytest.raises(ParameterError) as caught:
        begun([fault_text("gps", "loss", [], math.nan)], 5.0)
    assert caught.value.key == "duration_s"
    (text,) = begun([fault_text("gps", "loss", [], math.inf)], 5.0)
    assert faults_of([text])[0].duration_s == math.inf


def test_a_value_that_is_no_number_is_named():
    with pytest.raises(ValueError, match="value: '--duratoin'"):
        fault_text("gps", "loss", ["--duratoin"], None)
