# SPDX-License-Identifier: Apache-2.0
"""The whole loop in one process, without ROS: the nodes' kernels, called in the graph's order.

Tick n: the plant measures; the observer takes the measurements and the actuators of tick n-1; every
`period_ticks` the outer loop gives attitude and collective; the inner loop gives the actuators; the
plant integrates to n+1. The ROS graph calls the same kernels with the same numbers.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from heli_core.jit import (
    by_reference,
    copy,
    direct,
    fill,
    njit,
    njit_counted,
    njit_unlocked,
    scratch,
    scratch_matrix,
)
from heli_core.python_controller import INNER, OUTER, LawError, PythonLaw, find
from heli_core.rotations import fill_R_nb
from heli_core.rows import ACTUATOR, IMU, MEAS, NAV, NINE, PLANT, REFERENCE, SETPOINT, TRUTH
from heli_core.signals import NOTHING as NO_SWEEP
from heli_core.signals import SweepParams, add_sweep
from heli_core.ticks import Rate
from heli_core.trajectory import Trajectory, reference_at
from heli_dynamics_sim import noise, plant, servo
from heli_dynamics_sim.noise import NOISE
from heli_dynamics_sim.wind import injected_gust
from heli_flight.record import FlightRecord, FlightTrack, empty_track, record_of
from heli_flight.settings import Settings, own_laws, refuse_own_laws, without_own
from heli_inner_hinf import controllers as inner
from heli_inner_hinf import estimate
from heli_inner_hinf.controller_state import all_finite, initial_law_state, nine_states
from heli_inner_hinf.design import attitude_params
from heli_inner_hinf.excitation import (
    SENT,
    ExcitationParams,
    disturbance_params,
    excitation_params,
    excite,
    initial_excitation_state,
)
from heli_inner_hinf.ground_and_manual import OwnAttitudeLaw, law_or_hand
from heli_msgs_bridge import topics
from heli_msgs_bridge.links import (
    NOTHING,
    PLACE,
    LinkParams,
    LinkState,
    fault_rows,
    initial_links,
    link_params,
    pass_on,
)
from heli_observer import observer
from heli_observer.buffers import hear_fix, hear_imu
from heli_observer.layout import ObserverParams
from heli_outer_pd import inbox
from heli_outer_pd import position_law as outer
from heli_outer_pd.disturbance import hear_rotor
from heli_outer_pd.failsafes import Action
from heli_outer_pd.goto import Goto, PhaseNumbers
from heli_outer_pd.manual_controller import manual_deflections
from heli_outer_pd.modes import LANDING
from heli_outer_pd.parameters import outer_params
from heli_outer_pd.phases import Phases
from heli_outer_pd.position_health import answer
from heli_outer_pd.python_controller import OwnPositionLaw
from heli_outer_pd.reference import ReferenceLimits, fill_offset, move
from heli_outer_pd.script import script_of

# -------------------------------------------------------------------------------------------------
# The loop's links in one process: what each node hears where links have faults.
#
# The kernels are those of the nodes, in their order, on the same rows at the same ticks.
# -------------------------------------------------------------------------------------------------

_N_IMU, _N_NINE, _LINKED_N_NAV, _N_HANDED = IMU.size, len(NINE), NAV.size, 4
_TO_OBSERVER = "observer"
_IMU, _IMU2, _MAG, _BARO, _FIX, _VELOCITY, _FLOWN = (
    PLACE[topic, _TO_OBSERVER]
    for topic in (topics.IMU, topics.IMU2, topics.MAG, topics.BARO, topics.GPS_FIX,
                  topics.GPS_VELOCITY, topics.ACTUATORS)
)  # fmt: skip
_ODOM, _ROTOR, _ATTITUDE, _COLLECTIVE = (
    PLACE[topic, "inner_loop"]
    for topic in (topics.ODOM, topics.ROTOR_STATE, topics.ATTITUDE_SETPOINT, topics.COLLECTIVE)
)
_NAVIGATION = PLACE[topics.ODOM, "outer_loop"]
_SPINS = PLACE[topics.ROTOR_SPEED, "outer_loop"]
_COMMAND = PLACE[topics.ACTUATORS, "plant"]


@by_reference
class Linked(NamedTuple):
    """What nodes remember for links with faults; without any it is not used."""

    k: LinkParams
    s: LinkState
    model: estimate.EstimateParams
    known: estimate.EstimateState
    navigation: inbox.LatestNavigation
    fallback_n: servo.FallbackNumbers
    fallback_s: servo.FallbackState
    held: np.ndarray  # (7,) attitude, collective, hand as the inner loop heard them
    setpoint_tick: np.ndarray  # (1,) int64, of the attitude that it heard
    setpoint_ticks: int  # age from which on that is too old
    navigation_ticks: int
    tick_s: float


class HeldRow(NamedTuple):
    """Places of `Linked.held`."""

    attitude: slice = slice(0, 3)
    psi: int = 2
    handed: slice = slice(3, 7)
    col: int = 3
    hand: slice = slice(4, 7)
    size: int = 7


HELD = HeldRow()


def linked(nodes: Mapping[str, Mapping[str, Any]], seed: int, under_way: np.ndarray) -> Linked:
    """The links of a flight, by the parameter `link_faults` of each of its nodes.

    Parameters
    ----------
    nodes : mapping
        Parameters of each node.
    seed : int
    under_way : (n, 4) array
        Commands under way to the servos at the start; the last one is the trim.

    Raises
    ------
    ParameterError
        A fault that is none.
    """
    rate, inner = Rate.of_parameters(nodes["plant"]), nodes["inner_loop"]
    rows = [fault_rows(p["link_faults"], name, rate) for name, p in nodes.items()]
    k = link_params(np.concatenate(rows), seed, rate)
    model = estimate.estimate_params(inner)
    held = np.full(HELD.size, np.nan)
    held[HELD.attitude] = model.x_trim[[NINE.phi, NINE.theta, NINE.psi]]
    held[HELD.psi], held[HELD.col] = np.nan, inner["trim.u"][ACTUATOR.col]
    return Linked(
        k,
        initial_links(k, rate),
        model,
        estimate.initial_estimate(model),
        inbox.no_navigation(),
        servo.FallbackNumbers.from_parameters(nodes["plant"]),
        servo.initial_fallback(under_way[-1].copy() if len(under_way) else np.zeros(ACTUATOR.size)),
        held,
        np.full(1, NOTHING, np.int64),
        int(inner["setpoint_timeout_s"] * rate.hz),
        max(1, rate.ticks_in(nodes["outer_loop"]["navigation_timeout_s"])),
        rate.tick_s,
    )


@njit
def _value(links, link, tick, flag, y, first, count):
    """A sensor whose message comes at once: its numbers and its flag in the row y, in place."""
    row = y[first : first + count]
    valid = y[flag] > 0.5
    stamp = pass_on(links.s, links.k, link, tick, tick, valid, row, row)
    y[flag] = 1.0 if stamp != NOTHING else 0.0
    if stamp == NOTHING:
        fill(row, 0.0)


@njit
def _fix(links, tick, k, y):
    """A fix and its velocity, two messages with one stamp, in the row y, in place."""
    pos, vel, s = y[MEAS.gps_pos], y[MEAS.gps_vel], links.s
    came, stamp = y[MEAS.gps_valid] > 0.5, int(y[MEAS.gps_tick])
    of = pass_on(s, links.k, _VELOCITY, tick, stamp, came and all_finite(vel), vel, vel)
    stamp = pass_on(s, links.k, _FIX, tick, stamp, came, pos, pos)
    y[MEAS.gps_valid] = 1.0 if stamp != NOTHING else 0.0
    if stamp == NOTHING:
        fill(pos, 0.0)
        fill(vel, 0.0)
        y[MEAS.gps_tick] = 0.0
        return
    y[MEAS.gps_tick] = stamp
    if of != stamp:
        fill(vel, math.nan)
    if stamp < tick - k.horizon_ticks:
        hear_fix(tick, k, y)


@njit
def to_observer(links, tick, observer_s, observer_k, y, u):
    """What the observer hears at a tick, in place.

    Parameters
    ----------
    links : Linked
    tick : int
    observer_s, observer_k : ObserverState, ObserverParams
    y : (>= 28,) array
        Measurement row as it was sent; as it was heard.
    u : (4,) array
        Command of the tick before, the same; NaN for none.
    """
    sample = scratch(_N_IMU)
    copy(sample, y[MEAS.imu])
    stamp = pass_on(links.s, links.k, _IMU, tick, tick, all_finite(sample), sample, sample)
    fill(y[MEAS.imu], math.nan)
    if stamp != NOTHING:
        hear_imu(observer_s, tick, stamp, sample, observer_k, y)
    copy(sample, y[MEAS.imu2])
    stamp = pass_on(links.s, links.k, _IMU2, tick, tick, all_finite(sample), sample, sample)
    fill(y[MEAS.imu2], math.nan)
    if stamp == tick:
        copy(y[MEAS.imu2], sample)
    _value(links, _MAG, tick, MEAS.mag_valid, y, MEAS.mag.start, 3)
    _value(links, _BARO, tick, MEAS.baro_valid, y, MEAS.baro, 1)
    _fix(links, tick, observer_k, y)
    if pass_on(links.s, links.k, _FLOWN, tick, tick - 1, tick > 0, u, u) == NOTHING:
        fill(u, math.nan)


@njit
def to_outer_loop(links, tick, nav):
    """The navigation row (31,) as it was sent; in place, what the outer loop knows by then.

    True if that is of another tick, or nothing.
    """
    came = math.isfinite(nav[NAV.quat][0])
    stamp = pass_on(links.s, links.k, _NAVIGATION, tick, tick, came, nav, nav)
    if stamp != NOTHING:
        inbox.keep_newest(links.navigation, stamp, nav)
    oldest = links.navigation_ticks
    return inbox.navigation_at(links.navigation, tick, oldest, links.tick_s, nav)


@njit
def rotor_heard(links, tick, y):
    """Stamp of the rotor speed's sample that the outer loop hears at a tick, or NOTHING.

    y (>= 28,) is the measurement row as it was sent; in place, what it hears.
    """
    came = y[MEAS.rotor_valid] > 0.5
    if not links.k.on:
        return tick if came else NOTHING
    speed = y[MEAS.rotor : MEAS.rotor + 1]
    return pass_on(links.s, links.k, _SPINS, tick, tick, came, speed, speed)


@njit
def _to_setpoint(links, tick, psi, period_ticks, setpoint, hand):
    """What the inner loop flies of the outer loop's commands, in place; psi (rad) is now's."""
    held, s = links.held, links.s
    handed, attitude = scratch(_N_HANDED), scratch(3)
    came = tick % period_ticks == 0
    copy(attitude, setpoint[SETPOINT.attitude])
    handed[0] = setpoint[SETPOINT.col]
    for i in range(hand.shape[0]):
        handed[1 + i] = hand[i]
    stamp = pass_on(s, links.k, _ATTITUDE, tick, tick, came, attitude, attitude)
    if stamp != NOTHING:
        copy(held[HELD.attitude], attitude)
        links.setpoint_tick[0] = stamp
    if math.isnan(held[HELD.psi]):
        held[HELD.psi] = psi
    if pass_on(s, links.k, _COLLECTIVE, tick, tick, came, handed, handed) != NOTHING:
        copy(held[HELD.handed], handed)
    age = tick - links.setpoint_tick[0]
    copy(setpoint[SETPOINT.attitude], held[HELD.attitude])
    setpoint[SETPOINT.col] = held[HELD.col]
    if links.setpoint_tick[0] != NOTHING and age > links.setpoint_ticks:
        setpoint[SETPOINT.phi] = links.model.x_trim[NINE.phi]
        setpoint[SETPOINT.theta] = links.model.x_trim[NINE.theta]
        fill(held[HELD.hand], math.nan)
    copy(hand, held[HELD.hand])


@njit
def to_inner_loop(links, tick, period_ticks, nav, setpoint, hand, x9):
    """What the inner loop knows at a tick.

    Parameters
    ----------
    links : Linked
    tick, period_ticks : int
        The second one of the outer loop.
    nav : (31,) array
        As it was sent.
    setpoint, hand : (4,), (3,) arrays
        As they were sent; in place, what is flown of them.
    x9 : (9,) array
        Out: its estimate of now.
    """
    row, rotor, known = scratch(_LINKED_N_NAV), scratch(3), scratch(_N_NINE)
    came = math.isfinite(nav[NAV.quat][0])
    copy(row, nav)
    copy(rotor, nav[NAV.rotor])
    stamp = pass_on(links.s, links.k, _ODOM, tick, tick, came, row, row)
    of = pass_on(links.s, links.k, _ROTOR, tick, tick, came, rotor, rotor)
    if of == NOTHING:
        fill(rotor, math.nan)
    if stamp != NOTHING:
        nine_states(row, rotor, known)
        estimate.hear(links.known, stamp, known, of, links.model)
    estimate.estimate(links.known, tick, links.model, x9)
    _to_setpoint(links, tick, x9[NINE.psi], period_ticks, setpoint, hand)


@njit
def to_plant(links, tick, gyro, u):
    """The command (4,) as it was sent; in place, what the actuator side flies.

    gyro (3,): what the plant's own says, rad/s.
    """
    estimate.commanded(links.known, tick, u[ACTUATOR.attitude], links.model)
    if links.k.faulty[_COMMAND] == 0:
        return
    if pass_on(links.s, links.k, _COMMAND, tick, tick, True, u, u) != NOTHING:
        servo.hear(links.fallback_s, links.fallback_n, u)
    servo.step(links.fallback_s, links.fallback_n, gyro, 0)
    copy(u, links.fallback_s.out)


# -------------------------------------------------------------------------------------------------
# Closed loop.
# -------------------------------------------------------------------------------------------------

_CHUNK_TICKS = 6000
_N_MEAS, _N_NAV, _N_STATES, _N_REFERENCE = MEAS.size, NAV.size, len(NINE), REFERENCE.size
_N_SETPOINT, _N_ACTUATOR = SETPOINT.size, ACTUATOR.size


@by_reference
class AircraftInLoop(NamedTuple):
    """Kernels' numbers and states of one aircraft in flight; states are changed in place."""

    plant_k: plant.PlantParams
    plant_s: plant.PlantState
    observer_k: ObserverParams
    observer_s: observer.ObserverState
    inner_k: inner.AttitudeParams
    inner_s: np.ndarray
    excitation_k: ExcitationParams
    excitation_s: np.ndarray
    disturbance_k: SweepParams
    outer_k: outer.OuterParams
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
    loop : AircraftInLoop
    first_tick, n_ticks : int
    noise_rows : (n_ticks, NOISE.size) ndarray
    times_ns, points : ndarray
        Reference trajectory; the points are moved in place when the law engages, if they are to be.
    setpoint, u : (4,) ndarray
        Last phi, theta, psi, d_col and last actuators; changed in place.
    track : FlightTrack
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
            manual_deflections(loop.outer_s, loop.hand)
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


