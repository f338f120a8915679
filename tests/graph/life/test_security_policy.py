# SPDX-License-Identifier: Apache-2.0
"""The SROS 2 policy allows what the nodes of a flight open, and next to nothing besides."""

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as Xml

import pytest

from heli_flight.scenario import NODE_NAME as SUPERVISOR
from heli_msgs_bridge import topics

ROOT = Path(__file__).resolve().parents[3]
SCRIPT = ROOT / "scripts/security_policy.py"
FILE = ROOT / "src/heli_flight/config/security/policy.xml"
RIGHTS = {
    "publisher": "topics[@publish='ALLOW']/topic",
    "subscriber": "topics[@subscribe='ALLOW']/topic",
    "service": "services[@reply='ALLOW']/service",
    "client": "services[@request='ALLOW']/service",
}
# Only where the flight asks for it, or its messages are installed.
CONDITIONAL = {
    "publisher": {f"/{t}" for t in topics.BY_NAME if topics.BY_NAME[t].optional},
    "subscriber": {f"/{topics.IMU2}"},
    "service": set(),
    "client": set(),
}


def test_the_policy_is_what_the_table_says():
    done = subprocess.run(
        [sys.executable, SCRIPT, "--check"], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr


def allowed(node, right):
    profiles = Xml.parse(FILE).getroot()
    (profile,) = profiles.findall(f"enclaves/enclave[@path='/heli/{node}']/profiles/profile")
    assert profile.get("ns") == "/" and profile.get("node") == node
    names = [element.text for element in profile.findall(RIGHTS[right])]
    assert len(set(names)) == len(names)
    return {name if name.startswith("/") else f"/{name}" for name in names}


@pytest.fixture
def opened(crew):
    """What each node of a flight has open, asked of the graph."""
    nodes = ("recorder", "live_view", "outer_loop", "inner_loop", "observer", "plant")
    flying = crew("scenario", *nodes, lockstep=False, allow_commands=True)
    flying.bring_up()
    flying.fly(5)

    def ask(node, right):
        method = getattr(flying.client, f"get_{right}_names_and_types_by_node")
        return {name for name, _ in method(node, "/")}

    return {node: {right: ask(node, right) for right in RIGHTS} for node in flying.nodes}


def test_it_allows_what_nodes_open_and_no_more(opened):
    uninstalled = {f"/{name.lstrip('/')}" for name in topics.KNOWN if not topics.installed(name)}
    for node, has in opened.items():
        for right, names in has.items():
            may = allowed(node, right)
            assert names <= may, (node, right, names - may)
            if node != SUPERVISOR:  # a flight's supervisor has this name, too, and does more
                assert may - names <= CONDITIONAL[right] | uninstalled, (node, right, may - names)
