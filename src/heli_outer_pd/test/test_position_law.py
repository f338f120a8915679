# SPDX-License-Identifier: Apache-2.0
"""The outer law against eq. (20) and (21) by hand, in its limits, and under bad input."""

import math
from pathlib import Path

import numpy as np
import pytest

from heli_core.parameters import load
from heli_core.rcl_yaml import ParameterCause, ParameterError
from heli_core.rotations import quat_from_euler
from heli_core.rows import SETPOINT
from heli_core.trajectory import Trajectory, reference_at
from heli_outer_pd import disturbance, position_law, reference
from heli_outer_pd import parameters as config
from heli_outer_pd import state as thrust_map
from heli_outer_pd.guidance.paths import STEP_S, FlightPath
from heli_outer_pd.guidance.transfer import MotionLimits
from heli_outer_pd.parameters import NODE_NAME, TABLE
from heli_outer_pd.state import FLIES, LEAVES, LOW_BY_HAND, MACHINE, STEERED, OuterStatus
from support.step_climb import step_climb

YAML = Path(config.__file__).parents[1] / "config" / "outer_loop.yaml"


def kernel(**changes):
    parameters = load(TABLE, [YAML], NODE_NAME) | changes
    return config.outer_params(parameters)


def navigation(k, pos=(0, 0, -10), vel=(0, 0, 0), phi=None, theta=None, psi=0.0):
    phi = k.trim[0] if phi is None else phi
    theta = k.trim[1] if theta is None else theta
    return np.r_[np.array(pos, float), np.array(vel, float), quat_from_euler(phi, theta, psi)]


def step(k, nav, ref, state=None):
    state = position_law.initial_state(k) if state is None else state
    out = np.full(4, np.nan)
    ref = np.array(ref, float)
    status = position_law.position_law(nav, np.r_[ref[:6], 0, 0, 0, ref[6]], k, state, out)
    return OuterStatus(status), out, state


REF = (0, 0, -10, 0, 0, 0, 0)


def test_trim_at_reference_commands_the_trim():
    k = kernel()
    status, out, _ = step(k, navigation(k), REF)
    assert status is OuterStatus.OK
    np.testing.assert_allclose(out, [k.trim[0], k.trim[1], 0.0, k.trim[SETPOINT.col]], atol=1e-12)


def test_a_full_size_helicopter_is_taken_and_its_map_turns_back(tmp_path):
    """3.9 t, a rotor of 44 ft at 324 1/min: thrust of a collective that a thrust has given."""
    file = tmp_path / "full_size.yaml"
    file.write_text(
        "/**/outer_loop:\n  ros__parameters:\n    mass: 3856.0\n    rotor: {omega: 33.93, radius: "
        "6.706, chord: 0.686, K_col: -0.11}\n",
        encoding="utf-8",
    )
    k = config.outer_params(load(TABLE, [YAML, file], NODE_NAME))
    weight, d_col = k.mass * k.g, k.trim[SETPOINT.col]
    more = thrust_map.collective_for_thrust(1.1 * weight, 0.0, weight, d_col, k.rotor)
    back = thrust_map.thrust_for_collective(more, 0.0, weight, d_col, k.rotor)
    assert more < d_col and back == pytest.approx(1.1 * weight)


@pytest.mark.parametrize(
    ("psi_deg", "offset_ned", "roll_sign", "pitch_sign"),
    [
        (0, (1, 0, 0), 0, 1),  # target is behind: nose up
        (0, (0, 1, 0), -1, 0),  # target is left: roll left
        (90, (1, 0, 0), 1, 0),  # nose east, target south: that is right
        (90, (0, 1, 0), 0, 1),  # nose east, displaced east: nose up
        (180, (1, 0, 0), 0, -1),  # nose south, displaced north: target is ahead, nose down
        (-90, (0, 1, 0), 0, -1),
    ],
)
def test_attitude_signs_in_the_heading_frame(psi_deg, offset_ned, roll_sign, pitch_sign):
    k = kernel(wind_compensation=False)
    psi = math.radians(psi_deg)
    nav = navigation(k, pos=np.array(offset_ned) + [0, 0, -10], psi=psi)
    _, out, _ = step(k, nav, (*REF[:6], psi))
    assert np.sign(np.round(out[0] - k.trim[0], 9)) == roll_sign
    assert np.sign(np.round(out[1] - k.trim[1], 9)) == pitch_sign


