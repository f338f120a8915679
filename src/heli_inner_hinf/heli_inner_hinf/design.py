# SPDX-License-Identifier: Apache-2.0
"""From the inner loop's parameters to its kernel: the same judgement at start, on a change, in the
command.
"""

import math
import pickle
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from heli_core.errors import (
    InfeasibleGammaError,
    MarginError,
    ShapeError,
    SynthesisError,
    UnstableLoopError,
)
from heli_core.rows import ACTUATOR
from heli_core.ticks import TICK_S, Rate
from heli_inner_hinf.controller_state import (
    CONTROLLERS,
    LAST_R,
    LAST_X,
    NO_LAW,
    STATE_FEEDBACK,
    Actuation,
    AttitudeParams,
    OutputLaw,
    initial_law_state,
    output_law,
    predicting_gains,
    rest_map,
)
from heli_inner_hinf.controllers import swap_bumpless
from heli_inner_hinf.loops import Assessment, feedback_of, judge
from heli_inner_hinf.output_feedback import (
    IndiGains,
    OutputSynthesis,
    OutputWeights,
    generalised_plant,
    indi_law,
    lqg_law,
    synthesize_output,
)
from heli_inner_hinf.regular_form import N_U, N_X, Matrix, checked, output_selector, weights
from heli_inner_hinf.synthesis import Lqr, Synthesis, lqr, synthesize

# -------------------------------------------------------------------------------------------------
# Design.
# -------------------------------------------------------------------------------------------------

_OF_LINKS = ("link_faults", "link_seed")
LEAST_GAMMA_FACTOR = 1.05
"""Of gamma*: nearer to it a controller loses its margins; no bound chosen here is lower."""
_FROM_HOVER = 0.1
"""Least distance of the collective of standing from hover's."""


class UnknownControllerError(SynthesisError):
    """`controller` names no controller."""


