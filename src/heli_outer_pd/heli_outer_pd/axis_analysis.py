# SPDX-License-Identifier: Apache-2.0
"""One axis of the position loop as it flies, linear: margins, and rms in stationary wind.

Attitude (or thrust) loop -> acceleration -> speed -> position, and law (21) with its disturbance
observer, as blocks of python-control. Driven by the Dryden spectrum, the stationary covariance
follows from one Lyapunov equation, so the rms of a flight is predicted without flying.

For analysis: python-control takes seconds to import, so whatever flies does not import this module.
"""

from dataclasses import dataclass

import control
import numpy as np

from heli_math.rows import SETPOINT
from heli_outer_pd.position_law import OuterKernel
from heli_outer_pd.thrust_map import thrust_for_collective

_PADE_ORDER = 3


@dataclass(frozen=True)
class Axis:
    """What one axis looks like to the outer loop.

    Attributes
    ----------
    actuation : control.StateSpace
        Commanded to achieved acceleration at unit static gain: the attitude loop, or the
        collective's servo.
    delay_s : float
        What comes on top: sampling, computation, transport.
    damping_per_s : float
        Acceleration per air-relative speed, 1/s.
    modelled_lag_s, modelled_damping_per_s : float
        What the law's own model knows of actuation and damping; lag 0: none.
    gusts : sequence of control.StateSpace
        From white noise of unit intensity to speed of the air along the axis, m/s; independent.
    """

    actuation: control.StateSpace
    delay_s: float
    damping_per_s: float
    modelled_lag_s: float
    modelled_damping_per_s: float
    gusts: tuple[control.StateSpace, ...]


@dataclass(frozen=True)
class Gains:
    """Of one axis.

    Attributes
    ----------
    K_P, K_D : float
        1/s2, 1/s.
    l1, l2 : float
        Of the disturbance observer, 1/s, 1/s2; l2 = 0: there is none.
    """

    K_P: float
    K_D: float
    l1: float
    l2: float

    @classmethod
    def of(cls, kernel: OuterKernel, axis: int) -> "Gains":
        """As flown on an axis: 0 forward, 1 right, 2 down."""
        on = float(kernel.wind_compensation > 0.5)
        l1, l2 = on * kernel.observer_l1[axis], on * kernel.observer_l2[axis]
        return cls(float(kernel.K_P[axis]), float(kernel.K_D[axis]), float(l1), float(l2))


@dataclass(frozen=True)
class AxisReport:
    """What the gains of one axis are worth.

    Attributes
    ----------
    stable : bool
    crossover_radps : float
        Highest frequency at which the loop's gain is one.
    gain_margin_db, phase_margin_deg : float
        Smallest of either sign; inf where there is none.
    modulus_margin : float
        Smallest distance of the loop's Nyquist curve to -1; 0 if unstable.
    position_rms_m, speed_rms_mps : float
        In the axis' gusts, with exact navigation; inf if unstable.
    """

    stable: bool
    crossover_radps: float
    gain_margin_db: float
    phase_margin_deg: float
    modulus_margin: float
    position_rms_m: float
    speed_rms_mps: float


def modelled_heave_damping_per_s(kernel: OuterKernel) -> float:
    """Acceleration per vertical speed, 1/s, that the law's thrust map knows of, at trim."""
    k, step = kernel, 1e-3
    d_col = k.trim[SETPOINT.col]
    up, down = (
        thrust_for_collective(d_col, sign * step, k.mass * k.g, d_col, k.rotor)
        for sign in (-1.0, 1.0)
    )
    return float((down - up) / (2.0 * step * k.mass))


def dryden_along(sigma_mps: float, time_s: float) -> control.StateSpace:
    """MIL-F-8785C's H_u from white noise of unit intensity; time_s = L / V."""
    return control.tf2ss([sigma_mps * np.sqrt(2.0 * time_s)], [time_s, 1.0])


def dryden_across(sigma_mps: float, time_s: float) -> control.StateSpace:
    """MIL-F-8785C's H_v, H_w from white noise of unit intensity; time_s = L / V."""
    gain = sigma_mps * np.sqrt(time_s)
    return control.tf2ss([gain * np.sqrt(3.0) * time_s, gain], [time_s**2, 2.0 * time_s, 1.0])


