# SPDX-License-Identifier: Apache-2.0
"""GPS/inertial navigation filter and the reduced-order observer, eq. (19)."""

from heli_core.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "layout": ["ObserverStatus"],
        "observer": ["ObserverConfig", "ObserverConfigError"],
        "reduced_order": ["ReducedOrderError", "ReducedOrderModel", "reduced_order_model"],
    },
    modules=["layout", "observer"],
)
