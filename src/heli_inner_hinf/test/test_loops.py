# SPDX-License-Identifier: Apache-2.0
"""The three loops and their margins against simulation, python-control and brute force."""

import itertools
from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from heli_core.linear import WIND, held_and_linear
from heli_core.rows import INPUT_NAMES, MEASURED, STATE_NAMES, UNMEASURED
from heli_core.ticks import TICK_S
from heli_inner_hinf.controller_state import (
    OUTPUT_FEEDBACK,
    PID,
    Actuation,
    ObserverInput,
    initial_law_state,
    output_law,
    predicting_gains,
)
from heli_inner_hinf.controllers import attitude_law
from heli_inner_hinf.loops import (
    COMMANDS,
    MEASURED_NAMES,
    as_output_law,
    channel_margin,
    channel_margins,
    closed_loop,
    disk_margin,
    feedback_of,
    flown_loop,
    flown_plant,
    further_delay_s,
    judge,
    observer_of,
    observer_with_servo,
    output_loop,
    pid_as_output_law,
)
from heli_inner_hinf.mu import mu_bounds, peak_gain
from heli_inner_hinf.synthesis import hinf_norm
from heli_inner_hinf.tuning import (
    analyse,
    assess,
    choose_observer_gain,
    crossover_radps,
    diagonal_gain,
    model_of,
    singular_values,
    three_loops,
)

POLES = (-10.0, -10.0, -5.0)


@pytest.fixture(scope="module")
def model(config):
    return model_of(config)


@pytest.fixture(scope="module")
def K(config):
    return diagonal_gain(config.A, POLES)


def test_observer_matrices_make_the_error_decay(model, K):
    """Eq. (19): the error of x_u obeys e' = A' e whatever y, u are."""
    Az, By, Hu = observer_of(model.A, model.B, K)
    assert np.allclose(Az, np.diag(POLES), atol=1e-9)
    rng = np.random.default_rng(1)
    x, u, e = rng.standard_normal(9), rng.standard_normal(3), rng.standard_normal(3)
    y = x[list(MEASURED)]
    x_dot = model.A @ x + model.B @ u
    estimate = x[list(UNMEASURED)] + e
    z_dot = Az @ (estimate - K @ y) + By @ y + Hu @ u
    e_dot = z_dot + K @ x_dot[list(MEASURED)] - x_dot[list(UNMEASURED)]
    assert np.allclose(e_dot, Az @ e, rtol=1e-9, atol=1e-7)


@pytest.mark.parametrize("shift_rate", [0.0, 0.5])
def test_state_feedback_as_one_law_answers_every_command_as_flown(config, model, K, shift_rate):
    """`turn` makes a new heading an input that moves nothing else."""
    shifted, feed = replace(model, shift_rate=shift_rate), ObserverInput(1, 38.0, 0.51)
    law = as_output_law(shifted, K, config.prediction_s, feed)
    omega = np.geomspace(0.1, 300.0, 50)
    one = output_loop(shifted, law).closed(np.exp(1j * omega * TICK_S))
    other = flown_loop(shifted, K, config.prediction_s, feed).closed(np.exp(1j * omega * TICK_S))
    np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(("delay_s", "lag"), [(0.0, 0), (0.01, 1), (0.02, 2), (0.014, None)])
