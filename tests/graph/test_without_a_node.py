# SPDX-License-Identifier: Apache-2.0
"""Real time: a node that stands still for half a second costs less than a metre, and is noticed."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_core.ticks import NS_PER_S

FALLS_BACK = "no message on 'actuators' from inner_loop: the trim is held, rates are damped"
LIMIT_S = 120.0
STOPPED_S = 0.5


def check_logged(log, sentence, before):
    """Wait until the plant has said a sentence once more than before."""
    deadline = time.monotonic() + LIMIT_S
    while log.read_text().count(sentence) <= before:
        assert time.monotonic() < deadline, log.read_text()


@pytest.mark.nightly
@pytest.mark.parametrize("node", ["inner_loop", "observer"])
def test_half_a_second_without_a_node(ros_env, tmp_path, holder_of, living, node):
    """The actuator side flies meanwhile, and gives back without anybody's help."""
    out = tmp_path / "flight"
    log = out / "logs" / "plant.log"
    command = [sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report", "--realtime"]
    flying = subprocess.Popen(
        [*command, "--world", "paper", "--duration", "12", "--out", str(out)],
        env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert "flown" in flying.stdout.readline()
    flew = log.read_text().count("]: flying")
    fell_back = log.read_text().count(FALLS_BACK)
    pid = holder_of(out / "logs" / f"{node}.log")
    os.kill(pid, signal.SIGSTOP)
    check_logged(log, FALLS_BACK, fell_back)
    with pytest.raises(subprocess.TimeoutExpired):
        flying.wait(STOPPED_S)
    os.kill(pid, signal.SIGCONT)
    check_logged(log, "]: flying", flew)
    _, err = flying.communicate(timeout=LIMIT_S)
    assert flying.returncode in (0, 1) and err == "", err
    assert living() == []
    bag = read_bag(out / "bag")
    truth = bag.streams["ground_truth/odom"]
    begun = truth.stamp_ns[0]
    noticed = [remark.stamp_ns for remark in bag.remarks if remark.message == FALLS_BACK]
    # At the start the first command may be late, too; there is no place to lose yet.
    noticed = [stamp for stamp in noticed if stamp - begun > NS_PER_S]
    assert noticed
    for stamp in noticed:
        after = (truth.stamp_ns > stamp - NS_PER_S // 5) & (truth.stamp_ns < stamp + 3 * NS_PER_S)
        places = truth.rows[after, :3]
        assert np.linalg.norm(places - places[0], axis=1).max() < 1.0
    assert any("without_commands" in remark.facts for remark in bag.remarks)
