# SPDX-License-Identifier: Apache-2.0
"""Leads nodes through their life cycles together, and watches that they live: Nav2's semantics.

Commands are those of nav2_lifecycle_manager, and so is the bond: a node that was activated and is
not heard any more, or was started again, is lost. Three things differ. All nodes are configured at
once, as each compiles and loads for itself. Who is lost is given `bond_respawn_max_duration` to
come back while the others fly on: an aircraft in the air is not helped by taking its control away.
And in lockstep, where the plant makes time, it is paused until then, so that nothing is flown
without the one that is lost.

No executor here: `advance` is called when something has come, and now and then.
"""

import contextlib
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol

from lifecycle_msgs.msg import State, Transition

from heli_core.parameters import Parameter
from heli_flight.graph.lifecycle import TRANSITIONS, Answers, BringUpError, States
from heli_msgs_bridge.diagnostics import REPEAT_S, Level, NodeState

TABLE = (
    Parameter("node_names", "string[]", "Nodes in the order of their activation", read_only=True),
    Parameter(
        "bond_timeout",
        "double",
        "Wall time after which an active node that is not heard is lost; 0: never",
        "s",
        0.0,
        3600.0,
        read_only=True,
    ),
    Parameter(
        "attempt_respawn_reconnection",
        "bool",
        "Whether who is lost is waited for, and brought up again",
        read_only=True,
    ),
    Parameter(
        "bond_respawn_max_duration",
        "double",
        "Wall time in which who is lost must be back, else all are reset",
        "s",
        0.0,
        3600.0,
        read_only=True,
    ),
    Parameter(
        "service_timeout",
        "double",
        "Wall time in which a node must have made a transition; for the first, ten minutes",
        "s",
        1.0,
        3600.0,
        read_only=True,
    ),
)
"""Parameters of the manager, named as those of nav2_lifecycle_manager."""

CONFIGURE = Transition.TRANSITION_CONFIGURE
ACTIVATE = Transition.TRANSITION_ACTIVATE
DEACTIVATE = Transition.TRANSITION_DEACTIVATE
CLEANUP = Transition.TRANSITION_CLEANUP
SHUTDOWN = Transition.TRANSITION_UNCONFIGURED_SHUTDOWN
_UP = (CONFIGURE, ACTIVATE)
_CONFIGURE_LIMIT_S = 600.0
_INACTIVE, _FINALIZED = State.PRIMARY_STATE_INACTIVE, State.PRIMARY_STATE_FINALIZED


class SystemCommand(StrEnum):
    """What may be asked of all nodes together: of nav2_msgs/srv/ManageLifecycleNodes."""

    STARTUP = "startup"
    PAUSE = "pause"
    RESUME = "resume"
    RESET = "reset"
    SHUTDOWN = "shutdown"


class SystemState(StrEnum):
    """Where the nodes are, taken together."""

    UNCONFIGURED = "unconfigured"
    ACTIVE = "active"
    INACTIVE = "inactive"
    CHANGING = "changing"
    """A command is being carried out."""
    RECONNECTING = "reconnecting"
    """A node is lost, and waited for."""
    FAILED = "failed"
    """A command could not be carried out, or a node is lost for good."""
    FINALIZED = "finalized"


_STEPS: dict[SystemCommand, tuple[tuple[int, ...], SystemState]] = {
    SystemCommand.STARTUP: ((CONFIGURE, ACTIVATE), SystemState.ACTIVE),
    SystemCommand.PAUSE: ((DEACTIVATE,), SystemState.INACTIVE),
    SystemCommand.RESUME: ((ACTIVATE,), SystemState.ACTIVE),
    SystemCommand.RESET: ((DEACTIVATE, CLEANUP), SystemState.UNCONFIGURED),
    SystemCommand.SHUTDOWN: ((DEACTIVATE, CLEANUP, SHUTDOWN), SystemState.FINALIZED),
}


