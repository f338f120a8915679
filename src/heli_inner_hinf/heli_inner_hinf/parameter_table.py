# SPDX-License-Identifier: Apache-2.0
"""The inner loop's parameters; their values stand in config/inner_loop.yaml."""

from heli_inner_hinf.law_state import CONTROLLERS
from heli_parameters.parameters import Parameter

NODE_NAME = "inner_loop"


def _row(name: str, kind: str, description: str, unit: str = "", **bounds) -> Parameter:
    return Parameter(name, kind, description, unit, **bounds)


TABLE: tuple[Parameter, ...] = (
    _row("lockstep", "bool", "Act on the set of messages of a tick instead of on arrival",
         read_only=True),
    _row("expects_outer", "bool", "Lockstep waits for the outer loop's setpoint and collective"),
    _row("outer_period_ticks", "int", "The outer loop's period", "ticks",
         choices=(1, 2, 4, 5, 10, 20), read_only=True),
    _row("setpoint_timeout_s", "double",
         "Age of the newest attitude setpoint after which trim attitude is held", "s",
         lower=0.04, upper=60.0),
    _row("controller", "string", "Which attitude law flies", choices=tuple(CONTROLLERS)),
    _row("gamma", "double", "Bound on the H-infinity norm wind -> h, above gamma*", "",
         lower=0.0, lower_open=True),
    _row("C11", "double[]", "Weights on phi, theta (1/rad), p, q (s/rad), eq. (12)", "",
         shape=(4, 4)),
    _row("C22", "double[]", "Weights on a_s, b_s, r, d_int, psi, eq. (12)", "", shape=(2, 5)),
    _row("D11", "double[]", "Weights on d_lat, d_lon, d_ped, eq. (12)", "", shape=(3, 3)),
    _row("trim.x", "double[]", "Trim of phi theta p q a_s b_s r d_int psi", "rad, rad/s",
         shape=(9,)),
    _row("trim.u", "double[]", "Trim of d_lat, d_lon, d_ped, d_col", "", shape=(4,),
         lower=-1.0, upper=1.0, lower_open=True, upper_open=True),
    _row("model.A", "double[]", "State matrix about trim, eq. (9)", "", shape=(9, 9)),
    _row("model.B", "double[]", "Input matrix for d_lat, d_lon, d_ped, eq. (9)", "",
         shape=(9, 3)),
    _row("model.E", "double[]", "Wind matrix for u, v, w in body axes, eq. (9)", "",
         shape=(9, 3)),
    _row("prediction_s", "double", "Known lag from command to rotor that hinf and lqr predict over",
         "s", lower=0.0, upper=0.2),
    _row("actuator_limit", "double", "Actuators stay within plus and minus this", "",
         lower=0.1, upper=1.0, upper_open=True),
    _row("bumpless_time_s", "double", "Time constant with which a swap's offset fades", "s",
         lower=0.0, upper=60.0),
    _row("offset_free_radps", "double",
         "Rate at which a lasting attitude error shifts the target of hinf and lqr", "rad/s",
         lower=0.0, upper=2.0),
    _row("pid.K_P", "double[]", "Proportional gains of roll, pitch, yaw", "1/rad", shape=(3,)),
    _row("pid.K_I", "double[]", "Integral gains of roll, pitch, yaw", "1/(rad s)", shape=(3,)),
    _row("pid.K_D", "double[]", "Gains on p, q, r (derivative on measurement)", "s/rad",
         shape=(3,)),
    _row("excitation.frequency_hz", "double[]", "Lines of the excitation for identification", "Hz",
         shape=(None,), lower=0.0, upper=50.0, lower_open=True, read_only=True),
    _row("excitation.amplitude", "double[]",
         "Amplitude of each line on d_lat, d_lon, d_ped, d_col", "", shape=(None, 4),
         lower=-1.0, upper=1.0, read_only=True),
    _row("excitation.phase_rad", "double[]", "Phase of each line on d_lat, d_lon, d_ped, d_col",
         "rad", shape=(None, 4), lower=-10.0, upper=10.0, read_only=True),
    _row("excitation.start_s", "double", "Flight time at which the excitation starts", "s",
         lower=0.0, upper=86400.0, read_only=True),
    _row("excitation.duration_s", "double", "Length of the excitation with both fades", "s",
         lower=0.0, upper=86400.0, read_only=True),
    _row("excitation.fade_s", "double", "Length of the fade in and of the fade out", "s",
         lower=0.0, upper=600.0, read_only=True),
    _row("excitation.attitude_limit_deg", "double",
         "Deviation of roll or pitch from trim at which the excitation is given up", "deg",
         lower=0.0, upper=45.0, read_only=True),
    _row("excitation.saturation_s", "double",
         "Time at an actuator's limit after which the excitation is given up", "s",
         lower=0.0, upper=60.0, read_only=True),
)  # fmt: skip
