# SPDX-License-Identifier: Apache-2.0
"""A flight of the real graph: processes over DDS, brought up in order, recorded, scored."""

import contextlib
import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import rclpy
from lifecycle_msgs.msg import Transition
from rclpy.signals import SignalHandlerOptions

from heli_bags.parameters import NODE_NAME as RECORDER
from heli_bags.parameters import unrecorded
from heli_core.command_line import executable
from heli_core.errors import FlightError, StartError
from heli_core.rcl_yaml import ParameterError, dump_all
from heli_core.ticks import stamp_at
from heli_flight.flight_file import custom_data
from heli_flight.graph.bag_record import (
    TRUTH_SUMS,
    BagFlight,
    flight_from_bag,
    foreign_truth,
    lost_with_law,
)
from heli_flight.graph.lifecycle import BringUpError, NodeStatus
from heli_flight.graph.live import MODULE, LiveView, addresses, viewers
from heli_flight.graph.nodes import prepare_environment
from heli_flight.graph.processes import (
    DISCOVERY,
    DOMAIN,
    NodeProcess,
    domain_reserved,
    end_tracer,
    others_in,
    stop,
    why_ended,
)
from heli_flight.graph.respawn import AGAIN, Respawn, remove_left
from heli_flight.graph.supervisor import DEAF, Supervisor
from heli_flight.layers import LOCKSTEP, NODES, REAL_TIME
from heli_flight.process_faults import HOG, KILL, ProcessFault, process_faults_of
from heli_flight.result import Result
from heli_flight.scenario import NODE_NAME as SCENARIO
from heli_flight.scoring import score
from heli_flight.settings import Settings
from heli_live_view.access import TOKEN_VARIABLE
from heli_live_view.parameters import NODE_NAME as LIVE
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import FACT_FLOOD, FACT_LAW_FAILED, NodeState
from heli_msgs_bridge.peers import READY_LIMIT_S
from heli_msgs_bridge.signatures import KEY_VARIABLE, SUMS_VARIABLE, flight_key
from heli_msgs_bridge.sources import SENDERS

# -------------------------------------------------------------------------------------------------
# The ROS domain and the Ctrl-C of graphs that fly together.
# -------------------------------------------------------------------------------------------------

_HERE = "LOCALHOST"


@contextmanager
def running(*graphs: "Graph") -> Iterator[None]:
    """Hold a ROS domain and Ctrl-C for graphs that fly together; nothing of them stays."""
    chosen = not os.environ.get(DOMAIN, "").strip()

    def on_interrupt(*_: Any) -> None:
        # Remembered only; raised inside rclpy it would come out as something else.
        for graph in graphs:
            graph.interrupted = True

    with domain_reserved() as domain:
        if chosen and domain:
            graphs[0].say(
                f"flying in ROS domain {domain}: to listen in, {DOMAIN}={domain} ./heli topics"
            )
        reach = os.environ.get(DISCOVERY, "").strip() or _HERE
        on_this_machine = reach == _HERE
        if not on_this_machine:
            graphs[0].say(
                f"flying in ROS domain {domain} with {DISCOVERY}={reach}, as it is set: other "
                "machines may listen and send"
            )
        company = not on_this_machine or others_in(domain)
        for graph in graphs:
            graph.company = company
        before = signal.signal(signal.SIGINT, on_interrupt)
        try:
            yield
        finally:
            # The first has begun ROS, and ends it.
            for graph in reversed(graphs):
                graph.close()
            interrupted = graphs[0].interrupted
            signal.signal(signal.SIGINT, signal.SIG_IGN if interrupted else before)
    if interrupted:
        raise KeyboardInterrupt


# -------------------------------------------------------------------------------------------------
# What came of a flight of the graph: from its bag, and from what its nodes said.
# -------------------------------------------------------------------------------------------------


