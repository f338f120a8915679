# SPDX-License-Identifier: Apache-2.0
"""docs/ros.md out of the code's own tables: topics, services, life cycle, parameters.

Usage: python scripts/ros_page.py            write the page
       python scripts/ros_page.py --check    exit code 1 if it is stale
"""

import argparse
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from heli_actions.goals import Kind
from heli_actions.interfaces import PACKAGE, PREFIX
from heli_actions.node import ActionsNode
from heli_bags.node import RecorderNode
from heli_core.parameters import COMMON_TABLE, Parameter
from heli_dynamics_sim.node import PlantNode
from heli_flight.graph.lifecycle_manager_node import LifecycleManagerNode
from heli_flight.graph.scenario_node import ScenarioNode
from heli_flight.graph.world_clock_node import WorldClockNode
from heli_inner_hinf.node import InnerLoopNode
from heli_live_view.node import LiveViewNode
from heli_live_view.state import STATE_HZ
from heli_msgs_bridge import topics
from heli_msgs_bridge.layouts import CHANNELS
from heli_msgs_bridge.lifecycle_node import ManagedNode
from heli_msgs_bridge.topics import BASE, MAP, ODOM
from heli_observer.node import ObserverNode
from heli_outer_pd.node import OuterLoopNode

PAGE = Path(__file__).resolve().parents[1] / "docs" / "ros.md"
NODES: tuple[type[ManagedNode], ...] = (
    PlantNode,
    ObserverNode,
    InnerLoopNode,
    OuterLoopNode,
    RecorderNode,
    ScenarioNode,
    LiveViewNode,
    WorldClockNode,
    LifecycleManagerNode,
    ActionsNode,
)
SERVICES = {
    "change_state": "lifecycle_msgs/srv/ChangeState",
    "get_state": "lifecycle_msgs/srv/GetState",
    "get_available_states": "lifecycle_msgs/srv/GetAvailableStates",
    "get_available_transitions": "lifecycle_msgs/srv/GetAvailableTransitions",
    "get_transition_graph": "lifecycle_msgs/srv/GetAvailableTransitions",
    "describe_parameters": "rcl_interfaces/srv/DescribeParameters",
    "get_parameter_types": "rcl_interfaces/srv/GetParameterTypes",
    "get_parameters": "rcl_interfaces/srv/GetParameters",
    "get_type_description": "type_description_interfaces/srv/GetTypeDescription",
    "list_parameters": "rcl_interfaces/srv/ListParameters",
    "set_parameters": "rcl_interfaces/srv/SetParameters",
    "set_parameters_atomically": "rcl_interfaces/srv/SetParametersAtomically",
}
_FRAMES = {
    topics.REFERENCE: (MAP, BASE),
    topics.NO_ESTIMATE: (MAP,),
    topics.GOTO: (MAP,),
    topics.ORIGIN: (MAP,),
    topics.HOME: (MAP,),
    topics.COMMAND_POSE: (MAP,),
    topics.COMMAND_VELOCITY: (f"{MAP} or {BASE}",),
    topics.COMMAND_ATTITUDE: (MAP,),
    topics.COMMAND_CLIMB: (f"{MAP} or {BASE}",),
    topics.GOAL: (MAP,),
    topics.TF: (MAP, ODOM, BASE),
    topics.TF_STATIC: (BASE, "links of the model"),
    topics.SCENE: (MAP,),
}
_RATES = {
    topics.DIAGNOSTICS: "1 Hz and on change",
    topics.NO_ESTIMATE: "each tick without `odom`",
    topics.SCENE: f"{STATE_HZ} Hz of wall time",
}
_LONGEST = 44

