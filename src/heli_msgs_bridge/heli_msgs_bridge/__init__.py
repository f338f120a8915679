# SPDX-License-Identifier: Apache-2.0
"""The one boundary between arrays and ROS: frames, messages, topics, lockstep, node bases."""

from heli_core.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "command_messages": ["decode_reference", "encode_reference"],
        "lifecycle_node": ["Level", "ManagedNode", "NodeSpec", "NodeStartError"],
        "lockstep": ["Demand", "Lockstep", "RealTime", "TickAssembler"],
        "messages": ["ClockEncoder", "CutOffError", "Decoder", "Encoder", "MessageError"],
        "node_process": ["run"],
        "tick_node": ["Input", "TickCore", "TickNode"],
    },
    modules=["frames", "topics"],
)
