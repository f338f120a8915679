# SPDX-License-Identifier: Apache-2.0
"""Flight bags: recorded, read, played, repaired; tools for a running graph."""
