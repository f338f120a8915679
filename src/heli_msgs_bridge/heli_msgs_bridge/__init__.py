# SPDX-License-Identifier: Apache-2.0
"""The one boundary between arrays and ROS: frames, messages, topics, lockstep, node bases."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "messages": ["ClockEncoder", "Decoder", "Encoder", "MessageError"],
        "lockstep": ["Demand", "TickAssembler"],
        "managed_node": ["ManagedNode", "NodeSpec"],
        "tick_node": ["TickNode"],
        "reference_message": ["decode_reference", "encode_reference"],
    },
    modules=["frames", "topics"],
)
