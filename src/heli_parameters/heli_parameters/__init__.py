# SPDX-License-Identifier: Apache-2.0
"""Parameter tables, rcl YAML, command lines, and where packages have their files; no ROS."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "parameters": ["Parameter", "judge", "load"],
        "rcl_yaml": ["ParameterError"],
        "rcl_dump": ["dump_all"],
        "common_table": ["with_common"],
        "locate": ["MissingFileError", "config_folder", "executable", "share_folder"],
    },
    modules=["command_line", "rcl_yaml"],
)