def test_sampled_loop_against_simulation(config, model, K, delay_s, lag):
    """Tick by tick as the flight does it, the plant by an adaptive integrator, 40 ticks."""
    feed = ObserverInput(1, 38.0, 0.51)
    actuation = Actuation(delay_s=delay_s)
    loop = flown_loop(model, K, config.prediction_s, feed, actuation)
    closed = loop.closed
    x0 = 0.02 * np.random.default_rng(3).standard_normal(9)
    n = loop.plant.A.shape[0]
    F, H = predicting_gains(model.A, model.B, model.F, config.prediction_s)
    Az, By, Hu = observer_of(model.A, model.B, K)

    def servo(s, rate, u):
        return 38.0**2 * (u - s) - 2 * 0.51 * 38.0 * rate

    x, s, rate = x0.copy(), np.zeros(3), np.zeros(3)
    z = -K @ x0[list(MEASURED)]
    z_s, z_rate = np.zeros(3), np.zeros(3)
    commands = [np.zeros(3)] * 6
    trace = []
    for _ in range(40):
        trace.append(x.copy())
        full = x.copy()
        full[list(UNMEASURED)] = z + K @ x[list(MEASURED)]
        u = F @ full + H @ commands[-1]
        commands.append(u)
        y0 = x[list(MEASURED)]
        for part_s, acting in held_parts(commands, delay_s):

            def plant(_, v, acting=acting):
                return np.concatenate(
                    [model.A @ v[:9] + model.B @ v[9:12], v[12:], servo(v[9:12], v[12:], acting)]
                )

            v = solve_ivp(plant, (0, part_s), np.concatenate([x, s, rate]), rtol=1e-10, atol=1e-13)
            x, s, rate = np.split(v.y[:, -1], [9, 12])
        slope = (x[list(MEASURED)] - y0) / TICK_S

        def observer(t, v, u_fed=commands[-2], y0=y0, slope=slope):
            return np.concatenate(
                [
                    Az @ v[:3] + By @ (y0 + slope * t) + Hu @ v[3:6],
                    v[6:],
                    servo(v[3:6], v[6:], u_fed),
                ]
            )

        v = solve_ivp(
            observer, (0, TICK_S), np.concatenate([z, z_s, z_rate]), rtol=1e-10, atol=1e-13
        )
        z, z_s, z_rate = np.split(v.y[:, -1], [3, 6])
    start = np.zeros(closed.A.shape[0])
    start[:9] = x0
    # the controller's state leaves out what y_n adds: z = -K y becomes -(K + G1) y
    start[n : n + 9] = controller_rest(model, K, feed, x0)
    w = start
    for expected in trace:
        assert np.allclose(w[:9], expected, atol=2e-8)
        w = closed.A @ w
    assert lag is None or loop.plant.A.shape[0] == 15 + 3 * lag


def held_parts(commands, delay_s):
    """(duration, command) over one tick that starts with the newest command just worked out."""
    whole, part = divmod(delay_s + 1e-12, TICK_S)
    whole = int(whole)
    newest = commands[-1 - whole]
    if part < 1e-9:
        return [(TICK_S, newest)]
    return [(part, commands[-2 - whole]), (TICK_S - part, newest)]


def controller_rest(model, K, feed, x0):
    """State of the sampled controller for a_s, b_s, d_int estimated as zero at x0."""
    Ac, By, Bu = observer_with_servo(model, K, feed)
    _, _, _, G1 = held_and_linear(Ac, Bu, By, TICK_S)
    lift = np.vstack([K, np.zeros((6, 6))]) + G1
    return -lift @ x0[list(MEASURED)]


def test_continuous_loop_is_the_synthesis(config, model, K):
    loop, with_observer, _ = three_loops(model, K)
    report = analyse(loop)
    assert report.norm == pytest.approx(config.synthesis.norm, rel=1e-6)
    assert report.stability == pytest.approx(
        np.max(np.linalg.eigvals(model.A + model.B @ model.F).real), rel=1e-9
    )
    modes = np.linalg.eigvals(with_observer.closed.A)
    separate = np.concatenate([np.linalg.eigvals(model.A + model.B @ model.F), POLES])
    assert np.allclose(np.sort(modes.real), np.sort(separate.real), atol=1e-6)
    h = with_observer.wind_to_h
    assert not np.any(h.D)
    assert analyse(with_observer).norm == pytest.approx(hinf_norm(h.A, h.B, h.C)[0], rel=1e-6)


def test_singular_values_by_definition(model, K):
    loop = three_loops(model, K)[0]
    hv, uv = singular_values(loop, np.array([3.0]))
    closed = model.A + model.B @ model.F
    states = np.linalg.solve(3j * np.eye(9) - closed, model.E.astype(complex))
    assert np.allclose(hv[0], np.linalg.svd((model.C + model.D @ model.F) @ states)[1])
    assert np.allclose(uv[0], np.linalg.svd(model.F @ states)[1])


@pytest.mark.parametrize("shift_rate", [0.0, 0.5])
def test_attitude_settles_at_its_command(config, model, K, shift_rate):
    """python-control's gain at rest, command to the weighted attitude in h: the weight itself."""
    weights = config.C[[3, 4, 8]][:, [0, 1, 8]]
    for loop in three_loops(replace(model, shift_rate=shift_rate), K, config.prediction_s):
        settled = control.dcgain(loop.closed[["h4", "h5", "h9"], list(COMMANDS)])
        np.testing.assert_allclose(settled, weights, atol=1e-7)