def is_needed(transition: int, state: int) -> bool:
    """Whether a node in a primary state has to make a transition to get where all shall be.

    Up (configure, activate): who is there or beyond need not. Down: who is there or below.
    """
    target = TRANSITIONS[transition][1]
    if transition in _UP:
        return state < target
    return state != _FINALIZED if transition == SHUTDOWN else target < state < _FINALIZED


class Nodes(Protocol):
    """What the manager needs of `heli_flight.graph.lifecycle.Lifecycle`."""

    def missing(self) -> list[str]:
        """Nodes that cannot be told anything yet."""

    def ask_state(self, name: str) -> Any:
        """Future of a node's state."""

    def begin(self, names: Sequence[str], transition_id: int) -> Answers:
        """Ask nodes for a transition."""


@dataclass
class Bond:
    """That an active node is heard.

    Attributes
    ----------
    heard_s : float
        Wall time at which it was heard last, or activated.
    formed : bool
        Whether it has said since that it is active: what it said before may come late.
    why_broken : str
        Empty as long as it holds.
    """

    heard_s: float
    formed: bool = False
    why_broken: str = ""


@dataclass
class Order:
    """A command that was given.

    Attributes
    ----------
    command : SystemCommand
    answer : callable
        Called at its end, with whether it was carried out, and a sentence.
    """

    command: SystemCommand
    answer: Callable[[bool, str], None]


@dataclass(frozen=True)
class _Wait:
    """What is waited for: how long, and who is silent then."""

    done: Callable[[], bool]
    limit_s: float | None
    silent: Callable[[], list[str]]
    what: str


_Work = Generator[_Wait, bool, None]
# Said by a node that does not take part: it was started again, or has failed.
_OUT = (NodeState.UNCONFIGURED, NodeState.CONFIGURED, NodeState.FAILED)


