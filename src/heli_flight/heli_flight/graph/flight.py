# SPDX-License-Identifier: Apache-2.0
"""A flight of the real graph: processes over DDS, brought up in order, recorded, scored."""

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import rclpy
from lifecycle_msgs.msg import Transition
from rclpy.signals import SignalHandlerOptions

from heli_flight.errors import FlightError, StartError
from heli_flight.graph.bag_record import BagFlight
from heli_flight.graph.live import LiveView
from heli_flight.graph.live_up import bring_up_live, wait_for_viewer
from heli_flight.graph.outcome import outcome
from heli_flight.graph.parameters import of_graph, refuse_unscorable
from heli_flight.graph.plant_truth import TRUTH_SUMS
from heli_flight.graph.process_faults import ProcessFaults
from heli_flight.graph.processes import NodeProcess, stop, why_ended
from heli_flight.graph.programs import programs
from heli_flight.graph.respawn import AGAIN, Respawn
from heli_flight.graph.ros_session import prepare_environment
from heli_flight.graph.running import running
from heli_flight.graph.shared_memory import remove_left
from heli_flight.graph.supervisor import BringUpError, NodeStatus, Supervisor
from heli_flight.loop.layers import NODES
from heli_flight.loop.process_fault import process_faults_of
from heli_flight.loop.result import Result
from heli_flight.loop.settings import Settings
from heli_live_view.access import TOKEN_VARIABLE
from heli_live_view.parameter_table import NODE_NAME as LIVE
from heli_live_view.parameter_table import SHOWN_TO_THE_END
from heli_math.ticks import stamp_at
from heli_msgs_bridge import sums
from heli_msgs_bridge.managed_node import INACTIVE
from heli_msgs_bridge.peers import READY_LIMIT_S
from heli_parameters.parameters import dump_all

_APPEAR_LIMIT_S = 30.0
_TRANSITION_LIMIT_S = 60.0
# Configuration that takes longer is said to compile.
_TELL_AFTER_S = 10.0
# A participant with the defaults of Fast DDS announces itself every 3 s; whom we have not heard by
# then may send, and be heard by our nodes. Measured: half of them are heard at once.
_HEARD_ALL_S = 4.0
# Wall time without any sign of life from the plant after which the flight is given up.
_SILENCE_LIMIT_S = 30.0
_BAG_LIMIT_S = 10.0
# How long the end of a flight waits for the live view to have shown it, and for last words.
_END_LIMIT_S = 10.0


