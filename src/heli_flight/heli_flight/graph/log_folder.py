# SPDX-License-Identifier: Apache-2.0
"""Where ROS keeps its log, and what is done where nobody can write there."""

import os
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from heli_core.folders import temporary_folder

LOG_DIR = "ROS_LOG_DIR"


def log_folder(environ: Mapping[str, str]) -> tuple[str, Path | None]:
    """Variable that says where ROS keeps its log, and the folder; None: nothing says it.

    As ROS itself chooses: ROS_LOG_DIR, else `log` in ROS_HOME, else `.ros/log` in HOME; an empty
    one counts as unset (rcl_logging_interface, `rcl_logging_get_logging_directory`). Of HOME alone:
    one that is relative or not there is none, and is not made.
    """
    for name, below in ((LOG_DIR, ""), ("ROS_HOME", "log")):
        if environ.get(name):
            return name, Path(environ[name]) / below
    home = Path(environ.get("HOME", ""))
    return "HOME", home / ".ros" / "log" if home.is_absolute() and home.is_dir() else None


def why_not_writable(folder: Path) -> str | None:
    """Why no file can be made in a folder, which is made where it is missing; None: one can."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        return error.strerror or type(error).__name__
    return None


def keep_log() -> None:
    """Have ROS log to the temporary folder where no file can be made in its own.

    Of a folder that the user named this is said in one line.
    """
    name, folder = log_folder(os.environ)
    reason = "no home" if folder is None else why_not_writable(folder)
    if reason is None:
        return
    if name != "HOME":
        told = f"{name}={os.environ[name]!r}: {reason}; ROS keeps its log in the temporary folder"
        print(told, file=sys.stderr)
    os.environ[LOG_DIR] = str(temporary_folder("ros_log"))
