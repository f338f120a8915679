# SPDX-License-Identifier: Apache-2.0
"""The outer loop: PD position controller, modes, failsafes, references, paths, sticks."""

from heli_core.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "heli_core.errors": ["StickCause", "StickError"],
        "analysis": ["AxisReport"],
        "joystick": [
            "Device",
            "DeviceError",
            "KeyboardSticks",
            "Presses",
            "Reading",
            "SdlJoystick",
            "StickMap",
            "Sticks",
            "TerminalKeys",
            "expo",
            "without_dead_zone",
        ],
        "modes": [
            "Command",
            "Fact",
            "Guard",
            "Phase",
            "Refusal",
            "RefusalCause",
            "Refused",
            "TABLE",
            "Transition",
            "allowed",
            "command_named",
            "decide",
        ],
        "parameters": ["outer_params"],
        "position_law": ["OuterParams", "OuterStatus"],
        "state": ["RotorMap"],
    },
    modules=["analysis", "guidance", "position_law", "reference", "state"],
)
