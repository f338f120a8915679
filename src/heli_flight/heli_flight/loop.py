# SPDX-License-Identifier: Apache-2.0
"""The whole loop in one process, without ROS: the nodes' kernels, called in the graph's order.

Tick n: the plant measures; the observer takes the measurements and the actuators of tick n-1; every
`period_ticks` the outer loop gives attitude and collective; the inner loop gives the actuators; the
plant integrates to n+1. The ROS graph calls the same kernels with the same numbers.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from heli_dynamics_sim import noise, plant
from heli_dynamics_sim.wind import injected_gust
from heli_flight.loop.laws import refuse_own_laws
from heli_flight.loop.linked import (
    Linked,
    linked,
    rotor_heard,
    to_inner_loop,
    to_observer,
    to_outer_loop,
    to_plant,
)
from heli_flight.loop.record import FlightRecord
from heli_flight.loop.settings import Settings
from heli_flight.loop.track import empty_track, record_of
from heli_inner_hinf import attitude_law as inner
from heli_inner_hinf.attitude_disturbance import disturbance_kernel
from heli_inner_hinf.design import attitude_kernel
from heli_inner_hinf.excitation import (
    SENT,
    ExcitationKernel,
    excitation_kernel,
    excite,
    initial_excitation_state,
)
from heli_inner_hinf.ground_law import law_or_hand
from heli_inner_hinf.law_state import initial_law_state, nine_states
from heli_math.arrays import copy, fill, scratch, scratch_matrix
from heli_math.jit import njit, njit_counted, njit_unlocked
from heli_math.rotations import fill_R_nb
from heli_math.rows import (
    ACTUATOR,
    MEAS,
    NAV,
    NINE,
    PLANT,
    REFERENCE,
    SETPOINT,
    TRUTH,
)
from heli_math.sweep import SweepKernel, add_sweep
from heli_math.ticks import Rate
from heli_math.trajectory import Trajectory, reference_at
from heli_modes.failsafes import Action
from heli_modes.table import LANDING
from heli_msgs_bridge.links import NOTHING
from heli_observer import observer
from heli_observer.layout import ObserverKernel
from heli_outer_pd import position_law as outer
from heli_outer_pd.config import outer_kernel
from heli_outer_pd.goto import Goto
from heli_outer_pd.hand_law import hand_of
from heli_outer_pd.phase_ways import PhaseNumbers
from heli_outer_pd.phases import Phases
from heli_outer_pd.reference import fill_offset, move
from heli_outer_pd.reference_limits import ReferenceLimits
from heli_outer_pd.rotor_watch import hear_rotor
from heli_outer_pd.script import script_of
from heli_outer_pd.sight import answer

_CHUNK_TICKS = 6000
_N_MEAS, _N_NAV, _N_STATES, _N_REFERENCE = MEAS.size, NAV.size, len(NINE), REFERENCE.size
_N_SETPOINT, _N_ACTUATOR = SETPOINT.size, ACTUATOR.size


class Loop(NamedTuple):
    """Kernels' numbers and states of one aircraft in flight; states are changed in place."""

    plant_k: plant.PlantKernel
    plant_s: plant.PlantState
    observer_k: ObserverKernel
    observer_s: observer.ObserverState
    inner_k: inner.AttitudeKernel
    inner_s: np.ndarray
    excitation_k: ExcitationKernel
    excitation_s: np.ndarray
    disturbance_k: SweepKernel
    outer_k: outer.OuterKernel
    outer_s: np.ndarray
    hand: np.ndarray  # (3,) a pilot's d_lat, d_lon, d_ped about trim; NaN while the law flies
    period_ticks: int
    true_navigation: int
    # (2,) int64: 1 while the reference is still to be moved to where the aircraft is; tick of that.
    anchor: np.ndarray
    tick_ns: int
    tick_s: float
    links: Linked
    seen: np.ndarray  # (31,) navigation as the outer loop had it last


@njit_counted
def _turn(q, v, out):
    """Body vector (3,) into NED (3,), summed by BLAS, as all records have been so far."""
    R = scratch_matrix(3, 3)
    fill_R_nb(q, R)
    np.dot(R, v, out)


