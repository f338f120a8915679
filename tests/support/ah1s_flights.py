# SPDX-License-Identifier: Apache-2.0
"""Flights of JSBSim's AH-1S by our loops, and the facts of each; SI, deg where a name says so.

No requirement is from the flights: they are of a standard for full-size helicopters, ADS-33E-PRF
(US Army, 2000): the hover of 3.11.1, the damping ratio of 3.3.2.2.2, the coupling of 3.3.9.2; in
wind 2 m, set before the first flight. The standard's numbers are quoted from memory.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

import heli
from heli_core.rotations import euler_angles, wrap_pi
from heli_core.rows import NAV, NINE, REFERENCE, TRUTH
from heli_core.ticks import TICK_S
from heli_flight.position_axes import attitude_lags_s
from heli_inner_hinf.loops import channel_margins
from heli_studies.design.linear import NO_GROUND
from support.ah1s import STILL, Ah1sPlant, Air
from support.ah1s_loops import (
    FLIGHT_HEIGHT_M,
    basis,
    designed,
    forces,
    identified,
    position_design,
)

HOVER_M, HOVER_DOWN_M, HOVER_HEADING_DEG = 0.91, 0.61, 5.0
"""ADS-33E-PRF, hover, desired: 3 ft, 2 ft, 5 deg."""
IN_WIND_M = 2.0
OVERSHOOT = math.exp(-math.pi * 0.35 / math.sqrt(1.0 - 0.35**2))
"""Of a damping ratio of 0.35."""
COUPLING = 0.25
"""Level 1: roll by pitch and pitch by roll, peak within 4 s over what was commanded."""
STEP_DEG, STEP_START_S, STEP_S = 5.0, 10.0, 4.0
WAY_M, CLIMB_M = 15.0, 10.0
_EARLY_S = 60.0
_BEGINS_S = 5.0
"""Left out of a hover: what the hand-over leaves."""
_START = {"start_pos_ned_m": [0.0, 0.0, -FLIGHT_HEIGHT_M]}
_NO_CLIMB = {"climb.start_s": 0.0, "climb.end_s": 0.0, "climb.speed_mps": 0.0}


class Controller(NamedTuple):
    """An attitude controller of ours; gamma as a multiple of gamma*, or as packaged."""

    name: str
    gamma_factor: float | None = None


OUTPUT, EQ_17 = Controller("hinf_output"), Controller("hinf", 1.2)
CONTROLLERS = {controller.name: controller for controller in (OUTPUT, EQ_17)}
AXES = ("roll", "pitch")


class Truth:
    """The true motion, as if measured."""

    def reset(self, rng, tick_s, nodes):
        """Nothing to begin with."""

    def step(self, tick, time_s, truth, y):
        """The truth (19,)."""
        return truth


class TrueState:
    """Navigation that knows the true motion; the flapping of the structure is 0."""

    def reset(self, rng, tick_s, nodes):
        """Nothing to begin with."""

    def step(self, tick, time_s, y, u, readings):
        """The navigation row (31,)."""
        nav = np.zeros(NAV.size)
        nav[NAV.motion] = readings["Truth"][TRUTH.motion]
        return nav


@dataclass(frozen=True)
class Flown:
    """A flight.

    Attributes
    ----------
    time_s : (N,) array
    off_ned_m : (N, 3) array
        True position less the reference.
    attitude_deg, setpoint_deg : (N, 3) array
    rate_dps : (N, 3) array
    vel_down_mps : (N,) array
    u : (N, 4) array
    air_ned_mps : (N, 3) array
    rotor_share : (N,) array
        Its speed over the governed one.
    lost : str
        Empty if it was not.
    """

    time_s: np.ndarray
    off_ned_m: np.ndarray
    heading_off_deg: np.ndarray
    attitude_deg: np.ndarray
    setpoint_deg: np.ndarray
    rate_dps: np.ndarray
    vel_down_mps: np.ndarray
    u: np.ndarray
    air_ned_mps: np.ndarray
    rotor_share: np.ndarray
    lost: str


def flown(
    scenario="hover",
    scenario_values=_NO_CLIMB,
    *,
    controller=OUTPUT,
    observer=False,
    air=STILL,
    plant=None,
    outer=None,
    duration_s=60.0,
):
    """Fly it: outer and inner loop of this stack on JSBSim, world `paper`.

    observer: with our sensors (RTK) and observer; else navigation is true.
    """
    design, position = designed(*controller), position_design(*controller)
    values = {node: dict(of) for node, of in design.values.items()}
    values["outer_loop"] = position.values | (outer or {})
    values["inner_loop"] |= NO_GROUND
    values["scenario"] = _START | scenario_values
    plant = plant or Ah1sPlant(air)
    flight = heli.fly(
        scenario, world="paper", gps="rtk", seed=air.seed, controller=controller.name,
        params=values, plant=plant, sensors=[] if observer else [Truth()],
        estimator=None if observer else TrueState(), duration_s=duration_s, quiet=True,
    )  # fmt: skip
    record = flight._flown.record
    attitude = euler_angles(record.truth_q_nb)
    heading = record.reference[:, REFERENCE.psi]
    return Flown(
        record.time_s,
        record.truth_pos_ned_m - record.reference[:, REFERENCE.pos],
        np.degrees([wrap_pi(x) for x in attitude[:, 2] - heading]),
        np.degrees(attitude),
        np.degrees(record.setpoint),
        np.degrees(record.truth_rate_body_radps),
        record.truth_vel_ned_mps[:, 2],
        record.u,
        record.wind_ned_mps,
        np.array(plant.rotor_share),
        flight.lost or "",
    )


# -------------------------------------------------------------------------------------------------
# What they are made of.
# -------------------------------------------------------------------------------------------------


def identified_facts():
    """Of the model that everything is designed from."""
    found, made, felt = identified(), basis(), forces()
    poles = np.linalg.eigvals(made.A)
    return {
        "mass_kg": made.outer["mass"],
        "p_p_1ps": float(made.A[NINE.p, NINE.p]),
        "q_q_1ps": float(made.A[NINE.q, NINE.q]),
        "r_r_1ps": float(made.A[NINE.r, NINE.r]),
        "growth_1ps": float(poles.real.max()),
        "servo_radps": found.servo_radps,
        "delay_ticks": found.delay_ticks,
        "distortion": float(found.estimate.distortion),
        "heave_damping_1ps": float(-felt.V[2, 2]),
        "lift_mps2": float(felt.U[2, 1]),
        "explained": felt.explained.tolist(),
    }


def design_facts(controller):
    """Bound, margins and lags of the attitude loop; gains and margins of the position loop."""
    design, position = designed(*controller), position_design(*controller)
    report, bound = design.reports[-1], design.attitude.bound
    keys = ("K_P", "K_D", "disturbance.bandwidth_radps", "attitude_lead.lead_s")
    return {
        "gamma": bound.gamma,
        "gamma_star": bound.gamma_star.value,
        "disk_input": report.disk_input.alpha,
        "disk_output": report.disk_output.alpha,
        "lags_s": attitude_lags_s(design.loops[-1]).tolist(),
        "position": {key: list(position.values[key]) for key in keys},
        "position_disks": [axis.disk_margin for axis in position.reports],
        "position_crossovers_radps": [axis.crossover_radps for axis in position.reports],
    }


# -------------------------------------------------------------------------------------------------
# Hover, way, climb, steps.
# -------------------------------------------------------------------------------------------------


def away(flight, from_s=_BEGINS_S):
    """Largest distances from the reference, and how hard was worked for it."""
    kept = flight.time_s >= from_s
    off = flight.off_ned_m[kept]
    return {
        "lost": flight.lost,
        "horizontal_m": float(np.hypot(off[:, 0], off[:, 1]).max()),
        "down_m": float(np.abs(off[:, 2]).max()),
        "heading_deg": float(np.abs(flight.heading_off_deg[kept]).max()),
        "tilt_deg": float(np.abs(flight.attitude_deg[kept, :2]).max()),
        "at_limit": float(np.mean(np.abs(flight.u[kept]).max(axis=1) > 0.979)),
        "rotor_share": [float(flight.rotor_share.min()), float(flight.rotor_share.max())],
    }


def diagonal(speed_mps, w20_mps, seed=1):
    """Wind from 45 deg off the nose, as the hover test's."""
    each = -speed_mps / math.sqrt(2.0)
    return Air((each, each, 0.0), w20_mps, seed)


