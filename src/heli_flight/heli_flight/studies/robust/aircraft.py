# SPDX-License-Identifier: Apache-2.0
"""The linear aircraft as a function of its named parameters: a linear fractional transformation.

Eleven states: the nine of eq. (9) and the horizontal velocity over ground, without which flap-back
would not enter. Each row is multiplied by what its equation of motion divides by (an inertia, the
mass, the flapping time constant); what then is left is smooth and nearly straight in the others,
and a polynomial of second order through aircraft that were trimmed and linearised one by one. How
far it is from others that were not used for it is measured.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from heli_dynamics_sim.linearize import ReducedModel, smooth_kernel
from heli_dynamics_sim.parameters import HelicopterParameters
from heli_dynamics_sim.trim import trim
from heli_math.rotations import quat_from_euler, quat_to_R_nb
from heli_math.rows import NINE, PLANT
from heli_math.state_names import INPUT_NAMES
from heli_robust.uncertain import Matrix, Range, Uncertain

N_STATES = len(NINE) + 2
_STEP, _STEP_MPS = 1e-5, 1e-3
_SAMPLES, _CHECKS = 70, 20
_SHARE = 5e-3  # of a row: what changes it by less is left to the measured residual
_CHANNEL = 1e-3  # of a parameter's largest channel: the same

SCALED: Mapping[str, str] = {
    "mass": "mass_kg",
    "inertia_xx": "inertia_xx_kgm2",
    "inertia_yy": "inertia_yy_kgm2",
    "inertia_zz": "inertia_zz_kgm2",
    "rotor_stiffness": "hub_stiffness_nmprad",
    "flapping": "flap_time_constant_s",
    "thrust": "main_lift_slope",
    "servo_speed": "servo_bandwidth_radps",
}
"""Parameters whose ranges are factors of the aircraft's own; `flap_back` is in rad s/m."""
_DIVIDES: Mapping[str, tuple[int, ...]] = {
    "inertia_xx": (NINE.p,),
    "inertia_yy": (NINE.q,),
    "inertia_zz": (NINE.r,),
    "flapping": (NINE.a_s, NINE.b_s),
    "mass": (len(NINE), len(NINE) + 1),
}
_INERTIAS = ("inertia_xx", "inertia_yy", "inertia_zz")
EXACT = (*_INERTIAS, "servo_speed")
"""Enter by their row, or behind the servos, alone."""


def with_values(
    aircraft: HelicopterParameters, values: Mapping[str, float]
) -> HelicopterParameters:
    """The aircraft with factors of `SCALED` and, where it is named, `flap_back`, rad s/m."""
    changes = {
        SCALED[name]: getattr(aircraft, SCALED[name]) * value
        for name, value in values.items()
        if name != "flap_back"
    }
    if "flap_back" in values:
        changes["flap_back_radpmps"] = values["flap_back"]
    return replace(aircraft, **changes)


def linear(aircraft: HelicopterParameters) -> tuple[Matrix, Matrix]:
    """A (11, 11), B (11, 3) about hover in still air: the nine, then velocity north, east, m/s."""
    at = trim(aircraft)
    model = ReducedModel(smooth_kernel(aircraft, at, "descent"), at)
    still = model.velocity_ned.copy()
    n, inputs = len(NINE), len(INPUT_NAMES)

    def slope(z: NDArray[np.float64], velocity: NDArray[np.float64]) -> NDArray[np.float64]:
        model.velocity_ned = still + np.append(velocity, 0.0)
        rates = model(z)[:n]
        attitude = quat_to_R_nb(quat_from_euler(z[NINE.phi], z[NINE.theta], z[NINE.psi]))
        return np.append(rates, (attitude @ model.out[PLANT.vel])[:2])

    def central(place: int, step: float) -> NDArray[np.float64]:
        z, v = np.zeros(model.z0.size), np.zeros(2)
        (z if place < n + inputs else v)[place if place < n + inputs else place - n - inputs] = step
        return (slope(model.z0 + z, v) - slope(model.z0 - z, -v)) / (2.0 * step)

    steps = [_STEP] * (n + inputs) + [_STEP_MPS] * 2
    columns = [
        (4.0 * central(i, 0.5 * step) - central(i, step)) / 3.0 for i, step in enumerate(steps)
    ]
    full = np.column_stack(columns)
    return full[:, [*range(n), n + inputs, n + inputs + 1]], full[:, n : n + inputs]


@dataclass(frozen=True)
class AircraftSet:
    """Every aircraft whose parameters lie in their ranges.

    Attributes
    ----------
    aircraft : HelicopterParameters
    ranges : tuple of Range
        By the names of `SCALED`, and `flap_back`.
    model : Uncertain
        (11, 14): A and B of `linear`, without servos.
    residual : float
        Largest error of a row of the model, relative to the row, over aircraft not used for it.
    """

    aircraft: HelicopterParameters
    ranges: tuple[Range, ...]
    model: Uncertain
    residual: float

    def values(self, deltas: Mapping[str, float]) -> dict[str, float]:
        """Values of the parameters at deviations; those not named are nominal.

        However far the ranges are stretched, no rotor flaps forward.
        """
        found = {r.name: r.value(deltas.get(r.name, 0.0)) for r in self.ranges}
        if "flap_back" in found:
            found["flap_back"] = max(0.0, found["flap_back"])
        return found

    def linear(self, deltas: Mapping[str, float]) -> tuple[Matrix, Matrix]:
        """A (11, 11), B (11, 3) of one aircraft, linearised anew.

        Its inertias divide their rows, so they need not be those of one rigid body.
        """
        values = self.values(deltas)
        others = {name: value for name, value in values.items() if name not in EXACT}
        A, B = linear(with_values(self.aircraft, others))
        for name in _INERTIAS:
            for place in _DIVIDES[name]:
                A[place] /= values.get(name, 1.0)
                B[place] /= values.get(name, 1.0)
        return A, B

    def speed_of_servos(self) -> Uncertain:
        """Factor (1, 1) of the servos' bandwidth."""
        for r in self.ranges:
            if r.name == "servo_speed":
                return r.matrix
        return Uncertain.constant(np.eye(1))


