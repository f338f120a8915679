# SPDX-License-Identifier: Apache-2.0
"""Largest errors of the flight so far, beside the paper's: every sample counts. No ROS.

The same functions give the figures of result.json and report (`heli_flight.loop.scoring`): errors
from the reference as commanded, over the whole flight and over the scenario's windows; of positions
also those of ground truth less the receiver's drift at engagement.
"""

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from heli_live_view.climb_so_far import ClimbSoFar
from heli_live_view.drift_so_far import DriftSoFar
from heli_live_view.parameter_table import BOUNDS
from heli_math.paper_metrics import POSITIONS, hover_errors, in_windows, size
from heli_math.rows import REFERENCE
from heli_math.ticks import TICK_NS, seconds
from heli_math.trajectory import Trajectory

Array = NDArray[np.float64]
WHOLE, WINDOWS = "whole", "windows"
LESS_DRIFT = "truth_less_drift"
# Samples that wait for the outer loop to say from where its reference counts: half a minute.
_MOST_WAITING = 3000


class Largest:
    """Largest magnitudes by stretch, record and metric.

    Parameters
    ----------
    start_ns : int
        Stamp of flight time 0.
    windows_s : sequence of float
        Pairs of flight times that are scored; none: unknown.
    """

    def __init__(self, start_ns: int, windows_s: Sequence[float]) -> None:
        self._start_ns = start_ns
        self._windows_s = np.asarray(windows_s, float).reshape(-1, 2)
        self._waiting: dict[str, deque[tuple[int, Array, Array]]] = {}
        self._found: dict[str, dict[str, dict[str, float]]] = {WHOLE: {}, WINDOWS: {}}
        self._since_s: float | None = None
        self._climb, self._drift = ClimbSoFar(), DriftSoFar()

    def add(self, record: str, stamp_ns: int, pos_ned_m: Array, vel_ned_mps: Array) -> None:
        """A sample of a record, "nav" or "truth": position and velocity (3,)."""
        sample = stamp_ns, pos_ned_m.copy(), vel_ned_mps.copy()
        for name in (record, LESS_DRIFT) if record == "truth" else (record,):
            self._waiting.setdefault(name, deque(maxlen=_MOST_WAITING)).append(sample)
        self._drift.add(record, (stamp_ns - self._start_ns) // TICK_NS, sample[1])

    def count(self, way: Trajectory, offset_ned_m: Sequence[float]) -> None:
        """Hold what has come against the reference, moved by an offset (3,), NED, m."""
        for record, samples in self._waiting.items():
            drift_ned_m = self._drift.ned_m if record == LESS_DRIFT else np.zeros(3)
            if drift_ned_m is None:
                continue
            known = [s for s in samples if np.isfinite(s[1]).all() and np.isfinite(s[2]).all()]
            samples.clear()
            if not known:
                continue
            reference = np.array([way.at(stamp_ns) for stamp_ns, _, _ in known])
            reference[:, REFERENCE.pos] += np.asarray(offset_ned_m)
            pos, vel = (np.array([sample[i] for sample in known]) for i in (1, 2))
            pos += drift_ned_m
            ticks = (np.array([stamp_ns for stamp_ns, _, _ in known]) - self._start_ns) // TICK_NS
            errors = hover_errors(pos, vel, reference)
            if record == LESS_DRIFT:
                errors = {key: errors[key] for key in POSITIONS}
            self._hold(record, seconds(ticks), errors)
            self._climb.hold(record, seconds(ticks), -pos[:, 2], reference)

    def _hold(self, record: str, time_s: Array, errors: dict[str, Array]) -> None:
        if self._since_s is None:
            self._since_s = float(time_s[0])
        masks = {WHOLE: np.ones(time_s.shape, bool), WINDOWS: in_windows(time_s, self._windows_s)}
        for stretch, mask in masks.items():
            if not mask.any():
                continue
            found = self._found[stretch].setdefault(record, {})
            for name, key in BOUNDS.items():
                if key in errors:
                    largest, _ = size(errors[key][mask])
                    found[name] = max(largest, found.get(name, 0.0))

    def row(self) -> dict[str, object] | None:
        """For the page: per stretch and record the largest by name of the bound, the climb's
        figures per record, and from when on; None before.
        """
        if self._since_s is None:
            return None
        shown = {
            stretch: {
                record: {name: round(value, 4) for name, value in values.items()}
                for record, values in records.items()
            }
            for stretch, records in self._found.items()
        }
        return {**shown, "climb": self._climb.row(), "since_s": round(self._since_s, 2)}
