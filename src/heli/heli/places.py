# SPDX-License-Identifier: Apache-2.0
"""Places of what a law reads: `x[NINE.phi]`, `x[NAV.pos]`, `r[SHAPED.vel]`."""

from heli_math.rows import NAV, NINE, SHAPED

__all__ = ["NAV", "NINE", "SHAPED"]