@pytest.mark.parametrize(("exact", "tilt"), [(True, math.atan), (False, math.asin)])
def test_equation_21_value(exact, tilt):
    k = kernel(wind_compensation=False, exact_tilt=exact)
    _, out, _ = step(k, navigation(k, pos=(0.4, -0.3, -10), vel=(0.1, 0.2, 0)), REF)
    a_x = k.K_P[0] * -0.4 + k.K_D[0] * -0.1
    a_y = k.K_P[1] * 0.3 + k.K_D[1] * -0.2
    assert out[0] == pytest.approx(k.trim[0] + tilt(a_y / k.g), abs=1e-14)
    assert out[1] == pytest.approx(k.trim[1] - tilt(a_x / k.g), abs=1e-14)


def test_the_thrust_gives_the_acceleration_that_is_wanted_at_any_tilt():
    """The commanded tilt, once flown, beside the thrust of (20): force sideways, by vectors."""
    for exact in (True, False):
        k = kernel(
            wind_compensation=False, exact_tilt=exact, **{"trim.phi": 0.0, "trim.theta": 0.0}
        )
        wanted, vel = 5.6, (0, -5.6 / k.K_D[1], 0)
        _, out, _ = step(k, navigation(k, vel=vel), REF)
        _, out, _ = step(k, navigation(k, vel=vel, phi=out[0]), REF)
        thrust = thrust_map.thrust_for_collective(
            out[3], 0.0, k.mass * k.g, k.trim[SETPOINT.col], k.rotor
        )
        sideways = thrust * math.sin(out[0]) / k.mass
        assert thrust * math.cos(out[0]) == pytest.approx(k.mass * k.g, rel=1e-9)
        assert (sideways == pytest.approx(wanted, rel=1e-9)) == exact
        assert sideways > 1.2 * wanted or exact


def test_equation_20_gives_the_thrust_it_asks_for():
    """Altitude 0.5 m too low, tilted 20 deg: the collective goes through the rotor."""
    k = kernel(wind_compensation=False)
    phi = math.radians(20)
    _, out, _ = step(k, navigation(k, pos=(0, 0, -9.5), phi=phi, theta=0.0), REF)
    thrust = k.mass * (k.g + k.K_P[2] * 0.5) / math.cos(phi)
    trim_thrust = k.mass * k.g / (math.cos(k.trim[0]) * math.cos(k.trim[1]))
    pitch = thrust_map.blade_pitch(trim_thrust, 0.0, k.rotor) + k.rotor.K_col * (
        out[3] - k.trim[SETPOINT.col]
    )
    r = k.rotor
    v_i = math.sqrt(thrust / (2 * r.rho * math.pi * r.radius**2))
    lift = r.rho * r.omega * r.radius**2 * r.lift_slope * r.blades * r.chord / 4
    blade_element = lift * (2 / 3 * r.omega * r.radius * pitch - v_i)
    assert blade_element == pytest.approx(thrust, rel=1e-12)


@pytest.mark.parametrize(
    ("guidance", "ahead"), [(FLIES, True), (STEERED, True), (LEAVES, False), (LOW_BY_HAND, False)]
)
def test_the_vertical_speed_is_predicted_in_flight_only(guidance, ahead):
    """With a thrust off its trim; on the ground the skids carry what that thrust does not."""
    commanded = []
    for ahead_s in (0.0, 0.05):
        k = kernel(collective_prediction_s=ahead_s)
        state = position_law.initial_state(k)
        state.machine[MACHINE.guidance] = guidance
        state.x[position_law.MEMORY.command][SETPOINT.col] += 0.02
        commanded.append(step(k, navigation(k), REF, state)[1])
    now, later = commanded
    np.testing.assert_array_equal(now[: SETPOINT.col], later[: SETPOINT.col])
    assert (later[SETPOINT.col] != now[SETPOINT.col]) == ahead
    # What has too little thrust (the collective is negative upwards) will sink: more is wanted.
    assert not ahead or later[SETPOINT.col] < now[SETPOINT.col]


