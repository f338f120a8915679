# SPDX-License-Identifier: Apache-2.0
"""A pilot in Python: a call returns when it is done, or raises why it is not.

    from heli_actions import Pilot

    with Pilot() as pilot:
        pilot.takeoff(5.0)
        pilot.goto(10.0, 0.0, 5.0)
        pilot.land()

As Nav2's `BasicNavigator` it needs no node, no executor and no callbacks of its user: it has its
own, in a thread. Goals go over the actions where a node `actions` serves them and their types are
installed, else over the topic `goal`, which every flight has; what becomes of them is the same.
"""

import asyncio
import itertools
import math
import os
import threading
import time
import uuid
from collections.abc import Callable, Generator
from concurrent.futures import Future
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, Self

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from numpy.typing import NDArray
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import NavSatFix
from std_srvs.srv import SetBool

from heli_actions.errors import FlightNotHeard, GoalError, PilotError, goal_error
from heli_actions.foreign_mode import ForeignFlight, ForeignMode
from heli_actions.goals import (
    NOT_KNOWN,
    Code,
    FlightStatus,
    GoalFeedback,
    GoalLimits,
    GoalManager,
    GoalRequest,
    GoalStatus,
    Kind,
)
from heli_actions.interfaces import ActionClients, Interfaces
from heli_actions.parameters import NODE_NAME, TABLE
from heli_core.rotations import euler_from_quat, quat_from_euler
from heli_core.rows import NAV, REFERENCE
from heli_core.ticks import NS_PER_S
from heli_msgs_bridge import frames, topics
from heli_msgs_bridge.command_messages import (
    PLAIN_COMMANDS,
    decode_goto,
    decode_goto_gps,
    decode_reference,
    encode_goal,
)
from heli_msgs_bridge.diagnostics import GoalState, outer_loop_of
from heli_msgs_bridge.frames import datum
from heli_msgs_bridge.layouts import MessageError
from heli_msgs_bridge.lifecycle_node import NodeSpec
from heli_msgs_bridge.messages import Decoder
from heli_msgs_bridge.node_process import Spinning, outlasts_set_clock
from heli_msgs_bridge.status import AircraftStatus

# -------------------------------------------------------------------------------------------------
# A goal that is under way.
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Feedback:
    """Where a goal is.

    Attributes
    ----------
    flown_s : float
        Flight time by its stamps, s.
    mode : str
        Mode that is flown.
    pos_enu_m : (3,) array
        Navigated position in `map`: east, north, up.
    heading_deg : float
        0 is north, 90 east.
    left_m : float or None
        Distance to the end, of a take-off and a landing the height; None until it is known.
    left_s : float or None
        Flight time until the end of its way; None until it is known, and for a landing.
    """

    flown_s: float
    mode: str
    pos_enu_m: Array
    heading_deg: float
    left_m: float | None
    left_s: float | None

    @classmethod
    def of(cls, given: GoalFeedback) -> Self:
        """In a pilot's words."""
        enu = np.empty(3)
        frames.ned_to_enu(given.pos_ned_m, enu)
        heading_deg = math.degrees(euler_from_quat(given.quat)[2]) % 360.0
        left_m, left_s = (None if x == NOT_KNOWN else x for x in (given.left_m, given.left_s))
        return cls(given.stamp_ns / NS_PER_S, given.mode, enu, heading_deg, left_m, left_s)


class PilotGoal:
    """A goal that was sent; of `Pilot.takeoff(..., wait=False)` and its like.

    `await goal` waits in asyncio, as `result` does without.

    Attributes
    ----------
    name : str
        What was asked for.
    feedback : Feedback or None
        The newest; None before the first.
    """

    def __init__(
        self, name: str, cancel: Callable[[], None], tell: Callable[[Feedback], None] | None
    ) -> None:
        self.name, self._cancel, self._tell = name, cancel, tell
        self.feedback: Feedback | None = None
        self._ended: Future[str] = Future()

    @property
    def done(self) -> bool:
        """Whether it has ended, in whatever way."""
        return self._ended.done()

    def cancel(self) -> None:
        """Have it cancelled: the aircraft holds, and `result` raises `GoalCanceled`."""
        self._cancel()

    def result(self, timeout_s: float | None = None) -> str:
        """Wait for its end.

        Parameters
        ----------
        timeout_s : float, optional
            Wall time; None for ever. The goal goes on after it.

        Returns
        -------
        str
            What was done, one sentence.

        Raises
        ------
        GoalError
            It was not done; one class for each way to end (`heli_actions.errors`).
        TimeoutError
            It is still under way.
        """
        return self._ended.result(timeout_s)

    def __await__(self) -> Generator[Any, None, str]:
        # The end of who waits is none of the goal.
        return asyncio.shield(asyncio.wrap_future(self._ended)).__await__()

    def told(self, feedback: GoalFeedback) -> None:
        """Feedback has come."""
        self.feedback = Feedback.of(feedback)
        if self._tell is not None and not self.done:
            self._tell(self.feedback)

    def end(self, code: Code, sentence: str, cause: str = "") -> None:
        """It has ended."""
        if self.done:
            return
        if code == Code.DONE:
            self._ended.set_result(sentence)
        else:
            self._ended.set_exception(goal_error(code, sentence, cause))