class LoopFlight(NamedTuple):
    """A flight of the one-process loop."""

    record: FlightRecord
    status: plant.PlantStatus
    sentence: str


def build(
    settings: Settings,
    true_navigation: bool = False,
    plant_config: plant.PlantConfig | None = None,
    law: inner.AttitudeParams | None = None,
) -> AircraftInLoop:
    """Kernels' numbers and fresh states for a flight.

    Parameters
    ----------
    settings : Settings
        Without a law in Python: that is flown by `fly_settings`.
    true_navigation : bool
        As in `simulate`.
    plant_config : PlantConfig, optional
        Another aircraft than that of the settings; the controllers do not know.
    law : AttitudeParams, optional
        A law that is designed already.

    Raises
    ------
    ParameterError, TrimError, InfeasibleGammaError
        As the parts raise them, each with a sentence.
    """
    refuse_own_laws(settings)
    plant_config = plant_config or plant.PlantConfig.from_parameters(settings.nodes["plant"])
    observer_config = observer.ObserverConfig(settings.nodes["observer"])
    law = law or attitude_params(settings.nodes["inner_loop"])
    outer_k, rate = outer_params(settings.nodes["outer_loop"]), settings.rate
    plant_s = plant.initial_state(plant_config, settings.seed)
    return AircraftInLoop(
        plant_config.params,
        plant_s,
        observer_config.params,
        observer.initial_state(observer_config),
        law,
        initial_law_state(law),
        excitation_params(settings.nodes["inner_loop"]),
        initial_excitation_state(),
        disturbance_params(settings.nodes["inner_loop"]),
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


def simulate(settings: Settings, true_navigation: bool = False, progress=None) -> LoopFlight:
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
    LoopFlight
    """
    return fly_loop(build(settings, true_navigation), settings, progress)


def fly_loop(loop: AircraftInLoop, settings: Settings, progress=None, ticks=fly) -> LoopFlight:
    """Fly a loop that is built already; its states are used up.

    Parameters
    ----------
    loop : AircraftInLoop
        From `build`, or with parts of its own (perturbed aircraft, another law).
    settings : Settings
        Seed and scenario.
    progress : callable, optional
        Called with the flight time (s) now and then.
    ticks : callable
        What flies, with the arguments and the outcome of `fly`; below zero: it has given up.

    Returns
    -------
    LoopFlight
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
            if went_on and phases.trajectory is not None:
                times_ns, points = phases.trajectory.times_ns, phases.trajectory.points
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
    return LoopFlight(record, named, "" if status <= 0 else named.sentence)


def _phases(loop: AircraftInLoop, settings: Settings, given: Trajectory) -> tuple[Phases, bool]:
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


def _unasked(phases: Phases, tick: int, loop: AircraftInLoop) -> int:
    """Ticks to the next step of the law, that with it, after which something may follow."""
    due, order_ns = tick, phases.next_order_ns()
    if not phases.is_watched():
        if order_ns is None:
            return _CHUNK_TICKS
        due = max(tick, -(-order_ns // loop.tick_ns))
    step = -(-due // loop.period_ticks) * loop.period_ticks
    return min(step + 1 - tick, _CHUNK_TICKS)


def _excited(loop: AircraftInLoop) -> bool:
    return bool(loop.excitation_k.on or loop.plant_k.wind.sines.on)


# -------------------------------------------------------------------------------------------------
# The whole loop in one process with a law given in Python: `loop.fly`, tick by tick.
#
# The same kernels in the same order with the same numbers, called one by one as the nodes call
# them,
# so what set-up has compiled for the nodes is all that it needs.
# -------------------------------------------------------------------------------------------------

GAVE_UP = -1
"""Outcome of ticks in which a law has failed."""


def fly_settings(
    settings: Settings,
    laws: Sequence[PythonLaw] = (),
    progress: Callable[[float], None] | None = None,
) -> LoopFlight:
    """Fly a scenario with the laws that are given, else that the settings name, else packaged ones.

    Parameters
    ----------
    settings : Settings
    laws : sequence of PythonLaw
        At most one of each loop. **A law that the settings name is imported**: its code runs.
    progress : callable, optional
        Called with the flight time (s) now and then.

    Returns
    -------
    LoopFlight
        Where a law has failed it ends there, with the law's sentence.

    Raises
    ------
    LawError, ParameterError, TrimError, SynthesisError
    """
    found = laws or [find(source) for source in own_laws(settings).values()]
    if not found:
        return simulate(settings, progress=progress)
    by_loop = {law.loop: law for law in found}
    if len(by_loop) < len(found):
        raise LawError("law: two of one loop are given; allowed: one of each")
    loop = build(without_own(settings))
    ticks = _Ticks(loop, by_loop)
    flight = fly_loop(loop, settings, progress, ticks.fly)
    why = next((law.failure for law in found if law.failure), "")
    return flight._replace(sentence=why) if why else flight


class _Ticks:
    """`fly` is called in the place of the compiled `loop.fly`."""

    def __init__(self, loop: AircraftInLoop, laws: Mapping[str, PythonLaw]) -> None:
        self._inner = OwnAttitudeLaw(laws.get(INNER))
        self._outer = OwnPositionLaw(laws.get(OUTER))
        self._laws = tuple(laws.values())
        self._y, self._nav = np.zeros(MEAS.size), np.zeros(NAV.size)
        # What is heard of them: the same, but for links that have faults.
        self._heard, self._flown = np.zeros(MEAS.size), np.zeros(ACTUATOR.size)
        self._aim, self._hand = np.zeros(SETPOINT.size), np.zeros(3)
        self._x9, self._u3 = np.zeros(len(NINE)), np.zeros(3)
        self._calls = _compiled(loop, self)

    def fly(
        self,
        loop: AircraftInLoop,
        first_tick: int,
        n_ticks: int,
        noise_rows: np.ndarray,
        times_ns: np.ndarray,
        points: np.ndarray,
        setpoint: np.ndarray,
        u: np.ndarray,
        track: FlightTrack,
    ) -> tuple[int, int]:
        """As `loop.fly`; GAVE_UP at the tick at which a law has failed."""
        status = self._calls["status"]
        for i in range(n_ticks):
            tick = first_tick + i
            before = self._sight(loop)
            self._sense(loop, tick, noise_rows[i], times_ns, points, u, track)
            reference_at(tick * loop.tick_ns, times_ns, points, track.reference[tick])
            if tick % loop.period_ticks == 0:
                self._follow(loop, tick, times_ns, points, setpoint)
            self._act(loop, tick, setpoint, u)
            track.imu[tick] = self._y[MEAS.imu]
            if track.gust.shape[0] > 0:
                self._write_excited(loop, tick, track)
            track.nav[tick], track.setpoint[tick], track.u[tick] = self._nav, setpoint, u
            if any(law.failure for law in self._laws):
                return i + 1, GAVE_UP
            code = status(loop.plant_s, loop.plant_k)
            if code != 0:
                return i + 1, code
            self._flown[:] = u
            if loop.links.k.on:
                to_plant(loop.links, tick, self._y[MEAS.rate], self._flown)
            self._calls["advance"](loop.plant_s, self._flown, loop.plant_k)
            if self._sight(loop) != before:
                return i + 1, 0
        return n_ticks, 0

    @staticmethod
    def _sight(loop: AircraftInLoop) -> tuple[float, float, float]:
        """What ends a stretch of ticks when it changes."""
        places = outer.MEMORY.sight, outer.MEMORY.gone, outer.MEMORY.spin
        sight, gone, spin = loop.outer_s[list(places)]
        return sight, gone, spin

    def _sense(
        self,
        loop: AircraftInLoop,
        tick: int,
        noise: np.ndarray,
        times_ns: np.ndarray,
        points: np.ndarray,
        u: np.ndarray,
        track: FlightTrack,
    ) -> None:
        """The plant measures, the observer estimates; the law may engage."""
        y, nav = self._y, self._nav
        self._calls["measure"](loop.plant_s, tick, noise, loop.plant_k, y)
        write_truth(loop.plant_s, y, track.truth[tick])
        heard, flown, seen = self._heard, self._flown, loop.seen
        heard[:], flown[:] = y, u
        if loop.links.k.on:
            to_observer(loop.links, tick, loop.observer_s, loop.observer_k, heard, flown)
        self._calls["observe"](loop.observer_s, tick, heard, flown, loop.observer_k, nav)
        if loop.true_navigation:
            replace_by_truth(track.truth[tick], nav)
        seen[:] = nav
        if loop.links.k.on:
            loop.outer_s[outer.MEMORY.is_late] = to_outer_loop(loop.links, tick, seen)
        spun = rotor_heard(loop.links, tick, heard)
        if spun != NOTHING:
            now_s = spun * loop.tick_s
            self._calls["spins"](loop.outer_s, now_s, heard[MEAS.rotor], loop.outer_k)
        if loop.anchor[0] and tick % loop.period_ticks == 0 and outer.flyable(seen):
            offset = np.zeros(3)
            fill_offset(seen[NAV.pos], tick * loop.tick_ns, times_ns, points, offset)
            move(points, offset)
            loop.anchor[0], loop.anchor[1] = 0, tick

    def _follow(
        self,
        loop: AircraftInLoop,
        tick: int,
        times_ns: np.ndarray,
        points: np.ndarray,
        setpoint: np.ndarray,
    ) -> None:
        k, state, now_ns = loop.outer_k, loop.outer_s, tick * loop.tick_ns
        given = loop.seen, now_ns, times_ns, points, k, state, setpoint
        self._outer.step(tick, tick * loop.tick_s, *given, self._calls["follow"])
        manual_deflections(state, loop.hand)

    def _act(self, loop: AircraftInLoop, tick: int, setpoint: np.ndarray, u: np.ndarray) -> None:
        """Nine states, attitude law, excitation: the actuators of this tick."""
        x9, time_s, aim, hand = self._x9, tick * loop.tick_s, self._aim, self._hand
        nine_states(self._nav, self._nav[NAV.rotor], x9)
        aim[:], hand[:] = setpoint, loop.hand
        if loop.links.k.on:
            to_inner_loop(loop.links, tick, loop.period_ticks, self._nav, aim, hand, x9)
        if loop.disturbance_k.shape != NO_SWEEP:
            add_sweep(time_s, loop.disturbance_k, x9)
        given = x9, aim[SETPOINT.attitude], aim[SETPOINT.col], hand
        numbers = loop.inner_k, loop.inner_s, self._u3
        self._inner.step(tick, time_s, *given, *numbers, self._calls["law"])
        u[ACTUATOR.attitude], u[ACTUATOR.col] = self._u3, aim[SETPOINT.col]
        if loop.excitation_k.on:
            excite(time_s, x9, loop.excitation_k, loop.excitation_s, loop.inner_s, u)

    def _write_excited(self, loop: AircraftInLoop, tick: int, track: FlightTrack) -> None:
        track.excitation[tick] = loop.excitation_s[SENT : SENT + ACTUATOR.size]
        sines, time_s = loop.plant_k.wind.sines, tick * loop.tick_s
        injected_gust(loop.plant_s.x, time_s, sines, track.gust[tick])


def _compiled(loop: AircraftInLoop, ticks: _Ticks) -> dict[str, Callable[..., Any]]:
    """The kernels of every tick for numbers of these types, as the nodes call them."""
    four, three = np.zeros(ACTUATOR.size), np.zeros(3)
    times, points = np.zeros(1, np.int64), np.zeros((1, REFERENCE.size))
    y, nav, x9 = ticks._y, ticks._nav, ticks._x9
    p, o = (loop.plant_s, loop.plant_k), (loop.outer_k, loop.outer_s, four)
    calls: dict[str, tuple[Any, ...]] = {
        "measure": (plant.measure, p[0], 0, np.zeros(NOISE.size), p[1], y),
        "observe": (observer.observe, loop.observer_s, 0, y, four, loop.observer_k, nav),
        "follow": (outer.follow, nav, 0, times, points, *o),
        "spins": (hear_rotor, loop.outer_s, 0.0, 0.0, loop.outer_k),
        "law": (law_or_hand, x9, three, 0.0, three, loop.inner_k, loop.inner_s, three),
        "status": (plant.status, *p),
        "advance": (plant.advance, p[0], four, p[1]),
    }
    return {name: direct(*call) for name, call in calls.items()}