@pytest.mark.parametrize("w_r", [-8.0, -2.5, 0.0, 1.5])
@pytest.mark.parametrize("thrust", [20.0, 95.4, 180.0])
def test_thrust_map_is_its_own_inverse_and_solves_both_theories(thrust, w_r):
    r = kernel().rotor
    pitch = thrust_map.blade_pitch(thrust, w_r, r)
    assert thrust_map.thrust_of(pitch, w_r, r) == pytest.approx(thrust, rel=1e-12)
    lift = r.rho * r.omega * r.radius**2 * r.lift_slope * r.blades * r.chord / 4
    v_i = w_r + 2 / 3 * r.omega * r.radius * pitch - thrust / lift
    momentum = 2 * r.rho * math.pi * r.radius**2 * v_i * (v_i - w_r)
    assert momentum == pytest.approx(thrust, rel=1e-12)


def test_no_thrust_downwards():
    for pitch in (-0.2, -0.03, -0.01, -0.001):
        assert thrust_map.thrust_of(pitch, 0.0, kernel().rotor) == 0.0


def thrust_of(k, d_col, w_r=0.0):
    """Of the map, N."""
    hover = k.mass * k.g / (math.cos(k.trim[0]) * math.cos(k.trim[1]))
    return thrust_map.thrust_for_collective(d_col, w_r, hover, k.trim[SETPOINT.col], k.rotor)


def lifted(k, lift_mps2, pos_down_m=-60.0):
    """Collective far above its reference while the air lifts so much (m/s2)."""
    state = position_law.initial_state(k)
    step(k, navigation(k), REF, state)
    state.x[position_law.MEMORY.disturbance] = 0.0, 0.0, -lift_mps2
    return step(k, navigation(k, pos=(0, 0, pos_down_m)), REF, state)[1][SETPOINT.col]


def test_what_the_air_lifts_counts_towards_the_least_thrust():
    """In still air 0.4 of the weight; lifted by 0.2 of it the map's own is 0.2."""
    k = kernel(blade_pitch_floor=0.0)
    weight = k.mass * k.g
    assert thrust_of(k, lifted(k, 0.0)) == pytest.approx(0.4 * weight)
    # the estimate is a step older than the one that is set
    assert thrust_of(k, lifted(k, 0.2 * k.g)) == pytest.approx(0.2 * weight, rel=0.05)


@pytest.mark.parametrize("K_col", [-0.165, 0.165])
def test_blades_have_no_less_pitch_than_their_floor(K_col):
    """By hand: pitch of the map at the collective, a quarter of hover's, however much is lifted."""
    k = kernel(**{"rotor.K_col": K_col})
    hover = k.mass * k.g / (math.cos(k.trim[0]) * math.cos(k.trim[1]))
    hover_pitch = thrust_map.blade_pitch(hover, 0.0, k.rotor)
    for lift in (0.5 * k.g, 0.9 * k.g):
        pitch = hover_pitch + K_col * (lifted(k, lift) - k.trim[SETPOINT.col])
        assert pitch == pytest.approx(0.25 * hover_pitch)


def test_at_a_limit_is_whoever_stands_at_the_one_in_force():
    """In lifting air the least thrust of still air is no limit."""
    k = kernel()
    still, floor = lifted(k, 0.0), lifted(k, 0.9 * k.g)
    for collective, lift, held in ((still, 0.0, True), (still, 0.3 * k.g, False),
                                   (floor, 0.9 * k.g, True)):  # fmt: skip
        state = position_law.initial_state(k)
        state.x[position_law.MEMORY.disturbance] = 0.0, 0.0, -lift
        position_law.count_at_limit(collective, k, state)
        assert (state.x[position_law.MEMORY.at_limit_s] > 0.0) == held, (collective, lift)


