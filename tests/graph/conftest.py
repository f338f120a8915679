# SPDX-License-Identifier: Apache-2.0
"""Each test that opens a graph has a ROS domain of its own and leaves no process behind."""

import contextlib
import fcntl
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from pathlib import Path

import pytest

# Limits bound how long a failure takes; a loaded machine must not meet them.
END_LIMIT_S = 120.0
HERE = Path(__file__).parent


def pytest_collection_finish(session):
    """Compile what has changed once, here: five nodes that do it at once meet the tests' limits."""
    if session.config.option.collectonly:
        return
    if any(item.path.is_relative_to(HERE) for item in session.items):
        command = [sys.executable, "-m", "heli_flight.graph.warm_up"]
        # Of several processes of one test run the first compiles, the others then find it done.
        with open(
            Path(tempfile.gettempdir()) / f"heli_hover-test-warm_up-{os.getuid()}", "w"
        ) as one:
            fcntl.flock(one, fcntl.LOCK_EX)
            subprocess.run(command, stdout=subprocess.DEVNULL, check=True)


@pytest.fixture
def ros_env(own_domain):
    """Environment of a test's processes: own domain, this machine only.

    What is left of them when the test has failed is killed.
    """
    env = dict(os.environ)
    env["ROS_DOMAIN_ID"] = str(own_domain)
    env["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    env["HELI_TEST_RUN"] = uuid.uuid4().hex
    yield env
    for pid in processes_of(env):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def processes_of(env):
    """Process ids and command lines of living processes that the test started, directly or not."""
    wanted = f"HELI_TEST_RUN={env['HELI_TEST_RUN']}".encode()
    commands = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            environ = (folder / "environ").read_bytes().split(b"\0")
            command = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        except OSError:
            continue
        if wanted in environ and command and int(folder.name) != os.getpid():
            commands[int(folder.name)] = command
    return commands


def ends(pid, limit_s):
    """Whether a process, no child of ours perhaps, ends within the limit."""
    try:
        watched = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        return bool(select.select([watched], [], [], max(0.0, limit_s))[0])
    finally:
        os.close(watched)


def gone(env, limit_s=END_LIMIT_S):
    """Whether all processes of the test end within the limit."""
    deadline = time.monotonic() + limit_s
    while pids := list(processes_of(env)):
        if not all(ends(pid, deadline - time.monotonic()) for pid in pids):
            return False
    return True


@pytest.fixture
def holder_of():
    """Call it for the process that has a file open."""

    def holder(file):
        for link in Path("/proc").glob("[0-9]*/fd/*"):
            try:
                if os.readlink(link) == str(file):
                    return int(link.parts[2])
            except OSError:
                continue
        raise AssertionError(f"no process has {file} open")

    return holder


@pytest.fixture
def living(ros_env):
    """Call it for the test's processes that do not end within a limit."""

    def still(limit_s=END_LIMIT_S):
        return [] if gone(ros_env, limit_s) else list(processes_of(ros_env).values())

    return still


@pytest.fixture
def hover_test(ros_env):
    """Run the hover test's command; returns the finished process.

    In the paper's world, unless a test names another: there it is inside the paper's figures.
    """

    def run(*arguments, limit_s=240, env=None):
        command = [sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report"]
        command += map(str, arguments)
        if "--world" not in arguments:
            command += ["--world", "paper"]
        done = subprocess.run(
            command, env=ros_env | (env or {}), capture_output=True, text=True, timeout=limit_s
        )
        assert gone(ros_env)
        return done

    return run


@pytest.fixture
def refused(ros_env, living, monkeypatch, capfd):
    """Run the hover test's command with bad input, in this process, which is quicker than its own.

    Returns the one line that it says; what only a node finds is none of this fixture's.
    """
    from heli_flight.cli.hover_test import main

    for key, value in ros_env.items():
        monkeypatch.setenv(key, value)

    def run(*arguments):
        assert main(["--no-report", "--world", "paper", *map(str, arguments)]) == 2
        stderr = capfd.readouterr().err
        assert stderr.count("\n") == 1 and stderr.endswith("\n"), stderr
        assert living() == []
        return stderr

    return run
