# SPDX-License-Identifier: Apache-2.0
"""Node `inner_loop`: attitude setpoint and collective to actuators, every tick."""

import math
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from heli_core.jit import direct
from heli_core.python_controller import PARAMETER
from heli_core.rows import ACTUATOR, NAV, NINE, ROTOR, SETPOINT
from heli_core.signals import NOTHING, SweepParams, add_sweep
from heli_inner_hinf.controller_state import (
    RUN,
    AttitudeParams,
    AttitudeStatus,
    initial_law_state,
    nine_states,
)
from heli_inner_hinf.design import AttitudeConfig, LiveDesign
from heli_inner_hinf.estimate import (
    EstimateParams,
    EstimateState,
    commanded,
    estimate,
    estimate_params,
    hear,
    initial_estimate,
)
from heli_inner_hinf.excitation import (
    PLACES,
    SENT,
    ExcitationParams,
    ExcitationStatus,
    disturbance_params,
    excitation_params,
    excite,
    initial_excitation_state,
)
from heli_inner_hinf.ground_and_manual import OwnAttitudeLaw, law_or_hand, own_law
from heli_inner_hinf.parameters import NODE_NAME, TABLE
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import FACT_LAW_FAILED, Level
from heli_msgs_bridge.lifecycle_node import NodeSpec
from heli_msgs_bridge.lockstep import AHEAD_TICKS, Arrived, Demand
from heli_msgs_bridge.node_process import run
from heli_msgs_bridge.tick_node import Input, Send, TickCore, TickNode

# -------------------------------------------------------------------------------------------------
# What the node `inner_loop` has while it is configured, and while it is active.
# -------------------------------------------------------------------------------------------------


@dataclass
class Exciter:
    """Excitation for identification; its topic exists only while one is configured."""

    params: ExcitationParams
    send: Send
    state: np.ndarray
    status: ExcitationStatus = ExcitationStatus.SILENT


@dataclass
class Disturber:
    """What is added to the measured attitude; its topic exists only while a sweep is configured."""

    params: SweepParams
    send: Send
    tick_s: float
    added: np.ndarray = field(default_factory=lambda: np.zeros(len(NINE)))

    def disturb(self, tick: int, stamp_ns: int, x9: np.ndarray) -> None:
        """Add the sweep of this tick to the angles among the states (9,) and publish it."""
        self.added[:] = 0.0
        add_sweep(tick * self.tick_s, self.params, self.added)
        x9 += self.added
        self.send(self.added[list(PLACES)], stamp_ns)


@dataclass(kw_only=True)
class ConfiguredInnerLoop(TickCore):
    """What the inner loop has while it is configured.

    Attributes
    ----------
    design : LiveDesign
        Law and its state.
    exciter : Exciter or None
    disturber : Disturber or None
    collective : float
        As the outer loop sent it last; before that, the trim's.
    model, known : EstimateParams, EstimateState
        The newest estimate, and what carries it on to now.
    flown_tick : int or None
        Tick of the last command that was sent.
    x9, u3 : arrays
        Estimate and output of the law.
    hand3 : (3,) array
        A pilot's deflections, flown in place of the law; NaN for none.
    total : (4,) array
        Last command that was sent.
    flown : AttitudeParams or None
        Numbers that `law` is compiled for.
    law : callable
        `law_or_hand`, compiled.
    own : OwnAttitudeLaw
        Its place, taken by one in Python or by none.
    """

    design: LiveDesign
    send: Send
    exciter: Exciter | None
    disturber: Disturber | None
    collective: float
    model: EstimateParams
    known: EstimateState
    flown_tick: int | None = None
    x9: np.ndarray = field(default_factory=lambda: np.full(len(NINE), np.nan))
    u3: np.ndarray = field(default_factory=lambda: np.zeros(3))
    hand3: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    total: np.ndarray = field(default_factory=lambda: np.zeros(ACTUATOR.size))
    flown: AttitudeParams | None = None
    law: Callable[..., int] = law_or_hand
    own: OwnAttitudeLaw = field(default_factory=lambda: OwnAttitudeLaw(None))


