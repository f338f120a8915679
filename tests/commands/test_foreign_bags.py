# SPDX-License-Identifier: Apache-2.0
"""Each command on bags with topics that nobody here can read, and on a bag of two flights."""

import json
import re

import numpy as np
import pytest
from pyulog import ULog

import heli
from heli_bags.opening import opened
from heli_core.errors import FlightError
from heli_flight.cli import app as cli
from heli_flight.flight_file import NAME
from heli_flight.replay import replay_of
from heli_flight.report.write import BagChoice
from heli_flight.settings import resolve
from heli_msgs_bridge import topics
from heli_studies.handling import flight_of
from heli_studies.identify import BagDataError, IdentificationInputs, experiment_of_bag
from support import foreign_bags as foreign
from support.foreign_bags import FOREIGN, Kind, Sent
from support.record_bag import flown_folder

TRUTH = f"/{topics.TRUTH_ODOM}"
FIRST_S, LAST_S = 4.0, 6.0


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Two flights: settings beside, types and messages of each."""
    folder, flights = tmp_path_factory.mktemp("flown"), []
    for number, duration_s in enumerate((FIRST_S, LAST_S)):
        place = flown_folder(folder / str(number), resolve(duration_s=duration_s, seed=number + 1))
        with opened(place / "bag") as reader:
            types = {c.topic: c.msgtype for c in reader.connections}
            sent = [Sent(c.topic, ns, bytes(raw)) for c, ns, raw in reader.messages()]
        flights.append((place, types, sent))
    return flights


@pytest.fixture(scope="module", params=["mcap", "sqlite3"])
def places(request, flown, tmp_path_factory):
    """Folders of the last flight: as it is, with foreign topics, and behind another in one bag."""
    folder, (first, last) = tmp_path_factory.mktemp("places"), flown
    place, types, sent = last
    how = {"version": 3} if request.param == "sqlite3" else {}
    bags = {
        "plain": (foreign.ours(types), sent),
        "mixed": (foreign.kinds(types), foreign.among(sent)),
        "two": (foreign.ours(types), [*first[2], *sent]),
    }
    for name, (kinds, messages) in bags.items():
        foreign.write_bag(folder / name / "bag", kinds, messages, request.param, **how)
        (folder / name / NAME).write_bytes((place / NAME).read_bytes())
    return folder


def run(capsys, *words):
    code = cli.main([str(word) for word in words])
    return code, *capsys.readouterr()


def test_a_flight_is_loaded_as_if_there_was_nothing_else(places):
    plain, mixed, two = (heli.load(places / name) for name in ("plain", "mixed", "two"))
    for other in (mixed, two):
        np.testing.assert_array_equal(plain.truth.pos_ned_m, other.truth.pos_ned_m)
        np.testing.assert_array_equal(plain.u, other.u)
    assert len(heli.load(places / "two", flight=1).truth.pos_ned_m) == round(100 * FIRST_S)
    with pytest.raises(FlightError, match="2 flights"):
        heli.load(places / "two", flight=3)


@pytest.mark.parametrize("command", [
    ["report", "BAG", "--out", "OUT"],
    ["diff", "BAG", "FIRST", "--out", "OUT.html"],
])  # fmt: skip
def test_each_command_says_the_same_of_it(flown, places, tmp_path, capsys, command):
    answers = {}
    for name in ("plain", "mixed", "two"):
        words = {"BAG": places / name, "FIRST": flown[0][0]}
        out = [str(words.get(w, w)).replace("OUT", str(tmp_path / name)) for w in command]
        code, text, err = run(capsys, *out, "--json")
        assert code in (0, 1), err
        answers[name] = code, json.loads(text)
    (code, plain), (mixed_code, mixed), (two_code, two) = answers.values()
    assert code == mixed_code == two_code
    assert len(re.findall("2 flights", json.dumps(two))) == 1
    assert "2 flights" not in json.dumps(mixed)
    for key in {"level", "criteria", "verdict", "coverage", "metrics"} & plain.keys():
        assert plain[key] == mixed[key] == two[key]


def test_a_track_is_scored_as_if_there_was_nothing_else(places):
    plain, mixed, two = (flight_of(places / name) for name in ("plain", "mixed", "two"))
    for other in (mixed, two):
        np.testing.assert_array_equal(plain.track.pos_ned_m, other.track.pos_ned_m)
        np.testing.assert_array_equal(plain.track.time_s, other.track.time_s)
    assert "2 flights" in two.remarks[0] and mixed.remarks == plain.remarks
    assert len(flight_of(places / "two", number=1).track.time_s) == round(100 * FIRST_S)


def test_a_replay_shows_the_flight_that_is_asked_for(places):
    lengths = {}
    for name, number in (("plain", None), ("mixed", None), ("two", None), ("two", 1)):
        shown, _ = replay_of(places / name, BagChoice(flight=number))
        lengths[name, number] = shown.recording.streams[topics.TRUTH_ODOM].stamp_ns.size
    assert set(lengths.values()) == {round(100 * FIRST_S), round(100 * LAST_S)}
    assert lengths["two", 1] == round(100 * FIRST_S) == min(lengths.values())


def test_an_identification_asks_which_flight(places):
    given = IdentificationInputs({}, period_s=0.5, start_s=1.0, periods=4, source="test")
    with pytest.raises(BagDataError, match="2 flights"):
        experiment_of_bag(places / "two", "gusts", given, 1.0)
    for name, number in (("two", 1), ("mixed", None)):
        with pytest.raises(BagDataError) as caught:  # one of its streams was not recorded
            experiment_of_bag(places / name, "gusts", given, 1.0, number)
        assert topics.IMU in str(caught.value)


def test_ours_in_a_form_that_nobody_reads_is_named_in_the_report(flown, tmp_path, capsys):
    _, types, sent = flown[1]
    kinds = foreign.ours(types)
    kinds[f"/{topics.ACTUATORS}"] = Kind(types[f"/{topics.ACTUATORS}"], "jsonschema", b"{}", "json")
    foreign.write_bag(tmp_path / "bag", kinds, sent, "mcap")
    (tmp_path / NAME).write_bytes((flown[1][0] / NAME).read_bytes())
    code, text, _ = run(capsys, "report", tmp_path, "--json")
    (note,) = json.loads(text)["notes"]
    assert code in (0, 1) and note.startswith(f"{topics.ACTUATORS}: ") and "json" in note


def test_what_cannot_be_played_is_left_out_and_named(places, capsys):
    bag = places / "mixed" / "bag"
    words = ["bag", "play", bag, "--rate", 1000, "--json"]
    code, text, err = run(capsys, *words)
    played = json.loads(text)
    assert code == 1 and TRUTH in played and not FOREIGN.keys() & played.keys() - {"/acme/cut_off"}
    silent = FOREIGN.keys() - {"/acme/cut_off"}
    assert all(re.search(f"not read: .*{re.escape(name)}", err) for name in silent)
    left_out = [word for name in silent for word in ("--exclude", name)]
    assert run(capsys, *words, *left_out)[0] == 0
    code, _, err = run(capsys, *words, "--topic", "/acme/undefined")
    assert code == 2 and len(err.splitlines()) == 1


def test_of_two_flights_one_is_played(places, capsys):
    bag, ticks = places / "two" / "bag", round(100 * LAST_S)
    code, text, err = run(capsys, "bag", "play", bag, "--rate", 1000, "--json")
    assert code == 1 and err.count("2 flights") == 1 and json.loads(text)[TRUTH] == ticks
    words = ["bag", "play", bag, "--rate", 1000, "--json", "--flight", 1]
    code, text, _ = run(capsys, *words)
    assert code == 0 and json.loads(text)[TRUTH] == round(100 * FIRST_S)


@pytest.mark.parametrize("how", ["each twice", "all twice"])
def test_messages_that_are_in_a_bag_twice_are_taken_once(flown, tmp_path, capsys, how):
    """Each behind itself, or the whole flight behind itself: no time comes twice in a log."""
    place, types, sent = flown[0]
    twice = [one for one in sent for _ in range(2)] if how == "each twice" else [*sent, *sent]
    foreign.write_bag(tmp_path / "bag", foreign.ours(types), twice, "mcap")
    (tmp_path / NAME).write_bytes((place / NAME).read_bytes())
    code, _, err = run(capsys, "bag", "ulog", tmp_path)
    assert code == 0, err
    log = ULog(str(tmp_path / "flight.ulg"))
    (times,) = (d.data["timestamp"] for d in log.data_list if d.name == "actuator_servos")
    assert np.diff(times.astype(np.int64)).min() > 0
    np.testing.assert_array_equal(heli.load(tmp_path).u, heli.load(place).u)
    notes = heli.load(tmp_path).notes
    assert any("twice" in note or "2 flights" in note for note in notes)
