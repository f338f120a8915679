# SPDX-License-Identifier: Apache-2.0
"""The whole loop in one process, without ROS: the nodes' kernels, called in the graph's order.

Tick n: the plant measures; the observer takes the measurements and the actuators of tick n-1; every
`period_ticks` the outer loop gives attitude and collective; the inner loop gives the actuators; the
plant integrates to n+1:

    sense -> estimate -> guide -> listen -> control -> act

Each is a kernel on what came into an inbox, and the ROS nodes call the same ones with the same
numbers. `fly` is all of them compiled into one; a part that is given as an object in Python
(`Parts`) takes the place of one of them.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from heli_core.errors import PartError
from heli_core.inbox import NOTHING, Inbox, empty_inbox, put
from heli_core.jit import (
    by_reference,
    copy,
    direct,
    njit,
    njit_counted,
    njit_unlocked,
    scratch,
    scratch_matrix,
)
from heli_core.python_controller import INNER, OUTER, PythonLaw, find, in_one_line
from heli_core.rotations import fill_R_nb
from heli_core.rows import ACTUATOR, MEAS, NAV, NINE, PLANT, REFERENCE, SETPOINT, TRUTH
from heli_core.signals import SweepParams, add_sweep
from heli_core.ticks import Rate
from heli_core.trajectory import reference_at
from heli_dynamics_sim import noise, plant, servo
from heli_dynamics_sim.helicopter import same_air
from heli_dynamics_sim.linear_aircraft import PARAMETER as LINEAR
from heli_dynamics_sim.noise import NOISE
from heli_dynamics_sim.wind import injected_gust
from heli_flight.course import Course
from heli_flight.parts import Parts, with_linear, without_linear
from heli_flight.record import FlightRecord, FlightTrack, empty_track, record_of
from heli_flight.settings import Settings, own_laws, refuse_own_laws, without_own
from heli_inner_hinf import controllers as inner
from heli_inner_hinf import estimate
from heli_inner_hinf.controller_state import all_finite, initial_law_state
from heli_inner_hinf.design import attitude_params
from heli_inner_hinf.excitation import (
    SENT,
    ExcitationParams,
    disturbance_params,
    excitation_params,
    excite,
    initial_excitation_state,
)
from heli_inner_hinf.ground_and_manual import OwnAttitudeLaw, law_or_manual
from heli_msgs_bridge import topics
from heli_msgs_bridge.links import (
    PLACE,
    LinkParams,
    LinkState,
    fault_rows,
    initial_links,
    link_params,
    pass_on,
)
from heli_observer import observer
from heli_observer.layout import AID_PLACES, ObserverParams
from heli_outer_pd import outer_loop
from heli_outer_pd.manual_controller import manual_deflections
from heli_outer_pd.parameters import outer_params
from heli_outer_pd.python_controller import OwnPositionLaw
from heli_outer_pd.state import MACHINE, MEMORY, OuterParams

# -------------------------------------------------------------------------------------------------
# What a flight is made of.
# -------------------------------------------------------------------------------------------------

_N_HANDED = 4  # a collective, and behind it a pilot's deflections
_IMU, _IMU2, *_, _FIX, _VELOCITY, _FLOWN = range(len(observer.INPUTS))
_FIRST_AID = observer.AID_INPUTS.start
_ODOM, _ROTOR, _ATTITUDE, _COLLECTIVE = range(len(estimate.INPUTS))
_NAVIGATION, _ROTOR_SPEED = range(len(outer_loop.INPUTS))
_TO_OBSERVER = np.array([PLACE[topic, "observer"] for topic in observer.INPUTS])
_TO_INNER = np.array([PLACE[topic, "inner_loop"] for topic in estimate.INPUTS])
_TO_OUTER = np.array([PLACE[topic, "outer_loop"] for topic in outer_loop.INPUTS])
_TO_PLANT = PLACE[topics.ACTUATORS, "plant"]


@by_reference
class Links(NamedTuple):
    """What goes over links with faults; a flight without any has none."""

    k: LinkParams
    s: LinkState


@by_reference
class TickRows(NamedTuple):
    """What one part of a tick leaves for the next, changed in place."""

    y: np.ndarray  # (31,) measurement row
    nav: np.ndarray  # (31,) of the observer
    x9: np.ndarray  # (9,) states as the inner loop knows them
    aim: np.ndarray  # (7,) what it is to hold, places of `estimate.COMMAND`
    u3: np.ndarray  # (3,) output of the attitude controller


def _tick_rows() -> TickRows:
    return TickRows(
        np.zeros(MEAS.size),
        np.zeros(NAV.size),
        np.full(len(NINE), np.nan),
        np.full(estimate.COMMAND.size, np.nan),
        np.zeros(3),
    )


@by_reference
class AircraftInLoop(NamedTuple):
    """Kernels' numbers and states of one aircraft in flight; states are changed in place."""

    plant_k: plant.PlantParams
    plant_s: plant.PlantState
    fallback_k: servo.FallbackNumbers
    fallback_s: servo.FallbackState
    observer_k: ObserverParams
    observer_s: observer.ObserverState
    observer_in: Inbox
    inner_k: inner.AttitudeParams
    inner_s: np.ndarray
    estimate_k: estimate.EstimateParams
    estimate_s: estimate.EstimateState
    command: estimate.HeardCommand
    inner_in: Inbox
    excitation_k: ExcitationParams
    excitation_s: np.ndarray
    disturbance_k: SweepParams
    outer_k: OuterParams
    outer_s: outer_loop.OuterLoopState
    outer_in: Inbox
    period_ticks: int
    true_navigation: int
    tick_ns: int
    tick_s: float
    links: Links | None
    rows: TickRows


