# SPDX-License-Identifier: Apache-2.0
"""A machine whose shared memory cannot be written to, or is full (containers)."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 300.0
FLIGHT = (ROOT / "hover_test.sh", "--world", "paper", "--duration", "2", "--no-report")
KINDS = {
    "read-only": "mount -t tmpfs -o ro tmpfs /dev/shm",
    "full": "mount -t tmpfs -o size=8m tmpfs /dev/shm && fallocate -l 5M /dev/shm/full",
}


ALONE_AGAIN = """
import os, rclpy
from heli_flight.graph.processes import end_tracer
end_tracer()
end_tracer()
while len(os.listdir("/proc/self/task")) > 1:
    os.sched_yield()
print("flown")
"""


def run(kind, command, env, folder):
    """Run a command where /dev/shm is as `kind` says."""
    script = f'{{ {KINDS[kind]}; }} || exit 77\n"$@"'
    alone = ("unshare", "--mount", "--map-root-user", "bash", "-c", script, "bash")
    done = subprocess.run(
        (*alone, *command), env=env, cwd=folder, capture_output=True, text=True, timeout=LIMIT_S
    )
    if done.returncode in (1, 77) and "flown" not in done.stdout:
        pytest.skip("a file system of one's own needs the right to mount")
    return done


def test_no_thread_of_the_tracer_stays_that_would_take_the_end_of_a_node(ros_env, tmp_path):
    """With what rclpy imports it forks and waits for any child, where it has no shared memory."""
    done = run("read-only", (sys.executable, "-c", ALONE_AGAIN), ros_env, tmp_path)
    assert done.returncode == 0, done.stderr


def test_it_flies_over_udp_where_shared_memory_is_read_only(ros_env, tmp_path):
    done = run("read-only", FLIGHT, ros_env, tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("/dev/shm") == 1
    # Neither Fast DDS nor multiprocessing has anything to say.
    assert not re.search("RTPS|waitpid|Warning", done.stdout + done.stderr)


def test_full_shared_memory_is_named_before_anything_starts(ros_env, tmp_path):
    done = run("full", FLIGHT, ros_env, tmp_path)
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert "/dev/shm" in line and "3.0 MB free" in line
    assert not (tmp_path / "flights").exists() or not list((tmp_path / "flights").iterdir())
