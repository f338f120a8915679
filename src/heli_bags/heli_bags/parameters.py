# SPDX-License-Identifier: Apache-2.0
"""The recorder's parameters; their values stand in config/recorder.yaml. No ROS."""

from collections.abc import Collection

from heli_core.parameters import Parameter
from heli_msgs_bridge import topics

# -------------------------------------------------------------------------------------------------
# Parameter table.
# -------------------------------------------------------------------------------------------------

NODE_NAME = "recorder"

TABLE: tuple[Parameter, ...] = (
    Parameter("bag", "string", "Folder to write; empty for bags/<date and time>", read_only=True),
    Parameter(
        "topics",
        "string[]",
        "Topics to record: all of the graph (all), names of it, others as name:package/msg/Type",
        read_only=True,
    ),
    Parameter("exclude", "string[]", "Topics to leave out, or none", read_only=True),
    Parameter(
        "custom_data",
        "string[]",
        "What metadata.yaml is to say of the recording, as name: text, or none",
        read_only=True,
    ),
    Parameter(
        "storage",
        "string",
        "Format of the files",
        choices=("mcap", "sqlite3"),
        read_only=True,
    ),
    Parameter(
        "compression",
        "string",
        "Compression of the chunks",
        choices=("none", "zstd"),
        read_only=True,
    ),
    Parameter(
        "split.size_mb",
        "double",
        "Begin a new file at this size; 0 for never",
        unit="MB",
        lower=0.0,
        upper=1e6,
        read_only=True,
    ),
    Parameter(
        "split.duration_s",
        "double",
        "Begin a new file after this time of flight; 0 for never",
        unit="s",
        lower=0.0,
        upper=1e6,
        read_only=True,
    ),
    Parameter(
        "schedule.gps_latency_ticks",
        "int",
        "A fix is sent so many ticks after its stamp; a bag has it there",
        unit="ticks",
        lower=0,
        upper=1000,
        read_only=True,
    ),
    Parameter(
        "flush_s",
        "double",
        "Wall time after which what has come is on the disk, whatever happens to the process",
        unit="s",
        lower=0.02,
        upper=60.0,
        read_only=True,
    ),
)


# -------------------------------------------------------------------------------------------------
# What the recorder leaves out, by its parameters. No ROS, no rosbags: launch files need it.
# -------------------------------------------------------------------------------------------------


def unrecorded(wanted: Collection[str], exclude: Collection[str]) -> tuple[str, ...]:
    """Topics of the graph that a recorder does not take: nobody may wait for it there.

    Parameters
    ----------
    wanted, exclude : collection of str
        Its parameters `topics` and `exclude`.

    Returns
    -------
    tuple of str
        "none" alone if it takes all: rcl has no empty array.
    """
    left = tuple(
        topic.name
        for topic in topics.TABLE
        if topic.name in exclude or not {"all", topic.name}.intersection(wanted)
    )
    return left or ("none",)
