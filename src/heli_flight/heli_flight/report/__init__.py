# SPDX-License-Identifier: Apache-2.0
"""A flight's report: a page for the browser and figures for a paper."""