def test_climb_feedforward_asks_for_more_pitch():
    k = kernel()
    climb = (0, 0, -10, 0, 0, -2.5, 0)
    _, hover, _ = step(k, navigation(k), REF)
    _, up, _ = step(k, navigation(k, vel=(0, 0, -2.5)), climb)
    assert (up[3] - hover[3]) * k.rotor.K_col > 0


def test_tilt_and_thrust_are_limited():
    k = kernel()
    _, out, _ = step(k, navigation(k, pos=(-500, 500, 90)), REF)
    assert out[0] - k.trim[0] == pytest.approx(-k.tilt_limit)
    assert out[1] - k.trim[1] == pytest.approx(-k.tilt_limit)
    assert -1 < out[3] < 1


def simulate(k, disturbance_mps2, seconds=60.0):
    """A point mass behind lags of the attitude and of the collective, which the controller knows
    of, against a steady disturbance (NED, m/s2)."""
    pos, vel, out = (
        np.array([0.0, 0, -10]),
        np.zeros(3),
        np.r_[k.trim[:2], 0.0, k.trim[SETPOINT.col]],
    )
    state, psi = position_law.initial_state(k), 0.6
    attitude, trim_thrust = k.trim[:2].copy(), k.mass * k.g / math.cos(k.trim[0])
    col = k.trim[SETPOINT.col]
    c, s = math.cos(psi), math.sin(psi)
    for _ in range(int(seconds / k.dt_s)):
        nav = navigation(k, pos, vel, *attitude, psi)
        status = position_law.position_law(nav, np.r_[0.0, 0, -10, np.zeros(6), psi], k, state, out)
        assert status == OuterStatus.OK
        # The attitude loop leaves half a degree standing: the law has to cope with that, too.
        attitude += k.dt_s / 0.4 * (out[:2] + math.radians(0.5) - attitude)
        fwd = -k.g * math.tan(attitude[1] - k.trim[1])
        right = k.g * math.tan(attitude[0] - k.trim[0])
        acc = np.array([c * fwd - s * right, s * fwd + c * right, 0.0]) + disturbance_mps2
        # A vertical speed that is predicted by the thrust needs a thrust that follows so late.
        col += (1.0 - disturbance.kept(k.dt_s, k.collective_lag_s)) * (out[SETPOINT.col] - col)
        thrust = thrust_map.thrust_for_collective(
            col, vel[2], trim_thrust, k.trim[SETPOINT.col], k.rotor
        )
        acc[2] += k.g - thrust * math.cos(attitude[0]) * math.cos(attitude[1]) / k.mass
        vel = vel + k.dt_s * acc
        pos = pos + k.dt_s * vel
    return pos - [0, 0, -10]


def test_pure_pd_drifts_off_in_steady_wind_and_the_estimate_trims_it_out():
    """The paper's law stands off by d / K_P; with the disturbance estimate the offset vanishes."""
    d = np.array([0.3, -0.4, 0.1])
    pd = simulate(kernel(wind_compensation=False, K_P=np.full(3, 0.8)), d)
    standing = 9.781 * math.radians(0.5)
    c, s = math.cos(0.6), math.sin(0.6)
    total = d[:2] + standing * np.array([-c - s, -s + c])
    np.testing.assert_allclose(pd[:2], total / 0.8, rtol=0.01)
    for standing_s in (0.0, 5.0):
        estimated = kernel(**{"disturbance.tilt_standing_s": standing_s})
        assert np.abs(simulate(estimated, d)).max() < 1e-3


def test_late_navigation_makes_the_vertical_disturbance_be_found_more_slowly():
    """A speed that nothing explains: of the first step's estimate 0.46 is left, the share squared;
    the horizontal one is as it was."""
    k, found = kernel(), {}
    for late in (0.0, 1.0):
        state = None
        for speed in (0.0, 0.1):
            if state is not None:
                state.x[position_law.MEMORY.late] = late
            _, _, state = step(k, navigation(k, vel=(speed, 0.0, speed)), REF, state)
        found[late] = state.x[position_law.MEMORY.disturbance].copy()
    assert found[1.0][2] == pytest.approx(0.68**2 * found[0.0][2], rel=1e-9)
    assert found[1.0][0] == pytest.approx(found[0.0][0], rel=1e-9) and found[0.0][0] > 0.0


