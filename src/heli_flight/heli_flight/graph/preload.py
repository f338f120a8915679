# SPDX-License-Identifier: Apache-2.0
"""What every node of a flight needs, loaded once in the process that they are forked from.

Imports only, and compiled kernels: no ROS context exists here, and no thread is started.
"""

import contextlib

import heli_outer_pd.node  # noqa: F401
from heli_flight.graph.warm_up import load_kernels

# A bad default parameter is the node's to report, in its own words.
with contextlib.suppress(Exception):
    load_kernels()
