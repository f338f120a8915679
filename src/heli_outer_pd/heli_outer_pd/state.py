# SPDX-License-Identifier: Apache-2.0
"""Numbers, state and outcome of the outer loop's controllers."""

import enum
import math
from typing import NamedTuple

import numpy as np

from heli_core.jit import by_reference, njit
from heli_core.rows import SETPOINT
from heli_core.signals import SweepParams

# -------------------------------------------------------------------------------------------------
# The main rotor's own thrust map, inverted: thrust and climb speed to collective.
#
# Blade element and momentum theory in axial flow (Cai, Chen, Lee, Unmanned Rotorcraft Systems,
# 2011,
# ch. 6): T = rho Omega R^2 C_la b c / 4 (w_bl - v_i), w_bl = w_r + 2/3 Omega R theta_col,
# v_i (v_i - w_r) = T / (2 rho pi R^2). For given T and w_r both are explicit in theta_col. w_r is
# the
# hub's speed along body z relative to the air: positive in a descent.
# -------------------------------------------------------------------------------------------------


class RotorMap(NamedTuple):
    """Rotor constants of the thrust map (SI)."""

    rho: float  # kg/m3
    omega: float  # rad/s
    radius: float  # m
    lift_slope: float  # 1/rad
    blades: float
    chord: float  # m
    K_col: float  # rad of blade pitch per unit collective, negative on this aircraft


@njit
def _slope(rotor):
    """Thrust per speed through the blades, N s/m."""
    area = rotor.radius * rotor.radius * rotor.blades * rotor.chord
    return rotor.rho * rotor.omega * rotor.lift_slope * area / 4.0


@njit
def _disk(rotor):
    """2 rho times the disk's area, kg/m."""
    return 2.0 * rotor.rho * math.pi * rotor.radius * rotor.radius


@njit
def blade_pitch(thrust, w_r, rotor):
    """Blade pitch (rad) that gives thrust (N, > 0) at the hub speed w_r (m/s, down)."""
    v_i = 0.5 * w_r + math.sqrt(0.25 * w_r * w_r + thrust / _disk(rotor))
    return (thrust / _slope(rotor) + v_i - w_r) * 1.5 / (rotor.omega * rotor.radius)


@njit
def thrust_of(pitch, w_r, rotor):
    """Thrust (N) at blade pitch (rad) and hub speed w_r (m/s, down); the inverse of blade_pitch.

    0 where the disk would have to push downwards, which the map does not cover.
    """
    w_bl = w_r + rotor.omega * rotor.radius * pitch / 1.5
    if w_bl <= max(w_r, 0.0):
        return 0.0
    kappa = _slope(rotor) / _disk(rotor)
    half = 0.5 * (kappa - w_r)
    v_i = math.sqrt(half * half + kappa * w_bl) - half
    return _slope(rotor) * (w_bl - v_i)


@njit
def collective_for_thrust(thrust, w_r, thrust_trim, d_col_trim, rotor):
    """Collective (-) that gives thrust (N) at hub speed w_r, anchored at the trim point.

    Only differences of the map are used, so a constant error of the rotor model cancels at trim.
    """
    step = blade_pitch(thrust, w_r, rotor) - blade_pitch(thrust_trim, 0.0, rotor)
    return d_col_trim + step / rotor.K_col


@njit
def thrust_for_collective(d_col, w_r, thrust_trim, d_col_trim, rotor):
    """Thrust (N) at collective (-) and hub speed w_r: the inverse of collective_for_thrust."""
    pitch = blade_pitch(thrust_trim, 0.0, rotor) + rotor.K_col * (d_col - d_col_trim)
    return thrust_of(pitch, w_r, rotor)


# -------------------------------------------------------------------------------------------------
# Outer state.
# -------------------------------------------------------------------------------------------------


