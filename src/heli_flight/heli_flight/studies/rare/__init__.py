# SPDX-License-Identifier: Apache-2.0
"""Flights that are hard to find at random: rare failures, and the worst case of the dispersions."""