@njit
def write_truth(s, y, out):
    """Truth row (19,) of a plant's state and what it measures."""
    x = s.x
    copy(out[TRUTH.pos], x[PLANT.pos])
    _turn(x[PLANT.quat], x[PLANT.vel], out[TRUTH.vel])
    copy(out[TRUTH.quat], x[PLANT.quat])
    copy(out[TRUTH.rate], x[PLANT.rate])
    copy(out[TRUTH.rotor], x[PLANT.rotor])
    copy(out[TRUTH.wind], y[MEAS.wind])


@njit
def replace_by_truth(truth, nav):
    """Ideal navigation: what the sensors cannot spoil (for analysis, never for a score)."""
    copy(nav[NAV.motion], truth[TRUTH.motion])


@njit_unlocked
def fly(loop, first_tick, n_ticks, noise_rows, times_ns, points, setpoint, u, track):
    """Fly n_ticks from first_tick; returns (ticks flown, plant status).

    It ends early where the law has lost its position or found it again.

    Parameters
    ----------
    loop : Loop
    first_tick, n_ticks : int
    noise_rows : (n_ticks, NOISE.size) ndarray
    times_ns, points : ndarray
        Reference trajectory; the points are moved in place when the law engages, if they are to be.
    setpoint, u : (4,) ndarray
        Last phi, theta, psi, d_col and last actuators; changed in place.
    track : Track
        Rows first_tick .. first_tick + n_ticks - 1 are written.
    """
    y, nav, x9, u3 = scratch(_N_MEAS), scratch(_N_NAV), scratch(_N_STATES), scratch(3)
    reference, offset = scratch(_N_REFERENCE), scratch(3)
    # What is heard of it: the same, but for links that have faults.
    heard, flown, aim, hand = (
        scratch(_N_MEAS),
        scratch(_N_ACTUATOR),
        scratch(_N_SETPOINT),
        scratch(3),
    )
    links, seen = loop.links, loop.seen
    fill(y, 0.0)
    fill(nav, 0.0)
    for i in range(n_ticks):
        tick = first_tick + i
        plant.measure(loop.plant_s, tick, noise_rows[i], loop.plant_k, y)
        write_truth(loop.plant_s, y, track.truth[tick])
        copy(heard, y)
        copy(flown, u)
        if links.k.on:
            to_observer(links, tick, loop.observer_s, loop.observer_k, heard, flown)
        observer.observe(loop.observer_s, tick, heard, flown, loop.observer_k, nav)
        if loop.true_navigation:
            replace_by_truth(track.truth[tick], nav)
        copy(seen, nav)
        if links.k.on:
            is_late = to_outer_loop(links, tick, seen)
            loop.outer_s[outer.MEMORY.is_late] = 1.0 if is_late else 0.0
        if loop.anchor[0] and tick % loop.period_ticks == 0 and outer.flyable(seen):
            fill_offset(seen[NAV.pos], tick * loop.tick_ns, times_ns, points, offset)
            move(points, offset)
            loop.anchor[0], loop.anchor[1] = 0, tick
        reference_at(tick * loop.tick_ns, times_ns, points, reference)
        sight, gone = loop.outer_s[outer.MEMORY.sight], loop.outer_s[outer.MEMORY.gone]
        spin, spun = loop.outer_s[outer.MEMORY.spin], rotor_heard(links, tick, heard)
        if spun != NOTHING:
            hear_rotor(loop.outer_s, spun * loop.tick_s, heard[MEAS.rotor], loop.outer_k)
        if tick % loop.period_ticks == 0:
            outer.follow(
                seen, tick * loop.tick_ns, times_ns, points, loop.outer_k, loop.outer_s, setpoint
            )
            hand_of(loop.outer_s, loop.hand)
        nine_states(nav, nav[NAV.rotor], x9)
        copy(aim, setpoint)
        copy(hand, loop.hand)
        if links.k.on:
            to_inner_loop(links, tick, loop.period_ticks, nav, aim, hand, x9)
        add_sweep(tick * loop.tick_s, loop.disturbance_k, x9)
        attitude, collective = aim[SETPOINT.attitude], aim[SETPOINT.col]
        law_or_hand(x9, attitude, collective, hand, loop.inner_k, loop.inner_s, u3)
        copy(u[ACTUATOR.attitude], u3)
        u[ACTUATOR.col] = aim[SETPOINT.col]
        if loop.excitation_k.on:
            excite(tick * loop.tick_s, x9, loop.excitation_k, loop.excitation_s, loop.inner_s, u)
        copy(track.imu[tick], y[MEAS.imu])
        if track.gust.shape[0] > 0:
            sines, time_s = loop.plant_k.wind.sines, tick * loop.tick_s
            copy(track.excitation[tick], loop.excitation_s[SENT : SENT + ACTUATOR.size])
            injected_gust(loop.plant_s.x, time_s, sines, track.gust[tick])
        copy(track.nav[tick], nav)
        copy(track.reference[tick], reference)
        copy(track.setpoint[tick], setpoint)
        copy(track.u[tick], u)
        status = plant.status(loop.plant_s, loop.plant_k)
        if status != 0:
            return i + 1, status
        copy(flown, u)
        if links.k.on:
            to_plant(links, tick, y[MEAS.rate], flown)
        plant.advance(loop.plant_s, flown, loop.plant_k)
        known = loop.outer_s[outer.MEMORY.sight] == sight
        known = known and loop.outer_s[outer.MEMORY.spin] == spin
        if not known or loop.outer_s[outer.MEMORY.gone] != gone:
            return i + 1, 0
    return n_ticks, 0