class OuterStateRow(NamedTuple):
    """Numbers of the controller's state (93,)."""

    vel: slice = slice(0, 3)  # estimated velocity, NED, m/s
    disturbance: slice = slice(3, 6)  # estimated disturbance, NED, m/s2
    engaged: int = 6  # 1.0 once the controller has made a step
    command: slice = slice(7, 11)  # last output, a SetpointRow
    lagged: slice = slice(11, 13)  # commanded acceleration behind the attitude loop's lag, m/s2
    led: slice = slice(13, 15)  # wanted acceleration behind the lead's filter, NED, m/s2
    col_goal: int = 15  # collective that is gone to while it stands
    col_rate: int = 16  # at so much per second
    # What a pilot's sticks command (`steering`): phi, theta, psi, rad; down, m, m/s, m/s2.
    steer: slice = slice(17, 23)
    steer_attitude: slice = slice(17, 20)
    steer_down: int = 20
    steer_down_vel: int = 21
    steer_down_acc: int = 22
    manual: slice = slice(23, 26)  # by hand: d_lat, d_lon, d_ped about trim
    manual_col: int = 26  # by hand: collective
    fade: slice = slice(27, 31)  # left of the last command of who flew before, a SetpointRow
    takes_over: int = 31  # 1.0: the next step goes on from the last command
    rest: slice = slice(32, 34)  # mean disturbance at rest, NED, m/s2
    rested_s: int = 34  # over so long
    rest_psi: int = 35  # with the nose there, rad
    sigma: int = 36  # of the horizontal velocity at the last step, m/s
    lands: int = 37  # 1.0 while it comes down to land
    lost_s: int = 38  # for so long no position is known
    astray_m: int = 39  # sigma of the horizontal velocity, summed up since the last fix, m
    was_pos: slice = slice(40, 42)  # navigation at the last step, NED: position, m
    was_vel: slice = slice(42, 44)  # and velocity, m/s
    shift: slice = slice(44, 47)  # of the reference, NED, m: what a fix has moved the navigation
    rest_down: int = 47  # mean disturbance downwards, m/s2
    sink_mps: int = 48  # speed of the descent by thrust
    slow_mps: int = 49  # what the vertical velocity is off by meanwhile, in the long run
    probe_s: int = 50  # time since the last probe for the ground
    probe_mps: int = 51  # vertical velocity when a probe began
    eased_mps2: int = 52  # thrust that it takes away
    gone: int = 53  # 1.0: it should land for want of a position or of a vertical speed
    ground_m: int = 54  # where the ground is in a descent, as far as it is known, NED, m
    sunk_m: int = 55  # where the aircraft is if it sinks as it should, NED, m
    settles_s: int = 56  # for so long fixes are taken for those after a gap
    doubt_s: int = 57  # the vertical velocity has not been known for so long
    off_mean: slice = slice(58, 60)  # mean of what theta and phi are off by, rad
    off_square: slice = slice(60, 62)  # and mean square, rad2
    hangs_s: int = 62  # for so long it has been off to one side in soft flight
    calm_s: int = 63  # calm again for so long
    calm_wanted_s: int = 64  # which is enough
    soft_s: int = 65  # in soft flight for so long
    is_late: int = 66  # 1.0: the navigation is of another tick
    late: int = 67  # share of the last second's steps at which it was
    side: slice = slice(68, 70)  # -1, 1: beyond which end theta and phi were last
    turns: slice = slice(70, 72)  # how often they went from there to the other, lately
    # The rotor's speed as it is heard (`rotor_watch`), over the governed one.
    rotor: int = 72  # of the last sample
    rotor_s: int = 73  # flight time of it, s
    rotor_same: int = 74  # so many samples in a row were the same
    rotor_sound: int = 75  # so many were sound; enough: it is believed
    rotor_known: int = 76  # of the last one that was believed
    slow_s: int = 77  # too slow for so long
    driven_s: int = 78  # near the governed speed for so long
    still_s: int = 79  # it does not sink any more for so long
    silent_s: int = 80  # no fix has been fused for so long
    growth_mps2: int = 81  # by which sigma of the horizontal velocity grows meanwhile
    # The least one over this stretch of time and over the one before, m/s
    sigmas: slice = slice(82, 84)
    ground_known: int = 84  # 1.0: by where the flight began, not by the receiver alone
    ground_off_m: int = 85  # the reference was moved by so much to where it began, and the ground
    at_limit_s: int = 86  # the collective has commanded the least or most thrust for so long
    stands: slice = slice(87, 89)  # what the attitude loop leaves standing, forward, right, m/s2
    led_reference: slice = slice(89, 92)  # acceleration of the reference behind the same filter
    unforeseen: int = 92  # 1.0: a reference is followed that is not known ahead
    col_behind: int = 93  # commanded collective behind its lag
    stretch_s: int = 94  # of `sigmas`
    size: int = 95


MEMORY = OuterStateRow()


class OuterMachineRow(NamedTuple):
    """Places of the five state machines of the law (5,), integers; beside them `phases.Phases`."""

    guidance: int = 0  # who flies: FLIES to LOW_BY_HAND
    position: int = 1  # POSITION_VALID, ...
    altitude: int = 2  # ALTITUDE_VALID, ...
    servo: int = 3  # SERVO_NOMINAL, ...
    rotor: int = 4  # ROTOR_DRIVEN, ...
    size: int = 5


