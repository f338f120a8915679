# SPDX-License-Identifier: Apache-2.0
"""What every node of a flight needs, loaded once in the process that they are forked from.

Imports only, and compiled kernels: no ROS context exists here, and no thread stays. What is
loaded here a node need not load that is started again in flight. The search for cyclic garbage
leaves it alone from here on: each node would look through it all, and have a copy of its pages.
"""

import contextlib
import gc
import inspect
import sys

import lifecycle_msgs.srv
import rcl_interfaces.srv
import rclpy.experimental.events_executor  # noqa: F401
from rclpy.type_support import check_for_type_support

import heli_bags.node  # noqa: F401
import heli_dynamics_sim.node  # noqa: F401
import heli_inner_hinf.node  # noqa: F401
import heli_observer.node  # noqa: F401
import heli_outer_pd.node  # noqa: F401
from heli_flight.graph.processes import end_tracer
from heli_flight.graph.warm_up import load_kernels
from heli_msgs_bridge import topics

_SERVICES = (lifecycle_msgs.srv, rcl_interfaces.srv)


def _load_types() -> None:
    """The C side of all messages and of the services that each node has."""
    for row in topics.KNOWN.values():
        with contextlib.suppress(LookupError):
            check_for_type_support(topics.message_class(row.type))
    for package in _SERVICES:
        for name in vars(package):
            if isinstance(kind := getattr(package, name), type):
                check_for_type_support(kind)


_load_types()
end_tracer()
# A bad default parameter is the node's to report, in its own words.
with contextlib.suppress(Exception):
    load_kernels()
# The first line of a log has all modules looked at for who said it, and this remembered.
inspect.getmodule(sys._getframe())
gc.collect()
gc.freeze()
