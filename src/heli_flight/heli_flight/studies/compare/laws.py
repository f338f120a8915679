# SPDX-License-Identifier: Apache-2.0
"""The attitude laws that `heli compare` flies against each other."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from heli_flight.loop.record import FlightRecord
from heli_flight.loop.scoring import errors
from heli_flight.loop.settings import Settings
from heli_parameters.parameters import ParameterError

OFFSET_FREE_RADPS = 0.5
AXES = ("roll", "pitch")


@dataclass(frozen=True)
class Law:
    """A law: key, name for tables, and what it changes in the inner loop's parameters."""

    key: str
    name: str
    changes: Mapping[str, Any]


LAWS = (
    Law("hinf_output", "H-infinity, output feedback", {"controller": "hinf_output"}),
    Law("hinf", "H-infinity", {"controller": "hinf"}),
    Law(
        "hinf_offset_free",
        "H-infinity, offset-free",
        {"controller": "hinf", "offset_free_radps": OFFSET_FREE_RADPS},
    ),
    Law("lqr", "LQR", {"controller": "lqr"}),
    Law("pid", "PID", {"controller": "pid"}),
)
_BY_KEY = {law.key: law for law in LAWS}


def parse_laws(text: str) -> tuple[Law, ...]:
    """Laws of "hinf,pid".

    Raises
    ------
    ParameterError
        A name is unknown.
    """
    keys = text.split(",")
    for key in keys:
        if key not in _BY_KEY:
            raise ParameterError(f"--controllers {text}: {key!r} is none of {', '.join(_BY_KEY)}")
    return tuple(law for law in LAWS if law.key in keys)


def with_law(settings: Settings, law: Law) -> Settings:
    """The same flight under another law; everything else stays as it is."""
    inner = {**settings.nodes["inner_loop"], **law.changes}
    return replace(settings, nodes={**settings.nodes, "inner_loop": inner})


def attitude_errors_deg(record: FlightRecord, source: str) -> np.ndarray:
    """Roll and pitch error (N, 2), deg, from the "navigation" record or ground "truth"."""
    found = errors(record, source, "attitude")
    return np.column_stack([found[axis] for axis in AXES])


def largest(values: Sequence[float]) -> float:
    """Largest of the values, nan for none."""
    return float(max(values)) if values else float("nan")
