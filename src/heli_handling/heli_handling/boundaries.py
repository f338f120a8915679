# SPDX-License-Identifier: Apache-2.0
"""Levels of responses: the published boundaries, as far as they are numbers.

ADS-33E-PRF 3.3.2.1 and 3.3.5.1, all other mission task elements, UCE = 1 and fully attended: the
upright part of the boundaries only, which holds for small phase delays. Disturbance rejection:
Blanken, Tischler et al., proposed revisions to ADS-33E-PRF (2008 on), Level 1 only.
**As recalled, as the bounds of the manoeuvres are** (`definitions`).
"""

from dataclasses import dataclass
from typing import Any

from heli_handling.definitions import FULL, Scale
from heli_handling.errors import Cause, HandlingError
from heli_handling.response import Bandwidth, Rejection

AXES = ("roll", "pitch", "yaw")
_BANDWIDTH = {"roll": (1.0, 0.5), "pitch": (1.0, 0.5), "yaw": (2.0, 0.5)}
_REJECTION = {"roll": 0.9, "pitch": 0.5, "yaw": 0.7}
_PEAK_DB = 5.0
_UPRIGHT_S = 0.15
"""Up to this phase delay the boundaries of the bandwidth are upright, as far as is recalled."""


@dataclass(frozen=True)
class Measure:
    """A number of a response against its boundary.

    Attributes
    ----------
    name, text, unit : str
    value : float or None
        None: the data do not reach.
    level1, level2 : float or None
        Bounds; None where none is published as a number, or none applies.
    at_least : bool
        The bounds are the smallest values.
    """

    name: str
    text: str
    unit: str
    value: float | None
    level1: float | None = None
    level2: float | None = None
    at_least: bool = True

    @property
    def level(self) -> str | None:
        """`Level 1`, `Level 2` or `below`; None without value or bound. On a bound is inside."""
        if self.value is None or self.level1 is None:
            return None
        sign = 1.0 if self.at_least else -1.0
        for name, bound in (("Level 1", self.level1), ("Level 2", self.level2)):
            if bound is not None and sign * self.value >= sign * bound:
                return name
        return "below"

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "name": self.name,
            "text": self.text,
            "unit": self.unit,
            "bound": "at least" if self.at_least else "at most",
            "value": self.value,
            "level_1": self.level1,
            "level_2": self.level2,
            "level": self.level,
        }


def check_axis(axis: str) -> None:
    """Refuse an unknown axis (HandlingError, UNKNOWN)."""
    if axis not in AXES:
        raise HandlingError(Cause.UNKNOWN, f"axis {axis!r} is none of {', '.join(AXES)}")


def of_bandwidth(found: Bandwidth, axis: str, scale: Scale = FULL) -> list[Measure]:
    """Bandwidth by phase (attitude command), by gain, and phase delay.

    Frequencies grow with the inverse root of the scale's ratio.
    """
    check_axis(axis)
    root = scale.ratio**0.5
    upright = found.phase_delay_s is not None and found.phase_delay_s <= _UPRIGHT_S * root
    level1, level2 = (b / root if upright else None for b in _BANDWIDTH[axis])
    text = "bandwidth, attitude command (45 deg of phase margin)"
    return [
        Measure("bandwidth", text, "rad/s", found.phase_radps, level1, level2),
        Measure("gain_bandwidth", "frequency of 6 dB of gain margin", "rad/s", found.gain_radps),
        Measure("neutral", "frequency of -180 deg", "rad/s", found.neutral_radps),
        Measure("phase_delay", "phase delay", "s", found.phase_delay_s, at_least=False),
    ]


def of_rejection(found: Rejection, axis: str, scale: Scale = FULL) -> list[Measure]:
    """Disturbance-rejection bandwidth and peak."""
    check_axis(axis)
    least = _REJECTION[axis] / scale.ratio**0.5
    text = "disturbance-rejection bandwidth (-3 dB)"
    return [
        Measure("drb", text, "rad/s", found.bandwidth_radps, least),
        Measure("drp", "disturbance-rejection peak", "dB", found.peak_db, _PEAK_DB, at_least=False),
        Measure("peak", "frequency of this peak", "rad/s", found.peak_radps),
    ]
