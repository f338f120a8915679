# SPDX-License-Identifier: Apache-2.0
"""ArduPilot's JSON protocol, met by a client that is as strict as ArduPilot's parser."""

from dataclasses import replace

import numpy as np
import pytest

from heli_core.rotations import quat_to_R_nb
from heli_core.ticks import NS_PER_S, Rate
from heli_flight.ardupilot.physics import STEP, Physics
from heli_flight.ardupilot.protocol import (
    REPLY,
    PacketError,
    RefusedCause,
    read_packet,
    reply,
)
from heli_flight.ardupilot.server import ArduPilotOrder
from heli_flight.ardupilot.session import MULTICOPTER, SILENT_NS, Vehicle
from support.sitl_client import SitlClient, SitlRefuses, h3_120, packet, read

CALM = {"wind.turbulence": False, "wind.profile_speed_mps": [0.0, 0.0, 0.0]}
IDLE = [*h3_120(0.0, 0.0, 0.25, 0.0)]
HERE = ("127.0.0.1", 40000)


class Wall:
    """Wall time that goes on when the test says so."""

    def __init__(self):
        self.now_ns = 1

    def pass_by(self, seconds):
        self.now_ns += round(seconds * NS_PER_S)


class Bench:
    """A vehicle on a table: packets in, answers out, what it says in `said`."""

    def __init__(self, settings, servos, sender=HERE, measured=False):
        self.said, self.wall, self.sender = [], Wall(), sender
        self.vehicle = Vehicle(
            lambda rate: (Physics(settings, rate, servos, measured), None), self.said.append
        )

    def __call__(self, data, sender=None):
        return self.vehicle.answer(data, sender or self.sender, self.wall.now_ns)

    @property
    def flight(self):
        return self.vehicle.flights[-1]

    @property
    def u(self):
        return self.flight.physics.row[STEP.u]


@pytest.fixture(scope="module")
def order():
    return ArduPilotOrder(seed=1)


@pytest.fixture(scope="module")
def windy(order):
    return order.resolved()


@pytest.fixture(scope="module")
def calm(windy):
    nodes = {**windy.nodes, "plant": {**windy.nodes["plant"], **CALM}}
    return replace(windy, nodes=nodes)


@pytest.fixture(scope="module")
def servos(order, windy):
    return order.servos(windy)


@pytest.fixture
def bench(calm, servos):
    return Bench(calm, servos)


def test_a_blank_or_a_missing_newline_would_not_be_read():
    text = reply(2_500_000, np.append(np.zeros(12), [1.0, 0.0, 0.0, 0.0, 0.0]))
    assert read(text)["timestamp"] == (0.0025,)
    for worse in (text.replace(b":[", b": ["), text[1:], text[:-1], text.replace(b"0", b"nan")):
        with pytest.raises(SitlRefuses):
            read(worse)


def test_each_number_is_read_where_it_belongs():
    row = np.arange(1.0, 1.0 + REPLY.size) / 7.0
    state = read(reply(12 * NS_PER_S + 1, row))
    assert state["timestamp"] == (12.000000001,)
    places = {
        "gyro": REPLY.gyro, "accel_body": REPLY.force, "position": REPLY.pos,
        "velocity": REPLY.vel, "quaternion": REPLY.quat,
    }  # fmt: skip
    for key, place in places.items():
        np.testing.assert_allclose(state[key], row[place], rtol=1e-11)
    np.testing.assert_allclose(state["airspeed"], row[REPLY.airspeed], rtol=1e-11)


@pytest.mark.parametrize(
    ("data", "cause"),
    [
        (b"", RefusedCause.LENGTH),
        (b"\x00" * 7, RefusedCause.LENGTH),
        (packet(IDLE, 1)[:-1], RefusedCause.LENGTH),
        (packet(IDLE, 1) + b"\x00", RefusedCause.LENGTH),
        (packet(IDLE, 1, channels=32)[:40], RefusedCause.LENGTH),
        (b'{"timestamp":1.0}' * 3, RefusedCause.MAGIC),
        (b"\x00" * 40, RefusedCause.MAGIC),
        (packet(IDLE, 1, rate_hz=0), RefusedCause.STEP),
        (packet(IDLE, 1, rate_hz=10), RefusedCause.STEP),
        (packet(IDLE, 1, rate_hz=65535), RefusedCause.STEP),
    ],
)
def test_what_is_no_packet_is_named_and_gets_no_answer(bench, data, cause):
    with pytest.raises(PacketError) as refused:
        read_packet(data)
    assert refused.value.cause == cause
    assert bench(data) is None and bench(data) is None
    assert bench.vehicle.refused == {cause: 2} and len(bench.said) == 1
    assert bench(packet(IDLE, 1)) is not None


def test_16_and_32_channels_are_the_same_vehicle(calm, servos):
    few, many = (SitlClient(Bench(calm, servos), channels=n) for n in (16, 32))
    assert [few.frame(IDLE) for _ in range(5)] == [many.frame(IDLE) for _ in range(5)]


