# SPDX-License-Identifier: Apache-2.0
"""Attitude quickness: peak rate over peak change, of each change from a steady attitude.

Source: ADS-33E-PRF 3.3.3 (pitch, roll), 3.3.6 (yaw). Its boundaries are curves over the smallest
change after the peak; they are not in here, so no level is given.
"""

from dataclasses import dataclass

import numpy as np

from heli_handling.found import runs
from heli_handling.tracks import Array

LEAST_CHANGE_DEG = 5.0
_STEADY = 0.1  # of the peak rate
_STEADY_FOR_S = 0.2
_STEADY_SHARE = 0.2  # of the change's own duration: a sine is never steady for so long


@dataclass(frozen=True)
class Change:
    """One change of attitude.

    Attributes
    ----------
    start_s, peak_s : float
        When it begins, and when the attitude is furthest.
    peak_deg, least_deg : float
        Largest change, and the smallest after it (before the attitude goes on).
    rate_radps : float
        Peak rate.
    """

    start_s: float
    peak_s: float
    peak_deg: float
    least_deg: float
    rate_radps: float

    @property
    def quickness_per_s(self) -> float:
        """Peak rate over peak change."""
        return float(self.rate_radps / np.radians(self.peak_deg))

    def as_dict(self) -> dict[str, float]:
        """For JSON."""
        return {
            "start_s": self.start_s,
            "peak_s": self.peak_s,
            "peak_deg": self.peak_deg,
            "least_deg": self.least_deg,
            "rate_radps": self.rate_radps,
            "quickness_per_s": self.quickness_per_s,
        }


def changes(time_s: Array, angle_rad: Array) -> list[Change]:
    """Changes of at least 5 deg from a steady attitude; sizes are magnitudes."""
    rate = np.gradient(angle_rad, time_s)
    found = []
    for sign in (1.0, -1.0):
        for a, b in runs(sign * rate > 0.0):
            top = float(sign * (angle_rad[b] - angle_rad[a]))
            peak_rate = float((sign * rate[a : b + 1]).max())
            if np.degrees(top) < LEAST_CHANGE_DEG or b == time_s.size - 1:
                continue
            moving = np.flatnonzero(sign * rate[a : b + 1] > _STEADY * peak_rate)
            begin = a + int(moving[0])
            steady_s = max(_STEADY_FOR_S, _STEADY_SHARE * float(time_s[b] - time_s[begin]))
            since = float(time_s[begin]) - steady_s
            before = (time_s < time_s[begin]) & (time_s >= since)
            if since < time_s[0] or np.abs(rate[before]).max() > _STEADY * peak_rate:
                continue
            back = np.flatnonzero(sign * rate[b + 1 :] > 0.0)
            end = b + 1 + int(back[0]) if back.size else time_s.size
            first = float(angle_rad[a])
            peak = float(np.degrees((sign * (angle_rad[a : b + 2] - first)).max()))
            least = float(np.degrees((sign * (angle_rad[b:end] - first)).min()))
            found.append(Change(float(time_s[begin]), float(time_s[b]), peak, least, peak_rate))
    return sorted(found, key=lambda change: change.start_s)
