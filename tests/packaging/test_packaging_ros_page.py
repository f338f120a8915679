# SPDX-License-Identifier: Apache-2.0
"""docs/ros.md says what the code's tables and a real node say."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from heli_dynamics_sim.node import PlantNode
from heli_msgs_bridge import topics

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/ros.md").read_text(encoding="utf-8")
SCRIPT = ROOT / "scripts/ros_page.py"


def run(*words, script=SCRIPT):
    command = [sys.executable, str(script), *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


def test_the_page_is_what_the_tables_say():
    done = run("--check")
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_stale_page_is_told(tmp_path):
    (tmp_path / "scripts").mkdir()
    (tmp_path / "docs").mkdir()
    copy = tmp_path / "scripts/ros_page.py"
    copy.write_text(SCRIPT.read_text())
    (tmp_path / "docs/ros.md").write_text(PAGE.replace("| 100 Hz |", "| 99 Hz |"))
    done = run("--check", script=copy)
    (line,) = done.stderr.splitlines()
    assert (done.returncode, done.stdout) == (1, "")
    assert {"docs/ros.md", "scripts/ros_page.py"} <= set(line.split())
    assert run(script=copy).returncode == 0 and run("--check", script=copy).returncode == 0
    assert (tmp_path / "docs/ros.md").read_text() == PAGE


def test_services_are_those_of_a_node(bench):
    """Asked of the graph, not of a table."""
    node = bench(PlantNode).node
    listed = dict(re.findall(r"^\| `~/(\w+)` \| (\S+) \|$", PAGE, re.M))
    there = node.get_service_names_and_types_by_node("plant", "/")
    assert {name: kinds for name, kinds in there} == {
        f"/plant/{name}": [kind] for name, kind in listed.items()
    }
    sent = node.get_publisher_names_and_types_by_node("plant", "/")
    expected = {"/rosout", "/parameter_events", "/plant/transition_event", "/diagnostics"}
    expected |= {"/agreement"}
    assert {name for name, _ in sent} == expected


@pytest.mark.parametrize("topic", topics.KNOWN.values(), ids=lambda topic: topic.name)
def test_quality_of_service_is_as_told(topic):
    profile = topics.qos(topic.name)
    (row,) = re.findall(rf"^\| `{re.escape(topic.name)}` \|.*$", PAGE, re.M)
    assert profile.reliability.name == "RELIABLE"
    latched = profile.durability.name == "TRANSIENT_LOCAL"
    assert ("latched" in row) == latched
    assert profile.depth == (topic.kept if latched else 2000) and "2000 messages" in PAGE
    assert (f"latched ({topic.kept})" in row) == (latched and topic.kept > 1)
