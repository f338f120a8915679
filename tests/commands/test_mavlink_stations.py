# SPDX-License-Identifier: Apache-2.0
"""`heli mavlink` met by stations of others, where they are installed: MAVSDK and MAVProxy.

They are no dependency of this project: pip install mavsdk==4.1.0 MAVProxy==1.8.75.
"""

import importlib.util
import re
import socket
import subprocess
import sys
import tempfile
from contextlib import contextmanager

import pytest

pytest.importorskip("pymavlink")

HELI = [sys.executable, "-m", "heli_flight.start", "heli"]
pytestmark = [pytest.mark.nightly, pytest.mark.timeout(600)]
_MOST_LINES = 400

MAVSDK = """
import sys, time
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action

sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
sdk.add_any_connection("udpin://127.0.0.1:" + sys.argv[1])
action = Action(sdk.first_autopilot(120.0))
for line in sys.stdin:
    for attempt in range(100):
        try:
            getattr(action, line.strip())()
            break
        except Exception as error:
            print(error, flush=True)
            time.sleep(0.2)
"""


def needs(package, why):
    return pytest.mark.skipif(
        importlib.util.find_spec(package) is None,
        reason=f"{package} is not installed: pip install {why}",
    )


@contextmanager
def flown(station):
    """The vehicle and a station at its port; `until` reads the vehicle's line of each second."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        port = str(sock.getsockname()[1])
    command = [*HELI, "mavlink", "--port", port, "--world", "paper", "--speed", "3"]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as vehicle,
        subprocess.Popen(
            station(port),
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            text=True,
        ) as other,
    ):

        def until(wanted):
            for _ in range(_MOST_LINES):
                if re.search(wanted, line := vehicle.stdout.readline()):
                    return
                assert line, "the vehicle has ended"
            raise AssertionError(f"not seen: {wanted}")

        def ask(words):
            other.stdin.write(words + "\n")
            other.stdin.flush()

        try:
            yield until, ask
        finally:
            vehicle.kill()
            other.kill()


@needs("mavsdk", "mavsdk==4.1.0")
def test_mavsdk_arms_takes_off_and_lands():
    with flown(lambda port: [sys.executable, "-c", MAVSDK, port]) as (until, ask):
        until("height -?[0-9]")
        ask("arm")
        until(" armed")
        ask("takeoff")
        until("LOITER .*height [1-9]")
        ask("land")
        until("disarmed")


@needs("MAVProxy", "MAVProxy==1.8.75")
def test_mavproxy_arms_takes_off_and_lands():
    def station(port):
        master = ["--master", f"udp:127.0.0.1:{port}", "--state-basedir"]
        return [sys.executable, "-m", "MAVProxy.mavproxy", *master, tempfile.gettempdir()]

    with flown(station) as (until, ask):
        until("height -?[0-9]")
        ask("arm throttle")
        until(" armed")
        ask("takeoff 5")
        until("height [4-9]")
        ask("long NAV_LAND 0 0 0 0 0 0 0")
        until("disarmed")
