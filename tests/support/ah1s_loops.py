# SPDX-License-Identifier: Apache-2.0
"""Our loops for JSBSim's AH-1S, made from what was identified of it, and flights with them.

What comes from elsewhere than the record: mass (a scale), rotor's radius, chord, blades and speed
(a ruler, a tachometer; AH-1S: 44 ft, 27 in, 2, 324 1/min; TM 55-1520-236-10), the air's density.

Attitude controller: `design_of` with the packaged weights. Position gains: `best_gains`, the
search that `heli design --search` makes, with the packaged floors of the margins and the packaged
units of the errors, Froude-scaled (lengths by the rotors' ratio, speeds by its root).
"""

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.signal import butter, sosfiltfilt

from heli_analysis.identification import IdentifiedAB, RotorGeometry, fit_record
from heli_analysis.identification.model import full_matrices
from heli_analysis.identification.structure import AIR, STATE, ModelStructure, Rotor
from heli_core.linear import hover_system
from heli_core.rows import ACTUATOR, NINE
from heli_core.ticks import TICK_S
from heli_dynamics_sim.trim import MovingModel
from heli_dynamics_sim.wind import dryden_scales
from heli_flight.position_axes import PositionAxes, attitude_lags_s
from heli_flight.settings import resolve
from heli_inner_hinf.controller_state import Actuation
from heli_outer_pd.analysis import (
    AxisReport,
    AxisRequirements,
    Gains,
    analyse,
    best_gains,
    drifting,
    dryden_across,
)
from heli_outer_pd.parameters import OBSERVER_DAMPING, outer_params
from heli_studies.design.linear import NO_GROUND
from heli_studies.design.make import Basis, FinishedDesign, design_of
from support.ah1s import Hovered, chirps, hovered

RIGID = ModelStructure(Rotor.QUASI_STATIC, yaw_gyro=False)
RATES = [STATE.p, STATE.q, STATE.r]
_RADIUS_M, _CHORD_M, _BLADES = 22 * 0.3048, 27 * 0.0254, 2
_LIFT_SLOPE, _AIR_KGPM3 = 5.5, 1.225
_FORCE_HZ = 1.0
"""Below it the forces are fitted: what the position loop acts at."""


@dataclass(frozen=True)
class Forces:
    """Specific force about hover: V v + K (p', q', r') + U (d_ped, d_col), body axes.

    Attributes
    ----------
    V : (3, 3) array
        By u, v, w through the air, 1/s.
    K : (3, 3) array
        By the angular accelerations, m.
    U : (3, 2) array
        m/s2.
    explained : (3,) array
        Share of the power of x, y, z below 1 Hz.
    """

    V: np.ndarray
    K: np.ndarray
    U: np.ndarray
    explained: np.ndarray


@cache
def chirped() -> Hovered:
    """The record that it is identified from."""
    return hovered(chirps(), 1)


@cache
def identified() -> IdentifiedAB:
    """A, B, servos, delay of the quasi-static structure without a gyro."""
    return fit_record(chirped().record, structure=RIGID)


def angular_acceleration(model, record):
    """(N, 3) of the fitted model at the record's rates, sticks and speeds."""
    A, B, E = (matrix[RATES] for matrix in (model.A, model.B, model.E[:, AIR.velocity]))
    return record.rate_body_radps @ A[:, RATES].T + record.u @ B.T - record.vel_body_mps @ E.T


@cache
def forces() -> Forces:
    """Fitted by least squares to the accelerometers of the record."""
    flight, low = chirped(), butter(4, 2.0 * _FORCE_HZ * TICK_S, output="sos")
    record = flight.record
    parts = [
        record.vel_body_mps,
        angular_acceleration(identified().fast, record),
        record.u[:, [ACTUATOR.ped, ACTUATOR.col]],
    ]
    M, f = (
        sosfiltfilt(low, x - x.mean(axis=0), axis=0)
        for x in (np.hstack(parts), flight.force_body_mps2)
    )
    slopes = np.linalg.lstsq(M, f, rcond=None)[0]
    explained = 1.0 - np.sum((f - M @ slopes) ** 2, axis=0) / np.sum(f**2, axis=0)
    V, K, U = np.split(slopes.T, [3, 6], axis=1)
    return Forces(V, K, U, explained)


@cache
def basis() -> Basis:
    """What a design is made from, all of it identified or measured on the ground."""
    ab, flight = identified(), chirped()
    record = flight.record
    gravity = float(np.linalg.norm(flight.force_body_mps2.mean(axis=0)))
    x, u = np.zeros(len(NINE)), record.u.mean(axis=0)
    x[[NINE.phi, NINE.theta]] = ab.phi_rad, ab.theta_rad
    rotor = RotorGeometry(
        _AIR_KGPM3, flight.rotor_radps, _RADIUS_M, _LIFT_SLOPE, float(_BLADES), _CHORD_M
    )
    per_pitch = rotor.thrust_per_pitch(flight.mass_kg * gravity) / flight.mass_kg
    ground = {"mass": flight.mass_kg, "gravity": gravity}
    ground |= {f"rotor.{name}": getattr(rotor, name) for name in rotor.__annotations__}
    ground |= {"rotor.blades": _BLADES, "rotor.K_col": float(-forces().U[2, 1] / per_pitch)}
    A, B, E = full_matrices(ab.fast, ab.phi_rad, ab.theta_rad)
    return Basis(
        source="JSBSim's ah1s, identified in flight",
        system=hover_system(A, B, E, "identified"),
        x_trim=x,
        u_trim=u,
        actuation=Actuation(ab.servo_radps, ab.servo_damping, ab.delay_ticks * TICK_S),
        outer=ground,
        plant={},
        residual=float("nan"),
    )


