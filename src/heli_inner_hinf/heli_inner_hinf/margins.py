# SPDX-License-Identifier: Apache-2.0
"""Stability margins of a loop: with all channels at once, one at a time, and of delay."""

from dataclasses import dataclass, replace

import control
import numpy as np

from heli_inner_hinf.actuation import Actuation
from heli_inner_hinf.disk_margin import DiskMargin, smallest
from heli_inner_hinf.frequency import grid, modes, top
from heli_inner_hinf.loops import Loop, Model, sampled_plant
from heli_math.ticks import TICK_S


@dataclass(frozen=True)
class ChannelMargin:
    """Classical margins of one channel, the others closed.

    Attributes
    ----------
    gain_up_db, gain_down_db : float
        Largest and smallest (negative) gain change, dB; inf if none destabilises.
    phase_deg : float
        Smallest phase lag, deg; inf if the loop gain never crosses one.
    delay_s : float
        Smallest additional delay, s.
    """

    gain_up_db: float
    gain_down_db: float
    phase_deg: float
    delay_s: float


def frequency_grid(loop: Loop) -> np.ndarray:
    """Frequencies (m,), rad/s: 0.01 to 1000 or Nyquist's, denser at the loop's modes."""
    return grid(modes(loop.closed), 1e-2, top(loop.closed, 1e3), 400)


def disk_margin(loop: Loop, where: str, omega: np.ndarray | None = None) -> DiskMargin:
    """Multi-channel disk margin at `where` = "input" (3 channels) or "output" of the plant."""
    if loop.stability() >= 0.0:
        return DiskMargin(0.0, 0.0)
    omega = frequency_grid(loop) if omega is None else omega
    return smallest(loop.at_input(omega) if where == "input" else loop.at_output(omega), omega)


def channel_margins(loop: Loop) -> list[ChannelMargin]:
    """Margins of each actuator's channel, one at a time, the others closed."""
    omega = frequency_grid(loop)
    L = loop.at_input(omega)
    S = np.linalg.inv(np.eye(L.shape[1]) + L)
    return [channel_margin(1.0 / S[:, i, i] - 1.0, omega) for i in range(L.shape[1])]


def channel_margin(single: np.ndarray, omega: np.ndarray) -> ChannelMargin:
    """Margins of a scalar open loop (m,) at omega (m,), rad/s, by python-control."""
    measured = control.frd(single, omega, smooth=True)
    gain, phase_deg, _, _, crossover, _ = control.stability_margins(measured, returnall=True)
    up, down = gain[gain > 1.0], gain[gain < 1.0]
    lag_rad = np.radians(np.mod(phase_deg, 360.0))
    return ChannelMargin(
        gain_up_db=float(20.0 * np.log10(np.min(up, initial=np.inf))),
        gain_down_db=float(20.0 * np.log10(np.max(down))) if down.size else -np.inf,
        phase_deg=float(np.min(np.abs(phase_deg), initial=np.inf)),
        delay_s=float(np.min(lag_rad / crossover, initial=np.inf)),
    )


def further_delay_s(
    loop: Loop, model: Model, actuation: Actuation | None = None, longest_s: float = 0.08
) -> float:
    """Further transport delay (s), in all channels at once, up to which a loop as flown is stable.

    Exact discretisation for every delay; first crossing on a 2 ms grid, then bisected to 0.05 ms.
    `model` and `actuation` are those of the loop.
    """
    actuation = actuation or Actuation()

    def stable(extra: float) -> bool:
        later = replace(actuation, delay_s=actuation.delay_s + extra)
        return replace(loop, plant=sampled_plant(model, later)).stability() < 0.0

    if not stable(0.0):
        return 0.0
    good, step = 0.0, 0.2 * TICK_S
    while good < longest_s and stable(good + step):
        good += step
    if good >= longest_s:
        return longest_s
    bad = good + step
    while bad - good > 5e-5:
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if stable(middle) else (good, middle)
    return good