def test_what_is_commanded_and_on_its_way_is_no_disturbance():
    """A step of the collective, and the speed that thrust behind the known lag gives."""
    k = kernel()
    state, vel, col = None, 0.0, k.trim[SETPOINT.col]
    _, _, state = step(k, navigation(k), REF)
    assert k.collective_lag_s > 0.0
    for _ in range(round(2.0 / k.dt_s)):
        state.x[position_law.MEMORY.command] = k.trim
        state.x[position_law.MEMORY.command][SETPOINT.col] += 0.02
        keep = math.exp(-k.dt_s / k.collective_lag_s)
        col = keep * col + (1.0 - keep) * (k.trim[SETPOINT.col] + 0.02)
        nav = navigation(k, vel=(0, 0, vel))
        _, _, state = step(k, nav, (*REF[:5], vel, 0), state)
        assert state.x[position_law.MEMORY.col_behind] == pytest.approx(col)
        lift = math.cos(k.trim[0]) * math.cos(k.trim[1])
        vel += k.dt_s * disturbance.thrust_acceleration(col, vel, lift, k)
    assert abs(vel) > 0.4
    assert abs(state.x[position_law.MEMORY.disturbance][2]) < 1e-6


def test_what_the_measured_tilt_explains_is_no_disturbance():
    """A tilt that nobody commanded, and the speed that it gives: the estimate stays at nothing.

    By the commanded tilt alone it is taken for wind."""
    for standing_s, taken_for_wind in ((0.0, 1.0), (60.0, 0.02)):
        k = kernel(**{"disturbance.tilt_standing_s": standing_s})
        tilt, vel, state = math.radians(3.0), 0.0, None
        _, _, state = step(k, navigation(k), REF)
        for _ in range(round(2.0 / k.dt_s)):
            vel += k.dt_s * k.g * math.tan(tilt)
            nav = navigation(k, vel=(0, vel, 0), phi=k.trim[0] + tilt)
            state.x[position_law.MEMORY.command] = k.trim
            _, _, state = step(k, nav, (*REF[:4], vel, 0, 0), state)
        share = state.x[position_law.MEMORY.disturbance][1] / (k.g * math.tan(tilt))
        assert share == pytest.approx(taken_for_wind, abs=0.15), standing_s


def test_engagement_is_bumpless_in_flown_wind_trim():
    """Engaged while hanging 5 deg into the wind, it first commands what is flown."""
    k = kernel()
    phi, theta = k.trim[0] - math.radians(5), k.trim[1] + math.radians(2)
    _, out, _ = step(k, navigation(k, phi=phi, theta=theta, psi=0.3), (*REF[:6], 0.3))
    np.testing.assert_allclose(out[:2], [phi, theta], atol=1e-12)


@pytest.mark.parametrize("index", [0, 4, 8])
def test_nan_never_leaves(index):
    k = kernel()
    _, good, state = step(k, navigation(k, pos=(1, 1, -10)), REF)
    nav = navigation(k)
    nav[index] = np.nan
    before = state.copy()
    status, out, _ = step(k, nav, REF, state)
    assert status is OuterStatus.BAD_NAVIGATION
    np.testing.assert_array_equal(out, good)
    np.testing.assert_array_equal(state.x, before.x)
    np.testing.assert_array_equal(state.machine, before.machine)
    status, out, _ = step(k, navigation(k), (*REF[:5], np.inf, 0), state)
    assert status is OuterStatus.BAD_REFERENCE
    np.testing.assert_array_equal(out, good)
    assert OuterStatus.BAD_REFERENCE.sentence