def test_signals_have_their_names(model, K):
    for loop, measured in zip(
        three_loops(model, K), (STATE_NAMES, *[MEASURED_NAMES] * 2), strict=True
    ):
        assert loop.plant.input_labels == [*WIND, *COMMANDS, *INPUT_NAMES]
        assert (
            loop.plant.output_labels[12:] == loop.controller.input_labels == [*measured, *COMMANDS]
        )
        assert loop.plant.state_labels[:9] == list(STATE_NAMES)
        assert loop.wind_to_h.input_labels == list(WIND)


class TestNorm:
    """Against `control.system_norm`, which wants square, continuous systems without slycot."""

    @staticmethod
    def padded(A, B, C, D):
        n_y, n_u = D.shape
        more = n_y - n_u
        wide = np.hstack([D, np.zeros((n_y, more))])
        return control.ss(A, np.hstack([B, np.zeros((A.shape[0], more))]), C, wide)

    def test_continuous(self, model, K):
        for loop in three_loops(model, K)[:2]:
            h = loop.wind_to_h
            theirs = control.system_norm(self.padded(h.A, h.B, h.C, h.D), "inf", tol=1e-6)
            assert peak_gain(h)[0] == pytest.approx(theirs, rel=3e-6)

    def test_sampled(self, model, K, config):
        """The bilinear transformation z = (1 + s) / (1 - s) leaves the norm as it is."""
        h = flown_loop(model, K, config.prediction_s).wind_to_h
        inverse = np.linalg.inv(h.A + np.eye(h.nstates))
        continuous = self.padded(
            (h.A - np.eye(h.nstates)) @ inverse,
            np.sqrt(2.0) * inverse @ h.B,
            np.sqrt(2.0) * h.C @ inverse,
            h.D - h.C @ inverse @ h.B,
        )
        z = np.exp(1j * 20.0 * TICK_S)
        s = (z - 1.0) / (z + 1.0)
        np.testing.assert_allclose(continuous(s)[:, :3], h(z), rtol=1e-9, atol=1e-14)
        theirs = control.system_norm(continuous, "inf", tol=1e-6)
        assert peak_gain(h)[0] == pytest.approx(theirs, rel=3e-6)


