# SPDX-License-Identifier: Apache-2.0
"""The methods of `heli identify`, and how what they find is laid side by side."""

import enum
from collections.abc import Sequence
from typing import Any

from rich.console import Console

from heli_analysis.identification.output_error import MethodAgreement
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
