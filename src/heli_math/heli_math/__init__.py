# SPDX-License-Identifier: Apache-2.0
"""Small mathematics that every package of the stack shares: compilation, rotations, atmosphere."""
