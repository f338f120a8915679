# SPDX-License-Identifier: Apache-2.0
"""The process of a node, or of several together: from the command line to the exit code.

0: it was asked to end or its flight is over, 1: it failed while running or the helicopter was
lost, 2: it could not start (bad parameter, missing peer, no DDS). Every failure is one line on
stderr.
"""

import contextlib
import ctypes
import gc
import os
import signal
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, TypeVar

import rclpy
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from heli_core import command_line
from heli_core.parameters import Parameter
from heli_core.rcl_yaml import ParameterError
from heli_msgs_bridge.lifecycle_node import ManagedNode, NodeSpec, NodeStartError

# -------------------------------------------------------------------------------------------------
# What a node answers to `--help`: usage and its parameters, from its table and packaged files.
# -------------------------------------------------------------------------------------------------

_WIDTH = 100
_ROS_ARGUMENTS = (
    ("-r __node:=NAME", "another name; parameter files then speak of it by that name"),
    ("-r __ns:=/NAMESPACE", "prefix of node and topics"),
    ("-r FROM:=TO", "another name of a topic or service"),
    ("--params-file FILE", "parameter file over the packaged values; repeatable"),
    ("-p NAME:=VALUE", "one parameter, over all files; repeatable"),
    ("--log-level LEVEL", "debug, info, warn, error or fatal"),
)


def asks_for_help(arguments: Sequence[str]) -> bool:
    """Whether a command line asks for help rather than for a node (before `--ros-args`)."""
    words = list(arguments)
    if "--ros-args" in words:
        words = words[: words.index("--ros-args")]
    return "--help" in words or "-h" in words


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"' if value == "" or " " in value else value
    if hasattr(value, "tolist"):
        value = value.ravel().tolist()
    if isinstance(value, (list, tuple)):
        return textwrap.shorten(f"[{', '.join(_shown(v) for v in value)}]", 60, placeholder=" ...]")
    return str(value)


def _row(row: Parameter, value: Any) -> str:
    fixed = "; fixed while the node runs" if row.read_only else ""
    text = f"{row.description}: {row.allowed()}{fixed}"
    body = textwrap.fill(text, _WIDTH, initial_indent="      ", subsequent_indent="      ")
    return f"  {row.name} = {_shown(value)}\n{body}"


def usage(spec: NodeSpec, summary: str) -> str:
    """Help of a node.

    Parameters
    ----------
    spec : NodeSpec
    summary : str
        What the node does, in a sentence.

    Returns
    -------
    str
        With a line break at its end.

    Raises
    ------
    NodeStartError
        The installation lacks the packaged values.
    """
    values = spec.resolve()
    width = max(len(left) for left, _ in _ROS_ARGUMENTS)
    options = "\n".join(f"  {left:<{width}}  {right}" for left, right in _ROS_ARGUMENTS)
    rows = "\n".join(_row(row, values[row.name]) for row in spec.full_table())
    return (
        f"usage: ros2 run {spec.package} {spec.name} [--help] [--ros-args ...]\n\n"
        f"{textwrap.fill(' '.join(summary.split()), _WIDTH)}\n\n"
        f"after --ros-args:\n{options}\n\n"
        f"parameters with their packaged values:\n{rows}\n\n"
        "exit code: 0 asked to end or flight over, 1 failed in flight, 2 could not start\n"
    )


# -------------------------------------------------------------------------------------------------
# The way out of DDS, which may have no end.
#
# To destroy a participant rmw_fastrtps calls `DomainParticipant::set_listener` of Fast DDS, which
# waits until the listener is not being called. In the wheels' build (2.14) the limit of that wait
# is beyond what 64 bits hold: the wait returns at once, as the wrong argument it is, and keeps the
# lock for which the listener waits. Who leaves in the moment in which it is told of another one's
# coming or leaving turns in this loop for ever, with Python's lock held, so that no thread can
# help.
# -------------------------------------------------------------------------------------------------

LIMIT_S = 5.0
"""Wall time for leaving; it takes 0.03 s, on loaded cores up to a second."""
NOT_LEFT = "DDS was not left in time"
"""In the log of a process that was ended so: the file of its port stays in shared memory."""
_QUIET_S, _WAIT_S, _LEAVING_LOOK_S = 0.05, 0.5, 0.01
_HANDLER = ctypes.CFUNCTYPE(None, ctypes.c_int)


