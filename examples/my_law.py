# SPDX-License-Identifier: Apache-2.0
"""An attitude controller of your own: LQR with integral action on the aircraft linearised in hover.

Fly it:      ./hover_test.sh --custom-law examples/my_law.py:MyLaw
             ./hover_test.sh --custom-law examples/my_law.py:MyLaw --one-process
In Python:   heli.fly(law="examples/my_law.py:MyLaw")
"""

import control
import numpy as np

import heli

NINE = heli.NINE
ANGLES = [NINE.phi, NINE.theta, NINE.psi]  # what is commanded
DT_S = 0.01  # the controller is called so often


class MyLaw:
    """u = u_trim - K [x - x_trim, integral of the attitude error]."""

    def __init__(self):
        model = heli.linearize()  # x' = A x + B u + E w, about hover in still air
        self.x_trim, self.u_trim = model.x_trim, model.u_trim
        # The states, and behind them the integrals of the three errors.
        n = len(NINE)
        A = np.block([[model.A, np.zeros((n, 3))], [np.eye(n)[ANGLES], np.zeros((3, 3))]])
        B = np.vstack([model.B, np.zeros((3, 3))])
        # What a state costs: 1 / (what you would put up with)^2. Flapping and gyro cost nothing.
        allowed = {"phi": 0.15, "theta": 0.15, "psi": 0.15, "p": 5.0, "q": 5.0, "r": 5.0}
        costs = [1.0 / allowed[name] ** 2 if name in allowed else 0.0 for name in NINE._fields]
        Q = np.diag([*costs, 10.0, 10.0, 10.0])
        # What an actuator costs: servos and delay are not in the model, so not too little.
        R = np.eye(3) / 0.1**2
        self.K, _, _ = control.lqr(A, B, Q, R)

    def reset(self, x, r, u):
        """Before the first step, and when the controller begins again."""
        self.integral = np.zeros(3)

    def step(self, x, r, t):
        """Every tick: states x (9,), commanded phi theta psi r (3,), time t; gives u (3,)."""
        deviation = x - self.x_trim
        error = x[ANGLES] - r
        error[2] = (error[2] + np.pi) % (2.0 * np.pi) - np.pi  # the shorter way round
        deviation[ANGLES] = error
        u = self.u_trim - self.K @ np.concatenate([deviation, self.integral])
        if np.abs(u).max() < 0.95:  # at a limit an integral would run away
            self.integral += DT_S * error
        return u
