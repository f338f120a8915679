# SPDX-License-Identifier: Apache-2.0
"""Where a flight's middleware listens: on this machine alone, unless the user chose otherwise."""

import os
import re
from pathlib import Path

import pytest

from heli_core.command_line import config_folder
from heli_flight.graph.nodes import PROFILES, prepare_environment
from heli_flight.graph.processes import DISCOVERY

ALONE, OPEN = "fastdds_this_machine.xml", "fastdds.xml"


@pytest.mark.parametrize(
    ("given", "profile"),
    [
        ({}, ALONE),
        ({DISCOVERY: "LOCALHOST"}, ALONE),
        ({DISCOVERY: "SUBNET"}, OPEN),
        ({DISCOVERY: "SYSTEM_DEFAULT"}, OPEN),
        ({"ROS_STATIC_PEERS": "10.0.0.7"}, OPEN),
        ({PROFILES[0]: "my.xml"}, "my.xml"),
    ],
)
def test_other_machines_are_let_in_only_where_the_user_says_so(monkeypatch, given, profile):
    monkeypatch.setattr(os, "environ", {"HOME": os.environ["HOME"], **given})
    prepare_environment()
    assert Path(os.environ[PROFILES[0]]).name == profile


def test_both_profiles_are_the_same_but_for_where_they_listen():
    alone, opened = (
        re.sub(r"<!--.*?-->", "", (config_folder("heli_flight") / name).read_text(), flags=re.S)
        for name in (ALONE, OPEN)
    )
    assert alone.count("<address>127.0.0.1</address>") == 1 and "address" not in opened
    for part in ("transport_descriptors", "userTransports"):
        alone = re.sub(rf"<{part}>.*?</{part}>", "", alone, flags=re.S)
    assert alone.split() == opened.split()
