# SPDX-License-Identifier: Apache-2.0
"""The vehicle as MAVLink meets it, flown by pymavlink: no wall clock, turn by turn."""

import math
import socket
import subprocess
import sys

import pytest

pytest.importorskip("pymavlink")
from pymavlink.dialects.v20 import common as c  # noqa: E402

from heli_flight.layers import ONE_PROCESS  # noqa: E402
from heli_flight.mavlink.link import MOST_BYTES, Dropped, Link  # noqa: E402
from heli_flight.mavlink.names import OUTER_LOOP, VehicleMode, parameters  # noqa: E402
from heli_flight.mavlink.server import (  # noqa: E402
    HOST,
    MOST_READ,
    MavlinkDoor,
    flight_order,
    opened,
)
from heli_flight.mavlink.vehicle import MavlinkVehicle  # noqa: E402
from heli_flight.stepping import SteppedFlight  # noqa: E402

NAN = math.nan
STATION = (255, 190)
_MOST_TURNS = 4000
TAKEOFF, LAND, ARM = c.MAV_CMD_NAV_TAKEOFF, c.MAV_CMD_NAV_LAND, c.MAV_CMD_COMPONENT_ARM_DISARM


@pytest.fixture(scope="module")
def settings():
    return flight_order(None, [], mode=ONE_PROCESS, world="paper", seed=1).resolved()


class Station:
    """A ground station of pymavlink on a port of its own; the vehicle is turned by hand."""

    def __init__(self, settings, autopilot=c.MAV_AUTOPILOT_GENERIC):
        self.sock, self.vehicle_sock = opened(), opened()
        self.port = self.sock.getsockname()[1]
        self.vehicle = MavlinkVehicle(SteppedFlight(settings), 1, autopilot)
        self.door = MavlinkDoor(self.vehicle, (self.port,), self.vehicle_sock)
        self.mav = c.MAVLink(None, *STATION)
        self.heard, self.unread, self.words = [], [], ""

    def close(self):
        self.sock.close()
        self.vehicle_sock.close()

    def raw(self, data, sock=None):
        (sock or self.sock).sendto(data, self.vehicle_sock.getsockname())

    def send(self, message):
        self.raw(message.pack(self.mav))

    def turn(self):
        """One turn of the vehicle; what it said."""
        self.door.turn()
        self.unread, said = [], []
        while True:
            try:
                data = self.sock.recv(2048)
            except BlockingIOError:
                break
            said += c.MAVLink(None).parse_buffer(data)
        self.heard += said
        for message in said:
            if message.get_type() == "STATUSTEXT":  # the pieces of one text come together
                self.words += ("" if message.chunk_seq else "\n") + message.text
        return said

    def until(self, wanted):
        """Turn until it has said what is wanted of a message."""
        for _ in range(_MOST_TURNS):
            while self.unread:
                if wanted(message := self.unread.pop(0)):
                    return message
            self.unread = self.turn()
        raise AssertionError(f"not said within {_MOST_TURNS} turns")

    def kind(self, name):
        """The next one of a type that it says from now on."""
        self.unread.clear()
        return self.until(lambda m: m.get_type() == name)

    def command(self, command, *params, confirmation=0):
        """The result of a command."""
        filled = [*params, *[NAN] * (7 - len(params))]
        self.send(c.MAVLink_command_long_message(1, 1, command, confirmation, *filled))
        return self.answer(command)

    def answer(self, command):
        ack = self.until(lambda m: m.get_type() == "COMMAND_ACK")
        assert (ack.command, ack.target_system, ack.target_component) == (command, *STATION)
        return ack.result

    def goto(self, north_m, east_m, height_m):
        """The result of a go-to by place and height above home."""
        lat, lon, _ = self.vehicle.telemetry.geodetic([north_m, east_m, 0.0])
        frame = c.MAV_FRAME_GLOBAL_RELATIVE_ALT
        self.send(
            c.MAVLink_command_int_message(
                1, 1, frame, c.MAV_CMD_DO_REPOSITION, 0, 0, -1, 0, 0, NAN, lat, lon, height_m
            )
        )
        return self.answer(c.MAV_CMD_DO_REPOSITION)

    def mode(self, mode):
        flag = c.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        return self.command(c.MAV_CMD_DO_SET_MODE, flag, *map(float, mode.value))

    def landed(self, state):
        return self.until(
            lambda m: m.get_type() == "EXTENDED_SYS_STATE" and m.landed_state == state
        )

    def text(self, words):
        """Turn until a text is told that has not been asked for before."""
        for _ in range(_MOST_TURNS):
            _, found, after = self.words.partition(words)
            if found:
                self.words = after
                return
            self.turn()
        raise AssertionError(f"not told: {words}; {self.words}")

    def take_off(self, height_m=5.0):
        self.kind("HOME_POSITION")
        assert self.command(ARM, 1.0) == c.MAV_RESULT_ACCEPTED
        assert self.command(TAKEOFF, *[NAN] * 6, height_m) == c.MAV_RESULT_ACCEPTED
        self.landed(c.MAV_LANDED_STATE_IN_AIR)
        self.text("hover")