@dataclass(frozen=True, eq=False)
class AttitudeConfig:
    """A judged design: building one raises the named causes of `heli_core.errors`.

    Attributes
    ----------
    controller : str
        One of `CONTROLLERS`.
    A, B, E : (9, 9), (9, 3), (9, 3) arrays
        Linear model about trim, eq. (9), SI and rad.
    C, D : (9, 9), (9, 3) arrays
        Controlled output, eq. (11), (12).
    gamma : float
    x_trim, u_trim : (9,), (4,) arrays
        Trim; u_trim in the order d_lat, d_lon, d_ped, d_col.
    actuation : Actuation
        Servos and delay between command and rotor, of which output feedback knows.
    prediction_s : float
        Known lag from command to rotor, over which state feedback predicts the state, s.
    actuator_limit : float
        In (0, 1).
    bumpless_time_s : float
        Time constant with which a swap's offset fades, s.
    offset_free_radps : float
        Rate at which a lasting attitude error shifts the target of state feedback, rad/s.
    K_P, K_I, K_D : (3,) arrays
        PID gains of roll, pitch, yaw.
    output : OutputSynthesis or None
        Controller and certificate of `hinf_output`; None with another controller.
    law : OutputLaw
        Of order zero unless the controller is output feedback.
    margin_floor : float
        Disk margin below which a controller is refused.
    ground_collective : float
        Beyond it, seen from hover's, the aircraft stands and the controller rests.
    """

    controller: str
    A: Matrix
    B: Matrix
    E: Matrix
    C: Matrix
    D: Matrix
    gamma: float
    x_trim: Matrix
    u_trim: Matrix
    actuation: Actuation
    prediction_s: float
    actuator_limit: float
    bumpless_time_s: float
    offset_free_radps: float
    K_P: Matrix
    K_I: Matrix
    K_D: Matrix
    output: OutputSynthesis | None
    law: OutputLaw
    margin_floor: float
    ground_collective: float

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any]) -> "AttitudeConfig":
        """Judge and synthesise from dotted names to values (arrays flat or shaped).

        Raises
        ------
        ShapeError, InfeasibleGammaError, NotStabilizableError, InvariantZeroError,
        FeedforwardError, CertificateError, UnknownControllerError, UnstableLoopError, MarginError
            Each with a sentence.
        """
        p = parameters
        if p["controller"] not in CONTROLLERS:
            allowed = ", ".join(CONTROLLERS)
            raise UnknownControllerError(
                f"controller {p['controller']!r} is unknown; allowed: {allowed}"
            )
        C, D = weights(
            shaped("C11", p["C11"], (4, 4)),
            shaped("C22", p["C22"], (2, 5)),
            shaped("D11", p["D11"], (3, 3)),
        )
        A = shaped("model.A", p["model.A"], (9, 9))
        B = shaped("model.B", p["model.B"], (9, 3))
        E = shaped("model.E", p["model.E"], (9, 3))
        limit = float(p["actuator_limit"])
        if not 0.0 < limit < 1.0:
            raise ShapeError("actuator_limit", f"actuator_limit = {limit:g} must be inside (0, 1)")
        actuation = Actuation(
            p["servo.frequency_radps"],
            p["servo.damping"],
            p["delay_ticks"] * TICK_S,
            Rate.of_parameters(p).tick_s,
        )
        if p["controller"] == "matrices" and actuation.tick_s != TICK_S:
            raise ShapeError(
                "controller",
                f"controller: matrices: they are those of steps of 10 ms; rate_hz = {p['rate_hz']} "
                "does not go with them",
            )
        output, law = None, _law_of(p, A, B, actuation)
        if p["controller"] == "hinf_output":
            gamma = float(p["output.gamma"])
            output = synthesize_output(A, B, E, C, D, added_weights(p), actuation, gamma)
            law = output.law
        elif p["controller"] == "lqg":
            plant = generalised_plant(A, B, E, C, D, added_weights(p, "lqg"), actuation)
            law = lqg_law(plant, actuation.tick_s)
        config = cls(
            controller=p["controller"],
            A=A,
            B=B,
            E=E,
            C=C,
            D=D,
            gamma=float(p["gamma"]),
            x_trim=shaped("trim.x", p["trim.x"], (9,)),
            u_trim=shaped("trim.u", p["trim.u"], (4,)),
            actuation=actuation,
            prediction_s=float(p["prediction_s"]),
            actuator_limit=limit,
            bumpless_time_s=float(p["bumpless_time_s"]),
            offset_free_radps=float(p["offset_free_radps"]),
            K_P=shaped("pid.K_P", p["pid.K_P"], (3,)),
            K_I=shaped("pid.K_I", p["pid.K_I"], (3,)),
            K_D=shaped("pid.K_D", p["pid.K_D"], (3,)),
            output=output,
            law=law,
            margin_floor=float(p["margin_floor"]),
            ground_collective=float(p["ground_collective"]),
        )
        if config.controller == "hinf":
            _ = config.synthesis  # here it is refused
        config._refuse_weak()
        config._refuse_rest_in_hover()
        return config

    def _refuse_rest_in_hover(self) -> None:
        """Raise if the controller would rest near the collective of hover."""
        hover = self.u_trim[ACTUATOR.col]
        if not abs(self.ground_collective - hover) >= _FROM_HOVER:
            raise ShapeError(
                "ground_collective",
                f"ground_collective = {self.ground_collective:g} is that of hover, trim.u "
                f"{hover:.3g}, where it must not rest; allowed: {_FROM_HOVER:g} or more from it",
            )

    def _refuse_weak(self) -> None:
        """Raise what is wrong with the loop as flown."""
        judgement = self.judgement
        if judgement is None:
            return
        if not judgement.stable:
            raise UnstableLoopError(self.controller, judgement.radius)
        for where, margin in (("input", judgement.disk_input), ("output", judgement.disk_output)):
            if margin < self.margin_floor:
                raise MarginError(self.controller, where, margin, self.margin_floor)

    @cached_property
    def synthesis(self) -> Synthesis:
        """State feedback by eq. (15) to (17): F, G, P, certificate.

        Under another controller than `hinf` it is not flown, and `gamma`, which that one does not
        read, refuses nothing: below gamma* it is worked out at a bound that can be had.
        """
        model = self.A, self.B, self.E, self.C, self.D
        try:
            return synthesize(*model, self.gamma, output_selector())
        except InfeasibleGammaError as error:
            if self.controller == "hinf":
                raise
            least = float(f"{LEAST_GAMMA_FACTOR * error.gamma_star:.3g}")
            return synthesize(*model, least, output_selector())

    @property
    def bound(self) -> Synthesis | OutputSynthesis | None:
        """The synthesis with a bound gamma that flies; None for a controller without one."""
        return self.synthesis if self.controller == "hinf" else self.output

    @cached_property
    def lqr(self) -> Lqr:
        """LQR with the same weights."""
        return lqr(self.A, self.B, self.E, self.C, self.D, output_selector())

    @cached_property
    def params(self) -> AttitudeParams:
        """Numbers for `attitude_law`."""
        F, G = self._state_feedback()
        F, H = predicting_gains(self.A, self.B, F, self.prediction_s)
        tick_s = self.actuation.tick_s
        fade = math.exp(-tick_s / self.bumpless_time_s) if self.bumpless_time_s > 0.0 else 0.0
        return AttitudeParams(
            controller=CONTROLLERS[self.controller],
            F=np.ascontiguousarray(F),
            H=np.ascontiguousarray(H),
            G=np.ascontiguousarray(G),
            x_trim=self.x_trim,
            u_trim=self.u_trim[ACTUATOR.attitude].copy(),
            limit=self.actuator_limit,
            K_P=self.K_P,
            K_I=self.K_I,
            K_D=self.K_D,
            offset_decay=fade,
            shift_rate=self.offset_free_radps,
            law=self.law,
            rest=rest_map(self.law, tick_s),
            ground_collective=self.ground_collective,
            ground_side=math.copysign(1.0, self.ground_collective - self.u_trim[ACTUATOR.col]),
            tick_s=tick_s,
        )

    def _state_feedback(self) -> tuple[Matrix, Matrix]:
        """F (3, 9) and G (3, 3) that fly; zero under a controller of another kind."""
        if CONTROLLERS[self.controller] != STATE_FEEDBACK:
            return np.zeros((N_U, N_X)), np.zeros((N_U, N_U))
        gains = self.lqr if self.controller == "lqr" else self.synthesis
        return gains.F, gains.G

    @cached_property
    def judgement(self) -> Assessment | None:
        """The loop as flown; None for a kind of controller whose linear form is not known."""
        feedback = feedback_of(self.params)
        return feedback and judge(self.A, self.B, feedback, self.actuation)

    def summary(self) -> dict[str, float | str]:
        """What `/diagnostics` shows: controller, disk margins; of a bound that flies gamma, gamma*,
        mechanism and norm."""
        judgement, bound = self.judgement, self.bound
        margins = (
            (judgement.disk_input, judgement.disk_output)
            if judgement
            else ("not known", "not known")
        )
        facts: dict[str, float | str] = {
            "controller": self.controller,
            "disk_margin_input": margins[0],
            "disk_margin_output": margins[1],
        }
        if bound is None:
            return facts
        return facts | {
            "gamma": bound.gamma,
            "gamma_star": bound.gamma_star.value,
            "gamma_star_mechanism": bound.gamma_star.mechanism.value,
            "norm": bound.norm,
            "norm_frequency_radps": bound.norm_frequency,
        }


