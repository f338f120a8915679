# SPDX-License-Identifier: Apache-2.0
"""`heli.Simulation`: the aircraft step by step, commanded at any level of the cascade."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli.arguments import in_python, refused
from heli.flying import laws_of, ordered
from heli_core.errors import FlightError, ParameterError
from heli_core.rotations import euler_from_quat
from heli_core.rows import ACTUATOR, MEAS, NAV, ROTOR, SETPOINT, TRUTH
from heli_dynamics_sim.local_model import LocalModel, linearize_at
from heli_flight.fleet import design_file
from heli_flight.fly import tell_if_it_compiles
from heli_flight.parts import Parts
from heli_flight.settings import Settings
from heli_flight.stepping import VELOCITY, CommandLevel, SavedFlight, SteppedFlight, step
from heli_flight.terminal import console, silent

# -------------------------------------------------------------------------------------------------
# What is known after a step.
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]


class Field(NamedTuple):
    """A named part of a row of numbers."""

    of: int | slice | Callable[[Array], Any]
    unit: str
    meaning: str
    valid: int | None = None
    """Place of the flag that says whether it has come at this tick."""


def _motion(row: Any) -> dict[str, Field]:
    """What truth and navigation share, with the names of `flight.truth`."""

    def angle(i: int) -> Callable[[Array], float]:
        return lambda values: float(euler_from_quat(values[row.quat])[i])

    rotor = row.rotor.start
    return {
        "pos_ned_m": Field(row.pos, "m", "position: north, east, down"),
        "vel_ned_mps": Field(row.vel, "m/s", "velocity over the ground: north, east, down"),
        "q_nb": Field(row.quat, "", "attitude quaternion w, x, y, z, body to NED"),
        "rate_body_radps": Field(row.rate, "rad/s", "p, q, r: forward, right, down"),
        "altitude_m": Field(lambda values: -values[row.pos.stop - 1], "m", "position, up"),
        "phi_rad": Field(angle(0), "rad", "roll, right side down"),
        "theta_rad": Field(angle(1), "rad", "pitch, nose up"),
        "psi_rad": Field(angle(2), "rad", "heading"),
        "a_s_rad": Field(rotor + ROTOR.a_s, "rad", "disc tilted backwards"),
        "b_s_rad": Field(rotor + ROTOR.b_s, "rad", "disc tilted to the right"),
        "d_int_rad": Field(rotor + ROTOR.d_int, "rad", "integrator of the yaw gyro"),
    }


TRUTH_FIELDS = _motion(TRUTH) | {
    "wind_ned_mps": Field(TRUTH.wind, "m/s", "velocity of the air: north, east, down"),
}
NAV_FIELDS = _motion(NAV) | {
    "gyro_bias_body_radps": Field(NAV.gyro_bias, "rad/s", "estimated bias of the gyros"),
    "accel_bias_body_mps2": Field(NAV.accel_bias, "m/s2", "estimated bias of the accelerometers"),
    "sigma_pos_m": Field(NAV.sigma_pos, "m", "standard deviation of the position, NED"),
    "sigma_vel_mps": Field(NAV.sigma_vel, "m/s", "standard deviation of the velocity, NED"),
    "sigma_att_rad": Field(NAV.sigma_att, "rad", "of the attitude, about north, east, down"),
}
MEASURED_FIELDS = {
    "force_body_mps2": Field(MEAS.force, "m/s2", "specific force: forward, right, down"),
    "rate_body_radps": Field(MEAS.rate, "rad/s", "p, q, r: forward, right, down"),
    "force2_body_mps2": Field(MEAS.force2, "m/s2", "of a second IMU; zeros where there is none"),
    "rate2_body_radps": Field(MEAS.rate2, "rad/s", "of a second IMU; zeros where there is none"),
    "mag_body_t": Field(MEAS.mag, "T", "magnetic field: forward, right, down", MEAS.mag_valid),
    "pressure_pa": Field(MEAS.baro, "Pa", "static pressure", MEAS.baro_valid),
    "gps_pos_ned_m": Field(MEAS.gps_pos, "m", "fix: north, east, down", MEAS.gps_valid),
    "gps_vel_ned_mps": Field(MEAS.gps_vel, "m/s", "of the fix, over the ground", MEAS.gps_valid),
    "gps_tick": Field(MEAS.gps_tick, "", "tick at which the fix was true", MEAS.gps_valid),
    "rotor_speed_radps": Field(MEAS.rotor, "rad/s", "of the main rotor", MEAS.rotor_valid),
}
SETPOINT_FIELDS = {
    "phi_rad": Field(SETPOINT.phi, "rad", "commanded roll"),
    "theta_rad": Field(SETPOINT.theta, "rad", "commanded pitch"),
    "psi_rad": Field(SETPOINT.psi, "rad", "commanded heading"),
    "collective": Field(SETPOINT.col, "", "commanded collective, -1 to 1"),
}
U_FIELDS = {
    "delta_lat": Field(ACTUATOR.lat, "", "lateral cyclic, -1 to 1"),
    "delta_lon": Field(ACTUATOR.lon, "", "longitudinal cyclic, -1 to 1"),
    "delta_ped": Field(ACTUATOR.ped, "", "pedal, -1 to 1"),
    "delta_col": Field(ACTUATOR.col, "", "collective, -1 to 1"),
}


class NamedRow(Mapping[str, Any]):
    """Named numbers of one tick: `obs.truth.pos_ned_m`, `obs.truth["pos_ned_m"]`.

    What has not come at this tick is None.

    Attributes
    ----------
    row : ndarray
        All of them, in the places of `heli_core.rows`.
    """

    __slots__ = ("_fields", "_name", "row")

    def __init__(self, name: str, fields: Mapping[str, Field], row: Array) -> None:
        self._name, self._fields, self.row = name, fields, row

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name not in self._fields:
            raise AttributeError(self._unknown(name))
        return self[name]

    def __getitem__(self, name: str) -> Any:
        if name not in self._fields:
            raise KeyError(self._unknown(name))
        field = self._fields[name]
        if field.valid is not None and self.row[field.valid] < 0.5:
            return None
        return field.of(self.row) if callable(field.of) else self.row[field.of]

    def __iter__(self) -> Iterator[str]:
        return iter(self._fields)

    def __len__(self) -> int:
        return len(self._fields)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._fields]

    def _unknown(self, name: str) -> str:
        near = difflib.get_close_matches(str(name), self._fields, n=1, cutoff=0.4)
        hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(self._fields)}"
        return f"{self._name} has no {name!r}; {hint}"

    def __repr__(self) -> str:
        lines = []
        for name, field in self._fields.items():
            value = self[name]
            text = "-" if value is None else np.array2string(np.asarray(value), precision=4)
            lines.append(f"{self._name}.{name} = {text} {field.unit}  {field.meaning}")
        return "\n".join(lines)


class Observation:
    """What is known after a step, or at the beginning; it does not change any more.

    Attributes
    ----------
    tick : int
    time_s : float
        Flight time.
    truth : NamedRow
        How the aircraft really moves: no sensor knows it. `pos_ned_m` and `vel_ned_mps` are north,
        east, **down**, as everywhere here; `altitude_m` is **up**.
    measured : NamedRow
        What the sensors say at this tick.
    nav : NamedRow
        What the packaged observer, or the estimator that was given, makes of it.
    setpoint, u : NamedRow
        Attitude and actuators commanded last.
    lost : str
        Why the flight is over, one sentence; empty while it flies.
    """

    __slots__ = ("_nav", "_setpoint", "_truth", "_u", "_y", "lost", "tick", "time_s")

    def __init__(self, flight: SteppedFlight) -> None:
        rows = flight.loop.rows
        self.tick, self.lost = flight.tick, flight.sentence
        self.time_s = flight.rate.seconds(flight.tick)
        self._truth, self._y, self._nav = flight.truth.copy(), rows.y.copy(), rows.nav.copy()
        self._setpoint, self._u = flight.setpoint.copy(), flight.u.copy()

    @property
    def truth(self) -> NamedRow:
        """How the aircraft really moves."""
        return NamedRow("truth", TRUTH_FIELDS, self._truth)

    @property
    def measured(self) -> NamedRow:
        """What the sensors say."""
        return NamedRow("measured", MEASURED_FIELDS, self._y)

    @property
    def nav(self) -> NamedRow:
        """What is estimated on board."""
        return NamedRow("nav", NAV_FIELDS, self._nav)

    @property
    def setpoint(self) -> NamedRow:
        """The attitude and the collective commanded last."""
        return NamedRow("setpoint", SETPOINT_FIELDS, self._setpoint)

    @property
    def u(self) -> NamedRow:
        """The actuators commanded last."""
        return NamedRow("u", U_FIELDS, self._u)

    def __repr__(self) -> str:
        head = f"tick {self.tick}, {self.time_s:.2f} s{': ' if self.lost else ''}{self.lost}"
        groups = self.truth, self.measured, self.nav, self.setpoint, self.u
        return "\n".join([head, *map(repr, groups)])


# -------------------------------------------------------------------------------------------------
# The simulation.
# -------------------------------------------------------------------------------------------------


class Simulation:
    """A flight step by step, in this process, without ROS.

    A step is one tick (`dt_s`, 10 ms unless `rate_hz` says otherwise) of the loop that `heli.fly`
    flies: the same aircraft, sensors, observer and controllers, from the same compiled kernels. Who
    commands nothing flies the flight of `heli.fly`, bit for bit; the same arguments and commands
    give the same bytes.

    Parameters
    ----------
    scenario, seed, gps, world, laws, controller, params, faults, law, rate_hz
        As of `heli.fly`.
    plant, wind, sensors, estimator
        Parts of your own, as of `heli.fly`.
    aircraft : str, optional
        A packaged aircraft with its own design: helion, logo600, xcell60. Of your own: `params`.
    quiet : bool
        True: nothing is printed where the loop is compiled first.

    Raises
    ------
    ParameterError, TrimError, SynthesisError, PartError, LawError
        Each with one sentence.

    Attributes
    ----------
    dt_s : float
        Length of a step.

    Examples
    --------
    >>> sim = heli.Simulation(world="paper", seed=3)
    >>> obs = sim.reset()
    >>> while obs.time_s < 10.0 and not obs.lost:
    ...     obs = sim.step(velocity=[1.0, 0.0, 0.0])
    >>> obs.truth.pos_ned_m
    """

    @in_python
    def __init__(
        self,
        *,
        scenario: str | None = None,
        aircraft: str | None = None,
        world: str | None = None,
        seed: int | None = None,
        gps: str | None = None,
        laws: str | None = None,
        controller: str | None = None,
        params: Any = None,
        faults: Any = None,
        law: Any = None,
        plant: Any = None,
        wind: Any = None,
        sensors: Sequence[Any] = (),
        estimator: Any = None,
        rate_hz: int | None = None,
        quiet: bool = False,
    ) -> None:
        python_laws = laws_of(law)
        own = params if isinstance(params, (list, tuple)) else [] if params is None else [params]
        self._settings: Settings = ordered(
            python_laws, scenario=scenario, seed=seed, gps=gps, world=world, laws=laws,
            controller=controller, faults=faults, rate_hz=rate_hz,
            params=[*design_file(aircraft), *own],
        ).resolved()  # fmt: skip
        self._parts = Parts(
            plant=plant, wind=wind, sensors=sensors, estimator=estimator, controllers=python_laws
        )
        self.dt_s = self._settings.rate.tick_s
        tell_if_it_compiles(silent() if quiet else console(stderr=True), kernel=step)
        self._flight: SteppedFlight | None = None
        self._first: SavedFlight | None = None

    @property
    def seed(self) -> int:
        """Of the flight that is flown, or that `reset` begins."""
        return self._settings.seed

    @in_python
    def reset(self, seed: int | None = None) -> Observation:
        """Begin a flight at tick 0.

        Parameters
        ----------
        seed : int, optional
            Another one, from now on; default: as before, which gives the same flight again.
        """
        if seed is not None and seed != self.seed:
            self._settings, self._flight = self._settings.with_seed(seed), None
        if self._flight is not None and self._first is not None:
            self._flight.restore(self._first)
            return Observation(self._flight)
        self._flight = SteppedFlight(self._settings, self._parts)
        # Parts of the user begin by their own `reset`, not by a copy.
        self._first = None if self._parts else self._flight.save()
        return Observation(self._flight)

    def step(
        self,
        *,
        actuators: ArrayLike | None = None,
        attitude: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
    ) -> Observation:
        """Command, and fly to the next tick.

        Parameters
        ----------
        actuators : (4,) array, optional
            d_lat, d_lon, d_ped, d_col, -1 to 1: nothing packaged flies.
        attitude : (3,) or (4,) array, optional
            phi, theta, psi, rad, and the collective, -1 to 1, which stays as it was if it is left
            out: the packaged attitude controller flies.
        velocity : (3,) or (4,) array, optional
            Velocity north, east, **down**, m/s (a climb has a negative third), and a rate of turn,
            rad/s, positive to the right: every packaged controller flies, within
            its own limits. The position controller takes it at its next step.
        All left out: the scenario's own flight; after commands of yours a halt that is held.

        Returns
        -------
        Observation

        Raises
        ------
        ParameterError
            Several levels at once, or numbers that are none.
        FlightError
            There was no `reset`, the flight is over, or the velocity is refused: on the ground,
            without a position, or while the aircraft lands by itself.
        """
        flight = self._begun()
        if actuators is not None:
            _one_of(attitude, velocity)
            flight.step(CommandLevel.ACTUATORS, _numbers("actuators", actuators, (4,), 1.0))
        elif attitude is not None:
            _one_of(velocity)
            wanted = _numbers("attitude", attitude, (3, 4), 7.0)
            if len(wanted) == SETPOINT.col:
                wanted = [*wanted, float(flight.u[ACTUATOR.col])]
            if abs(wanted[SETPOINT.col]) > 1.0:
                allowed = "a collective, the fourth number, from -1 to 1"
                raise refused("attitude", attitude, allowed)
            flight.step(CommandLevel.ATTITUDE, wanted)
        elif velocity is not None:
            wanted = [*_numbers("velocity", velocity, (3, VELOCITY.size), 1e3), 0.0]
            flight.step(CommandLevel.GUIDANCE, wanted[: VELOCITY.size])
        else:
            flight.step(CommandLevel.GUIDANCE)
        return Observation(flight)

    def save(self) -> SavedFlight:
        """The whole state, as a copy: aircraft, air, sensors, filters, controllers, random numbers.

        Raises
        ------
        FlightError
            There was no `reset`.
        PartError
            A part of your own cannot be copied.
        """
        return self._begun().save()

    def restore(self, state: SavedFlight) -> Observation:
        """Go on from a saved state, as often as you like: what follows is the same, bit for bit.

        Raises
        ------
        FlightError
            It is of another flight: other arguments, or another seed.
        ParameterError
            It is no saved state.
        """
        flight = self._begun()
        if not isinstance(state, SavedFlight):
            raise refused("state", state, "what save() gave")
        flight.restore(state)
        return Observation(flight)

    def linearize(self) -> LocalModel:
        """A linear model about the present state: x' = f + A (x - x0) + B (u - u0) + E w.

        Returns
        -------
        LocalModel
            Of 23 states (places `heli.LOCAL`), four commands, three components of wind; position,
            velocity and wind are north, east, **down**. `.held(dt_s)` is its sampled form.

        Raises
        ------
        FlightError
            There was no `reset`.
        ParameterError
            The plant is one of your own.
        """
        flight = self._begun()
        if flight.has_own_plant:
            raise ParameterError("linearize: of a plant of your own; allowed: the packaged one")
        k, s = flight.loop.plant_k, flight.loop.plant_s
        return linearize_at(s.x, flight.u, s.air, k.aircraft, k.delay_ticks * k.tick_s)

    def _begun(self) -> SteppedFlight:
        if self._flight is None:
            raise FlightError("the flight has not begun; call reset() first")
        return self._flight


def _one_of(*others: Any) -> None:
    if any(other is not None for other in others):
        raise ParameterError("step: give one of actuators, attitude, velocity")


def _numbers(name: str, values: ArrayLike, sizes: tuple[int, ...], most: float) -> list[float]:
    """So many finite numbers, none larger than that; ParameterError with one sentence."""
    try:
        row = np.asarray(values, np.float64).tolist()
        good = len(row) in sizes and all(math.fabs(value) <= most for value in row)
    except (TypeError, ValueError):
        good = False
    if not good:
        count = " or ".join(map(str, sizes))
        raise refused(name, values, f"{count} finite numbers up to {most:g}")
    return list(row)