class TestMargins:
    def test_disk_margin_of_each_channel_is_that_of_python_control(self, model, K, config):
        """One channel broken, the others closed: a scalar loop, which python-control can judge."""
        loop = flown_loop(model, K, config.prediction_s)
        y, u = list(MEASURED_NAMES), list(INPUT_NAMES)
        L = -(loop.controller[u, y] * loop.plant[y, u])
        omega = np.geomspace(0.1, 0.99 * np.pi / TICK_S, 300)
        ours = loop.at_input(omega)
        for i in range(3):
            others = np.eye(3)
            others[i, i] = 0.0
            single = control.feedback(L, control.ss([], [], [], others, TICK_S))[i, i]
            theirs = control.disk_margins(single, omega)[0]
            S = np.linalg.inv(np.eye(3) + ours)[:, i, i]
            assert 1.0 / np.max(np.abs(S - 0.5)) == pytest.approx(theirs, rel=1e-6)

    def test_judgement_is_the_analysis(self, model, config):
        """Worked out with arrays alone, as a node must not wait for python-control's import; two
        grids of frequencies."""
        k = config.params
        law = pid_as_output_law(k.K_P, k.K_I, k.K_D)
        loop = output_loop(model, law)
        margins = judge(model.A, model.B, feedback_of(k._replace(controller=PID)), Actuation())
        for where in ("input", "output"):
            alpha = disk_margin(loop, where).alpha
            assert getattr(margins, f"disk_{where}") == pytest.approx(alpha, rel=3e-3)
        assert np.log(margins.radius) / TICK_S == pytest.approx(loop.stability(), rel=1e-9)

    @pytest.mark.parametrize("shift_rate", [0.0, 0.5])
    def test_state_feedback_is_judged_at_what_flies(self, config, shift_rate):
        """Closed loop against the kernel and the sampled plant, one stepped after the other."""
        k = config.params._replace(shift_rate=shift_rate)
        step = closed_loop(config.A, config.B, feedback_of(k), Actuation())
        A, B = flown_plant(config.A, config.B, Actuation())
        g = np.random.default_rng(9)
        x, state, u3 = 1e-3 * g.standard_normal(A.shape[0]), initial_law_state(k), np.zeros(3)
        both = np.concatenate([x, np.zeros(3 if shift_rate == 0.0 else 6)])
        trim = k.x_trim[[0, 1, 8]]
        for _ in range(40):
            attitude_law(k.x_trim + x[:9], trim, k, state, u3)
            x, both = A @ x + B @ (u3 - k.u_trim), step @ both
            assert np.allclose(both[: x.size], x, atol=1e-12)

    def test_loop_of_output_feedback_is_what_flies(self, model, config):
        """The analysed loop against the kernel on the sampled plant: wind, commands, and a heading
        reference that moves, with an observer inside; so small that a bank turns nothing."""
        g = np.random.default_rng(10)
        a = g.standard_normal((4, 4))
        shapes = ((4, 8), (3, 4), (3, 8), (4, 3), (4,))
        law = output_law(0.1 * a, *(0.01 * g.standard_normal(shape) for shape in shapes))
        loop = output_loop(model, law)
        k = config.params._replace(controller=OUTPUT_FEEDBACK, law=law)
        state, u3, trim = initial_law_state(k), np.zeros(3), k.x_trim[[0, 1, 8]]
        attitude_law(k.x_trim, trim, k, state, u3)
        closed = loop.closed
        x, both = np.zeros(loop.plant.nstates), np.zeros(closed.nstates)
        for _ in range(40):
            inputs = 1e-6 * g.standard_normal(6)
            attitude_law(k.x_trim + x[:9], trim + inputs[3:], k, state, u3)
            x = loop.plant.A @ x + loop.plant.B @ np.concatenate([inputs, u3 - k.u_trim])
            both = closed.A @ both + closed.B @ inputs
            assert np.allclose(both[: x.size], x, rtol=1e-4, atol=1e-13)

    def test_mu_against_search_over_phases(self):
        """For up to three scalar blocks mu is the largest spectral radius of U M, |U_ii| = 1."""
        rng = np.random.default_rng(8)
        phases = np.exp(1j * np.linspace(0, 2 * np.pi, 181)[:-1])
        for _ in range(5):
            M = rng.standard_normal((3, 3)) + 1j * rng.standard_normal((3, 3))
            grid = np.array([[1.0, a, b] for a, b in itertools.product(phases, phases)])
            best = np.max(np.abs(np.linalg.eigvals(grid[:, :, None] * M)))
            bound = mu_bounds(M[None])[0]
            assert best <= bound * (1 + 1e-9)
            assert bound == pytest.approx(best, rel=2e-3)

    def test_disk_margin_holds_and_is_tight(self, model, K, config):
        loop = flown_loop(model, K, config.prediction_s)
        margin = disk_margin(loop, "input")
        L = loop.at_input(np.array([margin.frequency]))[0]
        M = np.linalg.inv(np.eye(3) + L) - 0.5 * np.eye(3)
        phases = np.exp(1j * np.linspace(0, 2 * np.pi, 361)[:-1])
        grid = np.array([[1.0, a, b] for a, b in itertools.product(phases, phases)])
        radius = np.max(np.abs(np.linalg.eigvals(grid[:, :, None] * M)))
        assert 1.0 / radius == pytest.approx(margin.alpha, rel=5e-3)
        for gains in itertools.product((-1.0, 1.0), repeat=3):
            f = 0.5 * 0.99 * margin.alpha * np.array(gains)
            assert scaled_input(loop, (1 + f) / (1 - f)).stability() < 0.0

    def test_channel_gain_margin_is_where_stability_ends(self, model, K, config):
        loop = flown_loop(model, K, config.prediction_s)
        for i, margin in enumerate(channel_margins(loop)[:2]):
            edge = 10 ** (margin.gain_up_db / 20)
            for factor, stable in ((0.995, True), (1.005, False)):
                gain = np.ones(3)
                gain[i] = factor * edge
                assert (scaled_input(loop, gain).stability() < 0.0) is stable

    def test_phase_and_delay_margin_of_an_integrator(self):
        """L = 5 / s: 90 deg at 5 rad/s, pi / 10 s."""
        omega = np.geomspace(0.1, 100, 4000)
        margin = channel_margin(5.0 / (1j * omega), omega)
        assert margin.phase_deg == pytest.approx(90.0, abs=0.01)
        assert margin.delay_s == pytest.approx(np.pi / 2 / 5, rel=1e-3)
        assert margin.gain_up_db == np.inf

    def test_margins_of_a_triple_lag(self):
        """L = 4 / (s + 1)^3: gain margin 8 / 4 at sqrt(3) rad/s."""
        omega = np.geomspace(0.01, 100, 8000)
        margin = channel_margin(4.0 / (1j * omega + 1) ** 3, omega)
        assert margin.gain_up_db == pytest.approx(20 * np.log10(2.0), abs=1e-3)
        crossover = np.sqrt(4.0 ** (2 / 3) - 1)
        phase = 180.0 - 3 * np.degrees(np.arctan(crossover))
        assert margin.phase_deg == pytest.approx(phase, abs=0.01)
        assert margin.delay_s == pytest.approx(np.radians(phase) / crossover, rel=1e-3)

    def test_further_delay_is_where_stability_ends(self, model, K):
        extra = further_delay_s(flown_loop(model, K, 0.0), model)
        assert 0.01 < extra < 0.05
        for shift, stable in ((-2e-4, True), (2e-4, False)):
            later = Actuation(delay_s=0.01 + extra + shift)
            assert (flown_loop(model, K, 0.0, None, later).stability() < 0.0) is stable

    def test_unstable_loop_has_no_margin(self, model, K):
        loop = flown_loop(model, K, 0.0, None, Actuation(delay_s=0.06))
        assert disk_margin(loop, "input").alpha == 0.0
        assert analyse(loop).norm == np.inf


