# SPDX-License-Identifier: Apache-2.0
"""The process of a node: from the command line to the exit code.

0: it was asked to end or its flight is over, 1: it failed while running or the helicopter was
lost, 2: it could not start (bad parameter, missing peer, no DDS). Every failure is one line on
stderr.
"""

import gc
import signal
import sys
import threading
from collections.abc import Callable, Sequence

import rclpy
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.signals import SignalHandlerOptions

from heli_msgs_bridge.managed_node import ManagedNode
from heli_msgs_bridge.node_spec import StartError
from heli_msgs_bridge.usage import asks_for_help, usage
from heli_parameters import command_line
from heli_parameters.parameters import ParameterError

_SUCCESS = TransitionCallbackReturn.SUCCESS


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


def _start(
    cls: type[ManagedNode], argv: Sequence[str], args: Sequence[str], ending: Ending
) -> ManagedNode:
    """Check parameters, start ROS, make the node; raises StartError or ParameterError."""
    line = command_line.parse(argv, cls.SPEC.name)
    values = cls.SPEC.resolve(line.params_files, line.rules, line.full_name)
    try:
        rclpy.init(args=list(args), signal_handler_options=SignalHandlerOptions.NO)
        node = cls(values)
    except (StartError, ParameterError):
        raise
    except Exception as error:
        first = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise StartError(f"ROS 2 cannot start: {first}") from error
    node.asked_to_end = lambda: ending.asked
    return node


def _spin(node: ManagedNode, ending: Ending) -> int:
    executor = EventsExecutor()
    executor.add_node(node)
    ending.wake_by(executor.wake)
    try:
        return _serve(node, executor)
    finally:
        ending.wake_by(None)
        # It holds the node's parts, which could not be destroyed then.
        executor.shutdown()


# How long Python lets a thread that judges parameters run while the flight waits, s.
_SWITCH_S = 0.0005


def _serve(node: ManagedNode, executor: Executor) -> int:
    if node.values["autostart"]:
        for transition in (node.trigger_configure, node.trigger_activate):
            if transition() != _SUCCESS:
                if node.leaving():
                    return 0
                complain(node.SPEC.name, node.failure)
                return 2
    sys.setswitchinterval(_SWITCH_S)
    gc.collect()
    gc.freeze()
    while not (node.leaving() or node.finished or node.crash is not None):
        executor.spin_once(timeout_sec=0.5)
    if node.crash is not None:
        raise node.crash
    return node.exit_code


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
    node, ending = None, None
    try:
        if asks_for_help(argv):
            sys.stdout.write(usage(cls.SPEC, cls.__doc__ or ""))
            return 0
        ending = Ending()
        node = _start(cls, argv, [name, *argv], ending)
        return _spin(node, ending)
    except (StartError, ParameterError) as error:
        complain(name, str(error))
        return 2
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except Exception as error:
        complain(name, f"failed in flight: {type(error).__name__}: {error}")
        return 1
    finally:
        _end(node)
        if ending is not None:
            ending.close()


def _end(node: ManagedNode | None) -> None:
    """Last words and clean-up, whatever the state is in; no signal disturbs it."""
    try:
        if node is not None:
            node.end()
            node.destroy_node()
        rclpy.try_shutdown()
    except Exception as error:
        complain("shutdown", f"{type(error).__name__}: {error}")