def _notes(statuses: Mapping[str, Any]) -> Sequence[str]:
    """What nodes complained of at the end, and whether somebody commanded."""
    live = statuses.get(LIVE)
    commands = live.facts.get("commands", "0") if live is not None else "0"
    faults = statuses["plant"].facts.get("faults_in_flight", "") if "plant" in statuses else ""
    commanded = [f"commands given in flight: {commands}; it is not the scenario alone"]
    rivals = [
        f"{name}: {value}" if key != FACT_FLOOD else f"{name}: requests refused: {value}"
        for name, status in sorted(statuses.items())
        for key, value in status.facts.items()
        if key.startswith(SENDERS) or key == FACT_FLOOD
    ]
    complaints = [
        f"{name}: {status.message}"
        for name, status in sorted(statuses.items())
        if status.level > 0 and name != "plant" and FACT_LAW_FAILED not in status.facts
    ]
    broken = [f"faults given in flight: {faults}"] if faults else []
    return [*(commanded if commands != "0" else []), *broken, *rivals, *complaints]


def outcome(
    settings: Settings,
    folder: Path,
    statuses: Mapping[str, NodeStatus],
    killed: Sequence[str],
    start_up_s: float,
    aircraft: str = "",
    composed: bool = False,
) -> tuple[Result, Mapping[str, Any], BagFlight]:
    """The result of a flight that is over.

    Parameters
    ----------
    settings : Settings
    folder : Path
        Holds bag/.
    statuses : mapping
        What each node said last.
    killed : sequence of str
        Who had to be killed.
    start_up_s : float
        Wall time from the start to the first tick.
    aircraft : str
        Its namespace, if others fly beside it.
    composed : bool
        Whether the nodes of the loop were in one process.

    Returns
    -------
    Result, dict, BagFlight
        As `fly_graph`.
    """
    flight = flight_from_bag(folder / "bag", settings)
    record = flight.record
    plant = statuses.get("plant")
    # The plant's own clock: without start-up, and without the recorder's finishing.
    wall = float(plant.facts.get("wall_s", "nan")) if plant is not None else float("nan")
    plant_error = plant.message if plant is not None and plant.level > 1 else ""
    facts = (*(s.facts for _, s in sorted(statuses.items())), *(r.facts for r in flight.remarks))
    lost = lost_with_law(plant_error, facts)
    notes = [*_notes(statuses), *(f"{name} had to be killed" for name in killed)]
    missing = settings.rate.of(settings.scenario.n_ticks) - len(record)
    if missing > 0 and not plant_error:
        notes.append(f"the bag lacks {missing} ticks of ground truth")
    scores = score(record, settings.scenario, settings.rate)
    flown_s = settings.rate.seconds(len(record))
    forged = foreign_truth(flight, folder / TRUTH_SUMS, settings.rate)
    recorder = statuses.get("recorder")
    unheard = recorder.facts.get(DEAF, "") if recorder is not None else ""
    result = Result(scores, lost, flown_s, wall, tuple(notes), aircraft, forged, unheard)
    mode = LOCKSTEP if settings.nodes["plant"]["lockstep"] else REAL_TIME
    return result, {"mode": mode, "composed": composed, "start_up_s": start_up_s}, flight


# -------------------------------------------------------------------------------------------------
# What the processes of a supervised flight are given: its parameters, and that somebody leads.
# -------------------------------------------------------------------------------------------------


def _left_out(settings: Settings) -> tuple[str, ...]:
    return unrecorded(settings.recorder["topics"], settings.recorder["exclude"])


def refuse_unscorable(settings: Settings) -> None:
    """Raise ParameterError if the recorder is to leave out what a flight is scored by."""
    left = _left_out(settings)
    scored = (topics.TRUTH_ODOM, topics.ODOM, topics.REFERENCE, topics.ATTITUDE_SETPOINT)
    lacking = [name for name in scored if name in left]
    if lacking:
        raise ParameterError(f"recorder: leaves out {', '.join(lacking)}: a flight is scored by it")


def of_graph(
    settings: Settings, folder: Path, live: LiveView | None, namespace: str
) -> dict[str, Mapping[str, Any]]:
    """Parameters of each node of a flight.

    Parameters
    ----------
    settings : Settings
    folder : Path
        The flight's folder; gets the bag.
    live : LiveView, optional
    namespace : str
        Of an aircraft that is not alone: its clock is then that of its world.
    """
    peers = (*(node.name for node in NODES), RECORDER, SCENARIO)
    led: dict[str, Mapping[str, Any]] = {
        name: {**values, "autostart": False, "peers": peers, "unrecorded": _left_out(settings)}
        for name, values in settings.nodes.items()
    }
    if namespace:
        led["plant"] = {**led["plant"], "clock": "world"}
    led["inner_loop"] = {**led["inner_loop"], "expects_outer": True}
    bag = str((folder / "bag").absolute())
    bag_metadata = (*settings.recorder["custom_data"], *custom_data(settings))
    led[RECORDER] = {**settings.recorder, "bag": bag, "custom_data": bag_metadata}
    if live:
        led[LIVE] = {**live.parameters, "autostart": False, "peers": peers}
    return led


