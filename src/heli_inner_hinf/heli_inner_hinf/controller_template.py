# SPDX-License-Identifier: Apache-2.0
"""A template for your own attitude controller: copy it, change `user_law`, and put it into the
graph.

1. Copy this file and write the controller: the five arguments of `attitude_law`, in njit's subset
of
   Python.
2. Give it a name in `controller_state.CONTROLLERS` (`"mine": 3`, a kind of its own): this makes
   `controller: mine` a valid parameter. Its margins are not judged: the kernel's linear form is
   known for the kinds that are there (`loops.linear_law_of`). A linear controller needs no kernel:
   `controller: matrices`.
3. Call it in a branch of `controllers.attitude_law`, beside `pid_law`. Limits, NaN, status and the
   bumpless offset are done there: the controller only writes its unlimited command.
4. Numbers that it needs go into `AttitudeParams` and, as parameters, into `parameters.TABLE`
   and `config/inner_loop.yaml`.

The example is a controller that works: angles by proportional gain, rates by damping, one axis
each.
"""

from heli_core.jit import njit
from heli_core.rotations import wrap_pi
from heli_core.rows import NINE, SETPOINT


@njit
def user_law(x9, r3, k, state, u3):
    """Unlimited command (3,) into u3.

    Parameters
    ----------
    x9 : (9,) array
        Absolute phi theta p q a_s b_s r d_int psi, rad and rad/s, places of `NINE`; finite.
    r3 : (3,) array
        Commanded phi, theta, psi, absolute, rad, places of `SETPOINT`; finite.
    k : AttitudeParams
        Numbers of the controller; here K_P, K_D and u_trim.
    state : (N_LAW_STATE,) array
        Memory; see the layout in `controller_state`. This controller has none.
    u3 : (3,) array
        Out: d_lat, d_lon, d_ped, absolute.
    """
    roll = r3[SETPOINT.phi] - x9[NINE.phi]
    pitch = r3[SETPOINT.theta] - x9[NINE.theta]
    turn = wrap_pi(r3[SETPOINT.psi] - x9[NINE.psi])
    u3[0] = k.u_trim[0] + k.K_P[0] * roll - k.K_D[0] * x9[NINE.p]
    u3[1] = k.u_trim[1] + k.K_P[1] * pitch - k.K_D[1] * x9[NINE.q]
    u3[2] = k.u_trim[2] + k.K_P[2] * turn - k.K_D[2] * x9[NINE.r]