class Flight(NamedTuple):
    """A flight of the one-process loop."""

    record: FlightRecord
    status: plant.PlantStatus
    sentence: str


def build(
    settings: Settings,
    true_navigation: bool = False,
    plant_config: plant.PlantConfig | None = None,
    law: inner.AttitudeKernel | None = None,
) -> Loop:
    """Kernels' numbers and fresh states for a flight.

    Parameters
    ----------
    settings : Settings
        Without a law in Python: that is flown by `own_loop`.
    true_navigation : bool
        As in `simulate`.
    plant_config : PlantConfig, optional
        Another aircraft than that of the settings; the controllers do not know.
    law : AttitudeKernel, optional
        A law that is designed already.

    Raises
    ------
    ParameterError, TrimError, InfeasibleGammaError
        As the parts raise them, each with a sentence.
    """
    refuse_own_laws(settings)
    plant_config = plant_config or plant.PlantConfig.from_parameters(settings.nodes["plant"])
    observer_config = observer.ObserverConfig(settings.nodes["observer"])
    law = law or attitude_kernel(settings.nodes["inner_loop"])
    outer_k, rate = outer_kernel(settings.nodes["outer_loop"]), settings.rate
    plant_s = plant.initial_state(plant_config, settings.seed)
    return Loop(
        plant_config.kernel,
        plant_s,
        observer_config.kernel,
        observer.initial_state(observer_config),
        law,
        initial_law_state(law),
        excitation_kernel(settings.nodes["inner_loop"]),
        initial_excitation_state(),
        disturbance_kernel(settings.nodes["inner_loop"]),
        outer_k,
        outer.initial_state(outer_k),
        np.full(3, np.nan),
        rate.of(settings.nodes["outer_loop"]["period_ticks"]),
        int(true_navigation),
        np.array([settings.nodes["outer_loop"]["reference_anchor"] == "engagement", 0], np.int64),
        rate.tick_ns,
        rate.tick_s,
        linked(settings.nodes, settings.seed, plant_s.commands),
        np.full(NAV.size, np.nan),
    )


def simulate(settings: Settings, true_navigation: bool = False, progress=None) -> Flight:
    """Fly a scenario in this process.

    Parameters
    ----------
    settings : Settings
    true_navigation : bool
        Give the controllers the truth instead of the observer's estimate (analysis only).
    progress : callable, optional
        Called with the flight time (s) now and then.

    Returns
    -------
    Flight
    """
    return fly_loop(build(settings, true_navigation), settings, progress)


