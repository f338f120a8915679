# SPDX-License-Identifier: Apache-2.0
"""Rows of a parameter table as ROS parameter descriptors."""

from typing import Any

import numpy as np
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

from heli_parameters.parameters import Parameter


def descriptor(row: Parameter) -> ParameterDescriptor:
    """ROS descriptor of a table row."""
    descriptor = ParameterDescriptor(
        description=row.description + (f" [{row.unit}]" if row.unit else ""),
        additional_constraints=row.allowed(),
        read_only=row.read_only,
    )
    if row.lower is None or row.upper is None:
        return descriptor
    if row.kind == "double":
        reals = FloatingPointRange(from_value=float(row.lower), to_value=float(row.upper))
        descriptor.floating_point_range = [reals]
    elif row.kind == "int":
        wholes = IntegerRange(from_value=int(row.lower), to_value=int(row.upper), step=1)
        descriptor.integer_range = [wholes]
    return descriptor


def ros_value(value: Any) -> Any:
    """A checked value in the form that rclpy takes."""
    if isinstance(value, np.ndarray):
        return value.ravel().tolist()
    return list(value) if isinstance(value, tuple) else value
