# SPDX-License-Identifier: Apache-2.0
"""Bags that cannot be identified from: one line with the topic and the reason. Synthetic bags."""

import math
from dataclasses import fields

import numpy as np
import pytest

from heli_bags.writer import BagRecorder
from heli_core.errors import BrokenFlightError
from heli_flight.cli.common import EXIT_BROKEN, _refusal
from heli_flight.record import FlightRecord
from heli_msgs_bridge import topics
from heli_msgs_bridge.layouts import CHANNELS
from heli_msgs_bridge.messages import Encoder
from heli_studies import identify
from heli_studies.identify import (
    BagDataError,
    IdentificationInputs,
    evaluated,
    experiment_of_bag,
    experiment_of_record,
    read_given,
)
from support.record_bag import rows_of as rows_cut

GIVEN = IdentificationInputs({}, period_s=0.5, start_s=1.0, periods=4, source="test")
NEEDED = (topics.ODOM, topics.IMU, topics.ACTUATORS, topics.EXCITATION_ACTUATORS)
TICKS = 320


def rows_of(name, tick):
    swing = math.sin(4.0 * math.pi * tick / 100.0)
    if name == topics.ODOM:
        row = np.zeros(CHANNELS[name].size)
        row[3], row[6] = 1.0 + swing, 1.0
        return row
    return {
        topics.IMU: np.array([0.0, 0.0, -9.8, 0.1 * swing, 0.0, 0.0]),
        topics.ACTUATORS: 0.2 * np.array([swing, swing, swing, swing]),
        topics.EXCITATION_ACTUATORS: 0.1 * np.array([swing, swing, swing, swing]),
    }[name]


@pytest.fixture
def bag(tmp_path):
    """bag(topics, change, ticks): a bag of the given topics; change(name, tick, row) edits rows,
    None leaves the message out."""

    def build(names=NEEDED, change=lambda name, tick, row: row, ticks=TICKS):
        recorder = BagRecorder(tmp_path / "bag", names)
        encoders = {name: Encoder(name) for name in names}
        for tick in range(ticks):
            for name in names:
                row = change(name, tick, rows_of(name, tick))
                if row is not None:
                    recorder.write(name, encoders[name].encode(row, (100 + tick) * 10_000_000))
        recorder.close()
        return tmp_path / "bag"

    return build


def read(path, kind="actuators"):
    return experiment_of_bag(path, kind, GIVEN, 1.0)