@cache
def designed(controller: str, gamma_factor: float | None = None) -> FinishedDesign:
    """By the packaged weights."""
    settings = resolve(controller=controller, overrides={"inner_loop": dict(NO_GROUND)})
    return design_of(basis(), settings, gamma_factor=gamma_factor)


# -------------------------------------------------------------------------------------------------
# Position gains.
# -------------------------------------------------------------------------------------------------

_DOUBT = 0.3
FLIGHT_HEIGHT_M, _W20_MPS, _PASSING_MPS = 30.0, 5.0, 5.0
_OURS_RADIUS_M = 0.705
SCALE = _RADIUS_M / _OURS_RADIUS_M
"""Lengths of this aircraft over those of the default one (rotor radii)."""
_WANTED = ((0.16, 0.15, 0.05), (0.25, 0.15, 0.05), (0.10, 0.09, np.inf))
"""Of position, m, and speed, m/s, at 3.5 sigma, and of the command's step, of the default one."""
AS_IT_IS = {"collective_prediction_s": 0.0}
"""The vertical speed is fed back unpredicted: these flights are older than the prediction."""


def moving() -> MovingModel:
    """The nine derivatives, then the accelerations of the mass centre, as identified."""
    made, found, ab = basis(), forces(), identified()
    g, rates = made.outer["gravity"], [NINE.p, NINE.q, NINE.r]
    A = np.vstack([made.A, found.K @ made.A[rates]])
    A[9, NINE.theta] -= g
    A[10, NINE.phi] += g
    of_sticks = found.K @ ab.fast.B[RATES]
    of_sticks[:, [ACTUATOR.ped, ACTUATOR.col]] += found.U
    B = np.vstack([np.hstack([made.B, ab.B_col[:, None]]), of_sticks])
    return MovingModel(A, B, np.vstack([made.E, -found.V]))


def _gusts():
    sigma, sigma_w, length_m, length_w_m = dryden_scales(FLIGHT_HEIGHT_M, _W20_MPS)
    along = drifting(sigma, length_m / _PASSING_MPS)
    across = dryden_across(sigma, length_m / _PASSING_MPS)
    return ((along,), (across,), (dryden_across(sigma_w, length_w_m / _PASSING_MPS),))


def _stronger(axis, factor):
    act = axis.actuation
    commanded = np.array([factor, 1.0])
    return replace(axis, actuation=act._replace(B=act.B * commanded, D=act.D * commanded))


@dataclass(frozen=True)
class PositionDesign:
    """Gains of the outer loop, and what its axes say of them.

    Attributes
    ----------
    values : dict
        Parameters of the outer loop.
    reports : tuple of AxisReport
        Forward, right, down.
    """

    values: dict
    reports: tuple[AxisReport, ...]


@cache
def position_design(controller: str, gamma_factor: float | None = None) -> PositionDesign:
    """Searched around the attitude loop as flown."""
    design = designed(controller, gamma_factor)
    attitude = design.loops[-1]
    own = {
        "outer_loop": dict(design.values["outer_loop"]) | AS_IT_IS,
        "inner_loop": dict(NO_GROUND),
    }
    outer = resolve(overrides=own).nodes["outer_loop"]
    lags_s, kernel = attitude_lags_s(attitude), outer_params(outer)
    around = PositionAxes(
        None, attitude, design.model, None, moving(), lags_s, kernel, outer["period_ticks"]
    )
    late = replace(design.actuation, delay_s=design.actuation.delay_s + TICK_S)
    slow = replace(late, servo_radps=(1.0 - _DOUBT) * late.servo_radps)
    gusts, found = _gusts(), []
    axes = around.axes(design.actuation, gusts)
    later, slower = around.axes(late, gusts), around.axes(slow, gusts)
    for i, axis in enumerate(axes):
        others = (
            later[i], slower[i], _stronger(axis, 1.0 + _DOUBT), _stronger(axis, 1.0 - _DOUBT)
        )  # fmt: skip
        position_m, speed_mps, step_mps2 = _WANTED[i]
        wanted = AxisRequirements(
            SCALE * position_m / 3.5,
            math.sqrt(SCALE) * speed_mps / 3.5,
            step_mps2=step_mps2,
            disk_margin=0.6,
            disk_margin_of_others=0.4,
        )
        filter_s = outer["attitude_lead.filter_s"]
        found.append(
            best_gains("forward right down".split()[i], axis, others, wanted,
                       OBSERVER_DAMPING, filter_s)
        )  # fmt: skip
    K_P, K_D, bandwidth, lead_s = (list(column) for column in zip(*found, strict=True))
    gains = {
        "K_P": K_P,
        "K_D": K_D,
        "disturbance.bandwidth_radps": bandwidth,
        "attitude_lead.lead_s": lead_s[:2],
    }
    values = {**design.values["outer_loop"], **AS_IT_IS, **gains}
    flown = outer_params({**outer, **gains})
    reports = tuple(analyse(axis, Gains.of(flown, i)) for i, axis in enumerate(axes))
    return PositionDesign(values, reports)
