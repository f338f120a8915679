# SPDX-License-Identifier: Apache-2.0
"""`heli mavlink` as a process, flown over loopback by pymavlink."""

import signal
import socket
import subprocess
import sys
from contextlib import contextmanager

import pytest

pytest.importorskip("pymavlink")
from pymavlink.dialects.v20 import common as c  # noqa: E402

HELI = [sys.executable, "-m", "heli_flight.start", "heli"]
_LIMIT_S = 240.0


@contextmanager
def vehicle(port, *words):
    command = [*HELI, "mavlink", "--port", str(port), "--world", "paper", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.slow
def test_a_station_arms_it_takes_off_and_ctrl_c_ends_it():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        sock.settimeout(_LIMIT_S)
        station = c.MAVLink(None, 255, 190)

        def until(wanted, command=None, *params):
            """Hear until it is said; a command is sent with each heartbeat, as stations do."""
            while True:
                data, sender = sock.recvfrom(2048)
                for message in c.MAVLink(None).parse_buffer(data):
                    if wanted(message):
                        return
                    if command is not None and message.get_type() == "HEARTBEAT":
                        asked = [*params, *[float("nan")] * (7 - len(params))]
                        message = c.MAVLink_command_long_message(1, 1, command, 0, *asked)
                        sock.sendto(message.pack(station), sender)

        def armed(m):
            return m.get_type() == "HEARTBEAT" and m.base_mode & c.MAV_MODE_FLAG_SAFETY_ARMED

        def in_air(m):
            landed = c.MAV_LANDED_STATE_IN_AIR
            return m.get_type() == "EXTENDED_SYS_STATE" and m.landed_state == landed

        with vehicle(sock.getsockname()[1], "--speed", "10") as process:
            until(armed, c.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
            until(in_air, c.MAV_CMD_NAV_TAKEOFF)
            process.send_signal(signal.SIGINT)
            said, _ = process.communicate(timeout=_LIMIT_S)
    assert process.returncode == 0 and "not heard: nothing" in said