@pytest.fixture
def station(settings):
    made = Station(settings)
    yield made
    made.close()


@pytest.fixture
def flying(station):
    station.take_off()
    return station


def test_it_takes_off_goes_somewhere_lands_and_disarms(station):
    heartbeat = station.kind("HEARTBEAT")
    assert (heartbeat.type, heartbeat.autopilot) == (c.MAV_TYPE_HELICOPTER, 0)
    assert heartbeat.get_srcSystem() == 1
    assert station.command(TAKEOFF) == c.MAV_RESULT_TEMPORARILY_REJECTED
    station.take_off(5.0)
    above = station.kind("GLOBAL_POSITION_INT").relative_alt * 1e-3
    assert above == pytest.approx(5.0, abs=0.5)
    assert station.goto(12.0, 5.0, 8.0) == c.MAV_RESULT_ACCEPTED
    station.text("hover")
    here = station.kind("LOCAL_POSITION_NED")
    assert (here.x, here.y) == pytest.approx((12.0, 5.0), abs=0.5)
    assert station.kind("HEARTBEAT").base_mode & c.MAV_MODE_FLAG_SAFETY_ARMED
    assert station.command(LAND) == c.MAV_RESULT_ACCEPTED
    station.landed(c.MAV_LANDED_STATE_ON_GROUND)
    station.text("disarmed")
    assert not station.vehicle.armed
    kinds = {message.get_type() for message in station.heard}
    assert kinds >= {
        "ATTITUDE", "ATTITUDE_QUATERNION", "GPS_RAW_INT", "SERVO_OUTPUT_RAW", "SYS_STATUS",
    }  # fmt: skip
    assert station.door.dropped == 0


def test_the_same_commands_give_the_same_messages(settings):
    said = []
    for _ in range(2):
        station = Station(settings)
        station.take_off(3.0)
        said.append([message.to_dict() for message in station.heard])
        station.close()
    assert said[0] == said[1] or str(said[0]) == str(said[1])


def test_attitude_and_fix_are_those_that_the_flight_knows(flying):
    attitude, fix = flying.kind("ATTITUDE"), flying.kind("GPS_RAW_INT")
    nav = flying.vehicle.telemetry.nav
    assert flying.vehicle.telemetry.knows() and abs(attitude.roll) < 0.2
    assert fix.fix_type == c.GPS_FIX_TYPE_3D_FIX
    lat, lon, _ = flying.vehicle.telemetry.geodetic(nav[:3])
    assert abs(fix.lat - lat) < 1000 and abs(fix.lon - lon) < 1000
    assert all(1000 <= getattr(flying.kind("SERVO_OUTPUT_RAW"), f"servo{i}_raw") <= 2000
               for i in (1, 2, 3, 4))  # fmt: skip


def test_a_velocity_is_flown_while_it_is_renewed(flying):
    def velocity(frame=c.MAV_FRAME_LOCAL_NED, mask=0b010111000111):
        flying.send(
            c.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, frame, mask, 0, 0, 0, 1.5, 0, 0, 0, 0, 0, 0, 0
            )
        )

    assert flying.mode(VehicleMode.OFFBOARD) == c.MAV_RESULT_TEMPORARILY_REJECTED
    velocity()
    assert flying.mode(VehicleMode.OFFBOARD) == c.MAV_RESULT_ACCEPTED
    for _ in range(100):
        velocity()
        flying.turn()
    assert flying.kind("LOCAL_POSITION_NED").vx == pytest.approx(1.5, abs=0.4)
    assert flying.vehicle.mode == VehicleMode.OFFBOARD
    flying.text("set-points have stopped")
    flying.text("hover")
    assert flying.vehicle.mode == VehicleMode.LOITER
    velocity(mask=0)
    flying.text("accelerations and forces")


