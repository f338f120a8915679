# SPDX-License-Identifier: Apache-2.0
"""The recorder finishes its bag, whatever comes twice: a terminal and a launch both send SIGINT."""

import contextlib
import itertools
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from heli_bags.reader import read_bag

ROOT = Path(__file__).resolve().parents[3]
LIMIT_S = 120.0
INT, TERM = signal.SIGINT, signal.SIGTERM
PAIRS = [(INT, INT), (INT, TERM), (TERM, INT), (TERM, TERM)]


def distances(seed, count):
    """How far two signals are apart, s: at once, within the ending, and around its end."""
    draw = random.Random(seed)
    return [draw.choice([0.0, 10 ** draw.uniform(-4, -0.5)]) for _ in range(count)]


def twice(process, pair, apart_s, send):
    """Send both, so far apart."""
    for number, wait_s in zip(pair, (apart_s, 0.0), strict=True):
        with contextlib.suppress(ProcessLookupError):
            send(process, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(wait_s)


def grown(path, size):
    """Whether a file has so many bytes; one that has just got its final name has gone from here."""
    with contextlib.suppress(FileNotFoundError):
        return path.stat().st_size >= size
    return False


def recording(folder, process, size):
    """Wait until the bag in this folder has grown to so many bytes."""
    deadline = time.monotonic() + LIMIT_S
    while not any(grown(path, size) for path in folder.glob("**/bag/*.mcap")):
        assert time.monotonic() < deadline
        with contextlib.suppress(subprocess.TimeoutExpired):
            assert process.wait(0.02) is None, "it ended by itself"


@pytest.mark.parametrize(
    ("seed", "count"), [(1, 6), pytest.param(2, 200, marks=pytest.mark.nightly)]
)
@pytest.mark.timeout(1800)
def test_a_recorder_alone(ros_env, tmp_path, seed, count):
    """Exit code 0 and a bag that opens; nothing is said of it but how many messages it holds."""
    for number, (apart_s, pair) in enumerate(
        zip(distances(seed, count), itertools.cycle(PAIRS), strict=False)
    ):
        folder = tmp_path / str(number)
        folder.mkdir()
        command = [sys.executable, "-m", "heli_bags.node", "--ros-args", "-p", f"bag:={folder}/bag"]
        process = subprocess.Popen(
            [*command, "-p", "peers:=[plant]"], env=ros_env,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        recording(folder, process, 1)
        twice(process, pair, apart_s, subprocess.Popen.send_signal)
        out, _ = process.communicate(timeout=LIMIT_S)
        when = f"{number}: {pair} {apart_s:.4f} s apart: {process.returncode}\n{out}"
        assert process.returncode == 0 and "Traceback" not in out, when
        assert (folder / "bag/metadata.yaml").exists(), when
        read_bag(folder / "bag")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "count"), [(3, 4), pytest.param(4, 40, marks=pytest.mark.nightly)]
)
@pytest.mark.timeout(1800)
def test_a_whole_graph(ros_env, tmp_path, living, seed, count):
    """Sent to the whole process group of a flight: its bag opens, and nobody stays behind."""
    for number, (apart_s, pair) in enumerate(
        zip(distances(seed, count), itertools.cycle(PAIRS), strict=False)
    ):
        folder = tmp_path / str(number)
        folder.mkdir()
        process = subprocess.Popen(
            [ROOT / "hover_test.sh", "--duration", "600", "--no-report", "--out", "flight"],
            env=ros_env, cwd=folder, stdin=subprocess.DEVNULL, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            preexec_fn=lambda: signal.signal(INT, signal.SIG_DFL),
        )  # fmt: skip
        # An order that is interrupted before it flies leaves nothing.
        recording(folder, process, 300_000)
        twice(process, pair, apart_s, lambda p, sent: os.killpg(p.pid, sent))
        out, _ = process.communicate(timeout=LIMIT_S)
        when = f"{number}: {pair} {apart_s:.4f} s apart: {process.returncode}\n{out}"
        assert living() == [], when
        assert process.returncode not in (0, 1), when
        assert (folder / "flight/bag/metadata.yaml").exists(), when
        read_bag(folder / "flight/bag")
