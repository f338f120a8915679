# SPDX-License-Identifier: Apache-2.0
"""The nonlinear helicopter: dynamics, wind, sensors, trim and linearisation."""
