# SPDX-License-Identifier: Apache-2.0
"""`heli robust`: what is proved of the attitude loop as flown for every aircraft of a named set."""
