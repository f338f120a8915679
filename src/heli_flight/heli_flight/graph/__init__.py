# SPDX-License-Identifier: Apache-2.0
"""A flight of the real graph: processes over DDS, brought up, supervised, read from the bag."""
