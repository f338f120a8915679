# SPDX-License-Identifier: Apache-2.0
"""Flight bags: recorded, read, played, repaired; tools for a running graph."""

from heli_core.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "graph_tools": ["TopicError", "list_topics", "listen", "measure"],
        "player": ["Player"],
        "reader": ["Bag", "Remark", "Stream", "read_bag"],
        "tools": ["bag_info", "bag_messages", "write_csv"],
        "writer": ["BagError", "BagRecorder", "Format"],
    },
    modules=["repair"],
)
