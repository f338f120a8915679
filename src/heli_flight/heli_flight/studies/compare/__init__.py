# SPDX-License-Identifier: Apache-2.0
"""Attitude laws flown against each other."""