class Graph:
    """The processes of one flight and the supervisor's node.

    Parameters
    ----------
    settings : Settings
    folder : Path
        The flight's folder.
    live : LiveView, optional
        Brought up first, so that a port in use ends all before the flight.
    say : callable
        Takes a line for the user.
    namespace : str
        Of an aircraft that is not alone: its clock is then that of its world.
    composed : bool
        Whether the nodes of the loop are in one process.
    respawn : bool
        Whether nodes that die in flight are started again.

    Attributes
    ----------
    beside : list of callable
        Checks of what else must live, such as the other aircraft.
    company : bool
        Whether others may be in the ROS domain; they are waited for, to be heard.
    """

    def __init__(
        self,
        settings: Settings,
        folder: Path,
        live: LiveView | None = None,
        say: Callable[[str], None] = print,
        namespace: str = "",
        composed: bool = False,
        respawn: bool = False,
    ):
        self.namespace, self.composed = namespace, composed
        self._respawn = Respawn(folder, say) if respawn else None
        self._faults: ProcessFaults | None = None
        self._flies = False
        self.beside: list[Callable[[], None]] = []
        self.company = True
        self._joined_s = 0.0
        self._began_ros = False
        self.settings, self.folder, self.live, self.say = settings, folder, live, say
        self.processes: dict[str, NodeProcess] = {}
        self._nodes: dict[str, Sequence[str]] = {}
        self.supervisor: Supervisor | None = None
        self.interrupted = False
        self.watched = False

    def start(self) -> None:
        """Start the recorder and the nodes.

        Raises
        ------
        MissingFileError
            An executable is not installed; nothing has been started then.
        ParameterError
            The recorder would leave out what the flight is scored by.
        """
        refuse_unscorable(self.settings)
        started = programs(self.composed, live=self.live is not None)
        (logs := self.folder / "logs").mkdir()
        prepare_environment()
        env = {**os.environ, **(self._respawn.environment() if self._respawn else {})}
        parameters = logs.parent / "graph.yaml"
        dump_all(of_graph(self.settings, self.folder, self.live, self.namespace), parameters)
        arguments = ["--ros-args", "--params-file", str(parameters)]
        if self.namespace:
            arguments += ["-r", f"__ns:=/{self.namespace}"]
        self._join()
        for program in started:
            name, log = program.name, logs / f"{program.name}.log"
            own = {TOKEN_VARIABLE: self.live.token} if self.live and name == LIVE else {}
            if "plant" in program.nodes:
                own[sums.VARIABLE] = str((self.folder / TRUTH_SUMS).absolute())
            self.processes[name] = NodeProcess(name, program.module, arguments, log, env | own)
            self._nodes[name] = program.nodes
        if self._respawn:
            self._respawn.stand_by(arguments, env)

    def _join(self) -> None:
        """Make the supervisor's node, before all others.

        Fast DDS announces a participant at once only to the first few of a machine; who comes
        later is heard after 3 s. The supervisor must hear all.
        """
        try:
            if not rclpy.ok():
                self._began_ros = True
                rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
            names = [*(node.name for node in NODES), "recorder", *([LIVE] if self.live else [])]
            self.supervisor = Supervisor(names, self.namespace)
            self._joined_s = time.monotonic()
        except Exception as error:
            first = (str(error).strip().splitlines() or [type(error).__name__])[0]
            raise StartError(f"ROS 2 cannot start: {first}") from error

    def check(self) -> None:
        """Raise FlightError if a process has ended that should run, KeyboardInterrupt on Ctrl-C."""
        self.check_own()
        for check in self.beside:
            check()

    def check_own(self) -> None:
        """The same for this aircraft alone."""
        if self.interrupted:
            raise KeyboardInterrupt
        for name, process in list(self.processes.items()):
            if process.exit_code() is None:
                continue
            why = why_ended(process, self._nodes[name])
            if self._flies and self._respawn and name in AGAIN and self.supervisor:
                self.processes[name] = self._respawn.again(name, why, self.supervisor)
                continue
            if name != LIVE or not self.watched:
                raise FlightError(self._own(why))
            # A flight does not end because nobody can watch it any more.
            del self.processes[name]
            self.say(f"live view ended: {why}")

    def bring_up(self) -> None:
        """Configure all nodes, publish the reference, activate in order; the plant comes last.

        Raises
        ------
        StartError
            Names the node and what it said.
        """
        self.prepare()
        self.activate()

    def prepare(self) -> None:
        """Configure all nodes, publish the reference; raises as `bring_up`."""
        self._attempt(self._prepare)

    def activate(self) -> None:
        """Activate all, the plant last; raises as `bring_up`."""
        self._attempt(self._activate)

    def _attempt(self, step: Callable[[Supervisor], None]) -> None:
        assert self.supervisor is not None
        try:
            step(self.supervisor)
        except BringUpError as error:
            raise StartError(self._own(self._with_reason(str(error)))) from error
        except FlightError as error:
            raise StartError(str(error)) from error

    def _prepare(self, up: Supervisor) -> None:
        up.wait_for_services(_APPEAR_LIMIT_S, self.check)
        up.refuse_doubles()
        up.refuse_strangers(self.check)
        if self.live is not None:
            bring_up_live(up, self.live, self.say, self.check)
            self.watched = True
        self._configure(up, [node.name for node in NODES])
        if self.company:
            left_s = self._joined_s + _HEARD_ALL_S - time.monotonic()
            up.wait_until(lambda: False, max(left_s, 0.0), self.check)
            up.refuse_doubles()
            up.refuse_strangers(self.check)
        if self.live is not None:
            wait_for_viewer(up, self.live, self.say, self.check)
        start_ns = stamp_at(self.settings.nodes["plant"]["start_time_s"])
        up.publish_reference(self.settings.scenario, start_ns)

    def _activate(self, up: Supervisor) -> None:
        activate, limit = Transition.TRANSITION_ACTIVATE, _TRANSITION_LIMIT_S
        up.transition(["observer", "inner_loop", "outer_loop"], activate, limit, self.check)
        up.transition(["plant"], activate, limit, self.check)

    def _configure(self, up: Supervisor, names: Sequence[str]) -> None:
        """Configure nodes; where the kernels are not in the cache, they compile for minutes."""
        begun_s, told = time.monotonic(), False

        def check() -> None:
            nonlocal told
            self.check()
            if not told and time.monotonic() - begun_s > _TELL_AFTER_S:
                told = True
                self.say("the nodes compile their kernels: once, a minute or two ...")

        up.transition(names, Transition.TRANSITION_CONFIGURE, READY_LIMIT_S, check)

    def _with_reason(self, sentence: str) -> str:
        """The node's own words, where it has said why it refused."""
        name = sentence.split(":", 1)[0].split(",", 1)[0]
        status = self.supervisor.statuses.get(name) if self.supervisor else None
        if status is not None and status.level > 0:
            return f"{name}: {status.message}"
        return sentence

    def _own(self, sentence: str) -> str:
        """The sentence with the aircraft's name in front, where others fly beside it."""
        return f"{self.namespace}: {sentence}" if self.namespace else sentence

    def fly(self, progress: Callable[[float], None]) -> None:
        """Wait until the plant has flown its last tick; raise FlightError on silence or death."""
        up = self.supervisor
        assert up is not None
        start_s = self.settings.nodes["plant"]["start_time_s"]
        seen, seen_at = -1.0, time.monotonic()

        def over() -> bool:
            nonlocal seen, seen_at
            status = up.statuses.get("plant")
            paused = status is not None and status.message == INACTIVE
            if status is not None and (paused or status.time_s != seen):
                seen, seen_at = status.time_s, time.monotonic()
                progress(max(0.0, seen - start_s))
            return status is not None and status.facts.get("over") == "true"

        def alive() -> None:
            self.check()
            if self._faults:
                self._faults.look(up.flight_s())
            if self._respawn:
                self._respawn.look(up)
            if time.monotonic() - seen_at > _SILENCE_LIMIT_S:
                silent = f"the plant has been silent for {_SILENCE_LIMIT_S:g} s"
                raise FlightError(self._own(silent))

        faults = process_faults_of(self.settings.process_faults)
        if self._respawn or faults:
            up.watch_time(stamp_at(start_s))
        if faults:
            log = self.folder / "logs" / "hog.log"
            self._faults = ProcessFaults(faults, self.processes, log, self.say)
        self._flies = True
        while not up.wait_until(over, 1.0, alive):
            continue
        self._flies = False
        if self._faults:
            self._faults.undo()
        if LIVE in self.processes:
            up.wait_until(
                lambda: up.statuses[LIVE].message == SHOWN_TO_THE_END, _END_LIMIT_S, alive
            )
        up.close_bag(_BAG_LIMIT_S)
        up.name_senders(lambda: None)

    def told(
        self, result: Result, extra: Mapping[str, Any], flight: BagFlight
    ) -> tuple[Result, Mapping[str, Any], BagFlight]:
        """An outcome with what became of the processes in flight."""
        more: dict[str, Any] = {}
        if self._respawn:
            notes = (*self._respawn.words(), *result.notes)
            result, more["restarts"] = replace(result, notes=notes), self._respawn.as_dicts()
        if self._faults:
            more["process_faults_done"] = self._faults.as_dicts()
        return result, {**extra, **more}, flight

    def close(self) -> list[str]:
        """End everything; returns the names of processes that had to be killed."""
        if self._faults:
            self._faults.undo()
        nodes = [p for name, p in self.processes.items() if name != "recorder"]
        died = [p for p in self.processes.values() if (p.exit_code() or 0) < 0]
        killed = stop(nodes)
        if "recorder" in self.processes:
            # Last, so that it hears everything; it writes its index before it ends.
            killed += stop([self.processes["recorder"]], limit_s=_BAG_LIMIT_S)
        if self._respawn:
            killed += self._respawn.close()
        if self.supervisor is not None:
            self.supervisor.close()
            self.supervisor = None
        if self._began_ros and rclpy.ok():
            rclpy.shutdown()
        if killed or died or self._respawn:
            remove_left()
        return killed


