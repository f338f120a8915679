# SPDX-License-Identifier: Apache-2.0
"""Flight bags: recorded, read, played, repaired; tools for a running graph."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "folder": ["BagError", "Format"],
        "reader": ["Bag", "Remark", "Stream", "read_bag"],
        "recorder": ["BagRecorder"],
        "player": ["Player"],
        "tools": ["bag_info", "bag_messages", "write_csv"],
        "graph_tools": ["TopicError", "list_topics", "listen", "measure"],
    },
    modules=["repair"],
)