MACHINE = OuterMachineRow()
FLIES, STANDS, LEAVES, STEERED, BY_HAND, LOW_BY_HAND = range(6)
"""Along the reference; on the skids, not engaged; lifting off, engaged without estimating;
attitude, climb and turn by a pilot's sticks; actuators by them; the same near the ground.
`Phases` and the pilot's `StickFlight` change it."""
POSITION_VALID, POSITION_LOST, POSITION_REACQUIRED = range(3)
"""The horizontal position is known; is not; is again, and a reference from there is awaited.
`position_health.look` changes it."""
ALTITUDE_VALID, ALTITUDE_LOST, ALTITUDE_REACQUIRED = range(3)
"""The vertical velocity is known; is not, and thrust alone flies; is again, since this step.
`position_health` changes it."""
SERVO_NOMINAL, SERVO_DEGRADED, SERVO_STUCK = range(3)
"""With the gains as they are; with small ones, as the attitude does not follow; again with
them, as that was of no help. `disturbance.watch_attitude` changes it."""
ROTOR_DRIVEN, ROTOR_AUTOROTATES, ROTOR_LANDED = range(3)
"""The rotor has its speed, as far as it is known; has not, and lands the aircraft; has done so.
`disturbance` changes it."""


@by_reference
class OuterState(NamedTuple):
    """State of the controller, changed in place."""

    x: np.ndarray  # (94,) places of `MEMORY`
    machine: np.ndarray  # (5,) int64, places of `MACHINE`

    def copy(self) -> "OuterState":
        """The state of now, for later."""
        return OuterState(self.x.copy(), self.machine.copy())


class OuterStatus(enum.IntEnum):
    """Outcome of one step of the outer loop; `sentence` says it for people."""

    OK = 0
    BAD_NAVIGATION = 1
    BAD_REFERENCE = 2

    @property
    def sentence(self) -> str:
        """One line for a diagnostic message."""
        return _SENTENCES[self]


_SENTENCES = {
    OuterStatus.OK: "position is held",
    OuterStatus.BAD_NAVIGATION: "the navigation solution is not finite: the last command is held",
    OuterStatus.BAD_REFERENCE: "the reference is not finite: the last command is held",
}


@by_reference
class OuterParams(NamedTuple):
    """Numbers of the controller, in the form that compiled code takes."""

    K_P: np.ndarray  # (3,) 1/s2, heading x, heading y, down
    K_D: np.ndarray  # (3,) 1/s, same axes
    approach_speed_mps: float  # at which a large position error is flown back
    observer_l1: np.ndarray  # (3,) 1/s, same axes
    observer_l2: np.ndarray  # (3,) 1/s2, same axes
    disturbance_limit: np.ndarray  # (3,) m/s2, same axes
    wind_compensation: float  # 1 or 0
    hold_horizontal: float  # 1: hold position; 0: command level trim attitude (attitude test)
    level_phi_theta: np.ndarray  # (2,) rad, commanded when hold_horizontal is 0
    tilt_limit: float  # rad, of sat() in (21)
    exact_tilt: float  # 1: tilt whose thrust gives what is wanted; 0: asin() as printed in (21)
    mass: float  # kg
    g: float  # m/s2
    thrust_limits: np.ndarray  # (2,) fractions of m g
    collective_lag_s: float  # s, of thrust behind the commanded collective
    collective_prediction_s: float  # s, the speed down is predicted so far
    collective_floor: float  # at which the blades have their least pitch
    trim: np.ndarray  # (4,) a SetpointRow: phi, theta rad, d_col; its heading is not used
    rotor: RotorMap
    shaping_ns: int  # window of the reference shaping
    unforeseen_ns: int  # the same of a reference that is not known ahead
    heading_lead_s: float  # lead of the commanded heading on the reference's
    attitude_lag: np.ndarray  # (2,) s, forward and right: time constants of the attitude loop
    tilt_standing_s: float  # what tilt is off by for longer is disturbance; 0: all of it
    reference_lead: np.ndarray  # (3,) s, forward, right, down: lead of the reference's acceleration
    attitude_lead: np.ndarray  # (2,) s, forward and right: lead of the commanded acceleration
    lead_filter_s: float
    blind_sigma: float  # m/s, of the horizontal velocity: with more its position is not known
    land_after_s: float  # without a position it lands after so long
    land_astray_m: float  # or once sigma of the way since the last fix would be so much on ground
    land_silent_s: float  # but not before no fix has come for so long
    quick_mps: np.ndarray  # (3,) m/s: speed of that landing, at the ground, and where that may be
    flare_s: float  # height over what is faster than at the ground in its last part
    blind_sigma_down: float  # m/s, of the vertical velocity: with more that is not known
    blind_descent_mps: float  # it then descends so
    unfollowed: np.ndarray  # (2,) rad, pitch and roll: with more swing it is not followed
    rotor_slow_share: float  # slower than this share of the governed speed
    rotor_slow_s: float  # for so long the rotor is too slow
    dt_s: float
    sweep: SweepParams


def initial_state(k: OuterParams) -> OuterState:
    """State of a controller that is not engaged yet; its last command is the trim."""
    state = OuterState(np.zeros(MEMORY.size), np.zeros(MACHINE.size, np.int64))
    state.x[MEMORY.command] = k.trim
    state.x[MEMORY.col_behind] = k.trim[SETPOINT.col]
    state.x[MEMORY.rotor_s], state.x[MEMORY.rotor_known] = -1.0, 1.0
    return state
