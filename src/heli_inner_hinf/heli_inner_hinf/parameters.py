# SPDX-License-Identifier: Apache-2.0
"""The inner loop's parameters; their values stand in config/inner_loop.yaml."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from heli_core.parameters import Parameter
from heli_inner_hinf.controller_state import CONTROLLERS
from heli_inner_hinf.excitation import DISTURBANCE_ROWS

NODE_NAME = "inner_loop"

# By parameter, or by the section that ends in a point, the controllers that read it; any other one
# is read whatever flies.
_WEIGHTED = ("hinf_output", "hinf", "lqg", "lqr")
_READERS: Mapping[str, tuple[str, ...]] = {
    "gamma": ("hinf",),
    "C11": _WEIGHTED,
    "C22": _WEIGHTED,
    "D11": _WEIGHTED,
    "output.": ("hinf_output",),
    "lqg.": ("lqg",),
    "law.": ("matrices",),
    "prediction_s": ("hinf", "lqr"),
    "offset_free_radps": ("hinf", "lqr"),
    "pid.": ("pid",),
    "indi.": ("indi",),
}


def readers(parameter: str) -> tuple[str, ...]:
    """The controllers that read a parameter of the inner loop; empty: whatever flies reads it."""
    section, point, _ = parameter.partition(".")
    return _READERS.get(section + point, ())


@dataclass(frozen=True)
class Unread:
    """A parameter that changes nothing: the controller that flies does not read it.

    Attributes
    ----------
    parameter : str
    controller : str
        What flies.
    readers : tuple of str
        The controllers that read it.
    instead : str
        The parameter of the same kind that the controller reads; empty: there is none.
    """

    parameter: str
    controller: str
    readers: tuple[str, ...]
    instead: str

    @property
    def words(self) -> str:
        """What it is, who reads it, and what stands in its place."""
        instead = f"; {self.controller} has {self.instead}" if self.instead else ""
        return f"{self.parameter} (of {', '.join(self.readers)}{instead})"


def unread(controller: str, parameters: Iterable[str]) -> list[Unread]:
    """Those of the inner loop's parameters that a controller does not read.

    Parameters
    ----------
    controller : str
        One of `CONTROLLERS`, or the name of a controller in Python, which reads none of what
        belongs to them.
    parameters : iterable of str
        Names.

    Returns
    -------
    list of Unread
    """
    by_leaf = {
        row.name.rsplit(".", 1)[-1]: row.name for row in TABLE if controller in readers(row.name)
    }
    return [
        Unread(name, controller, readers(name), by_leaf.get(name.rsplit(".", 1)[-1], ""))
        for name in parameters
        if readers(name) and controller not in readers(name)
    ]


def unread_sentence(ones: Sequence[Unread]) -> str:
    """One sentence about all of them; empty without any."""
    if not ones:
        return ""
    words = ", ".join(one.words for one in ones)
    return f"changes nothing, as controller {ones[0].controller} does not read it: {words}"


def _row(name: str, kind: str, description: str, unit: str = "", **bounds) -> Parameter:
    if readers(name):
        description = f"{description} (controller: {', '.join(readers(name))})"
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
    _row("estimate_timeout_s", "double",
         "Age of an estimate over which the model is integrated; older ones are none", "s",
         lower=0.01, upper=2.0, read_only=True),
    _row("controller", "string", "Which attitude controller flies", choices=tuple(CONTROLLERS)),
    _row("own_law", "string", "A controller in Python that flies in its place, MODULE:NAME or "
         "FILE.py:NAME: its code runs", read_only=True),
    _row("gamma", "double", "Bound on the H-infinity norm wind -> h, above gamma*; "
         "that of the default controller, hinf_output, is output.gamma", "",
         lower=0.0, lower_open=True),
    _row("C11", "double[]", "Weights on phi, theta (1/rad), p, q (s/rad), eq. (12)", "",
         shape=(4, 4)),
    _row("C22", "double[]", "Weights on a_s, b_s, r, d_int, psi, eq. (12)", "", shape=(2, 5)),
    _row("D11", "double[]", "Weights on d_lat, d_lon, d_ped, eq. (12)", "", shape=(3, 3)),
    _row("output.gamma", "double", "Bound on the norm (wind, load, noise) -> (h, integrals)", "",
         lower=0.0, lower_open=True),
    _row("output.effort", "double[]", "Factors on D11", "", shape=(3,), lower=0.0,
         lower_open=True),
    _row("output.integral", "double[]", "Weights on the integrals of phi, theta, psi",
         "1/(rad s)", shape=(3,), lower=0.0, lower_open=True),
    _row("output.load", "double[]", "Load in place of d_lat, d_lon, d_ped per wind", "s/m",
         shape=(3,), lower=0.0),
    _row("output.noise", "double[]", "Noise of phi, theta, p, q, r, psi per wind", "rad s/m, rad/m",
         shape=(6,), lower=0.0, lower_open=True),
    _row("output.command_effort", "double", "Factor on D11 where commands are followed", "",
         lower=0.01, upper=10.0),
    _row("lqg.effort", "double[]", "Factors on D11", "", shape=(3,), lower=0.0, lower_open=True),
    _row("lqg.integral", "double[]", "Weights on the integrals of phi, theta, psi",
         "1/(rad s)", shape=(3,), lower=0.0, lower_open=True),
    _row("lqg.load", "double[]", "Load in place of d_lat, d_lon, d_ped per wind", "s/m",
         shape=(3,), lower=0.0),
    _row("lqg.noise", "double[]", "Noise of phi, theta, p, q, r, psi per wind", "rad s/m, rad/m",
         shape=(6,), lower=0.0, lower_open=True),
    _row("trim.x", "double[]", "Trim of phi theta p q a_s b_s r d_int psi", "rad, rad/s",
         shape=(9,)),
    _row("trim.u", "double[]", "Trim of d_lat, d_lon, d_ped, d_col", "", shape=(4,),
         lower=-1.0, upper=1.0, lower_open=True, upper_open=True),
    _row("model.A", "double[]", "State matrix about trim, eq. (9)", "", shape=(9, 9)),
    _row("model.B", "double[]", "Input matrix for d_lat, d_lon, d_ped, eq. (9)", "",
         shape=(9, 3)),
    _row("model.E", "double[]", "Wind matrix for u, v, w in body axes, eq. (9)", "",
         shape=(9, 3)),
    _row("servo.frequency_radps", "double", "Natural frequency of the servos", "rad/s",
         lower=1.0, upper=1000.0),
    _row("servo.damping", "double", "Damping ratio of the servos", "", lower=0.05, upper=5.0),
    _row("delay_ticks", "int", "A command acts so many ticks after the tick it was computed",
         "ticks", choices=(0, 1, 2, 3)),
    _row("law.A", "double[]", "State matrix of `controller: matrices`, n x n", "",
         shape=(None,)),
    _row("law.B", "double[]", "Input matrix of `controller: matrices`, n x 8", "",
         shape=(None,)),
    _row("law.C", "double[]", "Output matrix of `controller: matrices`, 3 x n", "",
         shape=(None,)),
    _row("law.D", "double[]", "Direct part of `controller: matrices`, 3 x 8", "",
         shape=(None,)),
    _row("law.L", "double[]", "Conditioning of `controller: matrices` at a limit, n x 3", "",
         shape=(None,)),
    _row("law.turn", "double[]", "What a new heading reference moves of its state, n", "1/rad",
         shape=(None,)),
    _row("prediction_s", "double", "Known lag from command to rotor that hinf and lqr predict over",
         "s", lower=0.0, upper=0.2),
    _row("actuator_limit", "double", "Actuators stay within plus and minus this", "",
         lower=0.1, upper=1.0, upper_open=True),
    _row("ground_collective", "double",
         "Beyond it, seen from hover's, the aircraft stands: controller at rest, sticks in trim",
         "", lower=-1.0, upper=1.0),
    _row("margin_floor", "double", "Least disk margin of a controller in the loop as flown", "",
         lower=0.0, upper=2.0),
    _row("bumpless_time_s", "double", "Time constant with which a swap's offset fades", "s",
         lower=0.0, upper=60.0),
    _row("offset_free_radps", "double",
         "Rate at which a lasting attitude error shifts the target of hinf and lqr", "rad/s",
         lower=0.0, upper=2.0),
    _row("pid.K_P", "double[]", "Proportional gains of roll, pitch, yaw", "1/rad", shape=(3,)),
    _row("pid.K_I", "double[]", "Integral gains of roll, pitch, yaw", "1/(rad s)", shape=(3,)),
    _row("pid.K_D", "double[]", "Gains on p, q, r (derivative on measurement)", "s/rad",
         shape=(3,)),
    _row("indi.angle", "double[]", "Wanted rate per error of phi, theta, psi", "1/s", shape=(3,),
         lower=0.0),
    _row("indi.rate", "double[]", "Share of p, q, r that is compared unfiltered", "", shape=(3,),
         lower=0.0, upper=1.0),
    _row("indi.acceleration", "double[]",
         "Rate that counts as much as an angular acceleration, roll, pitch, yaw", "s", shape=(3,),
         lower=0.0, upper=1.0),
    _row("indi.filter_radps", "double[]", "Natural frequency of the low-pass of p, q, r", "rad/s",
         shape=(3,), lower=0.1, upper=300.0),
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
    *DISTURBANCE_ROWS,
)  # fmt: skip