# -------------------------------------------------------------------------------------------------
# One tick, part by part.
# -------------------------------------------------------------------------------------------------


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
def _bring(links, box, place, link, tick, stamp, came, row):
    """Put a message into an inbox, or what its link lets through of those that were sent."""
    if links is None:
        put(box, place, stamp if came else NOTHING, row)
    else:
        out = box.rows[place, : row.shape[0]]
        box.stamps[place] = pass_on(links.s, links.k, link, tick, stamp, came, row, out)


@njit
def sense(loop, tick, noise_row, truth):
    """The plant measures; the row (19,) of the truth is written."""
    plant.measure(loop.plant_s, tick, noise_row, loop.plant_k, loop.rows.y)
    write_truth(loop.plant_s, loop.rows.y, truth)


@njit
def bring_sensors(loop, links, tick, u):
    """What the observer hears: the measurement row, and the actuators (4,) of the tick before."""
    box, y, to = loop.observer_in, loop.rows.y, _TO_OBSERVER
    imu, imu2, vel = y[MEAS.imu], y[MEAS.imu2], y[MEAS.gps_vel]
    # A link with faults carries what can be sent: a message whose numbers are finite.
    direct_way = links is None
    fix = y[MEAS.gps_valid] > 0.5
    true_at = int(y[MEAS.gps_tick]) if fix else tick
    _bring(links, box, _IMU, to[_IMU], tick, tick, direct_way or all_finite(imu), imu)
    _bring(links, box, _IMU2, to[_IMU2], tick, tick, direct_way or all_finite(imu2), imu2)
    for which in range(len(AID_PLACES)):
        at, place = AID_PLACES[which], _FIRST_AID + which
        sample = y[at.first : at.first + at.numbers]
        _bring(links, box, place, to[place], tick, tick, y[at.arrived] > 0.5, sample)
    has_vel = fix and (direct_way or all_finite(vel))
    _bring(links, box, _VELOCITY, to[_VELOCITY], tick, true_at, has_vel, vel)
    _bring(links, box, _FIX, to[_FIX], tick, true_at, fix, y[MEAS.gps_pos])
    _bring(links, box, _FLOWN, to[_FLOWN], tick, tick - 1, tick > 0, u)