def handed_over_early(controller=OUTPUT, observer=False):
    """In steady wind of 5 m/s, while the simple feedback has not come to rest yet."""
    plant = Ah1sPlant(diagonal(5.0, 0.0), settle_s=_EARLY_S)
    flight = flown(controller=controller, observer=observer, air=diagonal(5.0, 0.0), plant=plant)
    return {"speed_mps": plant.speed_at_start_mps, **away(flight)}


def climbed(controller=OUTPUT, observer=False):
    """The hover test's climb of 10 m in still air."""
    return flown(scenario_values={}, controller=controller, observer=observer)


def went(controller=OUTPUT, observer=False):
    """15 m to the north, then 15 m to the east, at 3 m/s, nose to the north, in still air."""
    height = -FLIGHT_HEIGHT_M
    way = {
        "kind": "path",
        "path.kind": "waypoints",
        "path.start_s": _BEGINS_S,
        "path.speed_mps": 3.0,
        "path.heading": "fixed",
        "path.waypoints_ned_m": [WAY_M, 0.0, height, WAY_M, WAY_M, height],
        "path.stay_s": 8.0,
    }
    return flown(
        scenario_values=_NO_CLIMB | way, controller=controller, observer=observer, duration_s=45.0
    )


def stepped(axis, controller=OUTPUT, observer=False):
    """A step of the commanded roll or pitch, position not held; facts of the first one.

    None: 90 % were not reached, or it was not within 10 % at the end.
    """
    trim = position_design(*controller).values
    flight = flown(
        "attitude_steps",
        {},
        controller=controller,
        observer=observer,
        outer={
            "level_attitude_deg": np.degrees([trim["trim.phi"], trim["trim.theta"]]).tolist(),
            "sweep.axis": axis,
            "sweep.amplitude_deg": STEP_DEG,
        },
        duration_s=STEP_START_S + 2.0 * STEP_S,
    )
    own = AXES.index(axis)
    during = (flight.time_s >= STEP_START_S) & (flight.time_s < STEP_START_S + STEP_S)
    before = flight.time_s < STEP_START_S
    moved = flight.attitude_deg[during] - flight.attitude_deg[before][-1]
    share = moved[:, own] / STEP_DEG
    off = np.abs(share - 1.0) > 0.1
    rise = np.flatnonzero(share >= 0.9)
    return {
        "lost": flight.lost,
        "overshoot": max(float(share.max()) - 1.0, 0.0),
        "rise_s": float(rise[0] * TICK_S) if rise.size else None,
        "settling_s": None if off[-1] else float((np.flatnonzero(off)[-1] + 1) * TICK_S),
        "coupling": float(np.abs(moved[:, 1 - own]).max() / STEP_DEG),
    }


