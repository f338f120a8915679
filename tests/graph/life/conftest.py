# SPDX-License-Identifier: Apache-2.0
"""The graph's nodes in this process, spun by the executor that their processes use, and a client.

What a node's process does with an exception is to end; here it surfaces in the test.
"""

import time

import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParameters
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.parameter import Parameter

from heli_bags.node import RecorderNode
from heli_dynamics_sim.node import PlantNode
from heli_flight.graph.lifecycle_manager_node import LifecycleManagerNode
from heli_flight.graph.scenario_node import ScenarioNode
from heli_inner_hinf.node import InnerLoopNode
from heli_live_view.node import LiveViewNode
from heli_observer.node import ObserverNode
from heli_outer_pd.node import OuterLoopNode

LIMIT_S = 120.0
KINDS = {
    kind.SPEC.name: kind
    for kind in (
        ScenarioNode,
        RecorderNode,
        LiveViewNode,
        LifecycleManagerNode,
        OuterLoopNode,
        InnerLoopNode,
        ObserverNode,
        PlantNode,
    )
}
CONFIGURE, ACTIVATE = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE


class Crew:
    """Nodes by name, and calls of their services as another process would make them.

    Parameters
    ----------
    context : rclpy.Context
    folder : Path
        Gets the bags.
    changes : mapping
        Values over the packaged ones; those that a node has.
    """

    def __init__(self, context, folder, **changes):
        self.context, self._folder = context, folder
        self._changes = {name.replace("__", "."): value for name, value in changes.items()}
        self.executor = EventsExecutor(context=context)
        self.client = rclpy.create_node("prober", context=context)
        self.executor.add_node(self.client)
        self.nodes, self._clients = {}, {}

    def join(self, *names, **changes):
        """Make nodes, as their processes do when they start; with values of their own."""
        own = {name.replace("__", "."): value for name, value in changes.items()}
        for name in names:
            kind = KINDS[name]
            values = kind.SPEC.resolve()
            overrides = {"autostart": False, "peers": [], "peer_timeout_s": 0.05}
            overrides |= {"bag": str(self._folder / f"bag{time.monotonic_ns()}")}
            if name == "lifecycle_manager":
                # It flies nothing: the bond must be shorter.
                del overrides["peer_timeout_s"]
            overrides |= {"port": 0, "foxglove": False, "nice": 0} | self._changes | own
            values |= {key: value for key, value in overrides.items() if key in values}
            self.nodes[name] = kind(values, context=self.context)
            self.executor.add_node(self.nodes[name])
        return self

    def leave(self, name):
        """End a node, as its process does."""
        node = self.nodes.pop(name)
        self.executor.remove_node(node)
        node.end()
        node.destroy_node()

    def close(self):
        """End all; once is enough."""
        if self.client is None:
            return
        for name in list(self.nodes):
            self.leave(name)
        self.executor.shutdown()
        self.client.destroy_node()
        self.client = None

    def spin_until(self, condition, limit_s=LIMIT_S):
        deadline = time.monotonic() + limit_s
        while not condition():
            assert time.monotonic() < deadline, "waited too long"
            self.executor.spin_once(timeout_sec=0.2)
            for node in self.nodes.values():
                if node.crash is not None:
                    raise node.crash

    def ask(self, kind, name, request):
        """Future of a service's answer, by its full name."""
        key = (kind, name)
        if key not in self._clients:
            self._clients[key] = self.client.create_client(kind, name)
        client = self._clients[key]
        self.spin_until(client.service_is_ready)
        return client.call_async(request)

    def call(self, kind, name, request):
        """Answer of a service by its full name."""
        future = self.ask(kind, name, request)
        self.spin_until(future.done)
        return future.result()

    def ask_to_change(self, name, transition=0, label=""):
        """Future of a transition's answer."""
        request = ChangeState.Request()
        request.transition.id, request.transition.label = transition, label
        return self.ask(ChangeState, f"/{name}/change_state", request)

    def change(self, name, transition=0, label=""):
        """Ask for a transition; whether it came about."""
        future = self.ask_to_change(name, transition, label)
        self.spin_until(future.done)
        return future.result().success

    def state(self, name):
        return self.call(GetState, f"/{name}/get_state", GetState.Request()).current_state.id

    def ask_to_set(self, name, **values):
        """Future of the answer to setting parameters, one by one."""
        request = SetParameters.Request()
        request.parameters = [
            Parameter(key.replace("__", "."), value=value).to_parameter_msg()
            for key, value in values.items()
        ]
        return self.ask(SetParameters, f"/{name}/set_parameters", request)

    def set(self, name, **values):
        """Results of setting parameters, one by one."""
        future = self.ask_to_set(name, **values)
        self.spin_until(future.done)
        return future.result().results

    def bring_up(self, *names):
        for transition in (CONFIGURE, ACTIVATE):
            for name in names or self.nodes:
                assert self.change(name, transition), (name, self.nodes[name].failure)

    def fly(self, ticks):
        """Let so many ticks go by; less if the flight ends."""
        plant = self.nodes["plant"]
        goal = plant.tick + ticks
        self.spin_until(lambda: plant.tick >= goal or plant.health.facts.get("over"))


@pytest.fixture
def crew(ros_context, tmp_path):
    """Make a `Crew` of nodes by name, with values over the packaged ones."""
    made = []

    def make(*names, folder=tmp_path, **changes):
        made.append(Crew(ros_context, folder, **changes).join(*names))
        return made[-1]

    yield make
    for one in made:
        one.close()