class Manager:
    """Brings nodes up and down together, and takes notice when one is lost.

    Parameters
    ----------
    values : mapping
        As `TABLE` has them.
    nodes : Nodes
    tell : callable
        Takes level, sentence and state, for people.
    reason : callable, optional
        From a node's name to what it said of its failure; empty if nothing.
    now_s : callable, optional
        Wall time, s.

    Attributes
    ----------
    state : SystemState

    Raises
    ------
    ValueError
        The values do not fit together.
    """

    def __init__(
        self,
        values: Any,
        nodes: Nodes,
        tell: Callable[[Level, str, SystemState], None],
        reason: Callable[[str], str] = lambda name: "",
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._names = list(values["node_names"])
        self._timeout_s = values["bond_timeout"]
        self._respawn_s = values["bond_respawn_max_duration"]
        self._reconnects = values["attempt_respawn_reconnection"]
        self._limit_s = values["service_timeout"]
        self._lockstep = values["lockstep"]
        if len(set(self._names)) < len(self._names) or not all(self._names):
            raise ValueError(f"node_names: {self._names}: name each node once")
        if 0.0 < self._timeout_s <= REPEAT_S:
            raise ValueError(
                f"bond_timeout: {self._timeout_s:g} s: nodes are heard once in {REPEAT_S:g} s; "
                "allowed are 0 (no bond) and more than that"
            )
        if self._lockstep and self._timeout_s >= values["peer_timeout_s"]:
            raise ValueError(
                f"bond_timeout: {self._timeout_s:g} s: in lockstep the flight goes on without a "
                f"silent node after peer_timeout_s, {values['peer_timeout_s']:g} s; allowed is less"
            )
        self._nodes, self._tell, self._reason, self._now_s = nodes, tell, reason, now_s
        self._bonds: dict[str, Bond] = {}
        self._lost: set[str] = set()
        self._over = False
        self._work: _Work | None = None
        self._wait: _Wait | None = None
        self._deadline_s = 0.0
        self._order: Order | None = None
        self.state = SystemState.UNCONFIGURED

    # --- what comes ------------------------------------------------------------------------------

    def give(self, order: Order) -> None:
        """Begin to carry a command out; ValueError if another one is under way."""
        if self._work is not None:
            doing = self._order.command if self._order else "a node is lost, its return"
            raise ValueError(f"{order.command}: {doing} is under way")
        self._order = order
        self._set(SystemState.CHANGING, Level.OK, f"{order.command} of {', '.join(self._names)}")
        self._begin(self._carry_out(order.command))

    def heard(self, name: str, state: NodeState) -> None:
        """A node has said in /diagnostics where it is."""
        bond = self._bonds.get(name)
        if bond is None:
            return
        bond.heard_s = self._now_s()
        if state == NodeState.FINISHED:
            # Nobody needs it any more, and its process ends.
            del self._bonds[name]
            self._over = self._over or name == self._names[-1]
        elif state not in _OUT:
            bond.formed, bond.why_broken = True, ""
        elif bond.formed:
            bond.why_broken = f"it is {state.value}"
        self.advance()

    def restarted(self, name: str) -> None:
        """A node has died, and is started again."""
        if name in self._bonds:
            self._bonds[name].why_broken = "it has died"
            self.advance()

    def advance(self) -> None:
        """Go on as far as that is possible now."""
        if self._work is None and self.state == SystemState.ACTIVE:
            if self._over:
                self._begin(self._end())
            else:
                self._watch()
        while self._work is not None and self._wait is not None:
            done = self._wait.done()
            if not done and self._now_s() < self._deadline_s:
                return
            self._step(done)

    # --- how it is done --------------------------------------------------------------------------

    def _begin(self, work: _Work) -> None:
        self._work = work
        self._step(None)
        self.advance()

    def _step(self, done: bool | None) -> None:
        """Have the work under way go on to the next thing that it waits for."""
        assert self._work is not None
        try:
            self._wait = next(self._work) if done is None else self._work.send(done)
            limit_s = self._wait.limit_s
            self._deadline_s = float("inf") if limit_s is None else self._now_s() + limit_s
        except StopIteration:
            self._work = self._wait = None
        except BringUpError as error:
            self._work = self._wait = None
            self._set(SystemState.FAILED, Level.ERROR, str(error))
            self._answer(False, str(error))

    def _answer(self, success: bool, sentence: str) -> None:
        order, self._order = self._order, None
        if order is not None:
            order.answer(success, sentence)

    def _set(self, state: SystemState, level: Level, sentence: str) -> None:
        self.state = state
        self._tell(level, sentence, state)

    def _carry_out(self, command: SystemCommand) -> _Work:
        transitions, end = _STEPS[command]
        if command in (SystemCommand.STARTUP, SystemCommand.RESUME):
            self._lost.clear()
            self._over = False
        for transition in transitions:
            yield from self._all(transition, self._names)
        sentence = f"nodes are {end.value}"
        self._set(end, Level.OK, sentence)
        self._answer(True, sentence)

    def _groups(self, transition: int, names: Sequence[str]) -> Iterator[list[str]]:
        """Who makes a transition together, one group after the other."""
        there = [name for name in names if name not in self._lost]
        if transition == CONFIGURE:
            yield there
            return
        for name in there if transition in _UP else reversed(there):
            yield [name]

    def _all(self, transition: int, names: Sequence[str]) -> _Work:
        """Have nodes make a transition, those who need to."""
        label, _ = TRANSITIONS[transition]
        limit_s = _CONFIGURE_LIMIT_S if transition == CONFIGURE else self._limit_s
        for group in self._groups(transition, names):
            if transition in _UP:
                yield from self._appear(group)
            states = States(group, self._nodes.ask_state, self._now_s)
            yield from self._until(states.complete, self._limit_s, states.silent, label)
            needing = [name for name in group if is_needed(transition, states.ids[name])]
            if transition == ACTIVATE:
                for name in needing:
                    if states.ids[name] != _INACTIVE:
                        raise BringUpError(f"{name}: is not configured", name)
            if needing:
                answers = self._nodes.begin(needing, transition)
                yield from self._until(answers.complete, limit_s, answers.silent, label)
                if refused := answers.refused():
                    why = self._reason(refused[0])
                    said = f": {why}" if why else ""
                    raise BringUpError(f"{', '.join(refused)}: refused to {label}{said}")
            for name in group:
                if transition == ACTIVATE:
                    self._bonds[name] = Bond(self._now_s())
                elif transition not in _UP:
                    self._bonds.pop(name, None)

    def _appear(self, group: Sequence[str]) -> _Work:
        """Wait for nodes to be there, for as long as it takes, and say for whom."""

        def missing() -> list[str]:
            return [name for name in self._nodes.missing() if name in group]

        if missing():
            self._tell(Level.OK, f"waiting for {', '.join(missing())} to start", self.state)
            yield _Wait(lambda: not missing(), None, missing, "start")

    def _until(
        self,
        done: Callable[[], bool],
        limit_s: float,
        silent: Callable[[], list[str]],
        what: str,
    ) -> _Work:
        if not (yield _Wait(done, limit_s, silent, what)):
            names = ", ".join(silent())
            raise BringUpError(f"{names}: no answer to '{what}' in {limit_s:g} s")

    def _end(self) -> _Work:
        """The work of the last node is done: it is shut down; the others may still be asked."""
        self._over, last = False, self._names[-1]
        self._set(SystemState.INACTIVE, Level.OK, f"{last} has finished")
        for transition in (DEACTIVATE, CLEANUP, SHUTDOWN):
            yield from self._all(transition, [last])

    # --- the bond --------------------------------------------------------------------------------

    def _watch(self) -> None:
        """Look for a node that is lost, where nodes are bonded."""
        if not self._timeout_s:
            return
        for name, bond in self._bonds.items():
            if self._now_s() - bond.heard_s > self._timeout_s:
                bond.why_broken = f"it was not heard for {self._timeout_s:g} s"
            if bond.why_broken:
                self._begin(self._recover(name, bond.why_broken))
                return

    def _who_makes_time(self, lost: str) -> list[str]:
        """In lockstep the last of the nodes, if it is there: it can be paused."""
        leader = self._names[-1]
        return [leader] if self._lockstep and leader != lost and leader in self._bonds else []

    def _recover(self, name: str, why: str) -> _Work:
        """Bring a node up again that is lost; reset the others if it does not come back."""
        lost_s = self._now_s()
        paused = self._who_makes_time(name)
        still = "; time stands still until it is back" if paused else ""
        self._set(SystemState.RECONNECTING, Level.ERROR, f"{name} is lost: {why}{still}")
        with contextlib.suppress(BringUpError):
            # If it does not pause either, its return fails below.
            yield from self._all(DEACTIVATE, paused)

        def is_back() -> bool:
            bond = self._bonds[name]
            # What it said before is no sign of life, but that it was started again is.
            return bond.heard_s > lost_s or bond.why_broken == f"it is {NodeState.UNCONFIGURED}"

        if self._reconnects and (yield _Wait(is_back, self._respawn_s, lambda: [name], "return")):
            try:
                yield from self._all(CONFIGURE, [name])
                yield from self._all(ACTIVATE, [name])
                yield from self._all(ACTIVATE, paused)
            except BringUpError as error:
                why = f"{why}; {error}"
            else:
                self._set(SystemState.ACTIVE, Level.OK, f"{name} is back, nodes are active")
                return
        self._lost.add(name)
        self._bonds.pop(name)
        for transition in (DEACTIVATE, CLEANUP):
            yield from self._all(transition, self._names)
        sentence = f"{name} is lost: {why}; the others have been reset"
        self._set(SystemState.FAILED, Level.ERROR, sentence)
