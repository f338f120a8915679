# SPDX-License-Identifier: Apache-2.0
"""`heli design`: from aircraft and weights to every number that the nodes load, with its proof."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from heli_core.central_controller import GeneralisedPlant, NoControllerError, optimal_gamma
from heli_core.errors import InfeasibleGammaError, RobustError
from heli_core.folders import write_whole
from heli_core.linear import with_servos
from heli_core.rcl_yaml import ParameterError, dump_all
from heli_core.rows import ACTUATOR, INPUT_NAMES, MEASURED, NINE
from heli_core.ticks import TICK_S, ticks_in
from heli_dynamics_sim.aircraft import HelicopterParameters, find_aircraft
from heli_dynamics_sim.linear_aircraft import PARAMETER as LINEAR
from heli_dynamics_sim.trim import (
    linearize,
    trim,
)
from heli_flight.position_axes import attitude_lags_s
from heli_flight.settings import Settings, resolve
from heli_flight.worlds import HOVER_TEST_WORLD
from heli_inner_hinf.controller_state import Actuation, ObserverInput
from heli_inner_hinf.design import LEAST_GAMMA_FACTOR, AttitudeConfig, added_weights
from heli_inner_hinf.loops import (
    N_Y,
    Loop,
    Model,
    flown_loop,
    further_delay_s,
    observer_loop,
    state_feedback_loop,
)
from heli_inner_hinf.mu import DiskMargin
from heli_inner_hinf.output_feedback import generalised_plant
from heli_inner_hinf.regular_form import N_H, N_U, N_X, Matrix, weights
from heli_inner_hinf.robust.sampled_norm import HeldPlant, SampledLaw, SampledNorm, sampled_norm
from heli_inner_hinf.synthesis import gamma_star, hinf_norm
from heli_inner_hinf.tuning import (
    AxisGains,
    Candidate,
    LawBenchmark,
    LoopReport,
    analyse,
    choose_observer_gain,
    gains_of,
    loops_of,
    model_of,
    tune_pid,
)
from heli_outer_pd.analysis import (
    AxisReport,
)
from heli_studies.design import rivals
from heli_studies.design.linear import NO_GROUND, is_linear, linear_basis

if TYPE_CHECKING:
    import control
from heli_studies.design.attitude_search import beyond_the_box, searched_output, yardstick
from heli_studies.design.position_search import position_loop

# -------------------------------------------------------------------------------------------------
# Which bounds on the norm a design is asked to keep.
# -------------------------------------------------------------------------------------------------

_BOUND_KEYS = {"hinf_output": "output.gamma", "hinf": "gamma"}
"""By controller the parameter that bounds its norm; the others have none."""


def bound_of(
    inner: Mapping[str, Any], gamma: float | None, factor: float | None, actuation: Actuation
) -> dict[str, float]:
    """The bounds of a design: of the controller that flies as it is asked for.

    Parameters
    ----------
    inner : mapping
        The inner loop's parameters.
    gamma, factor : float or None
        The bound itself, or as a multiple of gamma*; without either the parameter.
    actuation : Actuation

    Returns
    -------
    dict
        Parameters of the inner loop by name. The packaged `output.gamma` is raised for an aircraft
        that has no controller below it; one that was asked for is not.

    Raises
    ------
    ParameterError
        Both are given, or the controller has no bound.
    SynthesisError
    """
    if gamma is not None and factor is not None:
        raise ParameterError("--gamma and --gamma-factor: give one of them, not both")
    controller = inner["controller"]
    key = _BOUND_KEYS.get(controller)
    if key is None and not (gamma is None and factor is None):
        option = "--gamma" if factor is None else "--gamma-factor"
        raise ParameterError(
            f"{option}: controller {controller} has no bound on its norm; "
            f"{' and '.join(_BOUND_KEYS)} have"
        )
    if key is not None and gamma is not None:
        if not 0.0 < gamma < np.inf:
            raise InfeasibleGammaError(gamma, _gamma_star(inner, actuation), key)
        return {key: gamma}
    if key is not None and factor is not None:
        return {key: factor * _gamma_star(inner, actuation)}
    return {"output.gamma": _output_gamma(inner, actuation)}


def _gamma_star(inner: Mapping[str, Any], actuation: Actuation) -> float:
    """gamma* of the controller that flies, which has one."""
    if inner["controller"] == "hinf_output":
        return optimal_gamma(_output_plant(inner, actuation), float(inner["output.gamma"])).value
    C, D = weights(inner["C11"], inner["C22"], inner["D11"])
    return gamma_star(inner["model.A"], inner["model.B"], inner["model.E"], C, D).value


def _output_plant(inner: Mapping[str, Any], actuation: Actuation) -> GeneralisedPlant:
    model = inner["model.A"], inner["model.B"], inner["model.E"]
    C, D = weights(inner["C11"], inner["C22"], inner["D11"])
    return generalised_plant(*model, C, D, added_weights(inner), actuation)


def _output_gamma(inner: Mapping[str, Any], actuation: Actuation) -> float:
    """`output.gamma`; if an aircraft has no controller below the packaged one, a bound above."""
    gamma = float(inner["output.gamma"])
    if gamma != resolve().nodes["inner_loop"]["output.gamma"]:
        return gamma
    try:
        star = optimal_gamma(_output_plant(inner, actuation), gamma).value
    except NoControllerError:
        return gamma  # what flies it says why
    least = LEAST_GAMMA_FACTOR * star
    return gamma if gamma >= least else float(f"{least:.3g}")


# -------------------------------------------------------------------------------------------------
# The norm wind -> h of the attitude loop as flown, between its samples as well.
#
# The wind blows and h of eq. (11) is counted at every instant, the controller acts a hundred times
# a second.
# -------------------------------------------------------------------------------------------------

_FAST_SERVO = Actuation(1000.0, 1.0, 0.0)
"""Servos that cost nothing, and no transport delay."""


def norm_between_samples(model: Model, actuation: Actuation, flown: Loop) -> SampledNorm:
    """The norm from wind u v w (m/s) to h (9), enclosed, with the controller as flown.

    Raises
    ------
    RobustError
        The loop is not stable.
    """
    A, B = with_servos(model.A, model.B, actuation.servo_radps, actuation.servo_damping)
    n, rates = A.shape[0], np.zeros((N_H, N_U))
    plant = HeldPlant(
        A=A,
        B=B,
        E=np.vstack([model.E, np.zeros((n - N_X, N_U))]),
        C=np.hstack([model.C, model.D, rates]),
        C_y=np.eye(n)[list(MEASURED)],
        tick_s=TICK_S,
        delay_s=actuation.delay_s,
    )
    law = flown.controller
    return sampled_norm(plant, SampledLaw(law.A, law.B[:, :N_Y], law.C, law.D[:, :N_Y]))


def norms_on_the_way(
    model: Model, K: Matrix, prediction_s: float, feed: ObserverInput, actuation: Actuation
) -> list[tuple[str, float]]:
    """Norm wind -> h from what is proved to what is flown, one cause more at each step.

    Of state feedback (hinf, lqr), observer included. Output feedback has no such way: it is made
    on the plant as flown, and its norm is `norm_between_samples`.

    Returns
    -------
    list of (cause, norm)
        inf where the loop is not stable.
    """
    norms = []
    for name, loop in (
        ("state feedback", state_feedback_loop(model)),
        ("with the observer", observer_loop(model, K)),
    ):
        T = loop.wind_to_h
        stable = loop.stability() < 0.0
        norms.append((name, hinf_norm(T.A, T.B, T.C)[0] if stable else np.inf))
    late = replace(actuation, delay_s=0.0)
    no_delay = replace(feed, u_delay_ticks=0)
    for name, prediction, fed, lag in (
        ("at 100 Hz", 0.0, replace(no_delay, servo_radps=0.0), _FAST_SERVO),
        ("with servos", 0.0, no_delay, late),
        ("with transport delay", 0.0, feed, actuation),
        ("with prediction", prediction_s, feed, actuation),
    ):
        flown = flown_loop(model, K, prediction, fed, lag)
        try:
            norms.append((name, norm_between_samples(model, lag, flown).upper))
        except RobustError:
            norms.append((name, np.inf))
    return norms


# -------------------------------------------------------------------------------------------------
# Make.
# -------------------------------------------------------------------------------------------------

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
        Linear model about trim, eq. (9), SI and rad, as `heli_core.linear.hover_system`.
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
class FinishedDesign:
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
        and for a linear aircraft.
    outer_together : DiskMargin or None
        With its three channels broken together, the axes as they meet in the aircraft.
    values : dict
        Node name to the parameters that the design decides.
    remarks : tuple of str
        Sentences about the parameters that it was made from, as of `Settings`.
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
    remarks: tuple[str, ...] = ()

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
    controller: str | None = None,
) -> FinishedDesign:
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
        Bound on the norm of the controller that flies; default: the parameter.
    gamma_factor : float, optional
        Bound as a multiple of its gamma*, instead.
    search : bool
        Search for the position loop's gains, and, for the parameters' own aircraft, for `output`
        from the present numbers; another aircraft keeps these.
    controller : str, optional
        Which attitude controller flies; default: the parameters'.

    Raises
    ------
    ParameterError, AircraftError, TrimError, SynthesisError, NoGainsError
        Each with a sentence; the same as the nodes give.
    """
    settings = resolve(params=params, controller=controller).at_100_hz("heli design")
    air = resolve(params=params, world=HOVER_TEST_WORLD).nodes["plant"]
    basis = aircraft_basis(settings, aircraft)
    measure = None
    if search and aircraft is None:
        helicopter = HelicopterParameters.from_yaml(settings.nodes["plant"]["aircraft_file"])
        common = yardstick(helicopter, basis.actuation)
        measure = beyond_the_box(common, helicopter, basis.actuation)
    return design_of(basis, settings, gamma, gamma_factor, air, search, measure)


