# SPDX-License-Identifier: Apache-2.0
"""Fixtures that tests of packages and of the graph share."""

import fcntl
import itertools
import os
import subprocess
import tempfile
from pathlib import Path

import pytest

_DOMAINS = itertools.count((os.getpid() * 7) % 90)


@pytest.fixture
def own_domain():
    """A ROS domain that no other test run on this machine uses meanwhile."""
    while True:
        domain = next(_DOMAINS) % 100 + 1
        path = Path(tempfile.gettempdir()) / f"heli_hover-test-domain-{domain}-{os.getuid()}.lock"
        with open(path, "w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            yield domain
            return


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 4 MB: a disk that fills up."""
    disk = tmp_path / "disk"
    disk.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(disk)]
    if subprocess.run(command, capture_output=True).returncode:
        pytest.skip("a file system of a size of its own needs the right to mount")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)
