# SPDX-License-Identifier: Apache-2.0
"""`heli design`: trim, linearise, synthesise, prove, draw."""
