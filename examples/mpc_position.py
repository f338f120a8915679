# SPDX-License-Identifier: Apache-2.0
"""A model predictive position controller: limits on tilt, thrust and their rates, solved by OSQP.

Fly it:      ./hover_test.sh --custom-law examples/mpc_position.py:MpcPosition --one-process
In Python:   heli.fly(law="examples/mpc_position.py:MpcPosition")

Forward, right and down are three quadratic programs of 50 commands over 2 s. Each axis knows how
its acceleration follows its command (attitude loop with servos, delay and sampling; for down the
collective's servo), and an observer of the disturbance makes it free of offset in steady wind
(Maeder, Borrelli, Morari, Automatica 45, 2009). Its cost continues behind the horizon as the LQR's:
where no limit acts it is that LQR, and OSQP (Stellato et al., Math. Prog. Comp. 12, 2020) is asked
only where one does.
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh, solve_discrete_are

import heli
from heli_core.rotations import euler_from_quat
from heli_flight.settings import resolve
from heli_outer_pd.disturbance import trim_thrust
from heli_outer_pd.manual_controller import above_floor
from heli_outer_pd.parameters import outer_params
from heli_outer_pd.state import collective_for_thrust

try:
    import osqp
except ImportError as error:
    raise ImportError(
        "examples/mpc_position.py needs osqp, which is not installed here: "
        "./heli python -m pip install osqp"
    ) from error

DT_S = 0.04  # it plans so often; called more often, it holds its command
HORIZON = 50  # steps
TILT_RATE = math.radians(120.0)  # of the commanded tilt, rad/s
THRUST_RATE = 3.0  # of the commanded thrust, weights per second
AHEAD_S = DT_S * np.arange(HORIZON)
JERK_S, ACCELERATION_S = 0.3, 1.0  # the reference's jerk and acceleration go on for about so long
LEAST_LIFT = 0.5  # below this cos(phi) cos(theta) tilt is no longer compensated


@dataclass(frozen=True)
class Model:
    """How an axis' acceleration, averaged over a step, follows its command; both m/s2.

    a(k) = sum of num[i] u(k-i) - sum of den[i] a(k-1-i), less `damping` times the speed (1/s). For
    forward and right it is a fit to the default attitude loop in the world `honest`, for down the
    collective's delay and servo.
    """

    num: tuple[float, ...]
    den: tuple[float, ...]
    damping: float = 0.0


@dataclass(frozen=True)
class Weights:
    """What counts beside (position error, m)^2, and the observer's bandwidth."""

    speed: float  # (speed error, m/s)^2
    command: float  # (command off what holds the reference, m/s2)^2
    change: float  # (command's change in a step, m/s2)^2
    bandwidth_radps: float  # of the disturbance observer, double pole


MODELS = (
    Model((-0.003026, 0.079968, -0.075412), (-1.920641, 0.922229)),
    Model((0.060730, 0.307542, -0.565783, 0.472239), (-1.048805, 0.592222, -0.273193)),
    Model((0.069914, 0.607183, 0.288109), (-0.244186, 0.209401), 0.707),
)
WEIGHTS = (
    Weights(3.0, 0.0018, 0.015, 0.82),
    Weights(7.5, 0.01, 0.02, 3.9),
    Weights(2.2, 0.00022, 0.0013, 5.6),
)
"""By `./heli python -m evidence.experiments.mpc`: least predicted error on the axes in the world
`honest` under the floors of margin that the packaged controller's gains are searched with."""


class Qp:
    """min 1/2 U'HU + f'U with low <= U <= high and steps of U within a rate; begins where it ended.

    Each time from rho = 1, adapted every 50 iterations: what is found follows from the numbers
    alone, not from a clock nor from what else was solved before.
    """

    def __init__(self, H):
        n = len(H)
        self.H, self.x, self.y = H, np.zeros(n), np.zeros(2 * n)
        self.asked, self.unsolved = 0, 0
        self.rows = sp.vstack([sp.eye(n), sp.diags([1.0, -1.0], [0, -1], (n, n))], format="csc")
        self._solver = osqp.OSQP()
        self._solver.setup(
            sp.csc_matrix(np.triu(H)), np.zeros(n), self.rows, -np.ones(2 * n), np.ones(2 * n),
            verbose=False, eps_abs=1e-4, eps_rel=1e-4, max_iter=2000, check_termination=10,
            adaptive_rho_interval=50,
        )  # fmt: skip

    def __deepcopy__(self, memo):
        """`heli.Simulation.save` copies a controller; OSQP's memory is made anew."""
        again = Qp(self.H)
        again.x, again.y = self.x.copy(), self.y.copy()
        again.asked, again.unsolved = self.asked, self.unsolved
        return again

    def solve(self, f, low, high):
        """U (n,) for f (n,) and limits (2n,) of `rows`."""
        self._solver.update(q=f, l=low, u=high)
        self._solver.update_settings(rho=1.0)
        self._solver.warm_start(x=self.x, y=self.y)
        found = self._solver.solve(raise_error=False)
        self.asked += 1
        self.unsolved += found.info.status_val != osqp.SolverStatus.OSQP_SOLVED
        self.x, self.y = np.array(found.x), np.array(found.y)
        return self.x


