# SPDX-License-Identifier: Apache-2.0
"""Loaded first in the process that nodes are forked from: it ends when its parent ends."""

import os

from heli_flight.graph.processes import SERVER_PID, STARTER_PID, die_with_parent

die_with_parent(STARTER_PID)
os.environ[SERVER_PID] = str(os.getpid())
