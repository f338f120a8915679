# SPDX-License-Identifier: Apache-2.0
"""Flights with known truth, for tests and tables of the filter; nothing that flies imports it."""