def scaled_input(loop, gain):
    """The loop with its commands scaled on their way to the plant."""
    return replace(loop, controller=control.ss([], [], [], np.diag(gain), TICK_S) * loop.controller)


class TestTargets:
    """What the design must reach as it is flown, on the packaged model."""

    def test_loop_as_flown(self, config, model, K):
        loop = flown_loop(model, K, config.prediction_s)
        assert disk_margin(loop, "input").alpha >= 0.9
        assert disk_margin(loop, "output").alpha >= 0.6
        assert further_delay_s(loop, model) >= 0.02
        assert analyse(loop).norm < config.gamma

    def test_prediction_is_what_buys_it(self, model, K):
        assert disk_margin(flown_loop(model, K, 0.0), "output").alpha < 0.3

    def test_gain_is_the_one_that_the_margins_choose(self, model, config):
        best, tried = choose_observer_gain(model, config.prediction_s)
        assert best.poles == POLES
        reached = [c for c in tried if c.worst_disk >= 0.5 and c.further_delay_s >= 0.02]
        top = max(c.worst_disk for c in reached)
        quiet = [c.noise_gain for c in reached if c.worst_disk >= 0.9 * top]
        assert best in reached and best.noise_gain == min(quiet)
        # A choice and no edge: slower ones leave less margin, faster ones pass more noise.
        slower = [c for c in tried if c.poles[0] > best.poles[0]]
        faster = [c for c in tried if c.poles[0] < best.poles[0]]
        assert slower and all(c.worst_disk < best.worst_disk for c in slower)
        assert faster and all(c.noise_gain > 1.2 * best.noise_gain for c in faster)
        slow = assess(model, (-3.0, -3.0, -5.0), config.prediction_s)
        assert slow.disk_output < best.disk_output

    def test_known_lag_is_what_the_yaml_says(self, config):
        assert config.prediction_s == pytest.approx(Actuation().known_lag_s, abs=5e-4)

    def test_one_tick_more_or_less_delay_is_survived(self, model, K, config):
        for delay in (0.0, 0.02, 0.03):
            loop = flown_loop(model, K, config.prediction_s, None, Actuation(delay_s=delay))
            assert disk_margin(loop, "output").alpha > 0.4


def test_crossover_of_an_integrator():
    """L = 5 / s crosses one at 5 rad/s; one that is below it nowhere."""
    omega = np.geomspace(0.1, 100, 4000)
    loop = 5.0 / (1j * omega)
    assert crossover_radps(omega, loop) == pytest.approx(5.0, rel=1e-6)
    assert crossover_radps(omega, 1e-3 * loop) is None
