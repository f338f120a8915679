# SPDX-License-Identifier: Apache-2.0
"""Published linear helicopters: A, B, delay and trim of a file, with its citation.

What is published of a real aircraft is mostly a linear model about hover. A and B of a file are
the derivatives of the specific force, of the angular acceleration and of the rotor, without gravity
and Coriolis terms, which `linear_plant` adds; the velocity is that through the air, so E, the
effect of the air's velocity, is minus A's columns of u, v, w. Body axes FRD, SI units, rad.
"""

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.errors import ParameterCause
from heli_core.foreign_files import FileError, read_yaml
from heli_core.rcl_yaml import file_refusal
from heli_core.rotations import quat_from_euler, quat_to_R_nb
from heli_core.rows import ACTUATOR, ACTUATOR_NAMES, NINE
from heli_dynamics_sim.aircraft import PREFIX, SCALED, AircraftError, config_folders, number
from heli_dynamics_sim.aircraft import check as check_value

Array = NDArray[np.float64]

# -------------------------------------------------------------------------------------------------
# The file: what stands in it, and within which bounds.
# -------------------------------------------------------------------------------------------------


class LinearRow(NamedTuple):
    """States of A and B (9,): air speed, m/s; rates, rad/s; flapping and the gyro's integrator."""

    vel: slice = slice(0, 3)  # through the air, body
    w: int = 2
    rate: slice = slice(3, 6)  # body
    p: int = 3
    q: int = 4
    r: int = 5
    rigid: slice = slice(0, 6)  # both
    rotor: slice = slice(6, 9)  # a RotorRow
    a_s: int = 6
    b_s: int = 7
    flapping: slice = slice(6, 8)
    d_int: int = 8
    turning: slice = slice(3, 9)  # all but the velocity: what eq. (10) has of them
    size: int = 9


LINEAR = LinearRow()
STATES = ("u", "v", "w", "p", "q", "r", "a_s", "b_s", "d_int")
"""Names of the states."""
_RIGID = STATES[LINEAR.rigid]
_N, _M = LINEAR.size, len(ACTUATOR_NAMES)
_ANGLES = 2
"""States of `whole` before those of the file: phi, theta."""
PARAMETER = "linear_model"
"""Parameter of the plant that names one."""
FOLDER = "linear"

_LARGEST = 1e5
_FASTEST_RADPS = 1000.0
"""Poles beyond it are not integrated: the step of 2 ms follows no faster ones."""
_UNSTABLE_PER_S = 20.0
"""An aircraft whose departures double in less than 35 ms is a mistake in the file."""
_DISC_S = 0.01
"""Time constant of the disc that the nine states of a model without flapping are given."""
_TEXTS = ("name", "citation", "source")


def _rule(key: str, unit: str, lower: float, upper: float, meaning: str) -> Mapping[str, Any]:
    return number(key, "", unit, lower, upper, meaning).metadata


_NUMBERS = {
    rule["key"]: rule
    for rule in (
        _rule("body.mass_kg", "kg", 0.0, 1e5, "mass"),
        _rule("body.gravity_mps2", "m/s2", 0.0, 30.0, "gravity"),
        _rule("body.rotor_radius_m", "m", 0.0, 20.0, "main rotor radius"),
        _rule("body.rotor_speed_radps", "rad/s", 1.0, 1e3, "main rotor speed"),
        _rule("body.rotor_blades", "1", 1.0, 10.0, "main rotor blades"),
    )
}
_TRIM = {
    rule["key"]: rule
    for rule in (
        *(_rule(f"trim.{name}_rad", "rad", -1.0, 1.0, f"trim of {name}")
          for name in ("phi", "theta", "a_s", "b_s")),
        *(_rule(f"trim.{name}", "1", -1.0, 1.0, f"trim of {name}") for name in ACTUATOR_NAMES),
    )
}  # fmt: skip
_OPTIONAL = {
    rule["key"]: rule
    for rule in (
        _rule("servo.bandwidth_radps", "rad/s", 1.0, 500.0, "natural frequency of the servos"),
        _rule("servo.damping", "1", 0.05, 5.0, "damping ratio of the servos"),
        _rule("servo.rate_limit_per_s", "1/s", 0.1, 1e4, "largest speed of the servos"),
        _rule("yaw_gyro.proportional", "1", -1e3, 1e3, "pedal per rad/s of yaw rate error"),
        _rule("yaw_gyro.integral", "1", -1e3, 1e3, "pedal per rad of yaw rate error, integrated"),
        _rule("yaw_gyro.pedal_gain_radps", "rad/s", -50.0, 50.0, "yaw rate per unit of d_ped"),
    )
}
_DELAY = number("delay_s", "", "s", 0.0, 0.3, "transport delay", closed=True).metadata
_ENTRY = {"unit": "1", "lower": -_LARGEST, "upper": _LARGEST, "closed": True, "meaning": "entry"}
_KNOWN = (*_TEXTS, "delay_s", "body", "trim", "servo", "yaw_gyro", "states", "A", "B")