def attitude_params(parameters: Mapping[str, Any]) -> AttitudeParams:
    """Kernel of the inner loop's parameters; a judgement is made once per set of numbers.

    For who flies again and again: designing takes as long as a minute of flight. The arrays are
    shared, a flight must not write into them.

    Raises
    ------
    SynthesisError
        As `AttitudeConfig.from_parameters`.
    """
    designed = {key: value for key, value in parameters.items() if key not in _OF_LINKS}
    return _params_of(pickle.dumps(sorted(designed.items())))


@lru_cache(maxsize=8)
def _params_of(pickled: bytes) -> AttitudeParams:
    return AttitudeConfig.from_parameters(dict(pickle.loads(pickled))).params


def judged_design(parameters: Mapping[str, Any]) -> AttitudeConfig:
    """A design with all that a flight asks of it worked out: numbers and summary.

    Raises
    ------
    SynthesisError
        As `AttitudeConfig.from_parameters`.
    """
    config = AttitudeConfig.from_parameters(parameters)
    _ = config.params
    config.summary()
    return config


class LiveDesign:
    """The design in flight: changed between two ticks, and begun in flight, without a jump.

    Parameters
    ----------
    config : AttitudeConfig
        What is flown first, from trim.

    Attributes
    ----------
    config : AttitudeConfig
        What is flown.
    state : (N_LAW_STATE,) array
        State of the controller; it belongs to this object.
    """

    def __init__(self, config: AttitudeConfig) -> None:
        self.config = config
        self.state = initial_law_state(config.params)
        self._coming: AttitudeConfig | None = None

    def adopt(self, config: AttitudeConfig) -> None:
        """Fly this design from the next `take` on."""
        self._coming = config

    def take(self) -> AttitudeParams:
        """Kernel for the coming tick; an adopted design is swapped in here."""
        if self._coming is not None:
            self.config, self._coming = self._coming, None
            swap_bumpless(self.state, self.config.params)
        return self.config.params

    def start(self) -> None:
        """Begin a flight: the trim has been flown so far."""
        self.state[:] = initial_law_state(self.config.params)

    def engage(self, x9: Matrix, r3: Matrix, u_flown: Matrix) -> None:
        """Begin in flight: the first command is the one that is flown.

        Parameters
        ----------
        x9, r3 : (9,), (3,) arrays
            Estimate and setpoint now, rad and rad/s, finite.
        u_flown : (3,) array
            d_lat, d_lon, d_ped as flown, -1..1.
        """
        self.start()
        self.state[LAST_X : LAST_X + 9], self.state[LAST_R : LAST_R + 3] = x9, r3
        swap_bumpless(self.state, self.config.params, u_flown)


