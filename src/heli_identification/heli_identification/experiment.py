# SPDX-License-Identifier: Apache-2.0
"""The record of an identification experiment: one array per signal, one row per tick, checked."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from heli_identification.errors import Cause, IdentificationError
from heli_math.ticks import TICK_S, ticks_in

Array = NDArray[np.float64]

RATES = ("p", "q", "r")
ACTUATORS = ("lat", "lon", "ped", "col")
WIND = ("u", "v", "w")
CHANNELS = (*ACTUATORS, *WIND)
"""What can be excited: actuators as sent, gusts in body axes (m/s)."""
LEAST_PERIODS = 4
_WIDTH = {
    "time_s": 0,
    "u": 4,
    "excitation_u": 4,
    "attitude_rad": 3,
    "rate_body_radps": 3,
    "vel_body_mps": 3,
    "accel_body_mps2": 3,
    "gust_body_mps": 3,
}


@dataclass(frozen=True)
class Experiment:
    """One flight with a periodic excitation, sampled at 100 Hz; body axes FRD, SI, rad.

    Row n is what was known at tick n: rates and attitude before the command u of that tick acts.

    Attributes
    ----------
    time_s : (N,) array
        Flight time.
    u : (N, 4) array
        Actuators d_lat, d_lon, d_ped, d_col as sent, excitation included.
    excitation_u : (N, 4) array
        The excitation in u; zero where there is none.
    attitude_rad : (N, 3) array
        phi, theta, psi of the navigation.
    rate_body_radps : (N, 3) array
        p, q, r as measured by the gyros; a constant bias does no harm.
    vel_body_mps : (N, 3) array
        Velocity over ground, body axes, of the navigation.
    accel_body_mps2 : (N, 3) array
        Specific force.
    gust_body_mps : (N, 3) array
        Injected gust, velocity of the air, held over the tick; without the unknown turbulence.
    period_s : float
        Period of the excitation.
    start_s : float
        Beginning of the first period that is evaluated; transients have died out there.
    periods : int
        Number of whole periods from start_s on that are evaluated.
    """

    time_s: Array
    u: Array
    excitation_u: Array
    attitude_rad: Array
    rate_body_radps: Array
    vel_body_mps: Array
    accel_body_mps2: Array
    gust_body_mps: Array
    period_s: float
    start_s: float
    periods: int

    def __post_init__(self) -> None:
        size = np.asarray(self.time_s).size
        for field in fields(self):
            if field.name not in _WIDTH:
                continue
            array = np.asarray(getattr(self, field.name), dtype=np.float64)
            width = _WIDTH[field.name]
            shape = (size, width) if width else (size,)
            if array.shape != shape:
                raise IdentificationError(
                    Cause.SHAPE, f"{field.name} has shape {array.shape}, {shape} is needed"
                )
            object.__setattr__(self, field.name, array)

    @property
    def period_ticks(self) -> int:
        """Ticks of one period."""
        return ticks_in(self.period_s)

    def steady(self) -> "Experiment":
        """The evaluated periods alone, checked.

        Raises
        ------
        IdentificationError
            TOO_SHORT, GAP, NOT_FINITE or SHAPE, naming the signal and where.
        """
        if abs(self.period_ticks * TICK_S - self.period_s) > 1e-9 or self.period_ticks < 2:
            raise IdentificationError(
                Cause.SHAPE, f"period_s = {self.period_s:g} is not a multiple of {TICK_S:g} s"
            )
        if self.periods < LEAST_PERIODS:
            raise IdentificationError(
                Cause.TOO_SHORT, f"periods = {self.periods}, at least {LEAST_PERIODS} are needed"
            )
        first = int(np.searchsorted(self.time_s, self.start_s - 0.5 * TICK_S))
        count = self.periods * self.period_ticks
        if self.time_s.size - first < count or (
            first == 0 and self.time_s.size and self.time_s[0] > self.start_s + 0.5 * TICK_S
        ):
            raise IdentificationError(
                Cause.TOO_SHORT,
                f"{self.periods} periods of {self.period_s:g} s from {self.start_s:g} s on are "
                f"needed, but the record covers {_span(self.time_s)}",
            )
        cut = slice(first, first + count)
        steps = np.diff(self.time_s[cut])
        if not np.all(np.isfinite(steps)) or np.max(np.abs(steps - TICK_S)) > 0.01 * TICK_S:
            bad = int(np.argmax(~(np.abs(steps - TICK_S) <= 0.01 * TICK_S)))
            raise IdentificationError(
                Cause.GAP,
                f"time_s: {steps[bad]:g} s between two samples at {self.time_s[first + bad]:.2f} s,"
                f" {TICK_S:g} s is needed",
            )
        parts = {name: getattr(self, name)[cut] for name in _WIDTH}
        for name, array in parts.items():
            finite = np.isfinite(array).reshape(array.shape[0], -1).all(axis=1)
            if not finite.all():
                raise IdentificationError(
                    Cause.NOT_FINITE,
                    f"{name} is not finite at {parts['time_s'][int(np.argmin(finite))]:.2f} s",
                )
        return Experiment(
            **parts,
            period_s=self.period_s,
            start_s=float(parts["time_s"][0]),
            periods=self.periods,
        )


def _span(time_s: Array) -> str:
    return f"{time_s[0]:g} to {time_s[-1]:g} s" if time_s.size else "nothing"
