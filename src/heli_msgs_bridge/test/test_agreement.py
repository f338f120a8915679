# SPDX-License-Identifier: Apache-2.0
"""What peers must agree on: who has it otherwise is named, whoever it is. No ROS."""

import pytest

from heli_msgs_bridge.agreement import PAIRS, VERSION_TERM, Agreement, differences, terms

COMMON = {
    "start_time_s": 1.0, "rate_hz": 100, "origin.latitude_deg": 28.17,
    "origin.longitude_deg": 112.93, "origin.altitude_m": 50.0,
}  # fmt: skip


def values_of(name, **changes):
    own = {key: 4 for pair in PAIRS for node, key in (pair[:2], pair[2:]) if node == name}
    return own | COMMON | {key.replace("__", "."): value for key, value in changes.items()}


def test_peers_with_the_same_parameters_agree():
    names = ("plant", "observer", "inner_loop", "outer_loop", "recorder")
    told = {name: terms(name, values_of(name)) for name in names}
    for name in names:
        for peer in set(names) - {name}:
            assert list(differences(name, told[name], peer, told[peer])) == []


@pytest.mark.parametrize(("first", "key", "second", "other"), PAIRS)
def test_each_side_of_a_pair_names_the_other(first, key, second, other):
    a, b = terms(first, values_of(first) | {key: 7}), terms(second, values_of(second) | {other: 8})
    (seen,) = differences(first, a, second, b)
    assert (seen.peer, seen.key, seen.value) == (second, other, "8")
    assert (seen.own_key, seen.own_value) == (key, "7")
    (seen,) = differences(second, b, first, a)
    assert (seen.peer, seen.key, seen.value, seen.own_value) == (first, key, "7", "8")


@pytest.mark.parametrize("key", ["rate_hz", "start_time_s", "origin.altitude_m"])
def test_who_flies_without_a_plant_of_ours_must_agree_too(key):
    own, peer = terms("observer", values_of("observer")), values_of("inner_loop") | {key: 7}
    (seen,) = differences("observer", own, "inner_loop", terms("inner_loop", peer))
    assert seen.key == key


def test_another_version_is_another_term():
    agreement = Agreement("outer_loop", values_of("outer_loop"))
    told = terms("observer", values_of("observer"))
    agreement.hear("observer", "observer", told)
    assert agreement.broken == {}
    agreement.hear("observer", "observer", told | {VERSION_TERM: "1"})
    assert set(agreement.broken) == {"observer"} and VERSION_TERM in agreement.broken["observer"]
    agreement.hear("observer", "observer", told)
    assert agreement.broken == {}


def test_a_change_of_its_own_is_judged_and_who_is_gone_is_forgotten():
    values = values_of("inner_loop")
    agreement = Agreement("inner_loop", values)
    agreement.hear("pilot", "outer_loop", terms("outer_loop", values_of("outer_loop")))
    assert agreement.broken == {}
    values["outer_period_ticks"] = 8
    agreement.judge()
    assert set(agreement.broken) == {"pilot"}
    agreement.keep(["observer"])
    assert agreement.broken == {}


def test_of_strangers_nothing_is_known():
    agreement = Agreement("inner_loop", values_of("inner_loop"))
    agreement.hear("driver", "camera", {"rate_hz": "7"})
    agreement.hear("driver", "observer", {f"{n}": "7" for n in range(1000)})
    agreement.hear("driver", "observer", {})
    assert agreement.broken == {}