def added_weights(parameters: Mapping[str, Any], section: str = "output") -> OutputWeights:
    """What `output` or `lqg` adds to C11, C22, D11; `lqg` follows commands without a weight."""

    def part(name: str, size: int) -> Matrix:
        return shaped(f"{section}.{name}", parameters[f"{section}.{name}"], (size,))

    return OutputWeights(
        effort=part("effort", 3),
        integral=part("integral", 3),
        load=part("load", 3),
        noise=part("noise", 6),
        command_effort=float(parameters.get(f"{section}.command_effort", 1.0)),
    )


def _law_of(parameters: Mapping[str, Any], A: Matrix, B: Matrix, actuation: Actuation) -> OutputLaw:
    """Output feedback that needs no weights; of order zero for any other controller."""
    if parameters["controller"] == "indi":
        keys = (f"indi.{gain}" for gain in IndiGains._fields)
        return indi_law(A, B, IndiGains(*(shaped(k, parameters[k], (3,)) for k in keys)), actuation)
    if parameters["controller"] == "matrices":
        return output_law(*(parameters[f"law.{part}"] for part in OutputLaw._fields))
    return NO_LAW


def shaped(name: str, value: Any, shape: tuple[int, ...]) -> Matrix:
    """`value`, flat row by row or already in `shape`, as a contiguous array, or a ShapeError."""
    array = np.asarray(value)
    if array.ndim == 1 and len(shape) > 1:
        count = math.prod(shape)
        if array.size != count:
            wanted = " x ".join(str(s) for s in shape)
            raise ShapeError(
                name, f"{name} must hold {count} numbers ({wanted}), but has {array.size}"
            )
        array = array.reshape(shape)
    return np.ascontiguousarray(checked(name, array, shape))


# -------------------------------------------------------------------------------------------------
# Writes model and trim numbers into an inner-loop YAML and leaves the rest of it, comments too,
#
# alone.
# -------------------------------------------------------------------------------------------------

_SHAPES = {"A": (9, 9), "B": (9, 3), "E": (9, 3), "x": (9,), "u": (4,)}


def flow_array(value: ArrayLike, indent: int, digits: int = 10) -> str:
    """YAML flow sequence of doubles, one matrix row per line; every number reads back as a
    double."""
    rows = np.atleast_2d(np.asarray(value, float))
    texts = [", ".join(_double(v, digits) for v in row) for row in rows]
    return "[" + (",\n" + " " * indent).join(texts) + "]"


def write_model_yaml(
    path: str | Path,
    A: ArrayLike,
    B: ArrayLike,
    E: ArrayLike,
    x_trim: ArrayLike,
    u_trim: ArrayLike,
    extra: Mapping[str, ArrayLike] | None = None,
) -> None:
    """Replace model.A, model.B, model.E, trim.x, trim.u in the inner-loop YAML at `path`.

    Parameters
    ----------
    path : path
        A file like the packaged config/inner_loop.yaml, with these keys as flow sequences.
    A, B, E : (9, 9), (9, 3), (9, 3) arrays
        Linear model about trim, eq. (9).
    x_trim, u_trim : (9,), (4,) arrays
        Trim of the nine states, and of d_lat, d_lon, d_ped, d_col.
    extra : mapping, optional
        Further keys that are unique in the file (K_P, K_I, K_D, C11, ...) to arrays.

    Raises
    ------
    ShapeError
        A matrix has the wrong shape; names it.
    KeyError
        The file lacks one of the keys, or has it twice.
    """
    values = {"A": A, "B": B, "E": E, "x": x_trim, "u": u_trim}
    arrays = {key: checked(key, value, _SHAPES[key]) for key, value in values.items()}
    arrays.update({key: np.asarray(value, float) for key, value in (extra or {}).items()})
    text = Path(path).read_text(encoding="utf-8")
    for key, array in arrays.items():
        text = _replace(text, key, array, str(path))
    Path(path).write_text(text, encoding="utf-8")


def _replace(text: str, key: str, array: np.ndarray, path: str) -> str:
    pattern = re.compile(rf"^([ ]+){re.escape(key)}:\s*\[[^\]]*\]", re.MULTILINE)
    matches = pattern.findall(text)
    if len(matches) != 1:
        raise KeyError(f"{path} holds the key {key} {len(matches)} times instead of once")

    def line(match: re.Match[str]) -> str:
        indent = match.group(1)
        return f"{indent}{key}: " + flow_array(array, len(indent) + len(key) + 3)

    return pattern.sub(line, text)


def _double(value: float, digits: int) -> str:
    text = f"{value + 0.0:.{digits}g}"
    if "e" in text:
        mantissa, exponent = text.split("e")
        return f"{mantissa if '.' in mantissa else mantissa + '.0'}e{exponent}"
    return text if "." in text else text + ".0"