@pytest.mark.parametrize(
    ("asked_hz", "steps_hz"),
    [(400, 400), (1200, 1200), (1000, 1000), (1150, 1200), (50, 100), (11, 100)],
)
def test_the_plant_steps_as_asked_or_faster(calm, servos, asked_hz, steps_hz):
    bench = Bench(calm, servos)
    client = SitlClient(bench, asked_hz)
    for _ in range(steps_hz // 50):
        client.frame(IDLE)
    assert client.time_s == pytest.approx(0.02, abs=1e-9)
    assert bench.flight.physics.rate == Rate(steps_hz // 100)


@pytest.mark.parametrize("rate_hz", [400, 1200])
def test_on_its_skids_it_feels_gravity_alone(calm, servos, rate_hz):
    client = SitlClient(Bench(calm, servos), rate_hz)
    for _ in range(rate_hz // 2):
        client.frame(IDLE)
    state = client.state
    # The gear gives under the tail's thrust: it leans by a tenth of a degree.
    np.testing.assert_allclose(state["accel_body"], [0.0, 0.0, -9.781], atol=0.03)
    down = quat_to_R_nb(np.array(state["quaternion"]))[2]
    np.testing.assert_allclose(state["accel_body"], -9.781 * down, atol=2e-3)
    np.testing.assert_allclose(state["gyro"], 0.0, atol=1e-3)
    np.testing.assert_allclose(state["position"], 0.0, atol=5e-3)
    np.testing.assert_allclose(state["velocity"], 0.0, atol=1e-3)


def test_the_same_count_is_answered_again_without_a_step(bench):
    first = bench(packet(IDLE, 7))
    assert bench(packet(h3_120(0.5, 0.0, 0.6, 0.0), 7)) == first
    assert bench.flight.physics.tick == 1 and bench.flight.repeated == 1


def test_a_gap_is_counted_as_lost_frames(bench):
    bench(packet(IDLE, 1))
    bench(packet(IDLE, 5))
    assert bench.flight.physics.tick == 2 and bench.flight.lost == 3


def test_a_smaller_count_begins_anew(bench):
    first = bench(packet(IDLE, 100))
    for count in range(101, 120):
        bench(packet(IDLE, count))
    assert bench(packet(IDLE, 1)) == first
    assert len(bench.vehicle.flights) == 2


@pytest.mark.parametrize("measured", [False, True])
def test_the_same_seed_and_packets_give_the_same_bytes(windy, servos, measured):
    pulses = [h3_120(0.1 * np.sin(i / 40.0), 0.05, 0.2 + i / 1500.0, 0.0) for i in range(600)]

    def answers(settings):
        bench = Bench(settings, servos, measured=measured)
        return [bench(packet(p, n, 1200)) for n, p in enumerate(pulses, 1)]

    assert answers(windy) == answers(windy)
    assert answers(windy)[1:] != answers(windy.with_seed(2))[1:]


def test_the_aircraft_stands_until_each_servo_has_a_pulse(bench):
    for count in range(1, 4):
        bench(packet([1800, 0, 1800, 1500], count))
        np.testing.assert_array_equal(bench.u, bench.flight.physics.stand)
    bench(packet([0, 1800, 0, 0], 4))
    high = bench.u.copy()
    assert high[3] < -0.9
    bench(packet([], 5))
    np.testing.assert_array_equal(bench.u, high)


@pytest.mark.parametrize("pulse", [1, 499, 2501, 65535])
def test_a_pulse_that_no_servo_has_is_named_and_not_flown(bench, pulse):
    bench(packet(IDLE, 1))
    before = bench.u.copy()
    bench(packet([pulse, *IDLE[1:]], 2))
    np.testing.assert_array_equal(bench.u, before)
    assert f"{pulse} us" in bench.said[-1]


def test_a_multicopter_is_named_and_its_motors_are_not_flown(bench):
    for count in range(1, 4):
        assert bench(packet([1000] * 4, count)) is not None
        np.testing.assert_array_equal(bench.u, bench.flight.physics.stand)
    bench(packet([1400, 1500, 1450, 1500], 4))
    np.testing.assert_array_equal(bench.u, bench.flight.physics.stand)
    assert bench.said.count(MULTICOPTER) == 1 and MULTICOPTER in bench.flight.notes
    bench(packet(IDLE, 5))
    assert not np.array_equal(bench.u, bench.flight.physics.stand)


def test_a_second_arducopter_is_refused_while_the_first_flies(bench):
    bench(packet(IDLE, 1))
    bench.wall.pass_by(1.0)
    assert bench(packet(IDLE, 1), ("127.0.0.1", 40001)) is None
    assert bench.flight.refused == {RefusedCause.SENDER: 1}
    assert "40001" in bench.said[-1] and "40000" in bench.said[-1]
    assert bench(packet(IDLE, 2)) is not None


def test_one_that_died_and_returns_finds_the_aircraft_at_its_start(bench):
    first = bench(packet(IDLE, 1))
    for count in range(2, 50):
        bench(packet(h3_120(0.0, 0.0, 0.6, 0.0), count))
    bench.wall.pass_by(SILENT_NS / NS_PER_S)
    assert bench(packet(IDLE, 60), ("127.0.0.1", 40001)) == first
    assert len(bench.vehicle.flights) == 2
    assert bench(packet(IDLE, 50)) is None  # the first one's last words


def test_a_lost_aircraft_lies_where_it_fell_and_the_answers_go_on(bench):
    client = SitlClient(bench)
    for _ in range(3000):
        client.frame(h3_120(0.9, 0.0, 0.75, 0.0))
        if bench.flight.physics.status:
            break
    assert bench.flight.physics.status.name in ("ROLLED_OVER", "HIT_GROUND")
    before = client.state
    after = client.frame(IDLE)
    assert after["position"] == before["position"]
    assert after["velocity"] == (0.0, 0.0, 0.0) and after["gyro"] == (0.0, 0.0, 0.0)
    assert np.linalg.norm(after["accel_body"]) == pytest.approx(9.781)
    assert any(line.startswith("LOST") for line in bench.said)