# -------------------------------------------------------------------------------------------------
# Margins: what the identified model says, and what is flown with gain or delay on a stick.
# -------------------------------------------------------------------------------------------------

STICKS = ("lat", "lon", "ped", "col")
_MOST_DB, _DB, _MOST_TICKS = 30.0, 0.5, 60
_SHAKES_DPS, _BOBS_MPS, _LAST_S = 1.0, 0.05, 5.0
"""A loop that has not come to rest so long after the last step, in still air, is unstable."""


class Margin(NamedTuple):
    """Of one stick, the others as they are: gain, dB, and delay, s."""

    gain_up_db: float
    delay_s: float


def predicted_margins(controller=OUTPUT):
    """Of lat, lon, ped by the attitude loop, of col by the vertical axis of the position loop."""
    attitude = channel_margins(designed(*controller).loops[-1])
    found = [Margin(channel.gain_up_db, channel.delay_s) for channel in attitude]
    report = position_design(*controller).reports[2]
    delay_s = math.radians(report.phase_margin_deg) / report.crossover_radps
    return (*found, Margin(report.gain_margin_db, delay_s))


def comes_to_rest(controller, gain=(1.0,) * 4, further_ticks=(0,) * 4):
    """Whether small steps of roll die out with these sticks; position not held, altitude is."""
    trim = position_design(*controller).values
    flight = flown(
        "attitude_steps",
        {},
        controller=controller,
        plant=Ah1sPlant(gain=gain, further_ticks=further_ticks, settle_s=_EARLY_S),
        outer={
            "level_attitude_deg": np.degrees([trim["trim.phi"], trim["trim.theta"]]).tolist(),
            "sweep.axis": "roll",
            "sweep.amplitude_deg": 2.0,
            "sweep.start_s": 2.0,
            "sweep.duration_s": 16.0,
        },
        duration_s=30.0,
    )
    last = flight.time_s >= flight.time_s[-1] - _LAST_S
    calm = flight.rate_dps[last].std(axis=0).max() < _SHAKES_DPS
    return bool(not flight.lost and calm and flight.vel_down_mps[last].std() < _BOBS_MPS)


def flown_margin(stick, controller=OUTPUT):
    """By bisection: to 0.5 dB, to a tick; inf where the most that is tried is stable."""
    place = STICKS.index(stick)

    def holds(db=0.0, ticks=0):
        gain, late = [1.0] * 4, [0] * 4
        gain[place], late[place] = 10.0 ** (db / 20.0), ticks
        return comes_to_rest(controller, gain, late)

    steps = round(_MOST_DB / _DB)
    db = _DB * _last_good(lambda n: holds(db=_DB * n), steps)
    ticks = _last_good(lambda n: holds(ticks=n), _MOST_TICKS)
    return Margin(
        db if db < _MOST_DB else math.inf, ticks * TICK_S if ticks < _MOST_TICKS else math.inf
    )


def _last_good(good, most):
    """Largest n up to `most` for which good(n), which is true of 0 and monotone."""
    if good(most):
        return most
    low, high = 0, most
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if good(middle) else (low, middle)
    return low