def test_a_position_is_flown_to_in_offboard(flying):
    def position():
        flying.send(
            c.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, c.MAV_FRAME_LOCAL_NED, 0b100111111000, 4.0, -3.0, -6.0,
                0, 0, 0, 0, 0, 0, 0.5, 0,
            )
        )  # fmt: skip

    position()
    assert flying.mode(VehicleMode.OFFBOARD) == c.MAV_RESULT_ACCEPTED
    for _ in range(300):
        position()
        flying.turn()
    here = flying.kind("LOCAL_POSITION_NED")
    assert (here.x, here.y, here.z) == pytest.approx((4.0, -3.0, -6.0), abs=0.6)
    assert flying.kind("ATTITUDE").yaw == pytest.approx(0.5, abs=0.1)


def test_a_set_point_before_the_first_position_is_dropped_and_said(station):
    target = c.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, c.MAV_FRAME_LOCAL_NED, 0b100111111000, 4.0, -3.0, -6.0, 0, 0, 0, 0, 0, 0, 0.5, 0
    )
    turns = 0
    while station.vehicle.telemetry.home_ned_m() is None:
        station.send(target)
        station.turn()
        turns += 1
    dropped = "set-point: there is no position estimate yet; it is dropped"
    told = station.words.count(dropped)
    # 20 ms a turn: once a second, not once each.
    assert 1 <= told <= 1 + turns // 50
    station.words = ""
    for _ in range(50):
        station.send(target)
        station.turn()
    assert dropped not in station.words


def test_what_cannot_be_is_refused_with_its_cause(flying):
    assert flying.goto(5000.0, 0.0, 8.0) == c.MAV_RESULT_DENIED
    flying.text("allowed")
    assert flying.command(ARM, 0.0) == c.MAV_RESULT_DENIED
    assert flying.command(TAKEOFF) == c.MAV_RESULT_TEMPORARILY_REJECTED
    assert flying.command(c.MAV_CMD_NAV_WAYPOINT) == c.MAV_RESULT_UNSUPPORTED
    assert flying.command(c.MAV_CMD_DO_SET_MODE, 1.0, 4.0, 4.0) == c.MAV_RESULT_DENIED
    flying.text("not offered")
    assert flying.command(c.MAV_CMD_DO_REPOSITION, 9.0) == c.MAV_RESULT_DENIED
    assert flying.vehicle.mode == VehicleMode.LOITER


def test_a_command_that_is_sent_again_is_answered_again(station):
    station.kind("HOME_POSITION")
    station.command(ARM, 1.0)
    assert station.command(TAKEOFF) == c.MAV_RESULT_ACCEPTED
    assert station.command(TAKEOFF, confirmation=1) == c.MAV_RESULT_ACCEPTED
    assert station.command(TAKEOFF) == c.MAV_RESULT_TEMPORARILY_REJECTED


def test_parameters_are_read_and_stay_as_they_are(station):
    station.send(c.MAVLink_param_request_list_message(1, 1))
    wanted = parameters(station.vehicle.flight.settings.nodes["outer_loop"], 1)
    values = [station.kind("PARAM_VALUE") for _ in range(1)]
    while len({m.param_id for m in values}) < len(wanted):
        values += [m for m in station.turn() if m.get_type() == "PARAM_VALUE"]
        values += [m for m in station.heard if m.get_type() == "PARAM_VALUE"]
    read = {m.param_id: m.param_value for m in values}
    assert read == pytest.approx(wanted) and {m.param_count for m in values} == {len(wanted)}
    station.send(c.MAVLink_param_set_message(1, 1, b"TKO_HEIGHT_M", 50.0, 9))
    assert station.kind("PARAM_VALUE").param_value == pytest.approx(wanted["TKO_HEIGHT_M"])
    station.send(c.MAVLink_param_request_read_message(1, 1, b"TKO_HEIGHT_M", -1))
    assert station.kind("PARAM_VALUE").param_id == "TKO_HEIGHT_M"


def test_names_fit_into_a_parameter_of_mavlink():
    assert max(map(len, OUTER_LOOP)) <= 16


