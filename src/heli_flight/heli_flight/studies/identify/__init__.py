# SPDX-License-Identifier: Apache-2.0
"""`heli identify`: fly the experiments, fit, compare, report."""