def shaped(trajectory, t_s, window_s):
    out = np.empty(10)
    reference.shaped_reference_at(
        round(t_s * 1e9), round(window_s * 1e9), 0.0, trajectory.times_ns, trajectory.points, out
    )
    return out


def test_shaped_reference_is_consistent_and_arrives_exactly():
    """Position integrates velocity, velocity acceleration; the climb ends at its height."""
    climb = step_climb(np.zeros(3), 0.1, 18.0, 22.0, 2.5)
    t = np.arange(17.0, 25.0, 0.001)
    path = np.array([shaped(climb, s, 1.5) for s in t])
    np.testing.assert_allclose(np.gradient(path[:, 2], t)[5:-5], path[5:-5, 5], atol=0.06)
    # The acceleration is the mean of the speed's change over the 0.04 s about it.
    mean = (path[40:, 5] - path[:-40, 5]) / 0.04
    np.testing.assert_allclose(mean, path[20:-20, 8], atol=1e-6)
    assert np.abs(path[:, 8]).max() == pytest.approx(2.5 / 1.5)
    assert (path[t >= 22.751][:, :8] == [0, 0, -10, 0, 0, 0, 0, 0]).all()
    assert (path[t < 17.25][:, :8] == 0.0).all()
    assert (path[(t < 17.229) | (t > 22.771)][:, 6:9] == 0.0).all()
    assert path[:, 2].min() >= -10.0  # no overshoot
    # Half before the corner, half after it: v T / 8 off there, on the line in between.
    at_corner, between = shaped(climb, 18.0, 1.5), shaped(climb, 20.0, 1.5)
    assert at_corner[2] == pytest.approx(-2.5 * 1.5 / 8, abs=1e-3)
    np.testing.assert_allclose(between[:6], [0, 0, -5, 0, 0, -2.5], atol=1e-9)
    np.testing.assert_array_equal(shaped(climb, 20.0, 0.0)[:6], [0, 0, -5, 0, 0, -2.5])


def test_a_command_is_not_flown_before_its_time():
    """Nothing moves before it; from then on speed and acceleration of the reference as it is."""
    values = load(TABLE, [YAML], NODE_NAME)
    ahead, command = (
        reference.unforeseen_window_ns(values | {"reference_preview": known}) * 1e-9
        for known in (True, False)
    )
    assert (ahead, command) == (0.8, 0.04)
    off = values | {"reference_preview": False, "reference_shaping_s": 0.0}
    assert reference.unforeseen_window_ns(off) == 0
    # Of others alone: what the loop plans itself is known from its command on.
    k = config.outer_params(values | {"reference_preview": False})
    state = position_law.initial_state(k)
    assert reference.window_of(k, state) == 800_000_000
    state.x[position_law.MEMORY.unforeseen] = 1.0
    assert reference.window_of(k, state) == 40_000_000
    limits = MotionLimits(3.0, 2.5, 2.5, 5.0, 1.0, 1.0, 2.0)
    climb = FlightPath(np.zeros(3), 0.1, limits).stay(18.0).go_to([0.0, 0.0, -10.0]).trajectory()
    t = np.arange(17.0, 25.0, 0.04)
    path = np.array([shaped(climb, s, command) for s in t])
    assert (path[t < 17.99][:, :9] == 0.0).all()
    assert np.abs(path[t < 18.01][:, 2]).max() < 1e-4  # half a step of a jerk that has just begun
    assert shaped(climb, 17.9, ahead)[5] < -0.02
    asked = np.array([climb.at(round(s * 1e9)) for s in t])
    np.testing.assert_allclose(path[:, 2], asked[:, 2], atol=1e-3)
    np.testing.assert_allclose(path[:, 5], asked[:, 5], atol=0.06)
    assert np.abs(path[:, 8]).max() == pytest.approx(2.5, abs=1e-6)
    np.testing.assert_allclose(np.diff(path[:, 5]) / 0.04, path[:-1, 8], atol=0.15)


