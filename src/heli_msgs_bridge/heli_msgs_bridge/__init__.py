# SPDX-License-Identifier: Apache-2.0
"""The one boundary between arrays and ROS: frames, messages, topics, lockstep, node bases."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "messages": ["ClockEncoder", "CutOffError", "Decoder", "Encoder", "MessageError"],
        "lockstep": ["Demand", "TickAssembler"],
        "stepping": ["Lockstep", "RealTime"],
        "diagnostics": ["Level"],
        "managed_node": ["ManagedNode"],
        "node_process": ["run"],
        "node_spec": ["NodeSpec", "StartError"],
        "tick_node": ["Input", "TickCore", "TickNode"],
        "reference_message": ["decode_reference", "encode_reference"],
    },
    modules=["frames", "topics"],
)
