# SPDX-License-Identifier: Apache-2.0
"""Tables of the attitude loop over the airspeed, and of forward flight as it is flown."""

from typing import Any

from heli_flight.studies.results.files import Results
from heli_flight.studies.results.grid import grid, world
from heli_math.ticks import TICK_S

_FLOWN = {
    "roll, transition": "roll error in the transitions, deg (goal 2)",
    "pitch, transition": "pitch error in the transitions, deg (goal 2)",
    "roll": "roll error, deg",
    "pitch": "pitch error, deg",
    "altitude": "altitude error, m (goal 1)",
    "position": "position error, m",
    "speed": "speed over ground, m/s",
    "airspeed": "airspeed, m/s",
}


def airspeed(results: Results) -> str:
    """Trim and loop at each speed, and what the loops share."""
    found = results["airspeed"]
    head = [
        "ahead, m/s", "trim phi, theta, deg", "d_lon, over flap-back", "d_col",
        "slowest mode, s", "disk margin in / out",
    ]  # fmt: skip
    rows = [
        [
            f"{row['ahead_mps']:g}",
            "{:.1f}, {:.1f}".format(*row["phi_theta_deg"]),
            "{:.3f} to {:.3f}".format(*row["d_lon"]),
            f"{row['d_col']:.3f}",
            f"{TICK_S / (1.0 - row['radius']):.2f}",
            f"{row['disk_input']:.2f} / {row['disk_output']:.2f}",
        ]
        for row in found["speeds"]
    ]
    across = found["across_mps"]
    return (
        f"{grid(head, rows)}\n\nModes and margins: the worst of air from the side of "
        f"{min(across):g} to {max(across):g} m/s and flap-back 0 to 0.0015 rad s/m. "
        f"{' '.join(map(_shared, found['bounds']))}"
    )


def _shared(bound: dict[str, Any]) -> str:
    if bound["contraction"] is None:
        return f"`{bound['laws']}`: no shared bound was found."
    each = TICK_S / (1.0 - bound["contraction"])
    return (
        f"`{bound['laws']}`: one quadratic form shrinks by {1.0 - bound['contraction']:.4f} a tick "
        f"at least ({each:.1f} s), between these speeds by {1.0 - bound['between']:.4f}."
    )


def airspeed_flown(results: Results) -> str:
    """Largest errors in forward flight."""
    found = results["airspeed"]
    rows = [
        [
            f"{row['world']}, {row['gps']}",
            *(f"{row['max'][key]:.2f}" for key in _FLOWN),
            str(row["inside_transition"]),
            f"{row['hover']['roll']:.2f}, {row['hover']['pitch']:.2f}",
            str(row["lost"]),
        ]
        for row in found["flights"]
    ]
    winds = {row["world"]: [row["conditions"]] for row in found["flights"]}
    head = ["world, receiver", *_FLOWN.values(), "transitions inside", "hover: roll, pitch", "lost"]
    return (
        f"{grid(head, rows)}\n\nLargest from the start of the way to the end, truth, "
        f"{results.seeds('airspeed')}; attitude against the outer loop's command. Transitions: "
        f"while the reference gains or loses speed, and a second after; inside: seeds with both "
        f"errors below 2 deg there. Hover: the scenario `hover` over the same "
        f"time. {world(winds)}"
    )