def law(gains: Gains, axis: Axis) -> control.StateSpace:
    """Law (21) with its observer: position, speed -> commanded acceleration.

    States: estimated speed and disturbance, commanded acceleration behind the modelled lag.
    """
    signals = {"inputs": ["position", "speed"], "outputs": ["command"], "name": "law"}
    if gains.l2 == 0.0:
        return control.ss([], [], [], [[-gains.K_P, -gains.K_D]], **signals)
    l1, l2 = gains.l1, gains.l2
    C, D = np.array([[0.0, -1.0, 0.0]]), np.array([[-gains.K_P, -gains.K_D]])
    A = np.array([[-l1, 1.0, 0.0], [-l2, 0.0, 0.0], [0.0, 0.0, 0.0]])
    B = np.array([[0.0, l1 - axis.modelled_damping_per_s], [0.0, l2], [0.0, 0.0]])
    if axis.modelled_lag_s > 0.0:
        A[0, 2] = 1.0
        A[2] = C[0] / axis.modelled_lag_s + [0.0, 0.0, -1.0 / axis.modelled_lag_s]
        B[2] = D[0] / axis.modelled_lag_s
    else:
        A[0], B[0], A[2, 2] = A[0] + C[0], B[0] + D[0], -1.0
    return control.ss(A, B, C, D, **signals)


def plant(axis: Axis) -> control.StateSpace:
    """Commanded acceleration and air speed -> position, speed."""
    late = control.tf2ss(*control.pade(axis.delay_s, _PADE_ORDER))
    act = control.ss(control.series(late, axis.actuation), inputs="command", outputs="acceleration")
    d = axis.damping_per_s
    body = control.ss(
        [[0.0, 1.0], [0.0, -d]],
        [[0.0, 0.0], [1.0, d]],
        np.eye(2),
        np.zeros((2, 2)),
        inputs=["acceleration", "air"],
        outputs=["position", "speed"],
        name="body",
    )
    return control.interconnect(
        [control.ss(act, name="actuation"), body],
        inputs=["command", "air"],
        outputs=["position", "speed"],
    )


def analyse(axis: Axis, gains: Gains) -> AxisReport:
    """Margins of the axis' loop, broken at the commanded acceleration, and rms in its gusts."""
    body, controller = plant(axis), law(gains, axis)
    windy = _in_gusts(axis, body, controller)
    if np.max(windy.poles().real) >= 0.0:
        return AxisReport(False, np.nan, np.nan, np.nan, 0.0, np.inf, np.inf)
    loop = -control.series(body[["position", "speed"], ["command"]], controller)
    omega = np.geomspace(1e-2, 1e2, 2000)
    measured = control.frd(loop(1j * omega), omega, smooth=True)
    gain, phase_deg, modulus, _, crossover, _ = control.stability_margins(measured, returnall=True)
    covariance = windy.C @ control.lyap(windy.A, windy.B @ windy.B.T) @ windy.C.T
    position, speed = np.sqrt(np.diag(covariance))
    return AxisReport(
        stable=True,
        crossover_radps=float(np.max(crossover, initial=0.0)),
        gain_margin_db=float(np.min(np.abs(20.0 * np.log10(gain)), initial=np.inf)),
        phase_margin_deg=float(np.min(np.abs(phase_deg), initial=np.inf)),
        modulus_margin=float(np.min(modulus)),
        position_rms_m=float(position),
        speed_rms_mps=float(speed),
    )


def _in_gusts(
    axis: Axis, body: control.StateSpace, controller: control.StateSpace
) -> control.StateSpace:
    """White noises of unit intensity -> position, speed; the loop closed."""
    noises = [f"noise_{i}" for i in range(len(axis.gusts))]
    winds = [f"gust_{i}" for i in range(len(axis.gusts))]
    filters = [
        control.ss(gust, inputs=noise, outputs=wind, name=f"filter_{wind}")
        for gust, noise, wind in zip(axis.gusts, noises, winds, strict=True)
    ]
    air = control.summing_junction(winds, "air", name="air")
    return control.interconnect(
        [control.ss(body, name="plant"), controller, *filters, air],
        inputs=noises,
        outputs=["position", "speed"],
    )
