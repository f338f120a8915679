# SPDX-License-Identifier: Apache-2.0
"""The recorder's parameters; their values stand in config/recorder.yaml. No ROS."""

from heli_msgs_bridge.parameters import Parameter

NODE_NAME = "recorder"

TABLE: tuple[Parameter, ...] = (
    Parameter("bag", "string", "Folder to write; empty for bags/<date and time>", read_only=True),
    Parameter("topics", "string[]", "Topics to record, or all of the graph (all)", read_only=True),
    Parameter("exclude", "string[]", "Topics to leave out, or none", read_only=True),
    Parameter(
        "compression",
        "string",
        "Compression of the chunks",
        choices=("none", "zstd"),
        read_only=True,
    ),
)
