# SPDX-License-Identifier: Apache-2.0
"""The attitude loop as flown, with every aircraft of a set in it.

The proof wants a rational loop: the law, the delay and the hold are mapped exactly from z to the
plane of w by z = (c + w) / (c - w), and there the aircraft's own s stands for w. With c fitted at
`MATCHED_RADPS` both agree there, and nearly so below; the hold is (1 + 1/z) / 2, that is its
trapezoid. `exact` has neither approximation, for one aircraft: the tests and the report compare.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from heli_flight.loop.settings import Settings
from heli_flight.studies.robust.aircraft import N_STATES, AircraftSet
from heli_inner_hinf.actuation import Actuation, ObserverInput
from heli_inner_hinf.analysis import model_of
from heli_inner_hinf.as_flown import Feedback, closed_loop, linear_law_of
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import N_Y, sampled_controller
from heli_math.rows import NINE
from heli_math.state_names import INPUT_NAMES, MEASURED
from heli_math.ticks import TICK_S
from heli_robust.uncertain import Matrix, Uncertain
from heli_robust.worst_gain import GainFamily

MATCHED_RADPS = 25.0  # near where the margins are lost
_N_U = len(INPUT_NAMES)
_PLANE = MATCHED_RADPS / np.tan(0.5 * MATCHED_RADPS * TICK_S)


def feedback_flown(settings: Settings) -> Feedback:
    """The linear law of the settings with its observer and prediction, measured states to u."""
    nodes = settings.nodes
    config = AttitudeConfig.from_parameters(nodes["inner_loop"])
    law = linear_law_of(config.kernel)
    if law is not None:
        return Feedback(law.A, law.B[:, :N_Y], law.C, law.D[:, :N_Y], MEASURED)
    observer = nodes["observer"]
    feed = ObserverInput.from_parameters(observer)
    K = np.reshape(observer["K"], (-1, N_Y))
    own = sampled_controller(model_of(config), K, config.prediction_s, feed)
    return Feedback(own.A, own.B[:, :N_Y], own.C, own.D[:, :N_Y], MEASURED)


def uncertain_loop(aircraft: AircraftSet, law: Feedback, delay_ticks: int) -> Uncertain:
    """State matrix of the closed loop for every aircraft of the set."""
    parts = _parts(aircraft, law, delay_ticks)
    return Uncertain.stacked([[parts.plant @ parts.x_and_u], [parts.own]]).reduced()


def wind_to_h(
    aircraft: AircraftSet, law: Feedback, delay_ticks: int, C: Matrix, D: Matrix
) -> GainFamily:
    """Horizontal wind (north, east, m/s) to h = C x + D u of eq. (11), u behind the servos.

    Nothing depends on the ground's speed but through the air's: wind is motion the other way.
    """
    parts = _parts(aircraft, law, delay_ticks)
    n, size = N_STATES, parts.own.shape[1]
    moving = np.zeros((parts.x_and_u.shape[0], 2))
    moving[len(NINE) : n] = -np.eye(2)
    h = np.zeros((len(C), size))
    h[:, : len(NINE)], h[:, n : n + _N_U] = C, D
    rows: list[list[Uncertain | Matrix]] = [
        [parts.plant @ np.hstack([parts.x_and_u, moving])],
        [np.hstack([parts.own, np.zeros((len(parts.own), 2))])],
        [np.hstack([h, np.zeros((len(h), 2))])],
    ]
    return GainFamily(Uncertain.stacked(rows).reduced(), size)


def disks_at_input(aircraft: AircraftSet, law: Feedback, delay_ticks: int) -> GainFamily:
    """Its gain is 1 / alpha: commands times (1 + d / 2) / (1 - d / 2), |d| < alpha, are held."""
    parts = _parts(aircraft, law, delay_ticks)
    u = parts.x_and_u[-_N_U:]
    added = np.vstack([np.zeros((parts.x_and_u.shape[0] - _N_U, _N_U)), np.eye(_N_U)])
    return _disks(parts, u, added, np.zeros((len(parts.own), _N_U)))


def disks_at_output(
    aircraft: AircraftSet, law: Feedback, delay_ticks: int, channels: Sequence[int] | None = None
) -> GainFamily:
    """The same at what law and observer read: `channels`, places in `law.measured`, or all."""
    parts = _parts(aircraft, law, delay_ticks)
    chosen = list(range(len(law.measured)) if channels is None else channels)
    added = np.zeros((parts.x_and_u.shape[0], len(chosen)))
    added[-_N_U:] = parts.read.D[:, chosen]
    return _disks(parts, parts.y[chosen], added, parts.read.B[:, chosen])


def _disks(parts: "_Parts", signal: Matrix, to_plant: Matrix, to_law: Matrix) -> GainFamily:
    """w = d z is added to a signal (from all states), z = signal + w / 2; so it reaches both."""
    size, k = parts.own.shape[1], len(signal)
    rows: list[list[Uncertain | Matrix]] = [
        [parts.plant @ np.hstack([parts.x_and_u, to_plant])],
        [np.hstack([parts.own, to_law])],
        [np.hstack([signal, 0.5 * np.eye(k)])],
    ]
    return GainFamily(Uncertain.stacked(rows).reduced(), size, k)


class _Parts(NamedTuple):
    """plant: [A, B] behind its servos; its (x, u), the law's own x' and y from all states; law."""

    plant: Uncertain
    x_and_u: Matrix
    own: Matrix
    y: Matrix
    read: "_Law"


def _parts(aircraft: AircraftSet, law: Feedback, delay_ticks: int) -> _Parts:
    plant = _with_servos(aircraft)
    flown = _in_plane(_late_and_held(law, delay_ticks))
    n, k = plant.D.shape[0], len(flown.A)
    y = np.eye(n, n + k)[list(law.measured)]
    u = flown.D @ y + np.hstack([np.zeros((_N_U, n)), flown.C])
    own = flown.B @ y + np.hstack([np.zeros((k, n)), flown.A])
    return _Parts(plant, np.vstack([np.eye(n, n + k), u]), own, y, flown)


def exact(
    aircraft: AircraftSet, deltas: dict[str, float], law: Feedback, delay_ticks: int
) -> float:
    """Largest growth, 1/s, of the sampled loop with one aircraft, discretised exactly."""
    own, speed = aircraft.aircraft, aircraft.values(deltas).get("servo_speed", 1.0)
    lag = Actuation(speed * own.servo_bandwidth_radps, own.servo_damping, delay_ticks * TICK_S)
    poles = np.linalg.eigvals(closed_loop(*aircraft.linear(deltas), law, lag))
    return float(np.log(np.max(np.abs(poles))) / TICK_S)


def _with_servos(aircraft: AircraftSet) -> Uncertain:
    """Aircraft behind its servos: [A, B] (17, 20); states of the servos: position, rate / w."""
    own, eye, none = aircraft.aircraft, np.eye(_N_U), np.zeros((_N_U, _N_U))
    w, zeta = own.servo_bandwidth_radps, own.servo_damping
    moves = w * np.block([[none, eye, none], [-eye, -2.0 * zeta * eye, eye]])
    speed = aircraft.speed_of_servos()
    faster = [
        [speed if i == j else np.zeros((1, 1)) for j in range(2 * _N_U)] for i in range(2 * _N_U)
    ]
    servos = Uncertain.stacked(faster) @ np.hstack([np.zeros((2 * _N_U, N_STATES)), moves])
    return Uncertain.stacked(
        [[aircraft.model @ np.eye(N_STATES + _N_U, N_STATES + 3 * _N_U)], [servos]]
    )


class _Law(NamedTuple):
    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix


def _late_and_held(law: Feedback, delay_ticks: int) -> _Law:
    """The law, its command `delay_ticks` late, behind the hold: half of it and half of the last."""
    n, depth = len(law.A), delay_ticks + 1
    size = n + _N_U * depth
    A, B = np.zeros((size, size)), np.zeros((size, law.B.shape[1]))
    A[:n, :n], B[:n] = law.A, law.B
    A[n : n + _N_U, :n], B[n : n + _N_U] = law.C, law.D
    A[n + _N_U :, n : size - _N_U] = np.eye(_N_U * (depth - 1))
    # u_n, then u_(n-1), ...: (3, size) each, and what of y goes straight through.
    past = [np.hstack([law.C, np.zeros((_N_U, size - n))])]
    past += [np.eye(size)[n + _N_U * i : n + _N_U * (i + 1)] for i in range(depth)]
    through = [law.D] + [np.zeros_like(law.D)] * depth
    return _Law(
        A,
        B,
        0.5 * (past[delay_ticks] + past[delay_ticks + 1]),
        0.5 * (through[delay_ticks] + through[delay_ticks + 1]),
    )


def _in_plane(law: _Law) -> _Law:
    """The same law with w for z = (c + w) / (c - w); exact."""
    inverse = np.linalg.inv(law.A + np.eye(len(law.A)))
    root = np.sqrt(2.0 * _PLANE)
    return _Law(
        _PLANE * inverse @ (law.A - np.eye(len(law.A))),
        root * inverse @ law.B,
        root * law.C @ inverse,
        law.D - law.C @ inverse @ law.B,
    )