@pytest.mark.parametrize("period_ticks", [1, 2])
def test_a_path_that_is_not_known_ahead_is_followed_without_pulses(period_ticks):
    """Its speed is constant between its points: a difference over less is 0 or a pulse."""
    values = load(TABLE, [YAML], NODE_NAME)
    values |= {"reference_preview": False, "period_ticks": period_ticks}
    k = config.outer_params(values)
    state = position_law.initial_state(k)
    state.x[position_law.MEMORY.unforeseen] = 1.0
    window_ns = reference.window_of(k, state)
    assert window_ns == reference.unforeseen_window_ns(values) >= round(STEP_S * 1e9)
    # 2.5 m/s2 are reached in 0.5 s and left 0.5 s before 2.5 m/s: constant from 0.5 to 1.0 s.
    limits = MotionLimits(3.0, 2.5, 2.5, 5.0, 1.0, 1.0, 2.0)
    climb = FlightPath(np.zeros(3), 0.1, limits).stay(18.0).go_to([0.0, 0.0, -10.0]).trajectory()
    path = np.array([shaped(climb, s, window_ns * 1e-9) for s in np.arange(18.56, 18.94, 0.01)])
    np.testing.assert_allclose(path[:, 8], -2.5, atol=1e-6)


def test_a_trajectory_that_begins_with_a_step_is_begun_without_one_and_caught_up():
    """Nobody could look ahead of its start: at rest there, on the average of now 5 s later."""
    points = np.zeros((2, 7))
    points[0, 5], points[1, 2] = -1.0, -20.0
    trajectory = Trajectory(0, np.array([0, 20 * 10**9]), points)
    t = np.arange(0.0, 8.0, 0.001)
    path = np.array([shaped(trajectory, s, 1.0) for s in t])
    assert np.abs(path[0, :6]).max() < 1e-6
    assert np.abs(np.diff(path[:, 2])).max() < 1.15e-3
    np.testing.assert_allclose(np.gradient(path[:, 2], t)[5:-5], path[5:-5, 5], atol=0.11)
    np.testing.assert_allclose(path[t > 5.001, 2], -t[t > 5.001], atol=1e-6)


def test_lead_answers_a_step_of_the_error_ahead_and_settles_on_it():
    """(1 + (T + L) s) / (1 + T s): L / T more at once, nothing more in the end."""
    k = kernel(wind_compensation=False)
    lead, filter_s = k.attitude_lead[0], k.lead_filter_s
    _, _, state = step(k, navigation(k), REF)
    commanded = []
    for _ in range(round(2.0 / k.dt_s)):
        _, out, state = step(k, navigation(k, pos=(0.01, 0, -10)), REF, state)
        commanded.append(-k.g * math.tan(out[1] - k.trim[1]))
    without_lead = -k.K_P[0] * 0.01
    assert commanded[0] == pytest.approx(without_lead * (1.0 + lead / filter_s), rel=1e-9)
    assert commanded[1] == pytest.approx(
        without_lead * (1.0 + lead / filter_s * math.exp(-k.dt_s / filter_s)), rel=1e-9
    )
    assert commanded[-1] == pytest.approx(without_lead, rel=1e-6)


def test_what_the_reference_wants_is_led_by_the_lag_and_not_by_the_lead():
    """A step of its acceleration, all axes: by (T + L) / T at first, L the lag, T the filter."""
    k = kernel(wind_compensation=False, **{"attitude_lead.lead_s": [0.9, 0.7]})
    nav, out = navigation(k), np.empty(4)
    state = position_law.initial_state(k)
    for acceleration in (np.zeros(3), np.array([0.1, 0.2, -0.3])):
        ref = np.r_[nav[:6], acceleration, 0.0]
        position_law.position_law(nav, ref, k, state, out)
    led = acceleration * (1.0 + k.reference_lead / k.lead_filter_s)
    assert k.reference_lead == pytest.approx([*k.attitude_lag, k.collective_lag_s])
    assert k.trim[1] - out[1] == pytest.approx(math.atan(led[0] / k.g))
    assert out[0] - k.trim[0] == pytest.approx(math.atan(led[1] / k.g))
    assert thrust_of(k, out[3]) == pytest.approx(thrust_of(k, k.trim[3]) * (1 - led[2] / k.g))


