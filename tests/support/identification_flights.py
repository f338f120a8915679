# SPDX-License-Identifier: Apache-2.0
"""A linear helicopter in closed loop with a known truth, for the tests of the identification.

Nine states of eq. (10), velocity over ground, servos, transport delay, a PD attitude law, a slow
velocity law, coloured turbulence and sensor noise: everything is linear, so the fitted numbers must
agree with the true ones within their own confidence.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_continuous_are
from scipy.signal import chirp

from heli_analysis.identification.model import FAST, FastModel, full_matrices
from heli_analysis.identification.spectra import WIND, Experiment
from heli_analysis.identification.structure import AIR, N_FAST, STATE
from heli_core.linear import held, with_servos
from heli_core.rows import ACTUATOR, ATTITUDE, NINE
from heli_core.ticks import TICK_S

G = 9.8
TRIM = (0.039, 0.001)
_RATES = [NINE.p, NINE.q, NINE.r]


class _State(NamedTuple):
    """State without the servos (12,)."""

    nine: slice = slice(0, 9)  # of eq. (10)
    vel: slice = slice(9, 12)  # velocity over ground, body, m/s
    u: int = 9
    v: int = 10
    w: int = 11
    size: int = 12


_X = _State()


def true_model(delay_ticks: int = 1) -> FastModel:
    """An aircraft of the class of HeLion, with numbers of its own."""
    A = np.array(
        [
            [-0.05, 0.0, 0.0, 550.0, 10.0, -55.0],
            [0.0, -0.09, 250.0, 0.0, 0.0, 0.0],
            [0.0, -1.0, -3.4, 2.1, 0.0, 0.0],
            [-1.0, 0.0, 2.6, -3.4, 0.0, 0.0],
            [0.05, 0.0, 0.0, 0.0, -20.0, 110.0],
            [0.0, 0.0, 0.0, 0.0, -1.0, 0.0],
        ]
    )
    B = np.array(
        [
            [0.0, 0.0, 40.0, 0.0],
            [0.0, 0.0, 0.0, 0.0],
            [0.22, 2.4, 0.0, 0.0],
            [2.7, -0.08, 0.0, 0.0],
            [0.0, 0.0, -80.0, 3.0],
            [0.0, 0.0, -3.6, 0.0],
        ]
    )
    E = np.zeros((N_FAST, AIR.size))
    E[STATE.p, AIR.velocity] = 0.0, 0.17, -0.045
    E[STATE.q, AIR.velocity] = 0.0, 0.0, 0.034
    E[STATE.r, AIR.velocity] = 0.0, -0.34, 0.33
    return FastModel(A, B, E, 35.0, 0.55, delay_ticks * TICK_S)


@dataclass(frozen=True)
class Flight:
    """How the linear aircraft is flown."""

    seed: int = 1
    period_s: float = 20.0
    periods: int = 6
    settle_s: float = 20.0
    turbulence_mps: float = 0.4
    rate_noise: float = 1e-3
    velocity_noise: float = 0.02
    u_amplitude: tuple[float, ...] = (0.012, 0.012, 0.02, 0.02)
    gust_mps: tuple[float, ...] = (0.0, 0.0, 0.0)
    highest_hz: float = 9.0
    model: FastModel = field(default_factory=true_model)
    law: np.ndarray | None = None  # gains (4, 12); None: `_law`
    chirps_s: float = 0.0  # each actuator in its turn, instead of periodic lines; 0: none


def zippered_lines(period_s: float, lowest_hz: float, highest_hz: float, count: int, channels: int):
    """Odd harmonics, log-spaced, dealt out to the channels in turn: list of int arrays."""
    wanted = np.geomspace(lowest_hz, highest_hz, count * channels) * period_s
    used: list[int] = []
    for value in wanted:
        k = 2 * int(value // 2) + 1
        used.append(max(k, used[-1] + 2) if used else k)
    return [np.array(used[i::channels]) for i in range(channels)]


def multisine(lines, amplitude, period_s: float, n: int, seed: int):
    """(n,) samples of equal sines with phases drawn from the seed."""
    t = np.arange(n) * TICK_S
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, lines.size)
    w = 2.0 * np.pi * lines / period_s
    return amplitude * np.sin(np.outer(t, w) + phase).sum(axis=1)


def chirps(flight: Flight, n: int):
    """(n, 4): a logarithmic chirp on each actuator in its turn, faded in and out."""
    t = np.arange(round(flight.chirps_s / TICK_S)) * TICK_S
    fade = np.clip(np.minimum(t, t[::-1]) / 3.0, 0.0, 1.0)
    one = fade * chirp(t, 0.15, flight.chirps_s, flight.highest_hz, method="logarithmic", phi=-90.0)
    excite, first = np.zeros((n, ACTUATOR.size)), round(flight.settle_s / TICK_S)
    for i, amplitude in enumerate(flight.u_amplitude):
        at = first + i * t.size
        excite[at : at + t.size, i] = amplitude * one[: max(0, n - at)]
    return excite


def _law():
    """Gains (4, 12) on phi theta p q a_s b_s r d_int psi u v w, acting on measured ones only."""
    K = np.zeros((ACTUATOR.size, _X.size))
    K[ACTUATOR.lat, [NINE.phi, NINE.p, _X.v]] = -0.35, -0.005, -0.05
    K[ACTUATOR.lon, [NINE.theta, NINE.q, _X.u]] = -0.35, -0.008, 0.05
    K[ACTUATOR.ped, [NINE.psi, NINE.r]] = 1.5, 0.05
    K[ACTUATOR.col, _X.w] = 0.05
    return K


def stabilising_law(model: FastModel, most_u: float = 0.1):
    """Gains (4, 12) that hold any model in hover: linear-quadratic, of all states but the servos.

    most_u: what of an actuator costs as much as a rad, a rad/s or a m/s.
    """
    F, B, _, _ = _continuous(model)
    controls = np.eye(ACTUATOR.size) / most_u**2
    X = solve_continuous_are(F, B, np.eye(_X.size), controls)
    return -np.linalg.solve(controls, B.T @ X)


def open_loop_poles(model: FastModel):
    """Poles (12,) of hover, 1/s, without servos: gravity turns with the attitude."""
    return np.linalg.eigvals(_continuous(model)[0])


def _continuous(model: FastModel):
    """F (12, 12), B (12, 4) and what the air does: E (9, 3), drag (3, 3)."""
    A, _, E = full_matrices(model, *TRIM)
    drag = np.diag([0.05, 0.3, 0.6])
    F, B = np.zeros((_X.size, _X.size)), np.zeros((_X.size, ACTUATOR.size))
    F[_X.nine, _X.nine], B[_X.nine][FAST] = A, model.B
    F[_X.nine, _X.vel] = -E
    F[_X.u, NINE.theta], F[_X.v, NINE.phi], B[_X.w, ACTUATOR.col] = -G, G, 8.0
    F[_X.vel, _X.vel] = -drag
    return F, B, E, drag


def _discrete(model: FastModel):
    """Phi and inputs (u 4, wind 3) of x9, velocity 3, servos 8."""
    F, B, E, drag = _continuous(model)
    F, B = with_servos(F, B, model.servo_radps, model.servo_damping)
    wind = np.zeros((F.shape[0], len(WIND)))
    wind[_X.nine], wind[_X.vel] = E, drag
    return held(F, np.hstack([B, wind]), TICK_S)


def fly(flight: Flight) -> Experiment:
    """Fly it and hand out what a recorder would have."""
    n = round((flight.settle_s + flight.period_s * flight.periods) / TICK_S)
    rng = np.random.default_rng(1000 + flight.seed)
    lines = zippered_lines(flight.period_s, 0.15, flight.highest_hz, 20, 4)
    gust_lines = zippered_lines(flight.period_s, 0.05, 2.0, 10, 3)
    excite = np.column_stack(
        [multisine(k, a, flight.period_s, n, 10 + i)
         for i, (k, a) in enumerate(zip(lines, flight.u_amplitude, strict=True))]
    )  # fmt: skip
    if flight.chirps_s:
        excite = chirps(flight, n)
    gust = np.column_stack(
        [multisine(k, a, flight.period_s, n, 20 + i)
         for i, (k, a) in enumerate(zip(gust_lines, flight.gust_mps, strict=True))]
    )  # fmt: skip
    Phi, Gamma = _discrete(flight.model)
    by_command, by_wind = np.split(Gamma, [ACTUATOR.size], axis=1)
    K = _law() if flight.law is None else flight.law
    delay = round(flight.model.delay_s / TICK_S)
    no_command = np.zeros(ACTUATOR.size)
    x, turbulence, queue = np.zeros(Phi.shape[0]), np.zeros(len(WIND)), [no_command] * delay
    states, commands = np.empty((n, _X.size)), np.empty((n, ACTUATOR.size))
    rate_noise = flight.rate_noise * rng.standard_normal((n, 3))
    velocity_noise = flight.velocity_noise * rng.standard_normal((n, 3))
    drive = rng.standard_normal((n, 3))
    decay = np.exp(-TICK_S / 5.0)
    scale = flight.turbulence_mps * np.sqrt(1.0 - decay**2)
    for i in range(n):
        y = x[: _X.size].copy()
        y[_RATES] += rate_noise[i]
        y[_X.vel] += velocity_noise[i]
        states[i] = y
        commands[i] = K @ y + excite[i]
        queue.append(commands[i])
        turbulence = decay * turbulence + scale * drive[i]
        x = Phi @ x + by_command @ queue.pop(0) + by_wind @ (turbulence + gust[i])
    return Experiment(
        time_s=np.arange(n, dtype=np.float64) * TICK_S,
        u=commands,
        excitation_u=excite,
        attitude_rad=states[:, list(ATTITUDE)] + [*TRIM, 0.0],
        rate_body_radps=states[:, _RATES],
        vel_body_mps=states[:, _X.vel],
        accel_body_mps2=np.zeros((n, 3)),
        gust_body_mps=gust,
        period_s=flight.period_s,
        start_s=flight.settle_s,
        periods=flight.periods,
    )
