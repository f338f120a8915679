# SPDX-License-Identifier: Apache-2.0
"""GPS/inertial navigation filter and the reduced-order observer, eq. (19)."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "config": ["ObserverConfig", "ObserverConfigError"],
        "reduced_order": ["ReducedOrderError", "ReducedOrderModel", "reduced_order_model"],
        "layout": ["ObserverStatus"],
    },
    modules=["layout", "observer"],
)
