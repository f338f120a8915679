# SPDX-License-Identifier: Apache-2.0
"""`heli design`: from aircraft and weights to every number that the nodes load, with its proof."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import control
import numpy as np

from heli_dynamics_sim.aircraft_file import find_aircraft
from heli_dynamics_sim.linearize import linearize
from heli_dynamics_sim.parameters import HelicopterParameters
from heli_dynamics_sim.trim import trim
from heli_flight.loop.position_axes import attitude_lags_s
from heli_flight.loop.settings import Settings, resolve
from heli_flight.loop.worlds import HOVER_TEST_WORLD
from heli_flight.studies.design.attitude import beyond_the_box, searched_output, yardstick
from heli_flight.studies.design.between_samples import norm_between_samples
from heli_flight.studies.design.bounds import bound_of, output_bound_of
from heli_flight.studies.design.outer import position_loop
from heli_inner_hinf.actuation import Actuation, ObserverInput
from heli_inner_hinf.analysis import LoopReport, analyse, loops_of, model_of
from heli_inner_hinf.attitude_search import Yardstick
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.disk_margin import DiskMargin
from heli_inner_hinf.loops import Loop, Model
from heli_inner_hinf.margins import further_delay_s
from heli_inner_hinf.observer_gain import Candidate, choose_observer_gain
from heli_inner_hinf.pid_tuning import AxisGains, gains_of, tune_pid
from heli_math.rows import ACTUATOR, NINE
from heli_math.state_names import INPUT_NAMES
from heli_math.ticks import TICK_S, ticks_in
from heli_outer_pd.axis_analysis import AxisReport
from heli_parameters.parameters import ParameterError, dump_all
from heli_robust.lifting import SampledNorm

_MAX_DELAY_TICKS = 2
LONGEST_DELAY_S = 0.2


@dataclass(frozen=True)
class Basis:
    """What a design is made from: calculated from an aircraft file, or identified in flight.

    Attributes
    ----------
    source : str
        Where the numbers come from, for people.
    system : control.StateSpace
        Linear model about trim, eq. (9), SI and rad, as `heli_math.state_space.hover_system`.
    x_trim : (9,) array
        Trim of the nine states; psi is 0.
    u_trim : (4,) array
        Trim of d_lat, d_lon, d_ped, d_col.
    actuation : Actuation
        Servo and transport delay.
    outer : mapping
        Parameters of the outer loop: mass, gravity, rotor.* of the thrust map.
    plant : mapping
        Parameters of the plant that belong to the aircraft; empty for one that is not simulated.
    residual : float
        Largest residual of the trim; nan where it was measured.
    """

    source: str
    system: control.StateSpace
    x_trim: np.ndarray
    u_trim: np.ndarray
    actuation: Actuation
    outer: Mapping[str, Any]
    plant: Mapping[str, Any]
    residual: float

    @property
    def A(self) -> np.ndarray:
        """(9, 9), see `system`."""
        return self.system.A

    @property
    def B(self) -> np.ndarray:
        """(9, 3): effect of d_lat d_lon d_ped."""
        return self.system.B[:, : len(INPUT_NAMES)]

    @property
    def E(self) -> np.ndarray:
        """(9, 3): effect of the wind."""
        return self.system.B[:, len(INPUT_NAMES) :]


@dataclass(frozen=True)
class Design:
    """A finished design.

    Attributes
    ----------
    basis : Basis
        Model, trim and actuation that it is made from.
    attitude : AttitudeConfig
        Judged inner loop: model, F, G, certificate.
    observer : Candidate
        The reduced-order observer (19) and its margins.
    pid : tuple of AxisGains
        The PID of the same aircraft, by its rule.
    loops : tuple of Loop
        State feedback, with observer, as flown; of output feedback as flown alone.
    reports : tuple of LoopReport
        Of the loops.
    between_samples : SampledNorm
        Norm wind -> h of the loop as flown, between its samples as well.
    further_delay_s : float
        What the loop as flown survives on top of its own delay.
    outer : tuple of AxisReport
        The position loop with its present gains, forward, right, down; empty for an identified
        aircraft.
    outer_together : DiskMargin or None
        With its three channels broken together, the axes as they meet in the aircraft.
    values : dict
        Node name to the parameters that the design decides.
    """

    basis: Basis
    attitude: AttitudeConfig
    observer: Candidate
    pid: tuple[AxisGains, ...]
    loops: tuple[Loop, ...]
    reports: tuple[LoopReport, ...]
    between_samples: SampledNorm
    further_delay_s: float
    outer: tuple[AxisReport, ...]
    outer_together: DiskMargin | None
    values: Mapping[str, Mapping[str, Any]]

    @property
    def actuation(self) -> Actuation:
        """Servo and delay of the aircraft."""
        return self.basis.actuation

    @property
    def model(self) -> Model:
        """The linear model with its state feedback."""
        return model_of(self.attitude)

    @property
    def observer_input(self) -> ObserverInput:
        """How the command enters the observer."""
        return observer_input(self.actuation)


def make_design(
    params: Sequence[Path] = (),
    aircraft: str | None = None,
    gamma: float | None = None,
    gamma_factor: float | None = None,
    search: bool = False,
) -> Design:
    """Trim, linearise, synthesise, choose the observer, tune the PID, analyse.

    `output` and the position loop's gains are searched for if asked, else stay those of the
    parameters.

    Parameters
    ----------
    params : sequence of path
        rcl parameter files with weights and whatever else shall differ from the packaged values.
    aircraft : str, optional
        An aircraft file, or the bare name of a packaged one; default: the plant's.
    gamma : float, optional
        Bound on the norm; default: the parameter.
    gamma_factor : float, optional
        Bound as a multiple of gamma*, instead.
    search : bool
        Search for the position loop's gains, and, for the parameters' own aircraft, for `output`
        from the present numbers; another aircraft keeps these.

    Raises
    ------
    ParameterError, AircraftError, TrimError, SynthesisError, NoGainsError
        Each with a sentence; the same as the nodes give.
    """
    settings = resolve(params=params).at_100_hz("heli design")
    air = resolve(params=params, world=HOVER_TEST_WORLD).nodes["plant"]
    basis = aircraft_basis(settings, aircraft)
    measure = None
    if search and aircraft is None:
        own = HelicopterParameters.from_yaml(settings.nodes["plant"]["aircraft_file"])
        common = yardstick(own, basis.actuation)
        measure = beyond_the_box(common, own, basis.actuation)
    return design_of(basis, settings, gamma, gamma_factor, air, search, measure)


def aircraft_basis(settings: Settings, aircraft: str | None = None) -> Basis:
    """Trim and linearise an aircraft file; arguments and errors as in `make_design`."""
    plant = settings.nodes["plant"]
    file = aircraft or plant["aircraft_file"]
    helicopter = HelicopterParameters.from_yaml(file)
    if aircraft is not None and Path(file).is_file():
        file = str(find_aircraft(file).resolve())
    at = trim(helicopter)
    linear = linearize(helicopter, at)
    x_trim = linear.x_trim.copy()
    x_trim[NINE.psi] = 0.0
    delay_ticks = min(int(plant["delay_ticks"]), _MAX_DELAY_TICKS)
    return Basis(
        source=f"aircraft {file}",
        system=linear.system,
        x_trim=x_trim,
        u_trim=at.u,
        actuation=Actuation(
            helicopter.servo_bandwidth_radps, helicopter.servo_damping, delay_ticks * TICK_S
        ),
        outer={
            "mass": helicopter.mass_kg,
            "gravity": helicopter.gravity_mps2,
            "rotor.rho": helicopter.air_density_kgpm3,
            "rotor.omega": helicopter.main_speed_radps,
            "rotor.radius": helicopter.main_radius_m,
            "rotor.lift_slope": helicopter.main_lift_slope,
            "rotor.blades": round(helicopter.main_blades),
            "rotor.chord": helicopter.main_chord_m,
            "rotor.K_col": helicopter.collective_gain_rad,
        },
        plant={"aircraft_file": file},
        residual=float(at.residual),
    )


def design_of(
    basis: Basis,
    settings: Settings,
    gamma: float | None = None,
    gamma_factor: float | None = None,
    air: Mapping[str, Any] | None = None,
    search: bool = False,
    measure: Yardstick | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> Design:
    """Synthesise, choose the observer, tune the PID, analyse; no aircraft file is read.

    Parameters
    ----------
    basis : Basis
    settings : Settings
        Weights, gamma and whatever else the inner loop's parameters hold.
    gamma, gamma_factor
        As in `make_design`.
    search : bool
        Search for the position loop's gains.
    air : mapping, optional
        Parameters of the plant in whose wind and with whose terms the position loop is judged;
        default: the settings'.
    measure : Yardstick, optional
        Search by it for the numbers of `output`.
    tell : callable
        Told what comes next, a few words.

    Raises
    ------
    ParameterError, SynthesisError
    """
    if gamma is not None and gamma_factor is not None:
        raise ParameterError("--gamma and --gamma-factor: give one of them, not both")
    actuation = basis.actuation
    tell("attitude law and its certificate")
    inner: dict[str, Any] = {
        **settings.nodes["inner_loop"],
        "model.A": basis.A,
        "model.B": basis.B,
        "model.E": basis.E,
        "trim.x": basis.x_trim,
        "trim.u": basis.u_trim,
        "servo.frequency_radps": actuation.servo_radps,
        "servo.damping": actuation.servo_damping,
        "delay_ticks": ticks_in(actuation.delay_s),
        "prediction_s": round(actuation.known_lag_s, 3),
    }
    inner["gamma"] = bound_of(inner, gamma, gamma_factor)
    inner["output.gamma"] = output_bound_of(inner, actuation)
    if measure is not None:
        inner |= searched_output(inner, measure)
    attitude = AttitudeConfig.from_parameters(inner)
    feed = observer_input(actuation)
    model = model_of(attitude)
    tell("observer")
    plain = replace(model, shift_rate=0.0)
    best, _ = choose_observer_gain(plain, attitude.prediction_s, actuation, feed)
    tell("PID")
    pid = tune_pid(plain, actuation)
    inner |= {f"pid.{name}": gains for name, gains in gains_of(pid).items()}
    loops = loops_of(attitude, best.K, feed, actuation)
    values: dict[str, dict[str, Any]] = {
        "inner_loop": {key: inner[key] for key in _INNER_KEYS},
        "observer": _observer_values(inner, best, actuation),
        "outer_loop": _outer_values(basis, loops[-1]),
    }
    outer: tuple[AxisReport, ...] = ()
    together = None
    if basis.plant:
        tell("position loop")
        values["plant"] = dict(basis.plant)
        own = {**settings.nodes["outer_loop"], **values["outer_loop"]}
        around = {**(air or settings.nodes["plant"]), **basis.plant}
        position = position_loop(around, own, loops[-1], model, actuation)
        if search:
            values["outer_loop"] |= position.chosen(own)
        outer = position.reports(own | values["outer_loop"])
        together = position.common_margin(own | values["outer_loop"])
    tell("margins of the loop as flown")
    return Design(
        basis=basis,
        attitude=attitude,
        observer=best,
        pid=pid,
        loops=loops,
        reports=tuple(analyse(loop) for loop in loops),
        between_samples=norm_between_samples(model, actuation, loops[-1]),
        further_delay_s=further_delay_s(loops[-1], model, actuation, LONGEST_DELAY_S),
        outer=outer,
        outer_together=together,
        values=values,
    )


_INNER_KEYS = (
    "gamma", "C11", "C22", "D11", "output.gamma", "output.effort", "output.integral",
    "output.load", "output.noise", "output.command_effort",
    "trim.x", "trim.u", "model.A", "model.B", "model.E",
    "servo.frequency_radps", "servo.damping", "delay_ticks", "prediction_s",
    "pid.K_P", "pid.K_I", "pid.K_D",
)  # fmt: skip


def observer_input(actuation: Actuation) -> ObserverInput:
    """The observer is fed the command as late as the aircraft, through a model of its servos."""
    return ObserverInput(
        ticks_in(actuation.delay_s), actuation.servo_radps, actuation.servo_damping
    )


def _observer_values(
    inner: Mapping[str, Any], best: Candidate, actuation: Actuation
) -> dict[str, Any]:
    return {
        "model.A": inner["model.A"],
        "model.B": inner["model.B"],
        "trim.x": inner["trim.x"],
        "trim.u": inner["trim.u"],
        "K": best.K,
        "u_delay_ticks": ticks_in(actuation.delay_s),
        "servo.frequency_radps": actuation.servo_radps,
        "servo.damping": actuation.servo_damping,
    }


def _outer_values(basis: Basis, attitude: Loop) -> dict[str, Any]:
    return {
        "mass": basis.outer["mass"],
        "gravity": basis.outer["gravity"],
        "trim.phi": float(basis.x_trim[NINE.phi]),
        "trim.theta": float(basis.x_trim[NINE.theta]),
        "trim.d_col": float(basis.u_trim[ACTUATOR.col]),
        "disturbance.attitude_lag_s": np.round(attitude_lags_s(attitude), 2),
        **{key: value for key, value in basis.outer.items() if key.startswith("rotor.")},
    }


def write_yaml(design: Design, path: Path, by: str = "heli design") -> None:
    """Write the rcl parameter file that plant, observer, inner and outer loop load; `by`: who."""
    dump_all(design.values, path)
    s = design.attitude.output or design.attitude.synthesis
    flown = design.reports[-1]
    plant = "plant, " if "plant" in design.values else ""
    head = (
        f"# Design by {by}: one file for {plant}observer, inner_loop and outer_loop.\n"
        f"# gamma = {s.gamma:.8g}, gamma* = {s.gamma_star.value:.10g}, "
        f"norm = {s.norm:.6g} ({design.attitude.controller})\n"
        f"# as flown: disk margin {flown.disk_input.alpha:.3f} at the plant input, "
        f"{flown.disk_output.alpha:.3f} at its output\n"
        "# Arrays are flat, row by row; units and meaning: the packaged YAML of each node.\n"
    )
    path.write_text(head + path.read_text(encoding="utf-8"), encoding="utf-8")
