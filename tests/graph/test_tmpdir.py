# SPDX-License-Identifier: Apache-2.0
"""Whatever TMPDIR is, a flight flies, and leaves nothing in it."""

import signal
import subprocess
import sys

import pytest

from heli_bags.reader import read_bag


@pytest.mark.slow
def test_a_flight_with_a_long_tmpdir_leaves_nothing_there(hover_test, tmp_path):
    """Too long for the path of a Unix socket, which has 107 bytes at most."""
    folder = tmp_path / ("t" * 120)
    folder.mkdir()
    out = tmp_path / "flight"
    env = {"TMPDIR": str(folder), "ROS_DOMAIN_ID": ""}
    done = hover_test("--duration", "2", "--out", out, env=env)
    assert done.returncode == 0, done.stdout + done.stderr
    assert (out / "result.json").is_file()
    assert list(folder.iterdir()) == []


@pytest.mark.slow
def test_two_at_once_with_folders_of_their_own_do_not_meet(ros_env, tmp_path):
    """As two users have them: the second takes another ROS domain, though it sees no lock file."""
    command = [sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report"]
    command += ["--world", "paper"]
    envs = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        envs.append({"TMPDIR": str(tmp_path / name), "ROS_DOMAIN_ID": ""})
    words = ["--realtime", "--duration", "60", "--out", str(tmp_path / "one")]
    first = subprocess.Popen([*command, *words], env=ros_env | envs[0], stdout=subprocess.DEVNULL)
    plant = tmp_path / "one" / "logs" / "plant.log"
    while not (plant.is_file() and "flying" in plant.read_text()):
        with pytest.raises(subprocess.TimeoutExpired):
            first.wait(0.05)
    second = subprocess.run(
        [*command, "--duration", "2", "--out", str(tmp_path / "two")],
        env=ros_env | envs[1], capture_output=True, text=True, timeout=240,
    )  # fmt: skip
    first.send_signal(signal.SIGINT)
    first.wait(120)
    assert first.returncode == 130
    assert second.returncode == 0, second.stdout + second.stderr
    bag = read_bag(tmp_path / "one" / "bag")
    assert len(bag.references) == 1
    assert not any("sent by" in remark.message for remark in bag.remarks)
    assert not list((tmp_path / "a").iterdir()) and not list((tmp_path / "b").iterdir())
