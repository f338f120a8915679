# SPDX-License-Identifier: Apache-2.0
"""States, inputs and wind of the linear model of eq. (10): names, units, and which are measured."""

from heli_math.rows import ACTUATOR, NINE

STATE_NAMES = NINE._fields
"""phi theta p q a_s b_s r d_int psi: the order of every A, B, E of the stack; rad, p q r rad/s."""
ACTUATOR_NAMES = ("d_lat", "d_lon", "d_ped", "d_col")
INPUT_NAMES = ACTUATOR_NAMES[ACTUATOR.attitude]
"""The three inputs of B, -1..1; the collective belongs to the altitude law."""
WIND_NAMES = ("u", "v", "w")
"""The three inputs of E: velocity of the air in body axes, m/s."""

MEASURED = (NINE.phi, NINE.theta, NINE.p, NINE.q, NINE.r, NINE.psi)
"""Places of y in x, eq. (10)."""
UNMEASURED = (NINE.a_s, NINE.b_s, NINE.d_int)
"""Places in x of what the reduced-order observer (19) estimates, in the order of a RotorRow."""
ATTITUDE = (NINE.phi, NINE.theta, NINE.psi)
"""Places in x of what follows a command: the rows of C_out in eq. (15)."""
