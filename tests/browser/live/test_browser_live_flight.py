# SPDX-License-Identifier: Apache-2.0
"""A flying graph watched in a real browser: what is shown is the flight, and it keeps real time."""

import json
import os
import re
import subprocess
import sys

import pytest

from heli_live_view.parameters import BOUNDS

FLOWN_S = 9
DRAWN = "window.heliView && heliView.scene.drawn && heliView.flight.last.t > 4 && heliView.fps > 0"


@pytest.fixture
def flight(tmp_path, own_domain):
    """A real-time flight with the live view; gives its process and the page's address."""
    env = dict(os.environ)
    env["ROS_DOMAIN_ID"] = str(own_domain)
    env["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    command = [sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report", "--live"]
    command += ["--live-port", "0", "--foxglove-port", "0", "--seed", "11", "--gps", "rtk"]
    command += ["--duration", str(FLOWN_S), "--out", str(tmp_path / "flight")]
    process = subprocess.Popen(
        command, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    output = ""
    for line in process.stdout:
        output += line
        if address := re.search(r"http://127\.0\.0\.1:\d+/", line):
            yield process, address.group()
            break
    else:
        pytest.fail(output)
    if process.poll() is None:
        process.terminate()
        process.communicate(timeout=60)


@pytest.mark.slow
def test_flight_is_shown_above_its_shadow_in_real_time(page, flight, tmp_path):
    process, url = flight
    page.size(1440, 900)
    page.open(url, DRAWN)
    where = page.value("heliView.projected()")
    aircraft, shadow = where["helicopter"], where["shadow"]
    for spot in (aircraft, shadow):
        assert spot["inFront"] and 0 < spot["x"] < where["width"]
        assert 0 < spot["y"] < where["height"]
    assert aircraft["y"] + 0.3 * where["height"] < shadow["y"]
    at = "heliView.projected().{0}.x, heliView.projected().{0}.y"
    under = page.value(f"heliView.pixels({at.format('shadow')}, 6)")
    beside = page.value(f"heliView.pixels({at.format('shadow').replace('.x', '.x - 250')}, 6)")
    assert under["colours"] > 300
    assert under["lightness"] < 0.9 * beside["lightness"]
    page.screenshot(tmp_path / "live_view.png", whole=False)

    # Truth, navigation and commands of the flight have all come.
    newest = page.value("heliView.flight.last")
    assert abs(newest["truth"]["p"][2] - 10.0) < 1.5
    assert abs(newest["nav"]["p"][2] - 10.0) < 1.5
    assert newest["mode"] == "hover"
    assert len(newest["u"]) == 4 and newest["setpoint_deg"] and newest["wind_enu"]
    assert newest["rotor"] and newest["rotor_truth"] and newest["sigma_p"] and newest["gps"]
    assert {"plant", "observer", "inner_loop", "outer_loop"} <= set(newest["nodes"])
    assert page.value("document.getElementById('wind-nose').innerText").endswith("of the nose")
    print(f"{page.value('heliView.fps'):.0f} frames/s, {page.value('heliView.workMs'):.1f} ms each")

    page.wait("document.getElementById('connection').dataset.state === 'over'")
    largest = page.value("heliView.flight.last.largest")
    output, _ = process.communicate(timeout=120)
    assert process.returncode in (0, 1), output
    result = json.loads((tmp_path / "flight/result.json").read_text())
    assert abs(result["real_time_factor"] - 1.0) < 0.01
    # The largest errors on the page are those of the report, but for messages that it has missed.
    assert largest["since_s"] < 0.1
    for metric in result["metrics"]:
        if metric["measured_from"] == "navigation":
            name = next(bound for bound, key in BOUNDS.items() if key == metric["key"])
            shown = largest[metric["stretch"]]["nav"][name]
            assert 0.9 * metric["max"] < shown < metric["max"] + 1e-3
    assert [e for e in page.errors if "ERR_CONNECTION_REFUSED" not in e] == []
