# SPDX-License-Identifier: Apache-2.0
"""ArduPilot flies the plant: its JSON protocol for software in the loop, from the physics' side."""
