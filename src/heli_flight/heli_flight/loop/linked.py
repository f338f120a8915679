# SPDX-License-Identifier: Apache-2.0
"""The loop's links in one process: what each node hears where links have faults.

The kernels are those of the nodes, in their order, on the same rows at the same ticks.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from heli_dynamics_sim import fallback
from heli_inner_hinf import estimate
from heli_inner_hinf.law_state import all_finite, nine_states
from heli_math.arrays import copy, fill, scratch
from heli_math.jit import njit
from heli_math.rows import ACTUATOR, IMU, MEAS, NAV, NINE, SETPOINT
from heli_math.ticks import Rate
from heli_msgs_bridge import topics
from heli_msgs_bridge.link_faults import fault_rows
from heli_msgs_bridge.links import (
    NOTHING,
    PLACE,
    LinkKernel,
    LinkState,
    initial_links,
    link_kernel,
    pass_on,
)
from heli_observer.late import hear_fix, hear_imu
from heli_outer_pd import late

_N_IMU, _N_NINE, _N_NAV, _N_HANDED = IMU.size, len(NINE), NAV.size, 4
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


class Linked(NamedTuple):
    """What nodes remember for links with faults; without any it is not used."""

    k: LinkKernel
    s: LinkState
    model: estimate.EstimateKernel
    known: estimate.EstimateState
    navigation: late.Heard
    fallback_n: fallback.FallbackNumbers
    fallback_s: fallback.FallbackState
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
    k = link_kernel(np.concatenate(rows), seed, rate)
    model = estimate.estimate_kernel(inner)
    held = np.full(HELD.size, np.nan)
    held[HELD.attitude] = model.x_trim[[NINE.phi, NINE.theta, NINE.psi]]
    held[HELD.psi], held[HELD.col] = np.nan, inner["trim.u"][ACTUATOR.col]
    return Linked(
        k,
        initial_links(k, rate),
        model,
        estimate.initial_estimate(model),
        late.nothing_heard(),
        fallback.FallbackNumbers.from_parameters(nodes["plant"]),
        fallback.initial_fallback(
            under_way[-1].copy() if len(under_way) else np.zeros(ACTUATOR.size)
        ),
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
    observer_s, observer_k : ObserverState, ObserverKernel
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
        late.hear(links.navigation, stamp, nav)
    oldest = links.navigation_ticks
    return late.navigation_at(links.navigation, tick, oldest, links.tick_s, nav)


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
    row, rotor, known = scratch(_N_NAV), scratch(3), scratch(_N_NINE)
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
        fallback.hear(links.fallback_s, links.fallback_n, u)
    fallback.step(links.fallback_s, links.fallback_n, gyro, 0)
    copy(u, links.fallback_s.out)
