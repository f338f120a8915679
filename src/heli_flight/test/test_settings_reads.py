# SPDX-License-Identifier: Apache-2.0
"""What `settings.resolve` reads of the disk, counted by Python itself."""

import json
import subprocess
import sys

from heli_flight.settings import resolve

# An audit hook sees every open() whatever calls it, and stays: so in a process of its own.
COUNT = """
import collections, json, sys
from heli_flight.settings import resolve

params, opened = sys.argv[1:], collections.Counter()
resolve(params=params)  # imports what it needs, and their files
def hook(event, arguments):
    if event == "open" and str(arguments[0]).endswith(".yaml"):
        opened[str(arguments[0])] += 1
sys.addaudithook(hook)
settings = resolve("hover", "rtk", seed=3, params=params)
print(json.dumps([opened, [str(path) for path in settings.files]]))
"""


def test_each_file_is_read_once(tmp_path):
    """`common.yaml` is a layer of every node, the user's files are layers of all sections."""
    mine, other = tmp_path / "mine.yaml", tmp_path / "other.yaml"
    flight = "flight:\n  ros__parameters:\n    gps: rtk\n"
    mine.write_text(f"/**/plant:\n  ros__parameters:\n    wind.turbulence: false\n{flight}")
    other.write_text("/**/outer_loop:\n  ros__parameters:\n    tilt_limit_deg: 12.0\n")
    command = [sys.executable, "-c", COUNT, str(mine), str(other)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    opened, files = json.loads(done.stdout)
    assert {str(mine), str(other)} <= set(files) <= set(opened)
    assert {name: times for name, times in opened.items() if times != 1} == {}


def test_the_recorder_takes_the_latency_of_the_fixes_from_the_plant():
    plant, others = {"sensors.gps.latency_ticks": 10}, {"schedule.gps_latency_ticks": 10}
    assert (
        resolve(overrides={"plant": plant, "observer": others}).recorder.items() >= others.items()
    )
