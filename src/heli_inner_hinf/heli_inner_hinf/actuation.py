# SPDX-License-Identifier: Apache-2.0
"""What lies between command and rotor, how the observer hears of it, and the prediction over it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from heli_inner_hinf.regular_form import Matrix
from heli_math.linear_systems import held
from heli_math.ticks import TICK_S, Rate


@dataclass(frozen=True)
class Actuation:
    """What lies between command and rotor.

    Attributes
    ----------
    servo_radps, servo_damping : float
        Natural frequency (rad/s) and damping of each servo.
    delay_s : float
        Transport delay from the computation within tick n, s (0.01: acts from tick n+1).
    tick_s : float
        Between two steps of the law, s.
    """

    servo_radps: float = 38.0
    servo_damping: float = 0.51
    delay_s: float = TICK_S
    tick_s: float = TICK_S

    @property
    def known_lag_s(self) -> float:
        """Transport delay, half a tick of hold and the servo's low-frequency lag 2 zeta / w, s."""
        return self.delay_s + 0.5 * self.tick_s + 2.0 * self.servo_damping / self.servo_radps


@dataclass(frozen=True)
class ObserverInput:
    """How u enters the reduced-order observer.

    Attributes
    ----------
    u_delay_ticks : int
        Over [n, n+1] the observer uses the command u_(n - u_delay_ticks); 1 is true to a delay of
        one tick.
    servo_radps, servo_damping : float
        Servo model (exact ZOH) between that command and the observer; servo_radps = 0: none.
    tick_s : float
        Between two steps of the observer, s.
    """

    u_delay_ticks: int = 1
    servo_radps: float = 38.0
    servo_damping: float = 0.51
    tick_s: float = TICK_S

    @classmethod
    def from_parameters(cls, observer: Mapping[str, Any]) -> "ObserverInput":
        """That of the observer's parameters."""
        rate = Rate.of_parameters(observer)
        return cls(
            rate.of(int(observer["u_delay_ticks"])),
            observer["servo.frequency_radps"],
            observer["servo.damping"],
            rate.tick_s,
        )


def predicting_gains(A: Matrix, B: Matrix, F: Matrix, prediction_s: float) -> tuple[Matrix, Matrix]:
    """F Phi (3, 9) and F Gamma (3, 3) over `prediction_s`, with u held.

    The law then is u_n = F Phi x_n + F Gamma u_(n-1). At rest Phi x + Gamma u = x, so that the
    feedforward G of eq. (15) stays as it is.
    """
    if prediction_s == 0.0:
        return F.copy(), np.zeros((F.shape[0], B.shape[1]))
    Phi, Gamma = held(A, B, prediction_s)
    return F @ Phi, F @ Gamma