# -------------------------------------------------------------------------------------------------
# Brings up a flight's live view, says where to look, and waits for who wants to see the start.
# -------------------------------------------------------------------------------------------------

_LIMIT_S = 60.0


def _facts(up: Supervisor) -> Mapping[str, str]:
    status = up.statuses.get(LIVE)
    return status.facts if status else {}


def bring_up_live(
    up: Supervisor, live: LiveView, say: Callable[[str], None], check: Callable[[], None]
) -> None:
    """Serve before anything flies, and say where.

    Raises
    ------
    BringUpError
        The view refused, or does not say where it serves.
    """
    for step in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
        up.transition([LIVE], step, _LIMIT_S, check)
    if not up.wait_until(lambda: "page" in _facts(up), _LIMIT_S, check):
        raise BringUpError(f"{LIVE}: has not said where the page is", LIVE)
    for line in addresses(_facts(up), live):
        say(line)


def wait_for_viewer(
    up: Supervisor, live: LiveView, say: Callable[[str], None], check: Callable[[], None]
) -> None:
    """Wait for the first browser, if that was asked for, up to the parameter's limit."""
    if not live.wait or viewers(_facts(up)):
        return
    limit_s = live.parameters["viewer_limit_s"]
    say(f"waiting for a browser, at most {limit_s:g} s (viewer_limit_s); Ctrl-C ends it")
    if up.wait_until(lambda: viewers(_facts(up)) > 0, limit_s, check):
        say("a browser looks: the flight begins")
    else:
        say(f"no browser has come within {limit_s:g} s: the flight begins")


# -------------------------------------------------------------------------------------------------
# Which processes a flight has, and what runs in each.
# -------------------------------------------------------------------------------------------------

COMPOSED = "composed"
"""Name of the process that holds all nodes of the loop."""


@dataclass(frozen=True)
class Program:
    """A process of a flight.

    Attributes
    ----------
    name : str
        Of the process and its log: that of its node, or COMPOSED.
    module : str
        Python module whose `main(arguments)` it runs.
    nodes : tuple of str
        The nodes in it.
    """

    name: str
    module: str
    nodes: tuple[str, ...]


def programs(composed: bool, live: bool) -> list[Program]:
    """The processes of a flight, in the order in which they are started.

    Parameters
    ----------
    composed : bool
        Whether the nodes of the loop are in one process; the recorder has one of its own.
    live : bool
        Whether the live view is among them.

    Raises
    ------
    MissingFileError
        The executable of a node is not installed.
    """
    beside_loop = [("recorder", "heli_bags", "recorder")]
    beside_loop += [(LIVE, "heli_live_view", LIVE)] if live else []
    loop = [(node.name, node.package, node.executable) for node in NODES]
    for _, package, program in (*beside_loop, *loop):
        executable(package, program)
    modules = {name: f"{package}.node" for name, package, _ in (*beside_loop, *loop)} | {
        LIVE: MODULE
    }
    alone = beside_loop if composed else [*beside_loop, *loop]
    started = [Program(name, modules[name], (name,)) for name, _, _ in alone]
    if composed:
        names = tuple(node.name for node in NODES)
        started.append(Program(COMPOSED, "heli_flight.graph.composed", names))
    return started


# -------------------------------------------------------------------------------------------------
# Faults of processes, done in flight and undone at its end.
# -------------------------------------------------------------------------------------------------

RECORDER_PROCESS = "recorder"
# Wall time after which a flight that does not go on is taken to wait for a recorder that is paused.
_STANDS_S = 1.0
# Long enough for a thread to leave a lock, and short beside what a pause is for.
_STEP_S = 0.02