def fly_graph(
    settings: Settings,
    folder: Path,
    progress: Callable[[float], None],
    live: LiveView | None = None,
    say: Callable[[str], None] = print,
    composed: bool = False,
    respawn: bool = False,
) -> tuple[Result, Mapping[str, Any], BagFlight]:
    """Fly a scenario with the real graph.

    Parameters
    ----------
    settings : Settings
    folder : Path
        The flight's folder; gets bag/, logs/ and graph.yaml.
    progress : callable
        Called with the flight time (s).
    live : LiveView, optional
        Shows the flight.
    say : callable
        Takes a line for the user.
    composed : bool
        Whether the nodes of the loop are in one process.
    respawn : bool
        Whether nodes that die in flight are started again.

    Returns
    -------
    Result, dict, BagFlight
        The outcome, what result.json holds beside it, and the bag's content.

    Raises
    ------
    FlightError, MissingFileError
        The graph could not be brought up or kept up.
    """
    begun = time.monotonic()
    graph = Graph(settings, folder, live, say, composed=composed, respawn=respawn)
    with running(graph):
        graph.start()
        graph.bring_up()
        up = time.monotonic()
        graph.fly(progress)
        said = ended(graph)
    found = outcome(settings, folder, *said, round(up - begun, 3), composed=composed)
    return graph.told(*found)


def ended(graph: Graph) -> tuple[Mapping[str, NodeStatus], list[str]]:
    """End a graph; returns what its nodes said last, and who had to be killed."""
    statuses = dict(graph.supervisor.statuses) if graph.supervisor else {}
    if graph.live is not None and LIVE in statuses:
        graph.live.told.update(statuses[LIVE].facts)
    return statuses, graph.close()