@dataclass(frozen=True)
class LinearAircraft:
    """A published aircraft, SI units and rad.

    Attributes
    ----------
    name, citation, source : str
        What it is, where it is published, and where the numbers were read.
    A, B : (9, 9), (9, 4) arrays
        By `STATES` and d_lat, d_lon, d_ped, d_col, about trim, without gravity and Coriolis terms;
        the velocity is that through the air. A yaw gyro of the file is in them.
    states : tuple of str
        The states that the file has; rows and columns of the others are zero.
    phi, theta : float
        Attitude of the trim, rad.
    rotor : (3,) array
        a_s, b_s, d_int there.
    u_trim : (4,) array
    delay_s : float
        From a command to the aircraft.
    servo : (3,) floats or None
        Natural frequency (rad/s), damping, largest speed (1/s) of separate servos; None: their lag
        is in the delay.
    mass_kg, gravity_mps2, rotor_radius_m, rotor_speed_radps, rotor_blades : float
    """

    name: str
    citation: str
    source: str
    A: Array
    B: Array
    states: tuple[str, ...]
    phi: float
    theta: float
    rotor: Array
    u_trim: Array
    delay_s: float
    mass_kg: float
    gravity_mps2: float
    rotor_radius_m: float
    rotor_speed_radps: float
    rotor_blades: float
    servo: tuple[float, float, float] | None = None
    file: str = ""

    @classmethod
    def from_yaml(cls, path: str | Path) -> "LinearAircraft":
        """Read a file; a bare name is looked up in the packaged folder config/linear.

        Raises
        ------
        AircraftError
            Names file, key and what is allowed.
        """
        file = find_linear(path)
        try:
            return _of_tree(read_yaml(file), str(path))
        except FileError as error:
            raise AircraftError.like(file_refusal(error, "", "the file")) from error
        except AircraftError as error:
            error.where = error.where or str(path)
            raise

    @property
    def E(self) -> Array:
        """(9, 3): effect of the air's velocity u, v, w, body axes."""
        return -self.A[:, LINEAR.vel]

    @property
    def force_trim(self) -> Array:
        """Specific force (3,) of the trim, body, m/s2: it carries the weight."""
        R_nb = quat_to_R_nb(quat_from_euler(self.phi, self.theta, 0.0))
        return np.asarray(R_nb.T @ [0.0, 0.0, -self.gravity_mps2])

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Poles of the whole aircraft about hover, gravity included; without position, heading."""
        return np.asarray(np.linalg.eigvals(self.whole()[0]), np.complex128)

    def whole(self) -> tuple[Array, Array]:
        """A (n, n) and B (n, 4) of the textbook: phi, theta, then the states of the file.

        Coriolis terms vanish in hover; gravity turns with the attitude.
        """
        kept = [STATES.index(name) for name in self.states]
        phi, theta, g = self.phi, self.theta, self.gravity_mps2
        turns = np.zeros((_ANGLES, _N))
        turns[:, LINEAR.rate] = _euler_rates(phi, theta)[:_ANGLES]
        falls = np.zeros((_N, _ANGLES))
        falls[LINEAR.vel] = g * np.array(
            [
                [0.0, -math.cos(theta)],
                [math.cos(theta) * math.cos(phi), -math.sin(theta) * math.sin(phi)],
                [-math.cos(theta) * math.sin(phi), -math.sin(theta) * math.cos(phi)],
            ]
        )
        A = np.block([[np.zeros((_ANGLES, _ANGLES)), turns], [falls, self.A]])
        B = np.vstack([np.zeros((_ANGLES, _M)), self.B])
        places = [*range(_ANGLES), *(_ANGLES + i for i in kept)]
        return A[np.ix_(places, places)], B[places]

    def nine(self) -> tuple[Array, Array, Array, Array]:
        """A (9, 9), B (9, 3), E (9, 3) and trim (9,) of eq. (10) of the paper, for a controller.

        The velocity is taken as zero, as there. A model without flapping is given a disc of 10 ms
        whose slow pole and whose steady rate per cyclic are the model's.

        Raises
        ------
        AircraftError
            The roll or the pitch rate of a model without flapping is not damped, or there is
            neither a yaw gyro nor its integrator.
        """
        A, B = self.A.copy(), self.B[:, ACTUATOR.attitude].copy()
        if "a_s" not in self.states:
            for rate, disc, lever in (
                (LINEAR.q, LINEAR.a_s, ACTUATOR.lon),
                (LINEAR.p, LINEAR.b_s, ACTUATOR.lat),
            ):
                damping, push = -A[rate, rate], B[rate].copy()
                if not 0.0 < damping < 0.5 / _DISC_S:
                    raise AircraftError(
                        f"{damping:g} 1/s is no damping of a disc that follows in {_DISC_S:g} s",
                        ParameterCause.BOUNDS, key=f"A: {STATES[rate]}",
                        allowed=f"more than 0 and less than {0.5 / _DISC_S:g}",
                    )  # fmt: skip
                A[rate, rate], A[rate, disc] = 0.0, damping / _DISC_S - damping**2
                A[disc, rate], A[disc, disc] = -1.0, -1.0 / _DISC_S
                B[rate], B[disc] = 0.0, push / damping
                B[disc, lever] = push[lever] / damping
        if "d_int" not in self.states:
            raise AircraftError(
                "missing: without it the controllers have no d_int",
                ParameterCause.MISSING,
                key="yaw_gyro",
            )
        rates, rotor = [NINE.p, NINE.q, NINE.r], [NINE.a_s, NINE.b_s, NINE.d_int]
        order = rates + rotor
        nine_A, nine_B = np.zeros((len(NINE), len(NINE))), np.zeros((len(NINE), 3))
        nine_E, x_trim = np.zeros((len(NINE), 3)), np.zeros(len(NINE))
        turning = LINEAR.turning
        nine_A[np.ix_(order, order)], nine_B[order] = A[turning, turning], B[turning]
        nine_E[order] = -A[turning, LINEAR.vel]
        angles = [NINE.phi, NINE.theta, NINE.psi]
        nine_A[np.ix_(angles, rates)] = _euler_rates(self.phi, self.theta)
        x_trim[[NINE.phi, NINE.theta]] = self.phi, self.theta
        x_trim[rotor] = self.rotor
        return nine_A, nine_B, nine_E, x_trim

    def scaled(self, values: Mapping[str, Any]) -> "LinearAircraft":
        """The aircraft times the plant's parameters `scale.*`, where its numbers have a place.

        mass divides the forces of air speed, rates and controls (the tilted thrust carries the
        weight, and stays), and moves the collective of hover; inertia divides the angular
        accelerations; rotor_stiffness multiplies the moments of the tilted disc; thrust the
        vertical force; drag the forces of u, v along themselves; servo_speed separate servos.
        """
        by = {name: float(values[PREFIX + name]) for name in SCALED}
        A, B = self.A.copy(), self.B.copy()
        A[LINEAR.vel, LINEAR.rigid] /= by["mass"]
        B[LINEAR.vel] /= by["mass"]
        A[LINEAR.w, LINEAR.rigid] *= by["thrust"]
        B[LINEAR.w] *= by["thrust"]
        A[LINEAR.rate] /= by["inertia"]
        B[LINEAR.rate] /= by["inertia"]
        A[LINEAR.rate, LINEAR.flapping] *= by["rotor_stiffness"]
        A[[0, 1], [0, 1]] *= by["drag"]
        u_trim, lift = self.u_trim.copy(), B[LINEAR.w, ACTUATOR.col]
        heavier = (1.0 - 1.0 / by["mass"]) * self.force_trim[2]
        u_trim[ACTUATOR.col] += heavier / lift
        servo = self.servo
        if servo is not None:
            servo = servo[0] * by["servo_speed"], servo[1], servo[2] * by["servo_speed"]
        return replace(self, A=A, B=B, u_trim=u_trim, servo=servo)


def _euler_rates(phi: float, theta: float) -> Array:
    """(3, 3): rates of phi, theta, psi by p, q, r."""
    sin, cos, tan = math.sin(phi), math.cos(phi), math.tan(theta)
    return np.array(
        [[1.0, sin * tan, cos * tan], [0.0, cos, -sin],
         [0.0, sin / math.cos(theta), cos / math.cos(theta)]]
    )  # fmt: skip


def linear_models() -> list[str]:
    """Names of those that are packaged."""
    found = {path.stem for folder in config_folders() for path in (folder / FOLDER).glob("*.yaml")}
    return sorted(found)


def find_linear(path: str | Path) -> Path:
    """The file of a linear aircraft: a bare name in the packaged folder, else a path.

    Raises
    ------
    AircraftError
    """
    text = str(path)
    bare = Path(text).name == text
    for folder in config_folders() if bare else ():
        for candidate in sorted((folder / FOLDER).glob("*.yaml")):
            if text in (candidate.name, candidate.stem):
                return candidate
    if Path(text).is_file():
        return Path(text)
    hint = f"; packaged: {', '.join(linear_models()) or 'none'}" if bare else ""
    raise AircraftError(f"no such linear aircraft{hint}", ParameterCause.UNREADABLE, where=text)


class DerivativeEntry(NamedTuple):
    """A place in A or B of a file: its matrix, and the names of its row and column."""

    matrix: str
    row: str
    column: str


_KNOWN_ENTRIES = (DerivativeEntry("A", "a_s", "q"), DerivativeEntry("A", "b_s", "p"))


def attitude_entries(tree: Any) -> dict[DerivativeEntry, float]:
    """Entries of a file that move the attitude and are the aircraft's, as they stand there.

    Those of the rates and the disc, by rates, disc, gyro, d_lat, d_lon and d_ped. Left out is what
    is known: that the disc turns with the body, and a gyro's electronics.

    Parameters
    ----------
    tree : dict
        Content of a file that `LinearAircraft.from_yaml` takes.
    """
    states = _states(_given(tree, "states"))
    turning = [name for name in states if name in STATES[LINEAR.turning]]
    of_aircraft = [name for name in turning if name != "d_int"]
    levers = [name for i, name in enumerate(ACTUATOR_NAMES) if i != ACTUATOR.col]
    A, B = _matrix(tree, "A", states, states), _matrix(tree, "B", states, ACTUATOR_NAMES)
    places = [DerivativeEntry("A", row, column) for row in of_aircraft for column in turning]
    places += [DerivativeEntry("B", row, lever) for row in of_aircraft for lever in levers]
    found = {}
    for place in places:
        matrix, columns = (A, STATES) if place.matrix == "A" else (B, ACTUATOR_NAMES)
        value = float(matrix[STATES.index(place.row), columns.index(place.column)])
        if value and place not in _KNOWN_ENTRIES:
            found[place] = value
    return found


def with_entries(
    tree: Any, values: Mapping[DerivativeEntry, float], where: str = ""
) -> LinearAircraft:
    """The aircraft of a file's content with other entries in its A and B.

    Raises
    ------
    AircraftError
        With them it is no helicopter about hover.
    """
    states = _states(_given(tree, "states"))
    rows: dict[str, dict[str, dict[str, float]]] = {}
    for name, columns, names in (("A", states, STATES), ("B", ACTUATOR_NAMES, ACTUATOR_NAMES)):
        matrix = _matrix(tree, name, states, columns)
        rows[name] = {
            row: {c: float(matrix[STATES.index(row), names.index(c)]) for c in columns}
            for row in states
        }
    for place, value in values.items():
        rows[place.matrix][place.row][place.column] = value
    return _of_tree({**tree, **rows}, where)


def _of_tree(tree: Any, where: str) -> LinearAircraft:
    _mapping(tree, "the file", _KNOWN)
    texts = {key: _text(tree, key) for key in _TEXTS}
    flat = {
        f"{group}.{key}": value
        for group in ("body", "trim", "servo", "yaw_gyro")
        for key, value in _mapping(tree.get(group, {}), group).items()
    }
    rules = _NUMBERS | _TRIM | _OPTIONAL
    for key in flat:
        if key not in rules:
            raise _unknown(key, rules)
    for key in _NUMBERS:
        _given(flat, key)
    for group in ("servo", "yaw_gyro"):
        for key in _OPTIONAL if group in tree else ():
            if key.startswith(f"{group}."):
                _given(flat, key)
    of = {key: _number(rules[key], value) for key, value in flat.items()}
    delay_s = _number(_DELAY, _given(tree, "delay_s"))
    states = _states(_given(tree, "states"))
    A, B = _matrix(tree, "A", states, states), _matrix(tree, "B", states, ACTUATOR_NAMES)
    rotor = np.array([of.get(f"trim.{name}_rad", 0.0) for name in ("a_s", "b_s")] + [0.0])
    u_trim = np.array([of.get(f"trim.{name}", 0.0) for name in ACTUATOR_NAMES])
    if "yaw_gyro" in tree:
        if "d_int" in states:
            raise AircraftError(
                "not allowed beside the state d_int, which is a gyro's",
                ParameterCause.CONFLICT, key="yaw_gyro",
            )  # fmt: skip
        if of["yaw_gyro.integral"] == 0.0:
            raise AircraftError(
                "0 is not allowed", ParameterCause.BOUNDS, key="yaw_gyro.integral",
                allowed="a number that holds the tail against the rotor's torque",
            )  # fmt: skip
        states = (*states, "d_int")
        _close_yaw(A, B, *(of[f"yaw_gyro.{key}"] for key in
                           ("proportional", "integral", "pedal_gain_radps")))  # fmt: skip
        rotor[2] = u_trim[ACTUATOR.ped] / of["yaw_gyro.integral"]
        u_trim[ACTUATOR.ped] = 0.0
    servo = None
    if "servo" in tree:
        servo = of["servo.bandwidth_radps"], of["servo.damping"], of["servo.rate_limit_per_s"]
    found = LinearAircraft(
        name=texts["name"], citation=texts["citation"], source=texts["source"],
        A=A, B=B, states=states, rotor=rotor, u_trim=u_trim, delay_s=delay_s,
        phi=of.get("trim.phi_rad", 0.0), theta=of.get("trim.theta_rad", 0.0), servo=servo,
        mass_kg=of["body.mass_kg"], gravity_mps2=of["body.gravity_mps2"],
        rotor_radius_m=of["body.rotor_radius_m"], rotor_blades=of["body.rotor_blades"],
        rotor_speed_radps=of["body.rotor_speed_radps"], file=where,
    )  # fmt: skip
    _sound(found)
    return found


def _close_yaw(A: Array, B: Array, proportional: float, integral: float, gain: float) -> None:
    """Put a yaw-rate gyro, eq. (8), between d_ped and the pedal of A and B, in place."""
    pedal = B[:, ACTUATOR.ped].copy()
    A[:, LINEAR.r] -= proportional * pedal
    A[:, LINEAR.d_int] += integral * pedal
    B[:, ACTUATOR.ped] = proportional * gain * pedal
    A[LINEAR.d_int, LINEAR.r], B[LINEAR.d_int, ACTUATOR.ped] = -1.0, gain


def _sound(aircraft: LinearAircraft) -> None:
    """Refuse what is no helicopter about hover."""
    lift = aircraft.B[LINEAR.w, ACTUATOR.col]
    if not lift > 0.0:
        raise AircraftError(
            f"{lift:g} is not allowed", ParameterCause.BOUNDS, key="B: w: d_col",
            allowed="above 0: a larger d_col is less thrust",
        )  # fmt: skip
    poles = aircraft.poles
    if np.abs(poles).max() > _FASTEST_RADPS:
        raise AircraftError(
            f"its fastest pole is {np.abs(poles).max():.4g} rad/s", ParameterCause.BOUNDS, key="A",
            allowed=f"up to {_FASTEST_RADPS:g} rad/s, which the integration follows",
        )  # fmt: skip
    if poles.real.max() > _UNSTABLE_PER_S:
        raise AircraftError(
            f"a pole at {poles.real.max():.4g} 1/s", ParameterCause.BOUNDS, key="A",
            allowed=f"up to {_UNSTABLE_PER_S:g} 1/s: no helicopter departs faster",
        )  # fmt: skip


def _mapping(value: Any, key: str, known: tuple[str, ...] = ()) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise AircraftError("expected keys and values", ParameterCause.TYPE, key=key)
    for name in value if known else ():
        if name not in known:
            raise _unknown(str(name), known)
    return value


def _unknown(key: str, known: Any) -> AircraftError:
    near = difflib.get_close_matches(key, list(known), n=1)
    hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}"
    return AircraftError(
        f"unknown key; {hint}", ParameterCause.UNKNOWN_KEY, key=key, meant="".join(near)
    )


def _given(tree: Mapping[str, Any], key: str) -> Any:
    if key not in tree:
        raise AircraftError("missing", ParameterCause.MISSING, key=key)
    return tree[key]


def _text(tree: Mapping[str, Any], key: str) -> str:
    value = _given(tree, key)
    if not isinstance(value, str) or not value.strip():
        raise AircraftError("not allowed", ParameterCause.TYPE, key=key, allowed="a text")
    return " ".join(value.split())


def _number(rule: Mapping[str, Any], value: Any) -> float:
    check_value(rule, value)
    return float(value)


def _states(value: Any) -> tuple[str, ...]:
    names = value if isinstance(value, list) else []
    for name in names:
        if name not in STATES:
            raise _unknown(f"states: {name}", [f"states: {state}" for state in STATES])
    if not set(_RIGID) <= set(names) or len(set(names)) < len(names):
        raise AircraftError(
            f"{value!r} is not allowed", ParameterCause.LENGTH, key="states",
            allowed=f"{', '.join(_RIGID)}, and of a_s, b_s, d_int any, each once",
        )  # fmt: skip
    if ("a_s" in names) != ("b_s" in names):
        raise AircraftError("a_s and b_s come together", ParameterCause.CONFLICT, key="states")
    return tuple(state for state in STATES if state in names)


def _matrix(
    tree: Mapping[str, Any], name: str, rows: tuple[str, ...], columns: tuple[str, ...]
) -> Array:
    """A matrix of {row: {column: entry}}, or of rows of numbers in the order of the names."""
    all_columns = STATES if name == "A" else ACTUATOR_NAMES
    out = np.zeros((_N, len(all_columns)))
    content = _mapping(_given(tree, name), name)
    for row, entries in content.items():
        key = f"{name}: {row}"
        if row not in rows:
            raise _unknown(key, [f"{name}: {known}" for known in rows])
        if isinstance(entries, list):
            if len(entries) != len(columns):
                raise AircraftError(
                    f"has {len(entries)} values", ParameterCause.LENGTH, key=key,
                    allowed=f"{len(columns)}, of {', '.join(columns)}",
                )  # fmt: skip
            entries = dict(zip(columns, entries, strict=True))
        for column, value in _mapping(entries, key).items():
            if column not in columns:
                raise _unknown(f"{key}: {column}", [f"{key}: {known}" for known in columns])
            entry = _number({**_ENTRY, "key": f"{key}: {column}"}, value)
            out[STATES.index(row), all_columns.index(column)] = entry
    return out
