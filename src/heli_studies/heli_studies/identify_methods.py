# SPDX-License-Identifier: Apache-2.0
"""Methods and structures of `heli identify`, and how what they find is told."""

import enum
from collections.abc import Sequence
from typing import Any

from rich.console import Console

from heli_analysis.identification.actuators import IdentifiedAB
from heli_analysis.identification.doubts import structure_doubts
from heli_analysis.identification.output_error import MethodAgreement
from heli_analysis.identification.structure import ModelStructure, Rotor
from heli_core.rcl_yaml import ParameterError
from heli_flight.terminal import table


class Method(enum.StrEnum):
    """By which A, B and servos are found."""

    FREQUENCY = "frequency"
    OUTPUT_ERROR = "output_error"


def method_of(name: str) -> Method:
    """A method by its name; raises ParameterError."""
    try:
        return Method(name)
    except ValueError:
        known = ", ".join(Method)
        raise ParameterError(f"--method: {name!r} is not allowed; allowed: {known}") from None


def structure_of(rotor: str, yaw_gyro: bool = True) -> ModelStructure:
    """A structure by its rotor's name; raises ParameterError."""
    try:
        return ModelStructure(Rotor(rotor), yaw_gyro)
    except ValueError:
        known = ", ".join(Rotor)
        raise ParameterError(f"--structure: {rotor!r} is not allowed; allowed: {known}") from None


def structure_text(structure: ModelStructure) -> str:
    """A structure in words."""
    rotor = {
        Rotor.FULL: "flapping states",
        Rotor.QUASI_STATIC: "quasi-static rotor",
    }[structure.rotor]
    return f"{rotor}, {'with' if structure.yaw_gyro else 'without'} yaw gyro"


def structure_as_dict(ab: IdentifiedAB) -> dict[str, Any]:
    """The structure of a fit for JSON, and what speaks against it."""
    return {
        "rotor": str(ab.structure.rotor), "yaw_gyro": ab.structure.yaw_gyro,
        "states": list(ab.structure.states), "unexplained": ab.estimate.distortion,
        "doubts": [doubt.name for doubt in structure_doubts(ab)],
    }  # fmt: skip


def print_structure(ab: IdentifiedAB, out: Console) -> None:
    """A line, and one for each doubt."""
    out.print(f"structure: {structure_text(ab.structure)}", soft_wrap=True)
    for doubt in structure_doubts(ab):
        out.print(f"structure: {doubt.value}", soft_wrap=True)


def agreement_as_dict(rows: Sequence[MethodAgreement]) -> list[dict[str, Any]]:
    """For JSON."""
    return [
        {
            "name": row.name,
            "frequency": row.frequency, "frequency_sigma": row.frequency_sigma,
            "time": row.time, "time_sigma": row.time_sigma,
            "time_white_sigma": row.time_white_sigma,
            "deviation": row.deviation, "agrees": row.agrees,
        }
        for row in rows
    ]  # fmt: skip


def print_agreement(rows: Sequence[MethodAgreement], out: Console) -> None:
    """A table of both methods, and a line that counts."""
    shown = table("Both methods: frequency domain, output error in the time domain; two sigma", out)
    for i, name in enumerate(("", "frequency", "+-", "time", "+-", "apart", "")):
        shown.add_column(name, justify="right" if i else "left")
    for row in rows:
        shown.add_row(
            row.name, f"{row.frequency:.5g}", f"{2.0 * row.frequency_sigma:.2g}",
            f"{row.time:.5g}", f"{2.0 * row.time_sigma:.2g}", f"{100.0 * row.deviation:+.1f} %",
            "agrees" if row.agrees else "APART",
        )  # fmt: skip
    out.print(shown)
    agree = sum(row.agrees for row in rows)
    out.print(f"both methods agree within two sigma in {agree} of {len(rows)} entries")
