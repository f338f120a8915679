# SPDX-License-Identifier: Apache-2.0
"""How long a serialised message may be before anybody looks into it. No ROS."""

MOST_BYTES, MOST_WAY_BYTES = 1 << 16, 1 << 20
"""Of a message; of one that holds a way, whose points are counted afterwards."""


def too_long(topic: str, size: int, most: int = MOST_BYTES) -> str:
    """Why a serialised message is not even looked into; empty if it may be."""
    return f"{topic}: a message of {size} bytes; allowed: at most {most}" if size > most else ""