@pytest.fixture
def excited():
    """A record of one process in which something was excited."""
    z3, q = np.zeros((TICKS, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (TICKS, 1))
    arrays = {f.name: z3 for f in fields(FlightRecord) if f.name not in ("mode", "failsafe")}
    arrays |= {
        "time_s": np.arange(TICKS) / 100.0, "truth_q_nb": q, "nav_q_nb": q,
        "reference": np.zeros((TICKS, 7)), "u": np.zeros((TICKS, 4)),
        "excitation_u": np.zeros((TICKS, 4)), "imu": np.zeros((TICKS, 6)),
    }  # fmt: skip
    return FlightRecord(**arrays)


def test_a_good_bag_gives_the_evaluated_ticks(bag):
    experiment = read(bag())
    np.testing.assert_allclose(experiment.time_s, 1.0 + np.arange(200) / 100.0)
    swing = np.sin(4.0 * np.pi * experiment.time_s)
    np.testing.assert_allclose(experiment.excitation_u[:, 2], 0.1 * swing, atol=1e-12)
    np.testing.assert_allclose(experiment.rate_body_radps[:, 0], 0.1 * swing, atol=1e-12)
    np.testing.assert_allclose(experiment.vel_body_mps[:, 0], 1.0 + swing, atol=1e-12)
    np.testing.assert_array_equal(experiment.gust_body_mps, 0.0)


@pytest.mark.parametrize("gone", NEEDED)
def test_a_missing_topic_is_named(bag, gone):
    with pytest.raises(BagDataError, match=f"'{gone}'"):
        read(bag([name for name in NEEDED if name != gone]))


def test_gusts_need_their_own_topic(bag):
    with pytest.raises(BagDataError, match="'excitation/wind'"):
        read(bag(), "gusts")


def test_too_short(bag):
    with pytest.raises(BagDataError, match="'odom'") as refused:
        read(bag(ticks=200))
    assert refused.value.coverage.gap_s == pytest.approx((2.0, 3.0))
    assert refused.value.coverage.share == pytest.approx(0.5)


def test_a_gap(bag):
    def drop(name, tick, row):
        return None if name == topics.IMU and 150 <= tick < 153 else row

    with pytest.raises(BagDataError, match="'imu/data_raw'") as refused:
        read(bag(change=drop))
    assert refused.value.coverage.gap_s == pytest.approx((1.5, 1.53))
    assert refused.value.coverage.share == pytest.approx(197 / 200)


def test_a_flight_of_its_own_that_was_recorded_in_part_is_no_bad_input(bag, tmp_path, monkeypatch):
    """As on a disk that is full: exit code 1, as of the other commands that fly."""

    def fly(settings, folder, progress):
        bag(ticks=200).rename(folder)

    monkeypatch.setattr(identify, "_fly_graph", fly)
    order = identify.IdentifyOrder(quiet=True)
    with pytest.raises(BrokenFlightError) as refused:
        identify._experiment(order, "actuators", GIVEN, tmp_path)
    assert _refusal(refused.value) == EXIT_BROKEN


def test_a_record_of_one_process_that_ends_early(excited):
    assert evaluated(excited.time_s, GIVEN).share == 1.0
    with pytest.raises(BagDataError) as refused:
        experiment_of_record(rows_cut(excited, slice(250)), GIVEN)
    assert refused.value.coverage.gap_s == pytest.approx((2.5, 3.0))


def test_not_a_number(bag):
    def spoil(name, tick, row):
        if name == topics.IMU and tick == 170:
            row[3] = np.nan
        return row

    with pytest.raises(BagDataError, match="'imu/data_raw': 1 .*not finite"):
        read(bag(change=spoil))


def test_a_channel_without_excitation(bag):
    def silence(name, tick, row):
        if name == topics.EXCITATION_ACTUATORS:
            row[1] = 0.0
        return row

    with pytest.raises(BagDataError, match="'excitation/actuators': d_lon "):
        read(bag(change=silence))


def test_no_bag(tmp_path):
    with pytest.raises(BagDataError, match=str(tmp_path / "nothing")):
        read(tmp_path / "nothing")


def test_an_excitation_that_was_given_up_is_named_with_its_time(excited):
    excited.excitation_u[:150] = 0.1
    excited.gust_ned_mps[:] = 0.0
    with pytest.raises(BagDataError, match="given up at 1.49 s"):
        experiment_of_record(excited, GIVEN)
    excited.excitation_u[:] = 0.1
    assert experiment_of_record(excited, GIVEN).excitation_u.shape == (TICKS, 4)


def test_an_aircraft_with_a_design_is_excited_in_a_slow_position_loop():
    """The design's own, around the experiments' PID, swings logo600 to the limits."""
    flown = {}
    for name in (None, "xcell60", "logo600"):
        wanted = identify.IdentifyOrder(one_process=True, aircraft=name)
        flown[name] = identify.settings_of(wanted, "actuators").nodes
    slow = [flown[name]["outer_loop"]["K_P"].tolist() for name in ("xcell60", "logo600")]
    assert slow[0] == slow[1] == [1.0, 0.6, 3.0]
    assert flown["xcell60"]["outer_loop"]["mass"] != flown["logo600"]["outer_loop"]["mass"]
    assert flown[None]["outer_loop"]["K_P"].tolist() == [1.5, 1.3, 12.0]


def test_given_constants_are_packaged_for_every_aircraft():
    for name, mass in (("helion.yaml", 9.75), ("xcell60.yaml", 8.2), ("logo600.yaml", 3.6)):
        constants = read_given(name, [])
        assert constants.ground["mass"] == mass
        assert constants.source == name
        assert constants.end_s == 190.0
