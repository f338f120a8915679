# SPDX-License-Identifier: Apache-2.0
"""PX4 flies the plant: its `simulator_mavlink` interface, from the simulator's side."""