# -------------------------------------------------------------------------------------------------
# Pilot.
# -------------------------------------------------------------------------------------------------

_PATIENCE_S, _AGAIN_S = 0.02, 0.5
_CANCEL_S = 5.0
"""Wall time that a Ctrl-C waits for the aircraft to hold."""
_MODES = {"hover": "hold"}
"""Modes that are commanded by another name than their own."""
_COUNT = itertools.count()
_NOBODY = "no flight is heard: does one run in this ROS_DOMAIN_ID and namespace?"


@dataclass
class _Plain:
    """A command that is done when it is obeyed."""

    command: str
    goal: PilotGoal
    asked_s: float
    sent_s: float = -math.inf


class Pilot:
    """Commands the aircraft of one namespace.

    Calls wait for the end of what they ask for and return its sentence; with `wait=False` they
    return a `PilotGoal` at once. Ctrl-C in a call that waits cancels the goal. Callbacks for
    feedback are called in the pilot's own thread, where no call may wait.

    Parameters
    ----------
    namespace : str, optional
        Of the aircraft; empty for none.
    wait_s : float, optional
        Wall time in which a flight has to be heard that is ready to be commanded.
    actions : bool, optional
        True: over the actions, or `FlightNotHeard`; False: over the topic `goal`; by default over
        the actions where their types are installed and somebody serves them.
    context : rclpy.Context, optional
        ROS as it was begun elsewhere; by default the pilot begins one, by the environment.
    interfaces : Interfaces, optional
        Types of the actions, by default those of `heli_interfaces`.

    Raises
    ------
    FlightNotHeard
        No flight is ready in time.
    """

    def __init__(
        self,
        namespace: str = "",
        *,
        wait_s: float = 120.0,
        actions: bool | None = None,
        context: rclpy.Context | None = None,
        interfaces: Interfaces | None = None,
    ) -> None:
        self._own_context = context is None
        if context is None:
            context = rclpy.Context()
            rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
        self._ros = context
        self._node = Node(
            f"pilot_{os.getpid()}_{next(_COUNT)}",
            namespace=namespace,
            context=context,
            enable_rosout=False,
            start_parameter_services=False,
        )
        values = NodeSpec(NODE_NAME, "heli_actions", TABLE, f"{NODE_NAME}.yaml").resolve()
        limits = GoalLimits(**{row.name: values[row.name] for row in fields(GoalLimits)})
        self._flight, self._odom, self._newest = FlightStatus(), Decoder(topics.ODOM), b""
        self._manager = GoalManager(self, self._flight, limits)
        self._goals: dict[str, PilotGoal] = {}
        self._plain: dict[str, _Plain] = {}
        self._feedback_s, self._told_s = values["feedback_period_s"], 0.0
        self._ready, self._closing = threading.Event(), threading.Event()
        self._lock, self._origin_known = threading.Lock(), threading.Event()
        self._origin = 0.0, 0.0, 0.0
        self._foreign: ForeignFlight | None = None
        self._foreign_goal: PilotGoal | None = None
        self._wake: Callable[[], None] = lambda: None
        self._hear()
        self._arm = self._node.create_client(SetBool, "arm")
        self._clients = self._actions(actions, interfaces)
        self._executor = EventsExecutor(context=context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._serve, name="pilot", daemon=True)
        self._thread.start()
        try:
            self._await_flight(wait_s, actions)
        except BaseException:
            self.close()
            raise

    def _hear(self) -> None:
        node = self._node
        goal = topics.BY_NAME[topics.GOAL].type
        publisher = node.create_publisher(
            topics.message_class(goal), topics.GOAL, topics.qos(topics.GOAL, 10)
        )
        self._publish = publisher.publish
        best_effort = QoSProfile(
            history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.BEST_EFFORT
        )
        for topic, call, qos in (
            (topics.ODOM, self._on_odom, best_effort),
            (topics.DIAGNOSTICS, self._on_diagnostics, topics.qos(topics.DIAGNOSTICS)),
            (topics.ORIGIN, self._on_origin, topics.qos(topics.ORIGIN)),
        ):
            cls = topics.message_class(topics.KNOWN[topic].type)
            node.create_subscription(cls, topic, call, qos, raw=topic == topics.ODOM)

    def _actions(self, wanted: bool | None, given: Interfaces | None) -> ActionClients | None:
        """Clients of the actions, if their types are here and they are not unwanted."""
        if wanted is False:
            return None
        try:
            interfaces = given or Interfaces.installed()
        except LookupError as error:
            if wanted:
                raise FlightNotHeard(str(error)) from error
            return None
        return ActionClients(self._node, interfaces)

    def _await_flight(self, wait_s: float, actions: bool | None) -> None:
        deadline_s = time.monotonic() + wait_s
        if not self._ready.wait(wait_s):
            if not self._flight.outer_loop_ns:
                raise FlightNotHeard(f"{_NOBODY} (waited {wait_s:g} s)")
            raise FlightNotHeard(
                f"the flight is not ready after {wait_s:g} s: {self._flight.sentence}"
            )
        if self._clients is None:
            return
        # Whoever listens to the flight has been found by now, and so has who serves beside it.
        wait_s = max(deadline_s - time.monotonic(), 0.0) if actions else 0.0
        if not self._clients.served(wait_s):
            if actions:
                raise FlightNotHeard("nobody serves the actions: ros2 run heli_actions actions")
            self._clients = None

    # --- goals -----------------------------------------------------------------------------------

    def takeoff(self, height_m: float | None = None, **how: Any) -> Any:
        """Take off, climb, hover.

        Parameters
        ----------
        height_m : float, optional
            Above where it stands; by default the outer loop's `takeoff.height_m`.
        wait : bool, optional
            False: return a `PilotGoal` at once.
        on_feedback : callable, optional
            Called with each `Feedback`.
        timeout_s : float, optional
            Wall time after which `TimeoutError` is raised; the goal goes on.

        Returns
        -------
        str or PilotGoal

        Raises
        ------
        GoalError
            It was not done; one class for each way to end (`heli_actions.errors`).
        """
        return self._send(GoalRequest(Kind.TAKEOFF, message=height_m), **how)

    def goto(
        self, east_m: float, north_m: float, up_m: float, heading_deg: float | None = None,
        **how: Any,
    ) -> Any:  # fmt: skip
        """Fly to a point of `map`, and hold it; returns, raises and has more words as `takeoff`.

        Parameters
        ----------
        east_m, north_m, up_m : float
            From the origin of `map`.
        heading_deg : float, optional
            Of the nose there, 0 is north, 90 east; by default as it is now.
        """
        psi = math.radians(heading_deg) if heading_deg is not None else self._heading_rad()
        q = np.empty(4)
        frames.quat_ned_frd_to_enu_flu(quat_from_euler(0.0, 0.0, psi), q)
        message = PoseStamped()
        message.header.frame_id = topics.MAP
        at, r = message.pose.position, message.pose.orientation
        at.x, at.y, at.z = float(east_m), float(north_m), float(up_m)
        r.x, r.y, r.z, r.w = q.tolist()
        try:
            end_ned_m = decode_goto(message).pos_ned_m
        except MessageError as error:
            raise _refused(error) from error
        return self._send(GoalRequest(Kind.GOTO, end_ned_m, message), **how)

    def goto_gps(
        self, latitude_deg: float, longitude_deg: float, height_m: float,
        heading_deg: float | None = None, **how: Any,
    ) -> Any:  # fmt: skip
        """Fly to a place by latitude, longitude and height above the ellipsoid, all WGS-84.

        Else as `goto`.
        """
        if not self._origin_known.wait(self._manager.limits.answer_s):
            raise goal_error(Code.NO_ANSWER, "goto_gps: the outer loop tells no origin")
        fix = NavSatFix(
            latitude=float(latitude_deg), longitude=float(longitude_deg), altitude=float(height_m)
        )
        try:
            ned, enu = decode_goto_gps(fix, datum(*self._origin)).pos_ned_m, np.empty(3)
        except (MessageError, ValueError) as error:
            raise _refused(error) from error
        frames.ned_to_enu(ned, enu)
        east_m, north_m, up_m = enu.tolist()
        return self.goto(east_m, north_m, up_m, heading_deg, **how)

    def follow(self, trajectory: Any, **how: Any) -> Any:
        """Follow a way, and hold its end; returns, raises and has more words as `takeoff`.

        Parameters
        ----------
        trajectory : trajectory_msgs.msg.MultiDOFJointTrajectory
            In `map`; a stamp of zero stands for now.
        """
        stamp = trajectory.header.stamp
        if not stamp.sec and not stamp.nanosec:
            stamp.sec, stamp.nanosec = divmod(self._flight.now_ns, NS_PER_S)
        try:
            way = decode_reference(trajectory, self._node.get_namespace())
        except MessageError as error:
            raise _refused(error) from error
        end_ned_m = way.points[-1, REFERENCE.pos]
        return self._send(GoalRequest(Kind.FOLLOW, end_ned_m, trajectory), **how)

    def land(self, **how: Any) -> Any:
        """Come to rest, descend, touch down, stand; as `takeoff` without a height."""
        return self._send(GoalRequest(Kind.LAND), **how)

    def fly(self, mode: ForeignMode, **how: Any) -> Any:
        """Fly a mode of yours until it is done; returns, raises and has more words as `takeoff`.

        What it requires is checked first (`GoalRefused`) and at each step (`ModeLeft`); `cause`
        names what failed. When it ends, in whatever way, the aircraft hovers.

        Parameters
        ----------
        mode : ForeignMode
        """
        cancel, tell = partial(self._call, self._end_foreign), how.pop("on_feedback", None)
        wait, timeout_s = how.pop("wait", True), how.pop("timeout_s", None)
        if how:
            raise TypeError(f"fly: unknown words {', '.join(how)}")
        goal = PilotGoal(mode.name, cancel, tell)
        self._call(self._begin_foreign, goal, mode)
        return self._wait(goal, timeout_s) if wait else goal

    def hold(self) -> str:
        """Stop as soon as the limits allow, and stay; a goal that is under way ends by it."""
        return self.mode("hover")

    def mode(self, name: str) -> str:
        """Command a mode that needs nothing else: hover, velocity, attitude, manual, land, takeoff.

        Returns its sentence once it is obeyed; raises `GoalRefused` if it is not.
        """
        command = _MODES.get(name, name)
        if command not in PLAIN_COMMANDS:
            allowed = ", ".join((*_MODES, *PLAIN_COMMANDS))
            raise goal_error(
                Code.REFUSED, f"mode '{name}': none that needs only its name; allowed: {allowed}"
            )
        key = uuid.uuid4().hex
        goal = PilotGoal(command, partial(self._call, self._drop, key), None)
        self._call(self._plain.__setitem__, key, _Plain(command, goal, time.monotonic()))
        return self._wait(goal, None)

    def arm(self, armed: bool = True) -> str:
        """Let take-offs be obeyed, or not (False, only while it stands); as `mode` in the end."""
        goal = PilotGoal("arm", lambda: None, None)

        def answered(future: Any) -> None:
            answer = future.result()
            goal.end(Code.DONE if answer.success else Code.REFUSED, answer.message)

        def ask() -> None:
            self._arm.call_async(SetBool.Request(data=armed)).add_done_callback(answered)

        if not self._arm.wait_for_service(self._manager.limits.answer_s):
            raise goal_error(Code.NO_ANSWER, "arm: the outer loop has no such service")
        self._call(ask)
        try:
            return self._wait(goal, self._manager.limits.answer_s)
        except TimeoutError:
            raise goal_error(Code.NO_ANSWER, "arm: no answer of the outer loop") from None

    def cancel(self) -> None:
        """Cancel whatever goals of this pilot are under way; they say so themselves."""
        self._call(self._cancel_all)
        self._call(self._end_foreign)

    # --- the flight ------------------------------------------------------------------------------

    @property
    def over_actions(self) -> bool:
        """Whether goals go over the actions."""
        return self._clients is not None

    @property
    def status(self) -> AircraftStatus:
        """What the outer loop says of the aircraft: mode, armed, landed, failsafe, home."""
        flight = self._flight
        return AircraftStatus.of_facts(flight.outer_loop_ns, flight.sentence, flight.facts)

    @property
    def origin(self) -> tuple[float, float, float] | None:
        """Where `map` begins: latitude and longitude, deg, height, m (WGS-84); None till known."""
        return self._origin if self._origin_known.is_set() else None

    @property
    def pos_enu_m(self) -> Array:
        """Navigated position (3,) in `map`: east, north, up."""
        enu = np.empty(3)
        frames.ned_to_enu(self._flight.pos_ned_m, enu)
        return enu

    @property
    def flown_s(self) -> float:
        """The flight's time by its stamps, s."""
        return self._flight.now_ns / NS_PER_S

    def close(self) -> None:
        """Let go of its goals (`GoalClosed`) and of ROS; the flight goes on."""
        self._closing.set()
        if self._thread is not threading.current_thread():
            self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- in the caller's thread ------------------------------------------------------------------

    def _send(
        self,
        request: GoalRequest,
        *,
        wait: bool = True,
        on_feedback: Callable[[Feedback], None] | None = None,
        timeout_s: float | None = None,
    ) -> Any:
        key = uuid.uuid4().hex
        goal = PilotGoal(request.kind.value, partial(self._call, self._cancel, key), on_feedback)
        self._call(self._begin, key, goal, request)
        return self._wait(goal, timeout_s) if wait else goal

    def _wait(self, goal: PilotGoal, timeout_s: float | None) -> str:
        if threading.current_thread() is self._thread:
            raise PilotError(f"{goal.name}: no call may wait in a callback; say wait=False")
        try:
            return goal.result(timeout_s)
        except KeyboardInterrupt:
            goal.cancel()
            try:
                goal.result(_CANCEL_S)
            except (GoalError, TimeoutError):
                raise KeyboardInterrupt from None
            raise

    def _call(self, function: Callable[..., Any], *args: Any) -> None:
        """Have something done in the pilot's thread."""
        with self._lock:
            if self._closing.is_set():
                raise PilotError("this pilot is closed")
            self._executor.create_task(function, *args)

    def _heading_rad(self) -> float:
        return float(euler_from_quat(self._flight.quat)[2])

    # --- in its own thread -----------------------------------------------------------------------

    def _serve(self) -> None:
        spinning, at_once = Spinning(self._executor, _PATIENCE_S), Spinning(self._executor)
        self._wake = at_once.stop
        sentence = "the pilot is closed; the flight goes on"
        try:
            with outlasts_set_clock(self._executor, [self._node]):
                while not self._closing.is_set() and self._ros.ok():
                    (spinning if self._foreign is None else at_once).serve()
                    self._look()
        except BaseException as error:
            sentence = f"the pilot has failed: {type(error).__name__}: {error}"
            raise
        finally:
            with self._lock:
                self._closing.set()
            spinning.serve()  # what was still asked for
            if self._foreign is not None:
                self._foreign.end(Code.CLOSED, sentence, holds=False)
            for goal in (*self._goals.values(), *(one.goal for one in self._plain.values())):
                goal.end(Code.CLOSED, f"{goal.name}: {sentence}")
            self._executor.shutdown()
            if self._clients is not None:
                self._clients.destroy()
            self._node.destroy_node()
            if self._own_context:
                self._ros.try_shutdown()

    def _begin_foreign(self, goal: PilotGoal, mode: ForeignMode) -> None:
        if self._foreign is not None:
            goal.end(Code.REFUSED, f"{mode.name}: this pilot flies a mode already")
            return

        def finish(code: Code, sentence: str, cause: str, holds: bool) -> None:
            self._foreign = None
            self._wake()
            if holds:
                key = uuid.uuid4().hex
                hold = PilotGoal("hold", partial(self._drop, key), None)
                self._plain[key] = _Plain("hold", hold, time.monotonic())
            goal.end(code, sentence, cause)

        self._foreign = ForeignFlight(mode, self._node, self._manager.limits.answer_s, finish)
        self._foreign_goal = goal

    def _end_foreign(self) -> None:
        if self._foreign is not None:
            self._foreign.end(Code.CANCELED, "cancelled")

    def _step_foreign(self, nav: Array, stamp_ns: int, wall_s: float) -> None:
        """One step of the mode that is flown from here; feedback of it."""
        flight, foreign, goal = self._flight, self._foreign, self._foreign_goal
        if foreign is None or goal is None:
            return
        foreign.step(nav, stamp_ns, self.status, flight.facts, wall_s)
        if not goal.done:
            where = nav[NAV.pos].copy(), nav[NAV.quat].copy()
            goal.told(GoalFeedback(stamp_ns, flight.mode, *where, NOT_KNOWN, NOT_KNOWN))

    def _begin(self, key: str, goal: PilotGoal, request: GoalRequest) -> None:
        self._goals[key] = goal
        if self._clients is None:
            self._manager.accept(key, request)
        else:
            self._clients.send(key, request, goal.told, partial(self.finish, key))

    def _cancel(self, key: str) -> None:
        if self._clients is None:
            self._manager.cancel(key)
        else:
            self._clients.cancel(key)

    def _cancel_all(self) -> None:
        for key in list(self._goals):
            self._cancel(key)

    def send(self, command: str, goal_id: str, argument: Any) -> None:
        """The goal manager sends a command with an id to the outer loop."""
        self._publish(encode_goal(command, goal_id, argument))

    def finish(
        self, key: str, outcome: GoalStatus, code: Code, sentence: str, cause: str = ""
    ) -> None:
        """The goal manager, or the actions, end a goal."""
        answer = self._flight.answers.get(key)
        cause = cause or ("" if answer is None else answer.cause)
        if (goal := self._goals.pop(key, None)) is not None:
            goal.end(code, sentence, cause if code == Code.REFUSED else "")

    def _on_odom(self, raw: bytes) -> None:
        self._newest = raw
        if self._foreign is not None:
            self._look()

    def _on_origin(self, message: Any) -> None:
        self._origin = message.latitude, message.longitude, message.altitude
        self._origin_known.set()

    def _on_diagnostics(self, message: Any) -> None:
        for told in outer_loop_of(message, self._node.get_namespace()):
            self._flight.diagnostics(told.stamp_ns, told.sentence, told.facts, time.monotonic())

    def _look(self) -> None:
        """What follows from what was heard."""
        raw, self._newest = self._newest, b""
        wall_s, flight = time.monotonic(), self._flight
        if raw:
            nav = self._odom.decode(raw)
            if np.isfinite(nav[NAV.pos]).all() and np.isfinite(nav[NAV.quat]).all():
                stamp_ns = self._odom.stamp_ns
                self._manager.odom(stamp_ns, nav[NAV.pos], nav[NAV.quat], wall_s)
                self._step_foreign(nav, stamp_ns, wall_s)
        if flight.ready and flight.odom_ns:
            self._ready.set()
        self._manager.update(wall_s)
        for key, plain in list(self._plain.items()):
            self._look_after(key, plain, wall_s)
        if wall_s - self._told_s >= self._feedback_s:
            self._told_s = wall_s
            if self._clients is not None:
                self._clients.watch()
            if (latest := self._manager.feedback()) is not None and latest[0] in self._goals:
                self._goals[latest[0]].told(latest[2])

    def _drop(self, key: str) -> None:
        """A plain command is asked for no more."""
        if (plain := self._plain.pop(key, None)) is not None:
            plain.goal.end(Code.CANCELED, f"{plain.command}: asked for no more")

    def _look_after(self, key: str, plain: _Plain, wall_s: float) -> None:
        """Ask for a plain command again until it is answered, or too much time has passed."""
        answer, answer_s = self._flight.answers.get(key), self._manager.limits.answer_s
        if answer is not None:
            done = answer.state != GoalState.REFUSED
            code = Code.DONE if done else Code.REFUSED
            plain.goal.end(code, answer.sentence, answer.cause)
        elif wall_s - plain.asked_s > answer_s:
            sentence = f"{plain.command}: no answer of the outer loop in {answer_s:g} s"
            plain.goal.end(Code.NO_ANSWER, sentence)
        elif wall_s - plain.sent_s > _AGAIN_S:
            plain.sent_s = wall_s
            self.send(plain.command, key, None)
        if plain.goal.done:
            del self._plain[key]


def _refused(error: ValueError) -> GoalError:
    named = error.cause if isinstance(error, MessageError) else None
    cause = "" if named is None else named.name
    return goal_error(Code.REFUSED, str(error), cause)