def aircraft_basis(settings: Settings, aircraft: str | None = None) -> Basis:
    """Trim and linearise an aircraft file; arguments and errors as in `make_design`."""
    plant = settings.nodes["plant"]
    linear_model = aircraft or plant[LINEAR]
    if is_linear(linear_model):
        return Basis(**linear_basis(linear_model, plant)._asdict())
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
    measure: LawBenchmark | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> FinishedDesign:
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
    actuation = basis.actuation
    tell("attitude controller and its certificate")
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
    inner |= bound_of(inner, gamma, gamma_factor, actuation)
    if measure is not None:
        inner |= searched_output(inner, measure)
    attitude = AttitudeConfig.from_parameters(inner)
    inner["gamma"] = attitude.synthesis.gamma
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
        values["plant"] = dict(basis.plant)
    if LINEAR in basis.plant:
        values["inner_loop"] |= NO_GROUND
    if basis.plant and LINEAR not in basis.plant:
        tell("position loop")
        outer_parameters = {**settings.nodes["outer_loop"], **values["outer_loop"]}
        around = {**(air or settings.nodes["plant"]), **basis.plant}
        position = position_loop(around, outer_parameters, loops[-1], model, actuation)
        if search:
            values["outer_loop"] |= position.chosen(outer_parameters)
        outer = position.reports(outer_parameters | values["outer_loop"])
        together = position.common_margin(outer_parameters | values["outer_loop"])
    tell("margins of the loop as flown")
    return FinishedDesign(
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
        remarks=settings.remarks,
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
        **{
            key: value
            for key, value in basis.outer.items()
            if key.startswith("rotor.") or key == "blade_pitch_floor"
        },
    }


