# SPDX-License-Identifier: Apache-2.0
"""Node `inner_loop`: attitude setpoint and collective to actuators, every tick."""

import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from heli_core.beside import Beside, BesideError
from heli_core.inbox import NOTHING, Inbox, deliver, empty_inbox
from heli_core.jit import direct
from heli_core.python_controller import PARAMETER
from heli_core.rows import ACTUATOR, NINE
from heli_core.signals import NOTHING as NO_SWEEP
from heli_core.signals import SweepParams, add_sweep
from heli_inner_hinf.controller_state import (
    RUN,
    AttitudeParams,
    AttitudeStatus,
    initial_law_state,
)
from heli_inner_hinf.controllers import swap_bumpless
from heli_inner_hinf.design import AttitudeConfig, LiveDesign, judged_design
from heli_inner_hinf.estimate import (
    COMMAND,
    INPUTS,
    EstimateParams,
    EstimateState,
    HeardCommand,
    commanded,
    estimate_params,
    initial_estimate,
    listen,
    no_command,
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
from heli_inner_hinf.ground_and_manual import OwnAttitudeLaw, law_or_manual, own_law
from heli_inner_hinf.parameters import NODE_NAME, TABLE, unread, unread_sentence
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import FACT_LAW_FAILED, Level
from heli_msgs_bridge.lifecycle_node import NodeSpec
from heli_msgs_bridge.lockstep import Arrived, Demand
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
        Controller and its state.
    exciter : Exciter or None
    disturber : Disturber or None
    model, known : EstimateParams, EstimateState
        The newest estimate, and what carries it on to now.
    command : HeardCommand
        What the outer loop sent last.
    inbox : Inbox
        What has come for a tick.
    flown_tick : int or None
        Tick of the last command that was sent.
    x9, aim, u3 : arrays
        Estimate, what is to be held of it (places of `COMMAND`), and output of the controller.
    total : (4,) array
        Last command that was sent.
    flown : AttitudeParams or None
        Numbers that `law` is compiled for.
    law : callable
        `law_or_hand`, compiled.
    python_law : OwnAttitudeLaw
        Its place, taken by one in Python or by none.
    """

    design: LiveDesign
    send: Send
    exciter: Exciter | None
    disturber: Disturber | None
    model: EstimateParams
    known: EstimateState
    command: HeardCommand
    inbox: Inbox = field(default_factory=lambda: empty_inbox(len(INPUTS)))
    flown_tick: int | None = None
    x9: np.ndarray = field(default_factory=lambda: np.full(len(NINE), np.nan))
    aim: np.ndarray = field(default_factory=lambda: np.full(COMMAND.size, np.nan))
    u3: np.ndarray = field(default_factory=lambda: np.zeros(3))
    total: np.ndarray = field(default_factory=lambda: np.zeros(ACTUATOR.size))
    flown: AttitudeParams | None = None
    law: Callable[..., int] = law_or_manual
    python_law: OwnAttitudeLaw = field(default_factory=lambda: OwnAttitudeLaw(None))


@dataclass
class ActiveInnerLoop:
    """What the inner loop has while it is active.

    Attributes
    ----------
    first : bool
        True until a step has been made.
    resumes : bool
        True while the flight is to be taken over from the command that is flown.
    """

    first: bool = True
    resumes: bool = False


# -------------------------------------------------------------------------------------------------
# Node.
# -------------------------------------------------------------------------------------------------

_OUTER = (topics.ATTITUDE_SETPOINT, topics.COLLECTIVE)
_LATE = "the estimate is late: the model carries it on"
_LATE_TICKS = 5
"""Of 10 ms: an estimate that is older is spoken of."""
_WAITS = "waits for navigation: the trim is held"


def _aims(aim: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """Attitude (3,), collective and a pilot's deflections (3,) of a row of `COMMAND`."""
    return aim[COMMAND.attitude], aim[COMMAND.col], aim[COMMAND.manual]


def _law_for(kernel: AttitudeParams) -> Callable[..., int]:
    """The compiled controller for numbers of these types."""
    x9, aim, u3 = np.zeros(len(NINE)), np.zeros(COMMAND.size), np.zeros(3)
    return direct(law_or_manual, x9, *_aims(aim), kernel, initial_law_state(kernel), u3)


class InnerLoopNode(TickNode[ConfiguredInnerLoop, ActiveInnerLoop]):
    """Active means: attitude is held. The collective is passed through, in one message."""

    SPEC = NodeSpec(NODE_NAME, "heli_inner_hinf", TABLE, f"{NODE_NAME}.yaml")

    def __init__(self, values: Mapping[str, Any], **options: Any) -> None:
        super().__init__(values, **options)
        self._beside = Beside()

    def end(self) -> None:
        """As of any node; nothing is judged any more."""
        self._beside.close()
        super().end()

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
        collective = float(config.u_trim[ACTUATOR.col])
        core = ConfiguredInnerLoop(
            design=LiveDesign(config),
            model=model,
            known=initial_estimate(model),
            send=self.create_sender(topics.ACTUATORS),
            exciter=self._make_exciter(),
            disturber=self._make_disturber(),
            command=no_command(model, collective),
            python_law=own_law(self.values[PARAMETER]),
            pace=self.listen(inputs),
        )
        self._warm_up(core)
        return core

    def _designed(self) -> AttitudeConfig:
        """The design of the parameters; of a predecessor's it need not be worked out again."""
        known = self.memory.lasting() if self.memory else None
        if isinstance(known, AttitudeConfig):
            return known
        if self.values["lockstep"]:
            config = AttitudeConfig.from_parameters(self.values)
        else:
            # So the process that judges changes has loaded all before there is a flight.
            config = self._worked_out(self.values)
        self._keep(config)
        return config

    def _worked_out(self, values: Mapping[str, Any]) -> AttitudeConfig:
        """A design, worked out elsewhere, so that no tick waits for Python's lock; or here."""
        try:
            config: AttitudeConfig = self._beside.call(judged_design, dict(values))
        except BesideError as error:
            self.get_logger().debug(f"judged in this process: {error}")
            return judged_design(values)
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
        if kernel.shape == NO_SWEEP:
            return None
        send = self.create_sender(topics.EXCITATION_ATTITUDE)
        return Disturber(kernel, send, self.rate.tick_s)

    def _warm_up(self, core: ConfiguredInnerLoop) -> None:
        """Load the compiled controller before the first tick."""
        kernel = core.design.config.params
        self._load(core, kernel)
        core.law(core.x9, *_aims(core.aim), kernel, initial_law_state(kernel), core.u3)
        swap_bumpless(initial_law_state(kernel), kernel)
        spare, command = initial_estimate(core.model), no_command(core.model, 0.0)
        listen(spare, command, core.inbox, 0, core.model, core.x9, core.aim)
        commanded(spare, 0, core.u3, core.model)
        if core.exciter is not None:
            law, excitation = initial_law_state(kernel), initial_excitation_state()
            excite(-1.0, core.x9, core.exciter.params, excitation, law, core.total)
        if core.disturber is not None:
            add_sweep(-1.0, core.disturber.params, core.disturber.added)

    def _load(self, core: ConfiguredInnerLoop, kernel: AttitudeParams) -> None:
        """Compile the controller for numbers of these types; those of another design may differ."""
        core.flown, core.law = kernel, _law_for(kernel)

    def engage(self) -> ActiveInnerLoop:
        """Begin to hold attitude: from trim, or in flight from what is flown."""
        self.core.pace.expect(_OUTER, self.values["expects_outer"])
        core = self.core
        core.command = no_command(core.model, float(core.command.row[COMMAND.col]))
        return ActiveInnerLoop()

    def begin_anew(self) -> None:
        """Another flight: the controller begins in trim; the setpoint is old until a new one."""
        self.run.first = True

    def save_state(self) -> Any:
        """Law, setpoint and last command."""
        core, run = self.core, self.run
        excited = None if core.exciter is None else core.exciter.state
        law = core.design.state, core.x9, core.command, core.total, core.flown_tick
        return law, excited, run

    def restore_state(self, content: Any, gap: bool) -> None:
        """Continue the controller; after a gap it engages at the last command, as after a pause."""
        core = self.core
        (law, x9, core.command, total, core.flown_tick), excited, run = content
        core.x9[:], core.total[:] = x9, total
        core.design.state[:] = law
        if core.exciter is not None and excited is not None:
            core.exciter.state[:] = excited
        for name, value in vars(run).items():
            setattr(self.run, name, value)
        self.run.resumes |= gap

    def step(self, tick: int, arrived: Arrived) -> None:
        """One tick: newest setpoint, controller, actuators."""
        core, run = self.core, self.run
        if run.first:
            self._begin_flight(tick)
        deliver(core.inbox, INPUTS, arrived)
        stale = listen(core.known, core.command, core.inbox, tick, core.model, core.x9, core.aim)
        if core.disturber is not None:
            core.disturber.disturb(tick, self.stamp_ns(tick), core.x9)
        r3, collective, manual3 = _aims(core.aim)
        if run.resumes and np.isfinite(core.x9).all() and np.isfinite(r3).all():
            core.design.engage(core.x9, r3, core.total[ACTUATOR.attitude])
            run.resumes = False
        kernel = core.design.take()
        if kernel is not core.flown:
            self._load(core, kernel)
        inputs = core.x9, r3, collective, manual3, kernel, core.design.state, core.u3
        code = core.python_law.step(tick, tick * self.rate.tick_s, *inputs, core.law)
        # The outer loop's collective stays as it came: the excitation must not pile up on it.
        core.total[ACTUATOR.attitude], core.total[ACTUATOR.col] = core.u3, collective
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
        core.command.row[COMMAND.manual] = np.nan
        core.known = initial_estimate(core.model)
        core.python_law.begin(in_flight=run.resumes)
        if not run.resumes:
            core.design.start()
            core.command.row[COMMAND.col] = core.design.config.u_trim[ACTUATOR.col]

    def _excite(self, exciter: Exciter, tick: int) -> None:
        """Add the excitation to the actuators of this tick and publish it."""
        core, state = self.core, exciter.state
        now_s, law = tick * self.rate.tick_s, core.design.state
        code = excite(now_s, core.x9, exciter.params, state, law, core.total)
        exciter.status = ExcitationStatus(code)
        exciter.send(state[SENT : SENT + ACTUATOR.size], self.stamp_ns(tick))

    def _tell(self, code: int, stale: bool) -> None:
        exciter = self.core.exciter
        excited = ExcitationStatus.SILENT if exciter is None else exciter.status
        level, message = Level.OK, AttitudeStatus(code).sentence
        if self.core.python_law.failure:
            level, message = Level.ERROR, self.core.python_law.failure
        elif code == AttitudeStatus.NOT_FINITE and not self.core.design.state[RUN]:
            level, message = Level.OK, _WAITS
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
        core, stamp = self.core, int(self.core.command.tick[0])
        facts = dict(core.design.config.summary())
        if core.python_law.law is not None:
            facts["own_law"] = core.python_law.law.name
        if core.python_law.failure:
            facts[FACT_LAW_FAILED] = core.python_law.failure
        if core.exciter is not None:
            facts["excitation"] = core.exciter.status.sentence
        facts["setpoint_tick"] = "none" if stamp == NOTHING else stamp
        return facts

    def validate(
        self, values: Mapping[str, Any], changed: Collection[str]
    ) -> AttitudeConfig | None:
        """Synthesise the changed design; infeasible ones raise, before configuration too."""
        if set(changed) == {"expects_outer"}:
            return None
        config = self._worked_out(values)
        # Loaded now: the tick that flies it finds it compiled.
        _law_for(config.params)
        return config

    def apply(self, judged: AttitudeConfig | None, changed: Collection[str]) -> None:
        """The judged design is swapped in at the next tick."""
        if not self.configured:
            return
        if judged is not None:
            if sentence := unread_sentence(unread(judged.controller, changed)):
                self.get_logger().warning(sentence)
            self.core.design.adopt(judged)
            self._keep(judged)
        if "expects_outer" in changed:
            self.core.pace.expect(_OUTER, self.values["expects_outer"])


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_inner_hinf inner_loop`."""
    return run(InnerLoopNode, args)


if __name__ == "__main__":
    sys.exit(main())
