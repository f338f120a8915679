# SPDX-License-Identifier: Apache-2.0
"""Campaigns: many flights with drawn aircraft, winds and faults."""