HEAD = """# The graph, as ROS 2 sees it

Made from the code's own tables by `scripts/ros_page.py`; a test fails when it is stale.

## Topics

Names are relative, except those with a slash: `namespace:=heli2` moves all others to
`/heli2/...`, and every frame but `map` to `heli2/...`. Rates are per second of simulated time,
at the default `rate_hz`; what has 100 Hz here comes as often as it says (below, "Simulated time").
A frame `a > b` is that of the header and that of the child.
"""
QOS = f"""
All are reliable. History: the last {topics.DEPTH} messages, volatile; where the rate says
"latched", the last one, or as many as it says, transient local, for who comes late.
Subscribers of default QoS meet all of them; who asks for best effort does, too. `/tf` and
`/tf_static` are sent where `tf2_msgs` is installed: the PyPI wheels do not hold it,
`./heli setup --interfaces` builds it. At a tick of which the observer knows nothing it sends
`no_estimate` in the place of `odom` and `rotor_state`; `agreement` tells what nodes must agree on
(heli_msgs_bridge, `agreement`). No flight needs the last seven. `robot_state_publisher` turns
the main rotor by `joint_states`.
`excitation/*` is sent only where its sender is configured for it; with a scenario's flight started
by `hover_test.sh`, its supervisor sends `reference`, and so does the live view for who holds
its token, and the outer loop for each command that it flies. Yours to send are `goto`, or by
REP-147's name `command_pose`: a level pose in `map`, stamped with the flight's time,
or with zero for now (`heli goto`, [Pilot](howto/pilot.md));
`goto_gps`: a place by latitude, longitude and height above the ellipsoid (WGS-84), stamped alike,
flown to as the nose points;
`command_velocity`: in `map` (east, north, up) or in `base_link` (forward, left, up, level),
angular x and y 0, renewed within `command.timeout_s` (`examples/velocity.py`);
`command_attitude`: the attitude wanted, heading included, as `attitude_setpoint` has it, and
beside it `command_climb`: linear z, up, all others 0; both renewed as often
(`examples/attitude.py`); `joy`: axes and buttons as `joy.*` says, its stamp of any clock
(`heli joy`); `goal`: a command and an id of yours as `joint_names`, `[takeoff, 17]`, answered by
that id in `/diagnostics`, key `goals`: `takeoff` without points or with one whose z is its height
above where it stands; `land`, `hold`, `velocity`, `attitude` and `manual` without; `goto` with one
point that holds a pose, `follow` with those of a trajectory. `attitude_setpoint` and
`collective` are what the outer loop tells the inner one: while it is not active, you may send both
yourself. The recorder hears all but `scene`, the
live view all but the last six. As every node of ROS 2, these also send `/rosout`,
`/parameter_events` and `~/transition_event`.

The observer fuses GPS, so `odom` is given in `map` (REP-105). The frame `odom` is what moves
without jumps: the estimated velocity, summed up; the transform map -> odom holds the rest.
Diagnostics come at 1 Hz of the node's time, at once on a change, and once per second of wall
time where the node's time stands still.

## Simulated time

Stamps are simulated time: tick 0 is `start_time_s` (1 s), a tick is 10 ms, `/clock` tells the
newest. With `rate_hz: 400` of every node (`hover_test.sh --rate 400`; in a parameter file in the
section of each node, the recorder's, too) a tick is 2.5 ms: IMU, observer, inner loop, ground truth
and clock step at 400 Hz, each design is made for that step, and all else keeps its times: the
outer loop, GPS, magnetometer, barometer and every delay, as what YAMLs count in ticks is counted
in 10 ms at each rate. 200 goes, too. In lockstep the flight runs as fast as the
machine allows; with `lockstep` false simulated seconds last as long as others. The nodes of
this stack act on stamps and need no setting. Other nodes take the wall clock unless they are
told, and then find every message
decades old:

    rviz2 -d src/heli_live_view/config/flight.rviz --ros-args -p use_sim_time:=true
    ros2 topic delay -s /odom

`-s` makes a `ros2` command use `/clock`. Without it `topic delay` shows the difference of two
clocks, and `topic hz` counts per second of wall time, so in lockstep more than the table says.

## Who hears whom

`hover_test.sh` and `heli` set `ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST` unless it is set: only
this machine hears the flight. To listen from another one set
`ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET` on both, or `ROS_STATIC_PEERS` to the other's address;
`OFF` shuts everybody out. Both need the same `ROS_DOMAIN_ID`: a flight takes 0, or while
somebody else flies the one that it prints. `ros2 run` and `ros2 launch` set neither: without a
setting ROS 2 speaks to the whole subnet.

## One process or four

`./hover_test.sh --composed`, `ros2 launch heli_flight hover.launch.py composed:=true` and
`ros2 run heli_flight composed` hold plant, observer, inner and outer loop in one process and
one executor. Names, topics, services, parameters, life cycle and `/diagnostics` are those of
four processes, and so is the flight, number for number. What they send each other still goes
through DDS, but wakes no other process up, so in lockstep a flight takes about half as long
(`benchmarks/README.md`). What goes to one of them alone carries its name: `/**/plant:` in a
parameter file, `-p plant:seed:=7` on the command line. They end together: a crash of one is
the end of all. The recorder, and whoever else listens, has a process of its own.

With `FASTRTPS_DEFAULT_PROFILES_FILE` unset, `hover_test.sh` and `heli` take
`src/heli_flight/config/fastdds.xml` (`fastdds_this_machine.xml`, which listens on 127.0.0.1 alone,
unless other machines may speak): participants announce themselves more often, senders ask
for acknowledgements ten times a second, and no timer starts with each message. `ros2 launch`
does not; point that variable at the file for the same speed.

## Services

Every node has these, under its name (`/plant/get_state`):
"""
OUTER = """
The outer loop has more (std_srvs/srv/Trigger). `hold`: stop as soon as the limits `goto.*`
allow, and stay there. `takeoff`: from the ground up to `takeoff.height_m`. `land`: come to rest,
descend, touch down. `mode/velocity`, `mode/attitude`, `mode/manual`: these modes. `arm`
(std_srvs/srv/SetBool): without it no take-off; disarmed only while it stands. The answer says
what will be done, or why not and what is allowed. The parameter `mode` of `outer_loop` commands
by name when it is set: `ros2 param set /outer_loop mode hover`. `origin` tells where `map` begins,
as the latched topic of that name does: a YAML mapping of latitude, longitude and height.

The plant's `clear_faults` (std_srvs/srv/Trigger) ends all faults. They begin by its parameter
`faults`, where one without `start_s` begins now; `heli fault` sets it.

The `lifecycle_manager` has `startup`, `pause`, `resume`, `reset` and `shutdown` for all nodes
together, and `is_active` (std_srvs/srv/Trigger, under its name).
"""
ACTIONS = """
With the node `actions` beside the graph there are actions, too, where `heli_interfaces` is built
([heli_actions](../src/heli_actions/README.md)):

"""
STATUS = """
Where `heli_interfaces` is built that node sends `status` (heli_interfaces/msg/Status), too, latched
and with each `/diagnostics` of the outer loop: mode, ready, armed, landed, failsafe, home. There is
no battery, as none is simulated. From Python the same is `Pilot.status`, on any installation.
"""
LIFE = """
## Life cycle

A node started alone (`ros2 run`) configures and activates itself, unless `autostart` is false.
It answers its services in every state: kernels are compiled, and a design is made, in a thread
of its own (state `configuring`); one that waits for its peers is active, and says in
`/diagnostics` (`state: waiting`, `missing_peers`) for whom. A peer that is in the graph is waited
for while it gets ready, one that is not for `connect_timeout_s`, and five seconds if no other
node of the graph is there: then the node begins without, and goes on naming who is missing until
they listen. A plant alone flies at the pace of the wall clock with the trim held and rates
damped; who comes later flies it on.
A transition that fails or does not exist is refused with its reason and leaves the node where
it was.

| state | what the node does |
|---|---|
| unconfigured | has its parameters, checked; says in `/diagnostics` that it is there |
| inactive | has built its core, publishers and subscriptions; sends no data |
| active | takes part, once its peers listen |
| finalized | its process ends |

In flight the key `state` of `/diagnostics` says more: `unconfigured`, `configured`, `waiting` (for
peers, or to align), `active` (before its first step), `running`, `without_input` (a topic that it
needs is silent), `finished`, `inactive` (deactivated), `failed`.

| node | package | what active means |
|---|---|---|
"""
PARAMETERS = """
## Parameters

Defaults are those of the packaged YAML, which says where a value is from. "in flight": may be
set while the node is active; all others are read when the node starts. `ros2 param describe`
says the same.
"""


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(_cell(cell) for cell in line)} |\n" for line in lines)