def test_a_mission_is_an_empty_list_and_a_file_is_not_there(station):
    station.send(c.MAVLink_mission_request_list_message(1, 1))
    assert station.kind("MISSION_COUNT").count == 0
    station.send(c.MAVLink_mission_count_message(1, 1, 3))
    assert station.kind("MISSION_ACK").type == c.MAV_MISSION_UNSUPPORTED
    station.send(c.MAVLink_file_transfer_protocol_message(0, 1, 1, [1, 0, 7, 4] + [0] * 247))
    payload = station.kind("FILE_TRANSFER_PROTOCOL").payload
    assert (payload[0], payload[2], payload[3], payload[5]) == (2, 7, 129, 4)


def test_messages_are_sent_when_they_are_asked_for(station):
    station.kind("HEARTBEAT")
    wanted = c.MAVLINK_MSG_ID_AUTOPILOT_VERSION
    assert station.command(c.MAV_CMD_REQUEST_MESSAGE, float(wanted)) == c.MAV_RESULT_ACCEPTED
    assert any(m.get_type() == "AUTOPILOT_VERSION" for m in station.heard)
    interval = c.MAV_CMD_SET_MESSAGE_INTERVAL
    attitude = float(c.MAVLINK_MSG_ID_ATTITUDE)
    assert station.command(interval, attitude, -1.0) == c.MAV_RESULT_ACCEPTED
    station.heard.clear()
    for _ in range(50):
        station.turn()
    assert not any(m.get_type() == "ATTITUDE" for m in station.heard)
    assert station.command(interval, 999.0, 1e6) == c.MAV_RESULT_UNSUPPORTED
    station.send(c.MAVLink_timesync_message(0, 1234))
    assert station.kind("TIMESYNC").ts1 == 1234


def test_what_is_not_for_it_is_counted_and_dropped(station):
    dropped = station.door.link.dropped
    arm = c.MAVLink_command_long_message(2, 1, ARM, 0, 1, 0, 0, 0, 0, 0, 0)
    own = c.MAVLink(None, 1, 1)
    station.raw(b"\xfd" + b"\x00" * 40)
    station.raw(b"hello")
    station.send(arm)
    station.raw(c.MAVLink_command_long_message(1, 1, ARM, 0, 1, 0, 0, 0, 0, 0, 0).pack(own))
    station.raw(b"\xfe" * (MOST_BYTES + 100))
    bad = bytearray(arm.pack(station.mav))
    bad[-1] ^= 0xFF
    station.raw(bytes(bad))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind((HOST, 0))
        station.raw(arm.pack(station.mav), stranger)
        station.turn()
    assert set(dropped) == {
        Dropped.MALFORMED, Dropped.TARGET, Dropped.SOURCE, Dropped.TOO_LONG, Dropped.STRANGER,
    }  # fmt: skip
    assert not station.vehicle.armed


def test_a_flood_is_dropped_and_the_flight_goes_on(flying):
    ping = c.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(flying.mav)
    for _ in range(MOST_READ + 50):
        flying.raw(ping)
    before = flying.vehicle.telemetry.now_ns
    flying.turn()
    assert flying.door.link.dropped[Dropped.FLOOD] >= 1
    assert flying.vehicle.telemetry.now_ns > before
    assert flying.command(LAND) == c.MAV_RESULT_ACCEPTED


def test_any_bytes_are_read_without_an_error():
    import random

    draw, link = random.Random(1), Link(1)
    whole = c.MAVLink_command_long_message(1, 1, ARM, 0, 1, 0, 0, 0, 0, 0, 0).pack(
        c.MAVLink(None, *STATION)
    )
    for _ in range(2000):
        data = bytearray(whole * draw.randint(1, 3))
        for _ in range(draw.randint(1, 12)):
            data[draw.randrange(len(data))] = draw.randrange(256)
        link.read(bytes(data[: draw.randint(0, len(data))]), 14550)
    assert sum(link.dropped.values()) > 500


def test_without_pymavlink_a_sentence_says_what_to_install():
    code = (
        "import sys; sys.modules['pymavlink'] = None\n"
        "from heli_flight.cli import app; sys.exit(app.main(['mavlink']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 2 and "pip install 'heli-hover[mavlink]'" in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    "words",
    [["--speed", "0"], ["--autopilot", "x"], ["--aircraft", "nowhere"], ["--port", "0"]],
)
def test_bad_input_is_one_line(capsys, words):
    from heli_flight.cli import app as cli

    assert cli.main(["mavlink", *words]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
