# SPDX-License-Identifier: Apache-2.0
"""What every package of the stack shares: compilation, ticks, named rows, rotations, atmosphere."""
