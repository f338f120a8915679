# SPDX-License-Identifier: Apache-2.0
"""Fixtures that tests of packages and of the graph share."""

import subprocess

import pytest


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