@njit
def estimate_navigation(loop, links, tick, u, truth):
    """The observer makes of what it hears a navigation row, `rows.nav`."""
    nav = loop.rows.nav
    bring_sensors(loop, links, tick, u)
    observer.step(loop.observer_s, loop.observer_in, tick, loop.observer_k, nav)
    if loop.true_navigation:
        copy(nav[NAV.motion], truth[TRUTH.motion])


@njit
def perceive(loop, links, tick, noise_row, u, truth):
    """`sense`, then `estimate_navigation`: what is known before anything is commanded."""
    sense(loop, tick, noise_row, truth)
    estimate_navigation(loop, links, tick, u, truth)


@njit
def bring_navigation(loop, links, tick):
    """What the outer loop hears: the navigation row, and the rotor's speed."""
    y, nav, box, to = loop.rows.y, loop.rows.nav, loop.outer_in, _TO_OUTER
    came = math.isfinite(nav[NAV.quat][0])
    _bring(links, box, _NAVIGATION, to[_NAVIGATION], tick, tick, came, nav)
    turns, speed = y[MEAS.rotor_valid] > 0.5, y[MEAS.rotor : MEAS.rotor + 1]
    _bring(links, box, _ROTOR_SPEED, to[_ROTOR_SPEED], tick, tick, turns, speed)


@njit
def guide(loop, links, tick, times_ns, points, setpoint):
    """The outer loop, at its step: attitude and collective (4,) to hold.

    times_ns, points: reference trajectory; moved in place where the controller engages, if it is to
    be.
    """
    bring_navigation(loop, links, tick)
    box, period, now_ns = loop.outer_in, loop.period_ticks, tick * loop.tick_ns
    k, reference = loop.outer_k, (now_ns, times_ns, points)
    outer_loop.step(loop.outer_s, box, tick, period, *reference, k, setpoint)


@njit
def listen(loop, links, tick, setpoint):
    """The inner loop hears: `rows.x9` is where it is, `rows.aim` what it is to hold."""
    hear(loop, links, tick, tick % loop.period_ticks == 0, setpoint)


@njit
def hear(loop, links, tick, due, setpoint):
    """As `listen`, where the setpoint (4,) is sent at this tick only if it is `due`."""
    nav, box, to, rows = loop.rows.nav, loop.inner_in, _TO_INNER, loop.rows
    came = math.isfinite(nav[NAV.quat][0])
    sent = scratch(_N_HANDED)
    sent[0] = setpoint[SETPOINT.col]
    manual_deflections(loop.outer_s.law, sent[1:])
    _bring(links, box, _ODOM, to[_ODOM], tick, tick, came, nav)
    _bring(links, box, _ROTOR, to[_ROTOR], tick, tick, came, nav[NAV.rotor])
    attitude = setpoint[SETPOINT.attitude]
    _bring(links, box, _ATTITUDE, to[_ATTITUDE], tick, tick, due, attitude)
    _bring(links, box, _COLLECTIVE, to[_COLLECTIVE], tick, tick, due, sent)
    k, x9 = loop.estimate_k, rows.x9
    estimate.listen(loop.estimate_s, loop.command, box, tick, k, x9, rows.aim)
    add_sweep(tick * loop.tick_s, loop.disturbance_k, x9)


@njit
def control(loop, tick):
    """The attitude controller, or a pilot's hand, into `rows.u3`."""
    aim, command = loop.rows.aim, estimate.COMMAND
    attitude, manual = aim[command.attitude], aim[command.manual]
    inner_k, inner_s = loop.inner_k, loop.inner_s
    law_or_manual(loop.rows.x9, attitude, aim[command.col], manual, inner_k, inner_s, loop.rows.u3)


@njit
def command_actuators(loop, tick, u):
    """Actuators (4,) of this tick, in place: the controller's, the collective, the excitation."""
    copy(u[ACTUATOR.attitude], loop.rows.u3)
    u[ACTUATOR.col] = loop.rows.aim[estimate.COMMAND.col]
    if loop.excitation_k.on:
        k, s, time_s = loop.excitation_k, loop.excitation_s, tick * loop.tick_s
        excite(time_s, loop.rows.x9, k, s, loop.inner_s, u)
    estimate.commanded(loop.estimate_s, tick, u[ACTUATOR.attitude], loop.estimate_k)