@contextlib.contextmanager
def exit_within(code: int, limit_s: float = LIMIT_S) -> Iterator[None]:
    """End this process with an exit code if what is done inside does not end.

    Called in the main thread by who has nothing left to do. A handler of Python's would wait for
    the interpreter's next step, which does not come; this one is called in the midst of the loop.
    """
    sys.stdout.flush()
    libc = ctypes.CDLL(None)
    libc.signal.argtypes, libc.signal.restype = (ctypes.c_int, ctypes.c_void_p), ctypes.c_void_p

    def end_now(number: int) -> None:
        if not code:  # else the last line in the log says already why it ends
            os.write(2, f"{NOT_LEFT}\n".encode())
        os._exit(code)

    end = _HANDLER(end_now)
    before = libc.signal(signal.SIGALRM, ctypes.cast(end, ctypes.c_void_p))
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        libc.signal(signal.SIGALRM, before)


def wait_for_dds_shutdown(node: Node) -> None:
    """Wait until nobody comes or leaves, for half a second at most; not where ROS has ended.

    For who has work left when its node is destroyed.
    """
    last_graph: object = None
    begun_s = since_s = time.monotonic()
    while node.context.ok():
        now_s = time.monotonic()
        if (graph := _others(node)) != last_graph:
            last_graph, since_s = graph, now_s
        if now_s - since_s >= _QUIET_S or now_s - begun_s >= _WAIT_S:
            return
        time.sleep(_LEAVING_LOOK_S)


def _others(node: Node) -> tuple[object, ...]:
    """Who is in the graph, and what is sent and heard there."""
    topics = node.get_topic_names_and_types()
    return (
        sorted(node.get_node_names_and_namespaces()),
        [(name, node.count_publishers(name), node.count_subscribers(name)) for name, _ in topics],
    )


# -------------------------------------------------------------------------------------------------
# The system clock is set while somebody waits.
#
# The wheels of rclpy and Fast DDS wait on condition variables for a time of the system clock, also
# where they mean the steady one (libstdc++ without pthread_cond_clockwait): set back by an hour, a
# wait of 50 ms that is under way takes an hour, unless something comes.
# -------------------------------------------------------------------------------------------------

_CANCEL_ON_SET = 0b11  # TFD_TIMER_ABSTIME | TFD_TIMER_CANCEL_ON_SET of timerfd_create(2)
_NEVER_S = 1 << 33


class _TimerSpec(ctypes.Structure):
    """`struct itimerspec` of timerfd_create(2): interval and time, each in s and ns."""

    _fields_ = [(name, ctypes.c_long) for name in ("every_s", "every_ns", "at_s", "at_ns")]