class AxisMpc:
    """One axis: what it remembers, its observer and its quadratic program.

    Its program depends on theta: position and speed error (as flown less wanted), states of the
    model, last command, and over the horizon the disturbance less the reference's acceleration.
    """

    def __init__(self, model, weights, rate):
        self.model, self.weights, self.step_limit = model, weights, rate * DT_S
        self._realise()
        self._condense()
        self.begin(0.0, 0.0)

    def _realise(self):
        """The model as x+ = A x + B u, a = C x + D u, and theta+ = A theta + B u."""
        m, num = len(self.model.den), np.array(self.model.num)
        den = np.array(self.model.den)
        self.A = np.eye(m, k=1)
        self.A[:, 0] = -den
        self.B, self.C, self.D = num[1:] - den * num[0], np.eye(m)[0], num[0]
        self.gain = num.sum() / (1.0 + den.sum())
        # x that stands still under a command of 1
        self.stands = np.linalg.solve(np.eye(m) - self.A, self.B)
        e, v, last = np.eye(m + 3)[[0, 1, -1]]
        x = np.eye(m + 3)[2:-1]
        a = self.C @ x - self.model.damping * v
        self.full_A = np.vstack(
            [e + DT_S * v + 0.5 * DT_S**2 * a, v + DT_S * a, self.A @ x, 0.0 * e]
        )
        moved = np.array([0.5 * DT_S**2, DT_S, *np.zeros(m + 1)])
        self.full_B = self.D * moved + np.array([0.0, 0.0, *self.B, 1.0])
        self.moved = moved  # by an acceleration from outside

    def _condense(self):
        """H, F of 1/2 U'HU + (F theta)'U, and `free`: U = free theta where no limit acts."""
        w, n = self.weights, len(self.full_A)
        cost = np.diag([1.0, w.speed, *np.zeros(n - 3), w.change])
        cross = np.zeros((n, 1))
        cross[-1] = -w.change
        R = np.array([[w.command + w.change]])
        self.behind = solve_discrete_are(self.full_A, self.full_B[:, None], cost, R, s=cross)
        theta, U = np.eye(n, n + HORIZON), np.zeros((n, HORIZON))
        outside = np.eye(HORIZON, n + HORIZON, k=n)
        of_theta, of_U = [], []
        for now, net in zip(np.eye(HORIZON), outside, strict=True):
            rows = (
                (1.0, theta[0], U[0]),
                (w.speed, theta[1], U[1]),
                (w.command, net / self.gain, now),  # off the command that holds the reference
                (w.change, -theta[-1], now - U[-1]),
            )
            of_theta += [math.sqrt(weight) * row for weight, row, _ in rows]
            of_U += [math.sqrt(weight) * row for weight, _, row in rows]
            theta = self.full_A @ theta + np.outer(self.moved, net)
            U = self.full_A @ U + np.outer(self.full_B, now)
        rests = np.array([0.0, 0.0, *self.stands, 1.0])  # under a command of 1
        values, vectors = eigh(self.behind)
        root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
        off = theta + np.outer(rests, outside[-1] / self.gain)
        of_theta, of_U = np.vstack([*of_theta, root @ off]), np.vstack([*of_U, root @ U])
        H, F = of_U.T @ of_U, of_U.T @ of_theta
        self.H, self.F = H / H[0, 0], F / H[0, 0]
        self.free = -np.linalg.solve(self.H, self.F)

    def begin(self, command, speed):
        """What is flown stands still: command m/s2, speed m/s."""
        self.x, self.last = self.stands * command, command
        self.speed, self.disturbance = speed, -self.gain * command
        self.qp = Qp(self.H)

    def observe(self, speed, off, limit):
        """The disturbance, m/s2, by the speed, m/s, which is `off` the reference's."""
        a = self.C @ self.x + self.D * self.last - self.model.damping * off + self.disturbance
        self.x = self.A @ self.x + self.B * self.last
        w, ahead = self.weights.bandwidth_radps, self.speed + DT_S * a
        keep = math.exp(-w * DT_S)
        new = speed - ahead
        self.speed = ahead + (1.0 - keep**2) * new
        d = self.disturbance + (1.0 - keep) ** 2 / DT_S * new
        self.disturbance = min(max(d, -limit), limit)

    def command(self, position_error, speed_error, accelerations, low, high):
        """The command, m/s2, between low and high.

        accelerations (HORIZON,), m/s2: the reference's, of now and of the steps to come.
        """
        net = self.disturbance - accelerations
        theta = np.array([position_error, speed_error, *self.x, self.last, *net])
        U = self.free @ theta
        # A limit that has moved is gone to no faster than the rate.
        reach = self.step_limit * np.arange(1, HORIZON + 1)
        lows = np.minimum(low, self.last + reach)
        highs = np.maximum(high, self.last - reach)
        steps = np.full(HORIZON, self.step_limit)
        begins = self.last * np.eye(HORIZON)[0]
        lows, highs = (
            np.concatenate([lows, begins - steps]),
            np.concatenate([highs, begins + steps]),
        )
        made = self.qp.rows @ U
        if (made < lows).any() or (made > highs).any():
            U = self.qp.solve(self.F @ theta, lows, highs)
        first = min(max(U[0], lows[0]), highs[0])
        self.last = min(max(first, lows[HORIZON]), highs[HORIZON])
        return self.last


