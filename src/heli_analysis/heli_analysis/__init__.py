# SPDX-License-Identifier: Apache-2.0
"""What records of flights tell: identification of an aircraft, handling qualities."""

from heli_core.faces import face

__getattr__, __dir__, __all__ = face(__name__, {}, modules=["handling", "identification"])