@contextlib.contextmanager
def when_clock_is_set(call: Callable[[], object]) -> Iterator[None]:
    """Within the block, call something from another thread each time the system clock is set.

    Slewing, as NTP does it in daily life, is no setting. Elsewhere than on Linux nothing is called.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    file = libc.timerfd_create(time.CLOCK_REALTIME, os.O_CLOEXEC) if sys.platform == "linux" else -1
    if file < 0:
        yield
        return
    over = threading.Event()

    def wait() -> None:
        while not over.is_set():
            try:
                os.read(file, 8)
            except OSError:  # ECANCELED
                call()

    libc.timerfd_settime(file, _CANCEL_ON_SET, ctypes.byref(_TimerSpec(0, 0, _NEVER_S, 0)), None)
    thread = threading.Thread(target=wait, name="clock_is_set", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        libc.timerfd_settime(file, 0, ctypes.byref(_TimerSpec(0, 0, 0, 1)), None)
        thread.join()
        os.close(file)


@contextlib.contextmanager
def outlasts_set_clock(executor: Executor, nodes: Sequence[Node] = ()) -> Iterator[None]:
    """Within the block, an executor's waits and these nodes' timers on it go on if it is set."""

    def go_on() -> None:
        for node in nodes:
            for timer in list(node.timers):
                timer.reset()

    with when_clock_is_set(lambda: executor.create_task(go_on)):
        yield


# -------------------------------------------------------------------------------------------------
# Node process.
# -------------------------------------------------------------------------------------------------

Made = TypeVar("Made")

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Ending:
    """Takes SIGINT and SIGTERM: the first is remembered, whatever comes after it changes nothing.

    A terminal and a launch send SIGINT both, and SIGTERM soon after. rclpy's own handlers may abort
    the process when they are called twice, and a bag would have no index. So the signals are
    blocked in all threads, and one of our own waits for them until the process ends. It does not
    end ROS: the executor aborts the process if ROS ends while it takes up a node's subscriptions.
    It wakes the executor, and who serves the node looks at `asked`.

    Attributes
    ----------
    asked : bool
        Whether a signal has come.
    """

    def __init__(self) -> None:
        self.asked = False
        self._lock = threading.Lock()
        self._wake: Callable[[], None] | None = None
        signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
        thread = threading.Thread(target=self._wait, daemon=True)
        thread.start()

        def pass_on(number: int, frame: object) -> None:
            """For threads of libraries that were started before, and do not block them."""
            assert thread.ident is not None
            signal.pthread_kill(thread.ident, number)

        for number in _SIGNALS:
            signal.signal(number, pass_on)

    def close(self) -> None:
        """The process ends: while the interpreter gives handlers back, its exit code stands."""
        for number in _SIGNALS:
            signal.signal(number, signal.SIG_IGN)

    def wake_by(self, wake: Callable[[], None] | None) -> None:
        """What to call when a signal comes; None for nothing, as long as nobody waits."""
        with self._lock:
            self._wake = wake

    def _wait(self) -> None:
        while True:
            signal.sigwait(_SIGNALS)
            with self._lock:
                first, self.asked = not self.asked, True
                if first and self._wake is not None:
                    self._wake()


def complain(name: str, sentence: str) -> None:
    """One line on stderr."""
    sys.stderr.write(f"{name}: {' '.join(sentence.split())}\n")
    sys.stderr.flush()


class _Failed(Exception):
    """Why the process ends: the node that it concerns, and the exit code."""

    def __init__(self, name: str, sentence: str, code: int) -> None:
        super().__init__(sentence)
        self.name, self.code = name, code


def _values(cls: type[ManagedNode], argv: Sequence[str]) -> dict[str, Any]:
    """The parameters that a node is given, checked before ROS starts; raises _Failed."""
    try:
        line = command_line.parse(argv, cls.SPEC.name)
        return cls.SPEC.resolve(line.params_files, line.rules, line.full_name)
    except (NodeStartError, ParameterError) as error:
        raise _Failed(cls.SPEC.name, str(error), 2) from error


def _named(name: str, make: Callable[[], Made]) -> Made:
    """What starting ROS or a node gives; raises _Failed."""
    try:
        return make()
    except (NodeStartError, ParameterError) as error:
        raise _Failed(name, str(error), 2) from error
    except Exception as error:
        first = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise _Failed(name, f"ROS 2 cannot start: {first}", 2) from error


class Spinning:
    """An executor that serves nodes until it is stopped.

    What has come is served in one call of the executor, not in one each: a call that waits with a
    limit, and the look whether it was the last one, take longer than to hand a message over. With
    patience much has come by then, and each of it takes a call that does not wait.

    Parameters
    ----------
    executor : EventsExecutor
    patience_s : float
        Wall time between two calls; 0 for a node that is waited for.
    """

    def __init__(self, executor: Executor, patience_s: float = 0.0) -> None:
        self._executor, self._patience_s = executor, patience_s
        self._over = Future()

    def stop(self) -> None:
        """End the present call of `serve`, or the next; from any thread."""
        self._over.set_result(None)

    def serve(self) -> None:
        """Serve what comes, for a while; with patience, what has come."""
        if not self._patience_s:
            self._executor.spin_until_future_complete(self._over, timeout_sec=_LOOK_S)
            self._over = Future()
            return
        time.sleep(self._patience_s)
        # Whatever waits is served before this, which ends the call. A call that ends with a future
        # keeps some 30 bytes for good (pybind11's record of a function), at this pace 20 MB/h.
        reached: list[bool] = []
        self._executor.create_task(lambda: reached.append(True))
        begun_s = time.monotonic()
        while not reached and time.monotonic() - begun_s < _LOOK_S:
            self._executor.spin_once(_LOOK_S)


def _spin(nodes: Sequence[ManagedNode], ending: Ending) -> int:
    executor = EventsExecutor()
    spinning = Spinning(executor, min(node.PATIENCE_S for node in nodes))
    for node in nodes:
        executor.add_node(node)
        node.notify_end = spinning.stop
    ending.wake_by(spinning.stop)
    try:
        with outlasts_set_clock(executor, nodes):
            return _serve(nodes, executor, spinning)
    finally:
        ending.wake_by(None)
        # It holds the nodes' parts, which could not be destroyed then.
        executor.shutdown()


# How often one looks whether ROS has ended, s.
_LOOK_S = 0.5
# How long Python lets a thread that configures or judges run while the executor waits, s.
_SWITCH_S = 0.0005


def _over(node: ManagedNode) -> bool:
    return node.leaving() or node.finished or node.not_started or node.crash is not None


def _serve(nodes: Sequence[ManagedNode], executor: Executor, spinning: Spinning) -> int:
    sys.setswitchinterval(_SWITCH_S)
    gc.collect()
    gc.freeze()
    for node in nodes:
        if node.values["autostart"]:
            executor.create_task(node.start_itself)
    while not any(map(_over, nodes)):
        spinning.serve()
    for node in nodes:
        if node.crash is not None:
            message = f"failed in flight: {type(node.crash).__name__}: {node.crash}"
            raise _Failed(node.SPEC.name, message, 1) from node.crash
        if node.not_started and not node.leaving():
            raise _Failed(node.SPEC.name, node.failure, 2)
    return max(node.exit_code for node in nodes)


def run(cls: type[ManagedNode], args: Sequence[str] | None = None) -> int:
    """Run a node until it is asked to end.

    Parameters
    ----------
    cls : ManagedNode sub-class
    args : sequence of str, optional
        Command line without the program name; by default the process's.

    Returns
    -------
    int
        Exit code: 0 ended cleanly (also by SIGINT or SIGTERM), 1 failed in flight, 2 could not
        start.
    """
    argv = list(sys.argv[1:] if args is None else args)
    name = cls.SPEC.name
    if not asks_for_help(argv):
        return run_together([cls], argv, name)
    try:
        sys.stdout.write(usage(cls.SPEC, cls.__doc__ or ""))
    except NodeStartError as error:
        complain(name, str(error))
        return 2
    return 0


def run_together(classes: Sequence[type[ManagedNode]], argv: Sequence[str], name: str) -> int:
    """Run nodes in this process and one executor until it is asked to end, or one of them ends.

    Parameters
    ----------
    classes : sequence of ManagedNode sub-classes
    argv : sequence of str
        Command line without the program name, the same for all.
    name : str
        Of the process, for a failure that no node has.

    Returns
    -------
    int
        As `run`.
    """
    nodes: list[ManagedNode] = []
    ending, code = None, 1
    try:
        ending = Ending()
        values_by_class = [_values(cls, argv) for cls in classes]
        if all(cls.PATIENCE_S for cls in classes):
            _stand_back()
        options = SignalHandlerOptions.NO
        _named(name, lambda: rclpy.init(args=[name, *argv], signal_handler_options=options))
        for cls, values in zip(classes, values_by_class, strict=True):
            nodes.append(_named(cls.SPEC.name, partial(cls, values)))
            nodes[-1].asked_to_end = lambda: ending.asked
        code = _spin(nodes, ending)
    except _Failed as error:
        complain(error.name, str(error))
        code = error.code
    except (KeyboardInterrupt, ExternalShutdownException):
        code = 0
    except Exception as error:
        complain(name, f"failed in flight: {type(error).__name__}: {error}")
    finally:
        _end(nodes, code)
        if ending is not None:
            ending.close()
    return code


NodeCommandLine = tuple[type[ManagedNode], Sequence[str]]
"""Which node a process that stands by becomes, and further words of its command line."""


def stand_by(
    name: str, argv: Sequence[str], wait: Callable[[Callable[[], bool]], NodeCommandLine | None]
) -> int:
    """Take part in the graph without a part, until there is one; then run that node.

    Parameters
    ----------
    name : str
        Of the process.
    argv : sequence of str
        Command line without the program name, the same for all nodes.
    wait : callable
        Gets whether the process was asked to end; returns the order, or None for no node.

    Returns
    -------
    int
        As `run`.
    """
    nodes: list[ManagedNode] = []
    ending = standby_node = None
    code = 1
    try:
        ending = Ending()
        options = SignalHandlerOptions.NO
        _named(name, lambda: rclpy.init(args=[name, *argv], signal_handler_options=options))
        standby_node = Node(
            f"{name}_{os.getpid()}", enable_rosout=False, start_parameter_services=False
        )
        order = wait(lambda: ending.asked)
        if order is not None:
            cls, more = order
            name = cls.SPEC.name
            nodes.append(_named(name, partial(cls, _values(cls, [*argv, *more]))))
            nodes[-1].asked_to_end = lambda: ending.asked
        code = _spin(nodes, ending) if nodes else 0
    except _Failed as error:
        complain(error.name, str(error))
        code = error.code
    except Exception as error:
        complain(name, f"failed in flight: {type(error).__name__}: {error}")
    finally:
        _end(nodes, code, *([standby_node] if standby_node is not None else []))
        if ending is not None:
            ending.close()
    return code


def _stand_back() -> None:
    """Have no thread of this process push one of another aside when it wakes up (Linux).

    It has its share of the processors nevertheless. Called before others are started.
    """
    if hasattr(os, "SCHED_BATCH"):
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


def _end(nodes: Sequence[ManagedNode], code: int, *others: Node) -> None:
    """Last words and clean-up, whatever the state is in; no signal disturbs it."""
    for node in nodes:
        _attempt(node.end)
    with exit_within(code):
        for left in (*others, *nodes):
            _attempt(left.destroy_node)
        _attempt(rclpy.try_shutdown)


def _attempt(action: Callable[[], Any]) -> None:
    try:
        action()
    except Exception as error:
        complain("shutdown", f"{type(error).__name__}: {error}")