def _rate(topic: topics.Topic) -> str:
    rate = f"{topic.rate_hz:g} Hz" if topic.every_ticks else _RATES.get(topic.name, "on change")
    kept = f" ({topic.kept})" if topic.kept > 1 else ""
    return f"{rate}, latched{kept}" if topic.latched else rate


def _topic_row(topic: topics.Topic) -> tuple[str, ...]:
    channel = CHANNELS.get(topic.name)
    frames = channel.frames if channel else _FRAMES.get(topic.name, ())
    who = [", ".join(nodes) or "-" for nodes in (topic.source, topic.sinks)]
    return (f"`{topic.name}`", topic.type, _rate(topic), " > ".join(frames) or "-", *who)


def _topics() -> str:
    scene = topics.Topic(topics.SCENE, topics.SCENE_TYPE, ("live_view",), (), 0)
    rows = [_topic_row(topic) for topic in (*topics.TABLE, *topics.TOOLS, scene)]
    return _table(("topic", "type", "rate", "frame", "from", "to"), rows)


def _actions() -> str:
    rows = [
        (f"`{PREFIX}/{kind}`", f"{PACKAGE}/action/{kind.capitalize()}", f"`{topics.GOAL}`: {kind}")
        for kind in Kind
    ]
    return ACTIONS + _table(("action", "type", "sent on as"), rows) + STATUS


