# SPDX-License-Identifier: Apache-2.0
"""A short-lived ROS node for the commands that look at a graph or play into it."""

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from heli_flight import interrupts
from heli_flight.errors import StartError
from heli_flight.graph.processes import DISCOVERY, check_middleware
from heli_msgs_bridge.leaving import wait_for_quiet
from heli_parameters.locate import config_folder

PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def _keep_log() -> None:
    """Have ROS log to the temporary folder where there is no home that can be written to."""
    if "ROS_LOG_DIR" in os.environ or "ROS_HOME" in os.environ:
        return
    try:
        # An empty one is none: the log would go to wherever the command is run.
        log = Path(os.environ["HOME"] or os.devnull) / ".ros" / "log"
        log.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=log).close()
    except (OSError, KeyError):
        own = Path(tempfile.gettempdir()) / f"heli_hover-{os.getuid()}" / "ros_log"
        os.environ["ROS_LOG_DIR"] = str(own)


def prepare_environment() -> None:
    """Stay on this machine and announce participants often, unless the user chose otherwise."""
    _keep_log()
    os.environ.setdefault(DISCOVERY, "LOCALHOST")
    if not any(name in os.environ for name in PROFILES):
        profiles = str(config_folder("heli_flight") / "fastdds.xml")
        os.environ.update(dict.fromkeys(PROFILES, profiles))


@contextlib.contextmanager
def ros_node(name: str) -> Iterator[Node]:
    """A node without parameters, services and log topic; Ctrl-C stays a KeyboardInterrupt.

    Raises
    ------
    StartError
        ROS cannot start: one line with the reason.
    """
    prepare_environment()
    check_middleware()
    try:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        node = Node(f"{name}_{os.getpid()}", enable_rosout=False, start_parameter_services=False)
    except Exception as error:
        first = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise StartError(f"ROS 2 cannot start: {first}") from error
    try:
        # rclpy's C++ may drop a Ctrl-C that comes while it calls Python, and fail for it.
        with interrupts.told():
            yield node
    finally:
        wait_for_quiet(node)
        node.destroy_node()
        rclpy.try_shutdown()