def fly_loop(loop: Loop, settings: Settings, progress=None, ticks=fly) -> Flight:
    """Fly a loop that is built already; its states are used up.

    Parameters
    ----------
    loop : Loop
        From `build`, or with parts of its own (perturbed aircraft, another law).
    settings : Settings
        Seed and scenario.
    progress : callable, optional
        Called with the flight time (s) now and then.
    ticks : callable
        What flies, with the arguments and the outcome of `fly`; below zero: it has given up.

    Returns
    -------
    Flight
    """
    rate = settings.rate
    n = rate.of(settings.scenario.n_ticks)
    track = empty_track(n, _excited(loop))
    streams = noise.NoiseStreams(settings.seed)
    reference = settings.scenario.reference
    times_ns, points = reference.times_ns, reference.points.copy()
    phases, scripted = _phases(loop, settings, Trajectory(0, times_ns, points))
    setpoint = loop.outer_k.trim.copy()
    setpoint[SETPOINT.psi] = reference.points[0, REFERENCE.psi]
    u = np.append(loop.inner_k.u_trim, setpoint[SETPOINT.col])
    tick, status, rows = 0, 0, streams.rows(0)
    acted = [(0, Action.NONE)]
    while tick < n and status == 0:
        asked = scripted or phases.lost or phases.gone
        count = min(_unasked(phases, tick, loop) if asked else _CHUNK_TICKS, n - tick)
        rows = np.concatenate((rows, streams.rows(max(count - len(rows), 0))))
        flown, status = ticks(loop, tick, count, rows[:count], times_ns, points, setpoint, u, track)
        tick, rows = tick + flown, rows[flown:]
        last = tick - 1
        if (asked or phases.lost or phases.gone) and status == 0 and last % loop.period_ticks == 0:
            went_on = phases.after(last * rate.tick_ns, loop.seen, setpoint)
            if went_on and phases.way is not None:
                times_ns, points = phases.way.times_ns, phases.way.points
            scripted = scripted or phases.phase in LANDING
        action = answer(phases.phase, loop.outer_s)
        acted += [(last, action)] if action != acted[-1][1] else []
        if progress is not None:
            progress(rate.seconds(tick))
    for before in range(loop.anchor[1]):
        reference_at(before * rate.tick_ns, times_ns, points, track.reference[before])
    named = plant.PlantStatus(max(status, 0))
    modes = _modes(phases, tick, rate) if scripted else None
    record = replace(record_of(track, tick, rate), mode=modes, failsafe=_actions(acted, tick))
    return Flight(record, named, "" if status <= 0 else named.sentence)


def _phases(loop: Loop, settings: Settings, given: Trajectory) -> tuple[Phases, bool]:
    """Phases of a flight, and whether it has any but that it follows its reference throughout."""
    p = settings.nodes["outer_loop"]
    numbers, orders = PhaseNumbers.from_parameters(p), script_of(p)
    fence, goto = ReferenceLimits.from_parameters(p), Goto.from_parameters(p)
    phases = Phases(numbers, goto, loop.outer_k, loop.outer_s, fence, orders)
    if not numbers.on_ground:
        phases.follow(given, 0)
        phases.home_ned_m = given.points[0, REFERENCE.pos].copy()
    return phases, numbers.on_ground or bool(orders)


def _modes(phases: Phases, n: int, rate: Rate) -> np.ndarray:
    """Mode (n,) at each tick."""
    modes = np.empty(n, "U10")
    for began_ns, phase in phases.history:
        modes[began_ns // rate.tick_ns :] = phase.mode
    return modes


def _actions(acted: list[tuple[int, Action]], n: int) -> np.ndarray | None:
    """What the position loop did by itself (n,) at each tick; None for nothing throughout."""
    if len(acted) == 1:
        return None
    actions = np.empty(n, "U14")
    for tick, action in acted:
        actions[tick:] = action.name
    return actions


def _unasked(phases: Phases, tick: int, loop: Loop) -> int:
    """Ticks to the next step of the law, that with it, after which something may follow."""
    due, order_ns = tick, phases.next_order_ns()
    if not phases.is_watched():
        if order_ns is None:
            return _CHUNK_TICKS
        due = max(tick, -(-order_ns // loop.tick_ns))
    step = -(-due // loop.period_ticks) * loop.period_ticks
    return min(step + 1 - tick, _CHUNK_TICKS)


def _excited(loop: Loop) -> bool:
    return bool(loop.excitation_k.on or loop.plant_k.wind.sines.on)