@dataclass
class ActiveInnerLoop:
    """What the inner loop has while it is active.

    Attributes
    ----------
    r3 : (3,) array
        Setpoint, rad; at first the trim attitude and the heading that will be found.
    setpoint_tick : int or None
        Stamp of the setpoint; None: nobody has sent one.
    first : bool
        True until a step has been made.
    resumes : bool
        True while the flight is to be taken over from the command that is flown.
    """

    r3: np.ndarray
    setpoint_tick: int | None = None
    first: bool = True
    resumes: bool = False


# -------------------------------------------------------------------------------------------------
# Node.
# -------------------------------------------------------------------------------------------------

_OUTER = (topics.ATTITUDE_SETPOINT, topics.COLLECTIVE)
_NO_ROTOR = np.full(ROTOR.size, np.nan)
_LATE = "the estimate is late: the model carries it on"
_LATE_TICKS = 5
"""Of 10 ms: an estimate that is older is spoken of."""
_WAITS = "waits for navigation: the trim is held"


class InnerLoopNode(TickNode[ConfiguredInnerLoop, ActiveInnerLoop]):
    """Active means: attitude is held. The collective is passed through, in one message."""

    SPEC = NodeSpec(NODE_NAME, "heli_inner_hinf", TABLE, f"{NODE_NAME}.yaml")

    def configure(self) -> ConfiguredInnerLoop:
        """Synthesise the controller; an infeasible design is refused here."""
        config = self._designed()
        outer = Demand(self.rate.of(self.values["outer_period_ticks"]))
        inputs = (
            Input(topics.ODOM, Demand()),
            Input(topics.ROTOR_STATE, Demand()),
            Input(topics.ATTITUDE_SETPOINT, outer, off_tick=True),
            Input(topics.COLLECTIVE, outer, off_tick=True),
        )
        model = estimate_params(self.values)
        core = ConfiguredInnerLoop(
            design=LiveDesign(config),
            model=model,
            known=initial_estimate(model),
            send=self.create_sender(topics.ACTUATORS),
            exciter=self._make_exciter(),
            disturber=self._make_disturber(),
            collective=config.u_trim[ACTUATOR.col],
            own=own_law(self.values[PARAMETER]),
            pace=self.listen(inputs),
        )
        self._warm_up(core)
        return core

    def _designed(self) -> AttitudeConfig:
        """The design of the parameters; of a predecessor's it need not be worked out again."""
        known = self.memory.lasting() if self.memory else None
        if isinstance(known, AttitudeConfig):
            return known
        config = AttitudeConfig.from_parameters(self.values)
        self._keep(config)
        return config

    def _keep(self, config: AttitudeConfig) -> None:
        if self.memory:
            _ = config.params
            self.memory.keep_lasting(config)

    def _make_exciter(self) -> Exciter | None:
        kernel = excitation_params(self.values)
        if not kernel.on:
            return None
        send = self.create_sender(topics.EXCITATION_ACTUATORS)
        return Exciter(kernel, send, initial_excitation_state())

    def _make_disturber(self) -> Disturber | None:
        kernel = disturbance_params(self.values)
        if kernel.shape == NOTHING:
            return None
        send = self.create_sender(topics.EXCITATION_ATTITUDE)
        return Disturber(kernel, send, self.rate.tick_s)

    def _warm_up(self, core: ConfiguredInnerLoop) -> None:
        """Load the compiled law before the first tick."""
        kernel = core.design.config.params
        self._load(core, kernel)
        rest, state = float(core.collective), initial_law_state(kernel)
        core.law(core.x9, np.zeros(3), rest, core.hand3, kernel, state, core.u3)
        nav = np.full(NAV.size, np.nan)
        nine_states(nav, nav[NAV.rotor], core.x9)
        spare = initial_estimate(core.model)
        hear(spare, 0, core.x9, 0, core.model)
        commanded(spare, 0, core.u3, core.model)
        estimate(spare, 0, core.model, core.x9)
        if core.exciter is not None:
            law, own = initial_law_state(kernel), initial_excitation_state()
            excite(-1.0, core.x9, core.exciter.params, own, law, core.total)
        if core.disturber is not None:
            add_sweep(-1.0, core.disturber.params, core.disturber.added)

    def _load(self, core: ConfiguredInnerLoop, kernel: AttitudeParams) -> None:
        """Have the compiled law for numbers of these types; those of another design may differ."""
        like = core.x9, np.zeros(3), 0.0, core.hand3, kernel, initial_law_state(kernel), core.u3
        core.flown, core.law = kernel, direct(law_or_hand, *like)

    def engage(self) -> ActiveInnerLoop:
        """Begin to hold attitude: from trim, or in flight from what is flown."""
        self.core.pace.expect(_OUTER, self.values["expects_outer"])
        return ActiveInnerLoop(self._trim_attitude(np.nan))

    def begin_anew(self) -> None:
        """Another flight: the law begins in trim; the setpoint is too old until one comes."""
        self.run.first = True

    def save_state(self) -> Any:
        """Law, setpoint and last command."""
        core, run = self.core, self.run
        excited = None if core.exciter is None else core.exciter.state
        law = core.design.state, core.x9, core.hand3, core.total, core.collective, core.flown_tick
        return law, excited, run

    def restore_state(self, content: Any, gap: bool) -> None:
        """Go on with the law; after a gap it engages at the last command, as after a pause."""
        core = self.core
        (law, x9, hand3, total, core.collective, core.flown_tick), excited, run = content
        for own, known in ((core.x9, x9), (core.hand3, hand3), (core.total, total)):
            own[:] = known
        core.design.state[:] = law
        if core.exciter is not None and excited is not None:
            core.exciter.state[:] = excited
        for name, value in vars(run).items():
            setattr(self.run, name, value)
        self.run.resumes |= gap

    def step(self, tick: int, arrived: Arrived) -> None:
        """One tick: newest setpoint, law, actuators."""
        core, run = self.core, self.run
        if run.first:
            self._begin_flight(tick)
        self._take_navigation(tick, arrived)
        self._take_setpoint(arrived)
        if core.disturber is not None:
            core.disturber.disturb(tick, self.stamp_ns(tick), core.x9)
        stale = self._setpoint_is_stale(tick)
        r3 = self._trim_attitude(run.r3[SETPOINT.psi]) if stale else run.r3
        if stale:
            core.hand3[:] = np.nan
        if run.resumes and np.isfinite(core.x9).all() and np.isfinite(r3).all():
            core.design.engage(core.x9, r3, core.total[ACTUATOR.attitude])
            run.resumes = False
        kernel = core.design.take()
        if kernel is not core.flown:
            self._load(core, kernel)
        given = core.x9, r3, core.collective, core.hand3, kernel, core.design.state, core.u3
        code = core.own.step(tick, tick * self.rate.tick_s, *given, core.law)
        # The outer loop's collective stays as it came: the excitation must not pile up on it.
        core.total[ACTUATOR.attitude], core.total[ACTUATOR.col] = core.u3, core.collective
        if core.exciter is not None:
            self._excite(core.exciter, tick)
        core.send(core.total, self.stamp_ns(tick))
        core.flown_tick = tick
        commanded(core.known, tick, core.total[ACTUATOR.attitude], core.model)
        self._tell(code, stale)

    def _begin_flight(self, tick: int) -> None:
        """The first step since activation: of a new flight, or of one that was left in the air."""
        core, run = self.core, self.run
        run.first = False
        run.resumes = core.flown_tick is not None and tick > core.flown_tick
        core.hand3[:] = np.nan
        core.known = initial_estimate(core.model)
        core.own.begin(in_flight=run.resumes)
        if not run.resumes:
            core.design.start()
            core.collective = core.design.config.u_trim[ACTUATOR.col]

    def _excite(self, exciter: Exciter, tick: int) -> None:
        """Add the excitation to the actuators of this tick and publish it."""
        core, state = self.core, exciter.state
        now_s, law = tick * self.rate.tick_s, core.design.state
        code = excite(now_s, core.x9, exciter.params, state, law, core.total)
        exciter.status = ExcitationStatus(code)
        exciter.send(state[SENT : SENT + ACTUATOR.size], self.stamp_ns(tick))

    def _take_navigation(self, tick: int, arrived: Arrived) -> None:
        """The states of this tick, by what has come or by the model; NaN if nothing is known."""
        core, r3 = self.core, self.run.r3
        stamp, nav = arrived.get(topics.ODOM, (0, None))
        rotor_stamp, rotor = arrived.get(topics.ROTOR_STATE, (0, None))
        if nav is not None:
            nine_states(nav, _NO_ROTOR if rotor is None else rotor, core.x9)
            hear(core.known, stamp, core.x9, rotor_stamp, core.model)
        # Not a number: the law repeats its last command and says so.
        estimate(core.known, tick, core.model, core.x9)
        if math.isnan(r3[SETPOINT.psi]):
            r3[SETPOINT.psi] = core.x9[NINE.psi]

    def _take_setpoint(self, arrived: Arrived) -> None:
        stamp, attitude = arrived.get(topics.ATTITUDE_SETPOINT, (0, None))
        if attitude is not None:
            self.run.r3[:] = attitude
            self.run.setpoint_tick = stamp
        _, collective = arrived.get(topics.COLLECTIVE, (0, None))
        if collective is not None:
            self.core.collective = collective[0]
            self.core.hand3[:] = collective[1:] if collective.size > 1 else np.nan

    def _setpoint_is_stale(self, tick: int) -> bool:
        stamp = self.run.setpoint_tick
        if stamp is None:
            return False
        # One of a later moment than now belongs to another time, however young it looks.
        age = tick - stamp
        oldest = self.values["setpoint_timeout_s"] * self.rate.hz
        return age < -self.rate.of(AHEAD_TICKS) or age > oldest

    def _trim_attitude(self, psi: float) -> np.ndarray:
        """Trim attitude with a heading, rad."""
        trim = self.core.design.config.x_trim
        return np.array([trim[NINE.phi], trim[NINE.theta], psi])

    def _tell(self, code: int, stale: bool) -> None:
        exciter = self.core.exciter
        excited = ExcitationStatus.SILENT if exciter is None else exciter.status
        level, message = Level.OK, AttitudeStatus(code).sentence
        if self.core.own.failure:
            level, message = Level.ERROR, self.core.own.failure
        elif code == AttitudeStatus.NOT_FINITE and not self.core.design.state[RUN]:
            level, message = Level.WARN, _WAITS
        elif code == AttitudeStatus.NOT_FINITE:
            level = Level.ERROR
        elif self.tick - self.core.known.tick[0] > self.rate.of(_LATE_TICKS):
            level, message = Level.WARN, _LATE
        elif stale:
            level, message = Level.WARN, "the attitude setpoint is too old: trim attitude is held"
        elif excited > ExcitationStatus.EXCITING:
            level, message = Level.WARN, excited.sentence
        elif excited == ExcitationStatus.EXCITING and code == AttitudeStatus.OK:
            message = excited.sentence
        if self.tick % self.rate.hz == 0 or message != self.health.message:
            self.warn_or_ok(level, message, self._facts_now())

    def _facts_now(self) -> dict[str, Any]:
        core, stamp = self.core, self.run.setpoint_tick
        facts = dict(core.design.config.summary())
        if core.own.law is not None:
            facts["own_law"] = core.own.law.name
        if core.own.failure:
            facts[FACT_LAW_FAILED] = core.own.failure
        if core.exciter is not None:
            facts["excitation"] = core.exciter.status.sentence
        facts["setpoint_tick"] = "none" if stamp is None else stamp
        return facts

    def validate(
        self, values: Mapping[str, Any], changed: Collection[str]
    ) -> AttitudeConfig | None:
        """Synthesise the changed design; infeasible ones raise, before configuration too."""
        if set(changed) == {"expects_outer"}:
            return None
        config = AttitudeConfig.from_parameters(values)
        # Computed here, so that no tick has to.
        _ = config.params
        return config

    def apply(self, judged: AttitudeConfig | None, changed: Collection[str]) -> None:
        """The judged design is swapped in at the next tick."""
        if not self.configured:
            return
        if judged is not None:
            self.core.design.adopt(judged)
            self._keep(judged)
        if "expects_outer" in changed:
            self.core.pace.expect(_OUTER, self.values["expects_outer"])


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_inner_hinf inner_loop`."""
    return run(InnerLoopNode, args)


if __name__ == "__main__":
    sys.exit(main())