def _value(value: Any) -> str:
    if hasattr(value, "tolist"):
        value = value.ravel().tolist()
    if isinstance(value, list | tuple):
        text = f"[{', '.join(_value(item) for item in value)}]"
        return text if len(text) <= _LONGEST else f"{len(value)} numbers, see the YAML"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.10g}" if isinstance(value, float) else str(value) or '""'


def _parameters(rows: Iterable[Parameter], values: dict[str, Any]) -> str:
    lines = [
        (
            f"`{row.name}`",
            row.allowed(),
            _value(values[row.name]),
            "" if row.read_only else "in flight",
            row.description,
        )
        for row in rows
    ]
    return _table(("name", "allowed", "default", "set", "meaning"), lines)


def _own(node: type[ManagedNode]) -> list[Parameter]:
    common = {row.name for row in COMMON_TABLE}
    return [row for row in node.SPEC.full_table() if row.name not in common]


def page() -> str:
    """The whole page."""
    values = {node.SPEC.name: node.SPEC.resolve() for node in NODES}
    parts = [HEAD, "\n", _topics(), QOS, "\n"]
    rows = [(f"`~/{name}`", kind) for name, kind in SERVICES.items()]
    parts += [_table(("service", "type"), rows), OUTER, _actions(), LIFE]
    for node in NODES:
        meaning = " ".join((node.__doc__ or "").split())
        parts.append(f"| `{node.SPEC.name}` | `{node.SPEC.package}` | {_cell(meaning)} |\n")
    parts += [PARAMETERS, "\n### All nodes\n\n"]
    parts.append(_parameters(COMMON_TABLE, values[PlantNode.SPEC.name]))
    for node in NODES:
        name = node.SPEC.name
        parts += [f"\n### {name}\n\n", _parameters(_own(node), values[name])]
    return "".join(parts)


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or check the page; returns the exit code."""
    parser = argparse.ArgumentParser(description="docs/ros.md out of the code's own tables")
    parser.add_argument("--check", action="store_true", help="exit with code 1 if it is stale")
    if not parser.parse_args(arguments).check:
        PAGE.write_text(page(), encoding="utf-8")
        return 0
    if PAGE.exists() and PAGE.read_text(encoding="utf-8") == page():
        return 0
    print("docs/ros.md is stale: run scripts/ros_page.py", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