class ProcessFaults:
    """Kills, pauses and hogs of a flight, by its time.

    Parameters
    ----------
    faults : sequence of ProcessFault
    processes : mapping
        The flight's, by name; looked at anew each time.
    log : Path
        Gets what busy processes write.
    say : callable
        Takes a line for the user.
    now_s, wait : callable, optional
        Wall time, s, and how to let some of it pass.

    Attributes
    ----------
    done : list of (ProcessFault, float)
        What was begun, and at which flight time, s.
    """

    def __init__(
        self,
        faults: Sequence[ProcessFault],
        processes: Mapping[str, NodeProcess],
        log: Path,
        say: Callable[[str], None],
        now_s: Callable[[], float] = time.monotonic,
        wait: Callable[[float], None] = time.sleep,
    ) -> None:
        self._left = sorted(faults, key=lambda fault: fault.start_s)
        self._processes, self._log, self._say = processes, log, say
        self._now_s, self._wait = now_s, wait
        self._moved = (-1.0, now_s())
        self._paused: list[tuple[float, int, str]] = []
        self._killed: set[int] = set()
        self._busy: list[tuple[float, list[NodeProcess]]] = []
        self.done: list[tuple[ProcessFault, float]] = []

    def look(self, flight_s: float) -> None:
        """Begin and end what is due; what is due of a node that is dead waits for its successor."""
        for fault in [fault for fault in self._left if fault.start_s <= flight_s]:
            if not self._is_there(fault):
                continue
            self._left.remove(fault)
            self._begin(fault, fault.duration_s + flight_s)
            self.done.append((fault, flight_s))
            self._say(f"fault: {fault.words}")
        self._end(lambda end_s: end_s <= flight_s)
        self._let_out_of_locks(flight_s)

    def _let_out_of_locks(self, flight_s: float) -> None:
        """Let a paused recorder run for a moment where the flight stands still meanwhile.

        Nobody waits for it, unless it was stopped within a lock of the shared memory that senders
        want: a flight that stands still does not come to the end of the pause either.
        """
        now_s = self._now_s()
        if flight_s != self._moved[0]:
            self._moved = flight_s, now_s
        held = [pid for _, pid, node in self._paused if node == RECORDER_PROCESS]
        if not held or now_s - self._moved[1] < _STANDS_S:
            return
        self._moved = flight_s, now_s
        for pid in held:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)
                self._wait(_STEP_S)
                os.kill(pid, signal.SIGSTOP)

    def _is_there(self, fault: ProcessFault) -> bool:
        """Whether it can be done: in lockstep two kills may be due before the first is noticed."""
        process = self._processes.get(fault.node)
        return process is None or (process.exit_code() is None and process.pid not in self._killed)

    def _begin(self, fault: ProcessFault, end_s: float) -> None:
        if fault.kind == HOG:
            module = "heli_flight.graph.hog"
            self._busy.append(
                (end_s, [NodeProcess("hog", module, [], self._log, {}) for _ in range(fault.hogs)])
            )
            return
        process = self._processes.get(fault.node)
        if process is None:
            return
        number = signal.SIGKILL if fault.kind == KILL else signal.SIGSTOP
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, number)
        if fault.kind == KILL:
            self._killed.add(process.pid)
        else:
            self._paused.append((end_s, process.pid, fault.node))

    def _end(self, is_over: Callable[[float], bool]) -> None:
        for entry in [entry for entry in self._paused if is_over(entry[0])]:
            self._paused.remove(entry)
            with contextlib.suppress(ProcessLookupError):
                os.kill(entry[1], signal.SIGCONT)
        for busy in [busy for busy in self._busy if is_over(busy[0])]:
            self._busy.remove(busy)
            for process in busy[1]:
                process.kill()

    def undo(self) -> None:
        """End all of it: nobody stays stopped, nothing stays busy."""
        self._left.clear()
        self._end(lambda end_s: True)

    def as_dicts(self) -> list[dict[str, Any]]:
        """As JSON has it: each that was begun, with the flight time at which it was."""
        return [{**fault.as_dict(), "begun_s": round(at_s, 3)} for fault, at_s in self.done]