class MpcPosition:
    """Three axes, in the heading frame: tilt and thrust that they ask for.

    known: function of the flight time, s, that gives the reference's acceleration over the horizon
    (HORIZON, 3), NED, m/s2, where the path is known ahead; None: it goes on as it changes now.
    """

    loop = "outer"

    def __init__(self, models=MODELS, weights=WEIGHTS, known=None):
        self.k, self.known = outer_params(resolve().nodes["outer_loop"]), known
        g = self.k.g
        rates = g * TILT_RATE, g * TILT_RATE, g * THRUST_RATE
        self.axes = [AxisMpc(*of) for of in zip(models, weights, rates, strict=True)]
        self.planned_s, self.held = -math.inf, None

    def reset(self, x, r, u):
        """Before the first step, and when the controller begins again: what is flown stands."""
        phi, theta, psi = euler_from_quat(x[heli.NAV.quat])
        tilts = self.k.trim[1] - theta, phi - self.k.trim[0]
        flown = [*(self.k.g * math.tan(tilt) for tilt in tilts), 0.0]
        for axis, command, speed in zip(
            self.axes, flown, _turned(x[heli.NAV.vel], psi), strict=True
        ):
            axis.begin(command, speed)
        self.psi, self.acceleration = psi, r[heli.SHAPED.acc]
        self.planned_s = -math.inf

    def ahead(self, r, t):
        """The reference's acceleration over the horizon (HORIZON, 3), NED, m/s2."""
        if self.known is not None:
            return self.known(t)
        now = r[heli.SHAPED.acc]
        jerk, self.acceleration = (now - self.acceleration) / DT_S, now
        grown = now + np.outer(JERK_S * (1.0 - np.exp(-AHEAD_S / JERK_S)), jerk)
        return np.exp(-AHEAD_S / ACCELERATION_S)[:, None] * grown

    def step(self, x, r, t):
        """Navigation x (31,), reference r (10,), time t, s, to phi, theta, psi, rad, collective.

        Called more often than every `DT_S` it holds what it planned last.
        """
        if t - self.planned_s > 0.75 * DT_S:
            self.planned_s, self.held = t, self.plan(x, r, t)
        return self.held

    def plan(self, x, r, t):
        """The command of now, as of `step`."""
        k, g, trim = self.k, self.k.g, self.k.trim
        phi, theta, psi = euler_from_quat(x[heli.NAV.quat])
        # Wind stays where it is while the nose turns.
        forward, right = (axis.disturbance for axis in self.axes[:2])
        wind = _turned(np.array([forward, right, 0.0]), psi - self.psi)
        self.psi = psi
        self.axes[0].disturbance, self.axes[1].disturbance = wind[:2]
        speed = _turned(x[heli.NAV.vel], psi)
        off_m = _turned(x[heli.NAV.pos] - r[heli.SHAPED.pos], psi)
        off_mps = _turned(x[heli.NAV.vel] - r[heli.SHAPED.vel], psi)
        wanted = _turned(self.ahead(r, t).T, psi)
        for i, axis in enumerate(self.axes):
            axis.observe(speed[i], off_mps[i], k.disturbance_limit[i])
        lift = max(math.cos(phi) * math.cos(theta), LEAST_LIFT)
        # What the air lifts is the rotor's thrust, too, as for the packaged controller.
        lifted = max(-self.axes[2].disturbance / g, 0.0)
        least, largest = max(k.thrust_limits[0] - lifted, 0.0), k.thrust_limits[1]
        most = g * math.tan(k.tilt_limit)
        low = -most, -most, g * (1.0 - largest * lift)
        high = most, most, g * (1.0 - least * lift)
        errors = zip(off_m, off_mps, wanted, low, high, strict=True)
        u = [axis.command(*of) for axis, of in zip(self.axes, errors, strict=True)]
        share = min(max((1.0 - u[2] / g) / lift, least), largest)
        map_ = trim_thrust(k), trim[3], k.rotor
        d_col = collective_for_thrust(share * k.mass * g, r[heli.SHAPED.vel][2], *map_)
        return (
            trim[0] + math.atan(u[1] / g),
            trim[1] - math.atan(u[0] / g),
            r[heli.SHAPED.psi],
            above_floor(d_col, k),
        )


def _turned(ned, psi):
    """Vectors (3,) or (3, n), NED, in the heading frame: forward, right, down."""
    c, s = math.cos(psi), math.sin(psi)
    return np.array([c * ned[0] + s * ned[1], c * ned[1] - s * ned[0], ned[2]])
