# SPDX-License-Identifier: Apache-2.0
"""config/security/policy.xml of heli_flight: what each node of a flight may do, and no more.

Usage: python scripts/security_policy.py            write the file
       python scripts/security_policy.py --check    exit code 1 if it is stale

An SROS 2 policy (design.ros2.org/articles/ros2_access_control_policies.html) out of the table of
topics: one enclave per process, /heli/NODE. A test holds it against what the nodes really open.
"""

import argparse
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from xml.etree import ElementTree as Xml

from ros_page import SERVICES

from heli_msgs_bridge import topics

FILE = Path(__file__).resolve().parents[1] / "src/heli_flight/config/security/policy.xml"
NODES = ("plant", "observer", "inner_loop", "outer_loop", "recorder", "scenario", "live_view")
_EVERY_NODE_SENDS = (topics.DIAGNOSTICS, "/parameter_events", "/rosout")
_IN_TABLE = tuple(topic.name for topic in topics.TABLE)
_SENDS = {
    "outer_loop": (topics.REFERENCE,),
    "live_view": (topics.REFERENCE, topics.SCENE),
}
"""Beside what the table says: each sends the reference that it commands."""
_HEARS = {
    **dict.fromkeys(("plant", "observer", "inner_loop", "outer_loop"), (topics.AGREEMENT,)),
    "recorder": (*_IN_TABLE, *(topic.name for topic in topics.TOOLS)),
    "live_view": _IN_TABLE,
    "scenario": (topics.CLOCK, topics.DIAGNOSTICS),
}
_SERVES = {
    "plant": ("clear_faults",),
    "outer_loop": (
        "hold", "takeoff", "land", "arm", "origin", "mode/velocity", "mode/attitude", "mode/manual",
    ),
}  # fmt: skip
_ASKS = {
    "live_view": (
        "plant/get_parameters", "plant/set_parameters_atomically", "outer_loop/get_parameters",
        "outer_loop/change_state", "clear_faults",
    ),
    "scenario": tuple(
        f"{node}/{service}" for node in NODES for service in ("change_state", "get_state")
    ),
}  # fmt: skip
"""`scenario` is the name of a flight's supervisor, too, which leads all others."""


def sent(node: str) -> set[str]:
    """Names of the topics that a node may send, as it is written without a namespace."""
    own = {name for name, topic in topics.KNOWN.items() if node in topic.source}
    return {*own, *_EVERY_NODE_SENDS, f"{node}/transition_event", *_SENDS.get(node, ())}


def heard(node: str) -> set[str]:
    """Names of the topics that a node may hear."""
    own = {name for name, topic in topics.KNOWN.items() if node in topic.sinks}
    return {*own, *_HEARS.get(node, ())}


def served(node: str) -> set[str]:
    """Names of the services that a node may offer."""
    return {*(f"{node}/{name}" for name in SERVICES), *_SERVES.get(node, ())}


def asked(node: str) -> set[str]:
    """Names of the services that a node may call."""
    return set(_ASKS.get(node, ()))


def _rules(profile: Xml.Element, kind: str, right: str, names: Iterable[str]) -> None:
    if not names:
        return
    rules = Xml.SubElement(profile, f"{kind}s", {right: "ALLOW"})
    for name in sorted(names):
        Xml.SubElement(rules, kind).text = name


def policy() -> str:
    """The whole file."""
    root = Xml.Element("policy", version="0.2.0")
    enclaves = Xml.SubElement(root, "enclaves")
    for node in NODES:
        enclave = Xml.SubElement(enclaves, "enclave", path=f"/heli/{node}")
        profiles = Xml.SubElement(enclave, "profiles")
        profile = Xml.SubElement(profiles, "profile", ns="/", node=node)
        _rules(profile, "topic", "publish", sent(node))
        _rules(profile, "topic", "subscribe", heard(node))
        _rules(profile, "service", "reply", served(node))
        _rules(profile, "service", "request", asked(node))
    Xml.indent(root)
    head = "<!-- SPDX-License-Identifier: Apache-2.0 -->\n"
    head += "<!-- Made by scripts/security_policy.py; how to use it: SECURITY.md -->\n"
    start = '<?xml version="1.0" encoding="UTF-8"?>\n'
    return f"{start}{head}{Xml.tostring(root, encoding='unicode')}\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or check the file; returns the exit code."""
    parser = argparse.ArgumentParser(description="SROS 2 policy out of the table of topics")
    parser.add_argument("--check", action="store_true", help="exit with code 1 if it is stale")
    if not parser.parse_args(arguments).check:
        FILE.parent.mkdir(exist_ok=True)
        FILE.write_text(policy(), encoding="utf-8")
        return 0
    if FILE.exists() and FILE.read_text(encoding="utf-8") == policy():
        return 0
    print(f"{FILE.name} is stale: run scripts/security_policy.py", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