@njit
def write(loop, tick, times_ns, points, setpoint, u, track):
    """The tick's row of the record (`FlightTrack`)."""
    copy(track.imu[tick], loop.rows.y[MEAS.imu])
    if track.gust.shape[0] > 0:
        sines, time_s = loop.plant_k.wind.sines, tick * loop.tick_s
        copy(track.excitation[tick], loop.excitation_s[SENT : SENT + ACTUATOR.size])
        injected_gust(loop.plant_s.x, time_s, sines, track.gust[tick])
    reference_at(tick * loop.tick_ns, times_ns, points, track.reference[tick])
    copy(track.nav[tick], loop.rows.nav)
    copy(track.setpoint[tick], setpoint)
    copy(track.u[tick], u)


@njit
def act(loop, links, tick, u):
    """The plant flies the command to the next tick, unless it cannot; its status."""
    status = plant.status(loop.plant_s, loop.plant_k)
    if status != 0:
        return status
    if links is None or links.k.faulty[_TO_PLANT] == 0:
        plant.advance(loop.plant_s, u, loop.plant_k)
        return 0
    k, s, heard = loop.fallback_k, loop.fallback_s, scratch(_N_HANDED)
    came = pass_on(links.s, links.k, _TO_PLANT, tick, tick, True, u, heard) != NOTHING
    servo.after(s, k, came, heard, loop.rows.y[MEAS.rate])
    plant.advance(loop.plant_s, s.out, loop.plant_k)
    return 0


@njit
def what_changes(state):
    """What ends a stretch of ticks when it changes, of what the outer loop knows."""
    machine, x = state.law.machine, state.law.x
    return machine[MACHINE.position], machine[MACHINE.rotor], int(x[MEMORY.gone])


@njit_unlocked
def fly_ticks(loop, links, first_tick, n_ticks, noise_rows, times_ns, points, setpoint, u, track):
    """As `fly`, over the loop's links."""
    for i in range(n_ticks):
        tick = first_tick + i
        before = what_changes(loop.outer_s)
        perceive(loop, links, tick, noise_rows[i], u, track.truth[tick])
        guide(loop, links, tick, times_ns, points, setpoint)
        listen(loop, links, tick, setpoint)
        control(loop, tick)
        command_actuators(loop, tick, u)
        write(loop, tick, times_ns, points, setpoint, u, track)
        status = act(loop, links, tick, u)
        if status != 0 or what_changes(loop.outer_s) != before:
            return i + 1, status
    return n_ticks, 0


