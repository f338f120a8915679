# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C while a node has only just begun: the executor takes up its subscriptions then."""

import random
import signal
import subprocess
import sys

import pytest

LIMIT_S = 120.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "count"), [(1, 10), pytest.param(2, 100, marks=pytest.mark.nightly)]
)
@pytest.mark.timeout(1800)
def test_a_recorder_interrupted_as_it_begins(ros_env, tmp_path, seed, count):
    """Exit code 0, whenever it comes; once every second one of these aborted the process."""
    draw = random.Random(seed)
    for number in range(count):
        bag = tmp_path / str(number)
        process = subprocess.Popen(
            [sys.executable, "-m", "heli_bags.node", "--ros-args", "-p", f"bag:={bag}"],
            env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        try:
            first = process.stdout.readline()
            # Most of it within the tenth of a second in which it takes up its subscriptions.
            apart_s = draw.choice([0.0, draw.uniform(0.0, 0.1), 10 ** draw.uniform(-4.0, 0.0)])
            with pytest.raises(subprocess.TimeoutExpired):
                process.wait(apart_s)
            process.send_signal(signal.SIGINT)
            rest, _ = process.communicate(timeout=LIMIT_S)
        finally:
            process.kill()
        assert process.returncode == 0, (apart_s, first + rest)
        assert "Fatal" not in rest and "Traceback" not in rest, rest
