# SPDX-License-Identifier: Apache-2.0
"""Flights for the live view's page: states made here, sent by the real server."""

import json
import math
import threading
from pathlib import Path

import numpy as np
import pytest

from heli_core.faults import forms
from heli_live_view.access import Access
from heli_live_view.parameters import BOUNDS as METRIC_OF
from heli_live_view.server import PageServer
from heli_live_view.state import bounds, error_row

WEB = Path(__file__).resolve().parents[3] / "src/heli_live_view/web"
BOUNDS = bounds({f"bounds.{name}": -1.0 for name in METRIC_OF})
LIMITS = {
    "altitude_min_m": 2.0, "altitude_max_m": 100.0, "distance_m": 100.0, "speed_mps": 2.0,
    "climb_mps": 1.0, "turn_dps": 10.0, "gust_mps": 10.0, "gust_s": 20.0,
}  # fmt: skip
NODES = ("plant", "observer", "inner_loop", "outer_loop", "live_view")


def hello(commands=False, history=(), realtime=True):
    return {
        "type": "hello", "commands": commands,
        "flight": {"scenario": "hover", "seed": 7, "duration_s": 60.0, "realtime": realtime},
        "aircraft": {"name": "HeLion", "rotor_radius_m": 0.705},
        "bounds": BOUNDS, "limits": LIMITS, "faults": forms(), "state_hz": 30,
        "foxglove_url": "ws://127.0.0.1:8765",
        "events": [{"type": "event", "t": 1.5, "level": 1, "source": "observer",
                    "text": "GPS <b>late</b> & wrong"}],
        "history": list(history),
    }  # fmt: skip


def body(t, shift):
    """A vehicle that sways about (0, 0, 10) with its nose to the north, banked by 4 degrees."""
    phi, theta = math.radians(4.0 + math.sin(t)), math.radians(2.0 * math.cos(0.7 * t))
    e, n = shift + 0.5 * math.sin(0.5 * t), 0.3 * math.cos(0.4 * t)
    # FLU -> ENU: yaw of 90 degrees, then pitch (nose down positive in FLU), then roll.
    half = (0.5 * phi, -0.5 * theta, 0.25 * math.pi)
    (cr, cp, cy), (sr, sp, sy) = (tuple(map(f, half)) for f in (math.cos, math.sin))
    q = [sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy,
         cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy]  # fmt: skip
    v = [0.25 * math.cos(0.5 * t), -0.12 * math.sin(0.4 * t), 0.1 * math.sin(t)]
    return {
        "p": [e, n, 10.0 + 0.25 * math.sin(t) + 0.5 * shift], "q": q, "v_enu": v,
        "v_body": [v[1], -v[0], v[2]],
        "euler_deg": [math.degrees(phi), math.degrees(theta), 0.0], "rates_dps": [0.0, 0.0, 0.0],
    }  # fmt: skip


def state(t, **changed):
    nodes = {name: {"state": "active", "level": 0, "message": ""} for name in NODES}
    made = {
        "type": "state", "t": round(t, 3), "rtf": 1.0, "truth": body(t, 0.0), "nav": body(t, 0.4),
        "ref": {"p": [0.0, 0.0, 10.0], "v": [0.0, 0.0, 0.0], "yaw_deg": 0.0},
        "setpoint_deg": [4.0, 0.0, 0.0],
        "u": [0.1 * math.sin(t), 0.05, -0.2, 0.35 + 0.05 * math.sin(t)],
        "rotor": {"a_s_deg": 0.5, "b_s_deg": -0.8, "d_int": 0.1},
        "rotor_truth": {"a_s_deg": math.sin(t), "b_s_deg": -1.2, "d_int": 0.1},
        "wind_enu": [-2.5, -2.5, 0.2], "sigma_p": [0.2, 0.25, 0.3], "mode": "hover",
        "nodes": nodes, "alarms": [], "gps": {"age_s": 0.12}, "largest": None, "faults": [],
        **changed,
    }  # fmt: skip
    return made | {source: with_error(made[source], made["ref"]) for source in ("truth", "nav")}


def with_error(vehicle, ref):
    """The vehicle with its errors from the reference, as the live view's node gives them."""
    if vehicle is None or ref is None:
        return vehicle
    ned = [
        np.array([n, e, -up]) for e, n, up in (vehicle["p"], vehicle["v_enu"], ref["p"], ref["v"])
    ]
    reference = np.hstack([*ned[2:], math.radians(ref["yaw_deg"])])
    return vehicle | {"error": error_row(*ned[:2], reference)}


class Flight:
    """States at 30 Hz through the product's own server; `change` alters what comes next."""

    LIVE = "document.getElementById('connection').dataset.state === 'live'"
    TOKEN = "token-of-this-test"
    body = staticmethod(body)

    def __init__(self, port=0, commands=False, start_s=40.0, history_s=35.0, realtime=True):
        self.change, self.received, self._realtime = {}, [], realtime
        self._t, self._commands, self._history_s = start_s, commands, history_s
        access = Access(self.TOKEN if commands else "")
        self.server = PageServer(WEB, port, access, self._hello, self._on_command)
        self.url, self.port = self.server.url, self.server.port
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._fly, daemon=True)
        self.server.start()
        self._thread.start()

    def _hello(self):
        times = [self._t - 0.1 * k for k in range(round(10 * self._history_s), 0, -1)]
        rows = [state(t, nodes={}) for t in times]
        return json.dumps(hello(self._commands, rows, self._realtime))

    def _on_command(self, command):
        self.received.append((command.name, command.args))
        command.reply(True, f"{command.name} taken")

    def _fly(self):
        while not self._stop.wait(1.0 / 30.0):
            self._t += 1.0 / 30.0
            self.send(self._t, **self.change)

    def send(self, t, **changed):
        """Send one state."""
        self.server.send_state(json.dumps(state(t, **changed)))

    def open_in(self, page, width=1440, height=900, phone=False):
        """Open the page and wait until it shows the flight."""
        page.size(width, height, phone)
        page.open(self.url, self.LIVE)

    def hush(self):
        """Send no more states; the connection stays."""
        self._stop.set()
        self._thread.join()

    def end(self):
        self.hush()
        self.server.stop()


@pytest.fixture
def flown():
    """Make flights that end with the test."""
    made = []

    def make(**options):
        made.append(Flight(**options))
        return made[-1]

    yield make
    for flight in made:
        flight.end()