def aircraft_set(aircraft: HelicopterParameters, ranges: Sequence[Range]) -> AircraftSet:
    """The linear model of every aircraft in the ranges.

    Raises
    ------
    AircraftError, TrimError
        A corner of the ranges is no aircraft, or cannot hover.
    """
    smooth = [r for r in ranges if r.name not in EXACT]
    rng = np.random.default_rng(20)
    deltas = rng.uniform(-1.0, 1.0, (_SAMPLES + _CHECKS, len(smooth)))
    deltas[: _SAMPLES // 2] = np.where(deltas[: _SAMPLES // 2] > 0.0, 1.0, -1.0)
    rows = np.array([_undivided(aircraft, smooth, delta) for delta in deltas])
    centre = _undivided(aircraft, smooth, np.zeros(len(smooth)))
    terms: list[tuple[int, ...]] = [(i,) for i in range(len(smooth))]
    terms += [(i, j) for i in range(len(smooth)) for j in range(i, len(smooth))]
    columns = np.array([[np.prod(delta[list(term)]) for term in terms] for delta in deltas])
    flat = (rows - centre).reshape(len(rows), -1)
    found = np.linalg.lstsq(columns[:_SAMPLES], flat[:_SAMPLES], rcond=None)[0]
    left, right = _sizes(centre)
    model = Uncertain.constant(centre)
    for term, coefficient in zip(terms, found, strict=True):
        scaled = coefficient.reshape(centre.shape) / left[:, None] / right
        U, sigma, Vh = np.linalg.svd(scaled)
        keep = int(np.sum(sigma > _SHARE))
        if keep == 0:
            continue
        part: Uncertain | Matrix = right * Vh[:keep]
        for i in term:
            delta = Range(smooth[i].name, 0.0, -1.0, 1.0).matrix
            wide = [
                [delta if a == b else np.zeros((1, 1)) for b in range(keep)] for a in range(keep)
            ]
            part = Uncertain.stacked(wide) @ part
        model = model + (left[:, None] * U[:, :keep] * sigma[:keep]) @ part
    model = _divided(model, ranges, left, right)
    residual = 0.0
    for delta, truth in zip(deltas[_SAMPLES:], rows[_SAMPLES:], strict=True):
        named = {r.name: d for r, d in zip(smooth, delta, strict=True)}
        own = truth / _factors({r.name: r.value(named[r.name]) for r in smooth})[:, None]
        error = (model.at(named) - own) / left[:, None] / right
        residual = max(residual, float(np.max(np.linalg.norm(error, axis=1))))
    return AircraftSet(aircraft, tuple(ranges), model, residual)


def _undivided(
    aircraft: HelicopterParameters, ranges: Sequence[Range], delta: NDArray[np.float64]
) -> Matrix:
    """A and B with the rows of `_DIVIDES` times the factor of their parameter."""
    values = {r.name: r.value(float(d)) for r, d in zip(ranges, delta, strict=True)}
    return np.hstack(linear(with_values(aircraft, values))) * _factors(values)[:, None]


def _factors(values: Mapping[str, float]) -> NDArray[np.float64]:
    """What divides each row (11,)."""
    factors = np.ones(N_STATES)
    for name, places in _DIVIDES.items():
        factors[list(places)] = values.get(name, 1.0)
    return factors


def _divided(
    model: Uncertain,
    ranges: Sequence[Range],
    left: NDArray[np.float64],
    right: NDArray[np.float64],
) -> Uncertain:
    """The rows divided; as few channels as matter, in the sizes of `_sizes`."""
    divisors = {place: name for name, places in _DIVIDES.items() for place in places}
    by_name = {r.name: r.matrix.inverse() for r in ranges}
    one = Uncertain.constant(np.eye(1))
    rows = [
        [
            by_name.get(divisors.get(i, ""), one) if i == j else np.zeros((1, 1))
            for j in range(N_STATES)
        ]
        for i in range(N_STATES)
    ]
    full = Uncertain.stacked(rows) @ model
    even = Uncertain(
        full.channels,
        full.A,
        full.B / right,
        full.C / left[:, None],
        full.D / left[:, None] / right,
    ).reduced(_CHANNEL)
    return Uncertain(even.channels, even.A, even.B * right, left[:, None] * even.C, full.D)


def _sizes(rows: Matrix) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How large each row and column counts: columns of typical motions, rows of what these do."""
    columns = np.array([0.1, 0.1, 0.5, 0.5, 0.02, 0.02, 0.5, 0.1, 0.1, 5.0, 5.0, 0.1, 0.1, 0.1])
    columns = 1.0 / columns
    sizes = np.linalg.norm(rows / columns, axis=1)
    return np.where(sizes > 0.0, sizes, 1.0), columns
