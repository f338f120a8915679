# SPDX-License-Identifier: Apache-2.0
"""What the recorder leaves out, by its parameters. No ROS, no rosbags: launch files need it."""

from collections.abc import Collection

from heli_msgs_bridge import topics


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