# -------------------------------------------------------------------------------------------------
# Flight.
# -------------------------------------------------------------------------------------------------

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
    key : Path, optional
        File with the key that the nodes sign their messages with.

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
        key: Path | None = None,
    ):
        self._key = key
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
        env |= _key_environment(self._key)
        parameters = logs.parent / "graph.yaml"
        dump_all(of_graph(self.settings, self.folder, self.live, self.namespace), parameters)
        arguments = ["--ros-args", "--params-file", str(parameters)]
        if self.namespace:
            arguments += ["-r", f"__ns:=/{self.namespace}"]
        self._join()
        for program in started:
            name, log = program.name, logs / f"{program.name}.log"
            extra_env = {TOKEN_VARIABLE: self.live.token} if self.live and name == LIVE else {}
            if "plant" in program.nodes:
                extra_env[SUMS_VARIABLE] = str((self.folder / TRUTH_SUMS).absolute())
            self.processes[name] = NodeProcess(
                name, program.module, arguments, log, env | extra_env
            )
            self._nodes[name] = program.nodes
        if self._respawn:
            self._respawn.stand_by(arguments, env)

    def _join(self) -> None:
        """Make the supervisor's node, before all others.

        Fast DDS announces a participant at once only to the first few of a machine; who comes
        later is heard after 3 s. The supervisor must hear all.
        """
        end_tracer()
        try:
            if not rclpy.ok():
                self._began_ros = True
                rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
            names = [*(node.name for node in NODES), "recorder", *([LIVE] if self.live else [])]
            self.supervisor = Supervisor(names, self.namespace, key=self._key)
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
                raise FlightError(self._with_namespace(why))
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
            raise StartError(self._with_namespace(self._with_reason(error))) from error
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
        for names in (["observer", "inner_loop", "outer_loop"], ["plant"]):
            up.transition(names, Transition.TRANSITION_ACTIVATE, _TRANSITION_LIMIT_S, self.check)
            up.wait_for_peers(names, _TRANSITION_LIMIT_S, self.check)

    def _configure(self, up: Supervisor, names: Sequence[str]) -> None:
        """Configure nodes; where the kernels are not in the cache, they compile for minutes."""
        begun_s, announced = time.monotonic(), False

        def check() -> None:
            nonlocal announced
            self.check()
            if not announced and time.monotonic() - begun_s > _TELL_AFTER_S:
                announced = True
                self.say("the nodes compile their kernels: once, a minute or two ...")

        up.transition(names, Transition.TRANSITION_CONFIGURE, READY_LIMIT_S, check)

    def _with_reason(self, error: BringUpError) -> str:
        """The node's own words, where it has said why it refused."""
        status = self.supervisor.statuses.get(error.node) if self.supervisor else None
        if status is not None and status.level > 0:
            return f"{error.node}: {status.message}"
        return str(error)

    def _with_namespace(self, sentence: str) -> str:
        """The sentence with the aircraft's name in front, where others fly beside it."""
        return f"{self.namespace}: {sentence}" if self.namespace else sentence

    def fly(self, progress: Callable[[float], None]) -> None:
        """Wait until the plant has flown its last tick; raise FlightError on silence or death."""
        up = self.supervisor
        assert up is not None
        start_s = self.settings.nodes["plant"]["start_time_s"]
        plant_time_s, heard_at_s = -1.0, time.monotonic()

        def over() -> bool:
            nonlocal plant_time_s, heard_at_s
            status = up.statuses.get("plant")
            paused = status is not None and status.state == NodeState.INACTIVE
            if status is not None and (paused or status.time_s != plant_time_s):
                plant_time_s, heard_at_s = status.time_s, time.monotonic()
                progress(max(0.0, plant_time_s - start_s))
            return status is not None and status.facts.get("over") == "true"

        def alive() -> None:
            self.check()
            if self._faults:
                self._faults.look(up.flight_s())
            if self._respawn:
                self._respawn.look(up)
            if time.monotonic() - heard_at_s > _SILENCE_LIMIT_S:
                silent = f"the plant has been silent for {_SILENCE_LIMIT_S:g} s"
                raise FlightError(self._with_namespace(silent))

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
                lambda: up.statuses[LIVE].state == NodeState.FINISHED, _END_LIMIT_S, alive
            )
        up.close_bag(_BAG_LIMIT_S)
        up.name_senders(lambda: None)

    def with_process_events(
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
        # Of processes that died, or could not leave DDS; and of earlier flights'.
        remove_left()
        return killed


_KEY = "graph.key"


def _key_environment(key: Path | None) -> dict[str, str]:
    """What a process of the flight needs to sign its messages."""
    return {} if key is None else {KEY_VARIABLE: str(key.absolute())}


def _say_unsigned(key: Path | None, say: Callable[[str], None]) -> None:
    if key is None:
        say("the flight's folder knows no rights of users: the nodes do not sign their messages")


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
    with flight_key(folder / _KEY) as key:
        _say_unsigned(key, say)
        graph = Graph(settings, folder, live, say, composed=composed, respawn=respawn, key=key)
        end, up = _flown(graph, progress)
    flown = outcome(settings, folder, *end, round(up - begun, 3), composed=composed)
    return graph.with_process_events(*flown)


def _flown(
    graph: Graph, progress: Callable[[float], None]
) -> tuple[tuple[Mapping[str, NodeStatus], list[str]], float]:
    """Fly a graph from its start to its end; what `ended` gives, and when it was up."""
    with running(graph):
        graph.start()
        graph.bring_up()
        up = time.monotonic()
        graph.fly(progress)
        return ended(graph), up


def ended(graph: Graph) -> tuple[Mapping[str, NodeStatus], list[str]]:
    """End a graph; returns what its nodes said last, and who had to be killed."""
    statuses = dict(graph.supervisor.statuses) if graph.supervisor else {}
    if graph.live is not None and LIVE in statuses:
        graph.live.facts.update(statuses[LIVE].facts)
    return statuses, graph.close()


# -------------------------------------------------------------------------------------------------
# A flight of several aircraft in one ROS domain: a graph each, and the clock of their world.
# -------------------------------------------------------------------------------------------------

_CLOCK = "world_clock"


def _start_clock(names: Sequence[str], folder: Path, key: Path | None) -> NodeProcess:
    arguments = ["--ros-args", "-p", f"aircraft:=[{', '.join(names)}]"]
    module = "heli_flight.graph.world_clock_node"
    env = {**os.environ, **_key_environment(key)}
    return NodeProcess(_CLOCK, module, arguments, folder / f"{_CLOCK}.log", env)


def fly_several(
    settings: Mapping[str, Settings],
    folder: Path,
    progress: Callable[[float], None],
    say: Callable[[str], None] = print,
    composed: bool = False,
) -> dict[str, tuple[Result, Mapping[str, Any], BagFlight]]:
    """Fly aircraft side by side with the real graph.

    Parameters
    ----------
    settings : mapping
        Namespace of each aircraft to what it flies.
    folder : Path
        Gets the clock's log; in it a folder per aircraft, which must exist.
    progress : callable
        Called with the flight time (s).
    say : callable
        Takes a line for the user.
    composed : bool
        Whether each aircraft's nodes are in one process.

    Returns
    -------
    dict
        Per aircraft as `fly_graph`.

    Raises
    ------
    FlightError, MissingFileError
        A graph could not be brought up or kept up.
    """
    begun = time.monotonic()
    with ExitStack() as until_all_have_ended:
        key = until_all_have_ended.enter_context(flight_key(folder / _KEY))
        _say_unsigned(key, say)
        graphs = {
            n: Graph(its_settings, folder / n, None, say, n, composed, key=key)
            for n, its_settings in settings.items()
        }
        first = next(iter(graphs.values()))
        until_all_have_ended.enter_context(running(*graphs.values()))
        for graph in graphs.values():
            graph.start()
        clock = _start_clock(list(graphs), folder, key)
        try:
            for graph in graphs.values():
                others = [other.check_own for other in graphs.values() if other is not graph]
                graph.beside = [*others, lambda: _check(clock)]
                graph.prepare()
            for graph in graphs.values():
                graph.activate()
            up = time.monotonic()
            for graph in graphs.values():
                graph.fly(progress if graph is first else lambda flight_s: None)
        finally:
            stop([clock])
        ends = {name: ended(graph) for name, graph in reversed(graphs.items())}
    start_up_s = round(up - begun, 3)
    return {
        n: outcome(its_settings, folder / n, *ends[n], start_up_s, n, composed)
        for n, its_settings in settings.items()
    }


def _check(clock: NodeProcess) -> None:
    """It ends with 0 when all flights are over, and otherwise never."""
    if clock.exit_code():
        raise FlightError(f"{_CLOCK}: {clock.last_line()}")
