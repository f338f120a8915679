# SPDX-License-Identifier: Apache-2.0
"""Campaigns: many flights with dispersed parameters, on one machine or a cluster, kept as rows."""