def test_a_nose_that_turns_is_not_led():
    """A standing error: another heading turns the command as it turns a vector, and no more."""
    k = kernel(wind_compensation=False, K_P=np.full(3, 1.5))
    far = (0.5, -0.8, -10)
    state, commanded = None, []
    for psi in [0.3] * round(2.0 / k.dt_s) + [0.35]:
        _, out, state = step(k, navigation(k, pos=far, psi=psi), (*REF[:6], psi), state)
        commanded.append(k.g * np.tan([k.trim[1] - out[1], out[0] - k.trim[0]]))
    north, east = 1.5 * np.array([-0.5, 0.8])
    for psi, flown in ((0.3, commanded[-2]), (0.35, commanded[-1])):
        c, s = math.cos(psi), math.sin(psi)
        np.testing.assert_allclose(flown, [c * north + s * east, c * east - s * north], rtol=1e-6)


def test_a_far_target_is_approached_at_a_speed_and_not_faster():
    """Far away at the approach speed: nothing is wanted; nearer: what the error asks for."""
    k = kernel(wind_compensation=False, approach_speed_mps=2.0)
    for axis, row in ((0, SETPOINT.theta), (1, SETPOINT.phi)):
        vel = np.zeros(3)
        vel[axis] = 2.0
        far = np.zeros(3)
        far[axis] = -80.0
        _, out, _ = step(k, navigation(k, pos=far + [0, 0, -10], vel=vel), REF)
        assert out[row] == pytest.approx(k.trim[row], abs=1e-12)


def turning(rate_radps, step_rad=0.0):
    """A reference that turns steadily from 10 s on, and by a step at 20 s."""
    times = np.r_[0, 10_000_000_000 + 40_000_000 * np.arange(500)]
    points = np.zeros((times.size, 7))
    points[1:, 6] = wrap_pi_all(3.0 + rate_radps * 0.04 * np.arange(500))
    points[0, 6] = 3.0
    points[times >= 20_000_000_000, 6] += step_rad
    return times, points


def wrap_pi_all(angle):
    return np.angle(np.exp(1j * angle))


def test_heading_is_led_by_the_rate_also_across_180_degrees():
    times, points = turning(0.5)
    for time_s in (12.0, 10.28 + 0.04, 15.6):
        rate = reference.turn_rate_at(round(time_s * 1e9), times, points)
        assert rate == pytest.approx(0.5, rel=1e-9)
    out = np.empty(10)
    reference.shaped_reference_at(12_000_000_000, 0, 1.5, times, points, out)
    here = np.empty(7)
    reference_at(12_000_000_000, times, points, here)
    assert out[9] == pytest.approx(here[6] + 0.75)


def test_a_step_of_the_heading_is_not_led():
    times, points = turning(0.0, step_rad=1.0)
    for time_s in np.arange(19.0, 21.0, 0.04):
        assert reference.turn_rate_at(round(time_s * 1e9), times, points) == 0.0


@pytest.mark.parametrize(
    "change",
    [{"period_ticks": 4}, {"collective_lag_s": 0.01}, {"collective_prediction_s": 0.2}],
)
def test_a_prediction_that_makes_the_collective_swing_is_refused(change):
    """A command that is multiplied by less than -1 from step to step grows; named before it."""
    with pytest.raises(ParameterError, match="collective_prediction_s: .* K_D 24 .* up to") as told:
        kernel(**change)
    assert told.value.cause is ParameterCause.CONFLICT
    kernel(**change, **{"K_D": [2.7, 3.0, 5.0]})
    kernel(**change, wind_compensation=False)


def test_the_packaged_prediction_settles_in_the_loop_that_it_closes():
    """The factor from step to step of `check_prediction`, by the controller itself."""
    k = kernel()
    keep = math.exp(-k.dt_s / k.collective_lag_s)
    pole = keep - (1.0 - keep) * k.K_D[2] * k.collective_prediction_s
    assert -0.5 < pole < 0.5