def fly(
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
    """Fly n_ticks from first_tick; returns (ticks flown, plant status).

    It ends early where the controller has lost its position or found it again.

    Parameters
    ----------
    loop : AircraftInLoop
    first_tick, n_ticks : int
    noise_rows : (n_ticks, NOISE.size) array
    times_ns, points : arrays
        Reference trajectory; the points are moved in place when the controller engages, if they are
        to be.
    setpoint, u : (4,) arrays
        Last phi, theta, psi, d_col and last actuators; changed in place.
    track : FlightTrack
        Rows first_tick .. first_tick + n_ticks - 1 are written.
    """
    reference = times_ns, points
    flown: tuple[int, int] = fly_ticks(
        loop, loop.links, first_tick, n_ticks, noise_rows, *reference, setpoint, u, track
    )
    return flown


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
        Without a controller in Python or a linear aircraft: these are flown by `fly_settings`.
    true_navigation : bool
        As in `simulate`.
    plant_config : PlantConfig, optional
        Another aircraft than that of the settings; the controllers do not know.
    law : AttitudeParams, optional
        A controller that is designed already.

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
    nodes, outer_p = settings.nodes, settings.nodes["outer_loop"]
    begins = outer_loop.begins(outer_p)
    trim = plant_s.commands[-1].copy() if len(plant_s.commands) else np.zeros(ACTUATOR.size)
    estimate_k = estimate.estimate_params(nodes["inner_loop"])
    return AircraftInLoop(
        plant_config.params,
        plant_s,
        servo.FallbackNumbers.from_parameters(nodes["plant"]),
        servo.initial_fallback(trim),
        observer_config.params,
        observer.initial_state(observer_config),
        empty_inbox(len(observer.INPUTS)),
        law,
        initial_law_state(law),
        estimate_k,
        estimate.initial_estimate(estimate_k),
        estimate.no_command(estimate_k, nodes["inner_loop"]["trim.u"][ACTUATOR.col]),
        empty_inbox(len(estimate.INPUTS)),
        excitation_params(nodes["inner_loop"]),
        initial_excitation_state(),
        disturbance_params(nodes["inner_loop"]),
        outer_k,
        outer_loop.initial_loop(outer_k, outer_p["navigation_timeout_s"], rate, begins),
        empty_inbox(len(outer_loop.INPUTS)),
        rate.of(outer_p["period_ticks"]),
        int(true_navigation),
        rate.tick_ns,
        rate.tick_s,
        _links(nodes, settings.seed, rate),
        _tick_rows(),
    )


def _links(nodes: Mapping[str, Mapping[str, Any]], seed: int, rate: Rate) -> Links | None:
    """The links of a flight, by the parameter `link_faults` of each of its nodes."""
    rows = [fault_rows(p["link_faults"], name, rate) for name, p in nodes.items()]
    k = link_params(np.concatenate(rows), seed, rate)
    return Links(k, initial_links(k, rate)) if k.on else None


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
    if settings.nodes["plant"][LINEAR] and not true_navigation:
        return fly_settings(settings, progress=progress)
    return fly_loop(build(settings, true_navigation), settings, progress)


def fly_loop(loop: AircraftInLoop, settings: Settings, progress=None, ticks=fly) -> LoopFlight:
    """Fly a loop that is built already; its states are used up.

    Parameters
    ----------
    loop : AircraftInLoop
        From `build`, or with parts of its own (perturbed aircraft, another controller).
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
    course = Course(loop.outer_k, loop.outer_s, settings, loop.period_ticks)
    setpoint, u = first_commands(loop, settings)
    tick, status, rows = 0, 0, streams.rows(0)
    while tick < n and status == 0:
        count = min(course.unasked(tick), n - tick)
        rows = np.concatenate((rows, streams.rows(max(count - len(rows), 0))))
        reference = course.times_ns, course.points
        flown, status = ticks(loop, tick, count, rows[:count], *reference, setpoint, u, track)
        tick, rows = tick + flown, rows[flown:]
        course.after(tick - 1, setpoint, status == 0)
        if progress is not None:
            progress(rate.seconds(tick))
    for before in range(_moved_at(loop)):
        at_ns, row = before * rate.tick_ns, track.reference[before]
        reference_at(at_ns, course.times_ns, course.points, row)
    named = plant.PlantStatus(max(status, 0))
    record = record_of(track, tick, rate)
    record = replace(record, mode=course.modes(tick), failsafe=course.actions(tick))
    return LoopFlight(record, named, "" if status <= 0 else named.sentence)


def first_commands(loop: AircraftInLoop, settings: Settings) -> tuple[np.ndarray, np.ndarray]:
    """Setpoint (4,) and actuators (4,) before the first tick: the trim, the scenario's heading."""
    setpoint = loop.outer_k.trim.copy()
    setpoint[SETPOINT.psi] = settings.scenario.reference.points[0, REFERENCE.psi]
    return setpoint, np.append(loop.inner_k.u_trim, setpoint[SETPOINT.col])


def _moved_at(loop: AircraftInLoop) -> int:
    """Tick at which the reference was moved; 0 if it was not."""
    engagement, at = loop.outer_s.engagement, outer_loop.ENGAGEMENT
    moved = engagement[at.reference] == outer_loop.MOVED
    return max(int(engagement[at.tick]), 0) if moved else 0


def _excited(loop: AircraftInLoop) -> bool:
    return bool(loop.excitation_k.on or loop.plant_k.wind.sines.on)


# -------------------------------------------------------------------------------------------------
# Parts given as objects in Python: each takes the place of a kernel, the others are as they are.
# -------------------------------------------------------------------------------------------------

GAVE_UP = -1
"""Outcome of ticks in which a part has failed."""
# Children of a flight's seed below this one belong to the plant and the links.
_CHILD_OF_PARTS = 128


def fly_settings(
    settings: Settings,
    laws: Sequence[PythonLaw] = (),
    progress: Callable[[float], None] | None = None,
    parts: Parts | None = None,
) -> LoopFlight:
    """Fly a scenario with the parts that are given, that the settings name, or packaged ones.

    Parameters
    ----------
    settings : Settings
    laws : sequence of PythonLaw
        At most one of each loop. **A controller that the settings name is imported**: its code
        runs.
    progress : callable, optional
        Called with the flight time (s) now and then.
    parts : Parts, optional
        Plant, wind, sensors, estimator; controllers of `laws` go before its own.

    Returns
    -------
    LoopFlight
        Where a part has failed it ends there, with the part's sentence.

    Raises
    ------
    LawError, PartError, ParameterError, TrimError, SynthesisError
    """
    parts = parts or Parts()
    controllers = laws or parts.controllers or [find(s) for s in own_laws(settings).values()]
    parts = with_linear(replace(parts, controllers=controllers), settings.nodes)
    if not parts:
        return simulate(settings, progress=progress)
    compiled = replace(settings, nodes=without_linear(settings.nodes))
    loop = build(without_own(compiled))
    ticks = TicksWithParts(loop, parts, settings)
    flight = fly_loop(loop, settings, progress, ticks.fly)
    why = ticks.failure
    return flight._replace(sentence=why) if why else flight


class TicksWithParts:
    """`fly` is called in place of the compiled `loop.fly`: the same kernels, one by one.

    Parameters
    ----------
    loop : AircraftInLoop
    parts : Parts
    settings : Settings
        Its seed is what every part's own random numbers come from.
    """

    def __init__(self, loop: AircraftInLoop, parts: Parts, settings: Settings) -> None:
        laws = {law.loop: law for law in parts.controllers}
        self._inner = OwnAttitudeLaw(laws.get(INNER))
        self._outer = OwnPositionLaw(laws.get(OUTER))
        self._parts, self._calls = parts, _compiled(loop)
        self.failure, arguments = "", (loop.tick_s, settings.nodes)
        self._readings: dict[str, np.ndarray] = {}
        for n, (name, part) in enumerate(parts.named()):
            child = np.random.SeedSequence(settings.seed, spawn_key=(_CHILD_OF_PARTS + n,))
            self._ask(name, part, "reset", 0, np.random.default_rng(child), *arguments)

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
        """As `loop.fly`; GAVE_UP at the tick at which a part has failed."""
        call, reference = self._calls, (times_ns, points)
        for i in range(n_ticks):
            tick = first_tick + i
            before = call["what_changes"](loop.outer_s)
            self.perceive(loop, tick, noise_rows[i], u, track.truth[tick])
            self.command(loop, tick, *reference, setpoint, u)
            call["write"](loop, tick, *reference, setpoint, u, track)
            status = self.act(loop, tick, u)
            if status != 0 or call["what_changes"](loop.outer_s) != before:
                return i + 1, status
        return n_ticks, 0

    def perceive(
        self, loop: AircraftInLoop, tick: int, noise: np.ndarray, u: np.ndarray, truth: np.ndarray
    ) -> None:
        """As `loop.perceive`."""
        self._sense(loop, tick, noise, truth)
        self._estimate(loop, tick, u, truth)

    def command(
        self,
        loop: AircraftInLoop,
        tick: int,
        times_ns: np.ndarray,
        points: np.ndarray,
        setpoint: np.ndarray,
        u: np.ndarray,
    ) -> None:
        """As `loop.guide`, `listen`, `control` and `command_actuators`, one after the other."""
        self.guide(loop, tick, times_ns, points, setpoint)
        self._calls["listen"](loop, loop.links, tick, setpoint)
        self.control(loop, tick)
        self._calls["command_actuators"](loop, tick, u)

    def memory(self) -> Any:
        """What the objects remember, as a copy.

        Raises
        ------
        PartError
            One of them cannot be copied.
        """
        try:
            parts = [deepcopy(vars(part)) for _, part in self._parts.named()]
            return parts, deepcopy((self._inner, self._outer, self._readings))
        except Exception as error:
            raise PartError(
                f"parts: what they remember cannot be copied: {in_one_line(error)}"
            ) from error

    def remember(self, memory: Any, failure: str) -> None:
        """Go on from what `memory` gave, and from a failure or none."""
        parts, rest = memory
        for (_, part), values in zip(self._parts.named(), parts, strict=True):
            vars(part).clear()
            vars(part).update(deepcopy(values))
        self._inner, self._outer, self._readings = deepcopy(rest)
        controllers = [own.law for own in (self._inner, self._outer) if own.law is not None]
        self._parts = replace(self._parts, controllers=controllers)
        self.failure = failure

    def _ask(self, name: str, part: Any, method: str, tick: int, *arguments: Any) -> Any:
        """What a part answers; what it raises becomes the flight's sentence."""
        if self.failure:
            return None
        try:
            return getattr(part, method)(*arguments)
        except (Exception, SystemExit) as error:
            self.failure = (
                f"The {name} {type(part).__name__} failed at tick {tick}: {method} raised "
                f"{in_one_line(error)}"
            )
            return None

    def _numbers(
        self, name: str, part: Any, tick: int, made: Any, size: int | None = None
    ) -> np.ndarray | None:
        """An answer as numbers, (size,) of them; None, and the flight's sentence, if it is none."""
        try:
            row = np.asarray(made, np.float64)
        except (TypeError, ValueError):
            row = None
        if row is not None and (size is None or row.shape == (size,)):
            return row
        if not self.failure:
            shape = "" if row is None else f" of shape {row.shape}"
            allowed = "numbers" if size is None else f"({size},) numbers"
            self.failure = (
                f"The {name} {type(part).__name__} failed at tick {tick}: step gave a "
                f"{type(made).__name__}{shape}; allowed: {allowed}"
            )
        return None

    def _finite(self, name: str, part: Any, tick: int, row: np.ndarray) -> bool:
        """Whether a row holds no NaN and no infinity; the flight's sentence, if it does."""
        if np.isfinite(row).all():
            return True
        if not self.failure:
            self.failure = (
                f"The {name} {type(part).__name__} failed at tick {tick}: it gave {row.tolist()}; "
                "allowed: finite numbers"
            )
        return False

    def _sense(self, loop: AircraftInLoop, tick: int, noise: np.ndarray, truth: np.ndarray) -> None:
        """The plant measures, in its wind; then the sensors that are given."""
        parts, y, time_s = self._parts, loop.rows.y, tick * loop.tick_s
        if parts.plant is not None:
            self._ask("plant", parts.plant, "measure", tick, tick, y, truth)
            self._finite("plant", parts.plant, tick, truth)
        elif parts.wind is not None:
            plant.meet_air(loop.plant_s, tick, noise, loop.plant_k)
            pos = loop.plant_s.x[PLANT.pos].copy()
            made = self._ask("wind", parts.wind, "step", tick, tick, time_s, pos)
            wind = self._numbers("wind", parts.wind, tick, made, 3)
            if wind is not None and self._finite("wind", parts.wind, tick, wind):
                loop.plant_s.air[:] = same_air(wind)
            plant.read(loop.plant_s, tick, noise, loop.plant_k, y)
            write_truth(loop.plant_s, y, truth)
        else:
            self._calls["sense"](loop, tick, noise, truth)
        self._readings = {}
        for sensor in parts.sensors:
            arguments = tick, time_s, truth.copy(), y
            made = self._ask("sensor", sensor, "step", tick, *arguments)
            reading = None if made is None else self._numbers("sensor", sensor, tick, made)
            if reading is not None:
                self._readings[type(sensor).__name__] = reading

    def _estimate(self, loop: AircraftInLoop, tick: int, u: np.ndarray, truth: np.ndarray) -> None:
        estimator, rows = self._parts.estimator, loop.rows
        if estimator is None:
            self._calls["estimate_navigation"](loop, loop.links, tick, u, truth)
            return
        arguments = tick, tick * loop.tick_s, rows.y.copy(), u.copy(), self._readings
        made = self._ask("estimator", estimator, "step", tick, *arguments)
        nav = self._numbers("estimator", estimator, tick, made, NAV.size)
        if nav is not None:
            rows.nav[:] = nav

    def guide(
        self,
        loop: AircraftInLoop,
        tick: int,
        times_ns: np.ndarray,
        points: np.ndarray,
        setpoint: np.ndarray,
    ) -> None:
        """As `loop.guide`."""
        call, box, k, reference = self._calls, loop.outer_in, loop.outer_k, (times_ns, points)
        call["bring_navigation"](loop, loop.links, tick)
        inputs = box, tick, loop.period_ticks, tick * loop.tick_ns, *reference, k, setpoint
        self._outer.step(loop.outer_s, *inputs, call["outer_step"])

    def control(self, loop: AircraftInLoop, tick: int) -> None:
        """As `loop.control`."""
        aim, rows, command = loop.rows.aim, loop.rows, estimate.COMMAND
        arguments = rows.x9, aim[command.attitude], aim[command.col], aim[command.manual]
        numbers = loop.inner_k, loop.inner_s, rows.u3
        self._inner.step(tick, tick * loop.tick_s, *arguments, *numbers, self._calls["law"])

    def act(self, loop: AircraftInLoop, tick: int, u: np.ndarray) -> int:
        """As `loop.act`; GAVE_UP where a part has failed."""
        controllers = self._parts.controllers
        self.failure = self.failure or next((law.failure for law in controllers if law.failure), "")
        if self.failure:
            return GAVE_UP
        if self._parts.plant is None:
            return int(self._calls["act"](loop, loop.links, tick, u))
        status = self.status(loop)
        if status != 0:
            return status
        self._ask("plant", self._parts.plant, "step", tick, tick, u.copy())
        return GAVE_UP if self.failure else 0

    def status(self, loop: AircraftInLoop) -> int:
        """PlantStatus of now, of the plant that flies."""
        if self._parts.plant is None:
            return int(plant.status(loop.plant_s, loop.plant_k))
        return int(getattr(self._parts.plant, "status", plant.PlantStatus.OK))


def _compiled(loop: AircraftInLoop) -> dict[str, Callable[..., Any]]:
    """The kernels of every tick for numbers of these types."""
    four, three, rows = np.zeros(ACTUATOR.size), np.zeros(3), loop.rows
    truth, noise_row, links = np.zeros(TRUTH.size), np.zeros(NOISE.size), loop.links
    reference = np.zeros(1, np.int64), np.zeros((1, REFERENCE.size))
    outer_step = loop.outer_in, 0, loop.period_ticks, 0, *reference, loop.outer_k, four
    calls: dict[str, tuple[Any, ...]] = {
        "sense": (sense, loop, 0, noise_row, truth),
        "estimate_navigation": (estimate_navigation, loop, links, 0, four, truth),
        "bring_navigation": (bring_navigation, loop, links, 0),
        "outer_step": (outer_loop.step, loop.outer_s, *outer_step),
        "listen": (listen, loop, links, 0, four),
        "law": (law_or_manual, rows.x9, three, 0.0, three, loop.inner_k, loop.inner_s, three),
        "command_actuators": (command_actuators, loop, 0, four),
        "write": (write, loop, 0, *reference, four, four, empty_track(1, _excited(loop))),
        "act": (act, loop, links, 0, four),
        "what_changes": (what_changes, loop.outer_s),
    }
    return {name: direct(*call) for name, call in calls.items()}