def write_yaml(design: FinishedDesign, path: Path, by: str = "heli design") -> None:
    """Write the rcl parameter file that plant, observer, inner and outer loop load; `by`: who."""
    dump_all(design.values, path)
    bound = design.attitude.bound
    controller = design.attitude.controller
    certificate = (
        "without a bound on its norm"
        if bound is None
        else (
            f"gamma = {bound.gamma:.8g}, gamma* = {bound.gamma_star.value:.10g}, "
            f"norm = {bound.norm:.6g}"
        )
    )
    flown = design.reports[-1]
    plant = "plant, " if "plant" in design.values else ""
    head = (
        f"# Design by {by}: one file for {plant}observer, inner_loop and outer_loop.\n"
        f"# {controller}: {certificate}\n"
        f"# as flown: disk margin {flown.disk_input.alpha:.3f} at the plant input, "
        f"{flown.disk_output.alpha:.3f} at its output\n"
        "# Arrays are flat, row by row; units and meaning: the packaged YAML of each node.\n"
    )
    write_whole(path, head + path.read_text(encoding="utf-8"))


# -------------------------------------------------------------------------------------------------
# `heli design --check`: whether the packaged YAML holds what the searches yield.
# -------------------------------------------------------------------------------------------------

SEARCHED = {
    "inner_loop": (
        "output.effort",
        "output.integral",
        "output.load",
        "output.noise",
    ),
    "outer_loop": (
        "K_P",
        "K_D",
        "disturbance.bandwidth_radps",
        "disturbance.attitude_lag_s",
        "attitude_lead.lead_s",
    ),
}
"""By node the parameters that a search chooses, on a grid of rounded numbers."""


def differences(design: FinishedDesign, params: Sequence[Path] = ()) -> list[str]:
    """Where what is shipped is not what the searches yield, a sentence each.

    Parameters
    ----------
    design : FinishedDesign
        Made with the searches.
    params : sequence of path
        Parameter files that the design was made with.
    """
    nodes = resolve(params=params).nodes
    yielded = {
        node: {key: design.values[node][key] for key in keys} for node, keys in SEARCHED.items()
    }
    sentences = [
        line
        for node, values in yielded.items()
        for line in _parameter_differences(node, nodes[node], values)
    ]
    actuation = AttitudeConfig.from_parameters(
        {**nodes["inner_loop"], "controller": "pid"}
    ).actuation
    helicopter = HelicopterParameters.from_yaml(nodes["plant"]["aircraft_file"])
    measure = yardstick(helicopter, actuation)
    for controller in rivals.KEYS:
        rival_nodes = resolve(params=params, laws=controller).nodes
        # One number at a time, from what is shipped on.
        optimum = rivals.chosen(controller, rival_nodes, measure, (1,), pairs=False)
        sentences += _parameter_differences(
            f"controllers {controller}: inner_loop", rival_nodes["inner_loop"], optimum
        )
    return sentences


def _parameter_differences(
    where: str, shipped: Mapping[str, Any], yielded: Mapping[str, Any]
) -> list[str]:
    """A sentence for each parameter that differs."""
    return [
        f"{where}: {key}: shipped {np.asarray(shipped[key]).tolist()}, the search yields "
        f"{np.asarray(value).tolist()}"
        for key, value in yielded.items()
        if not np.array_equal(np.ravel(shipped[key]), np.ravel(value))
    ]
