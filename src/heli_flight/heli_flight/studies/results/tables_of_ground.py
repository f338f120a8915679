# SPDX-License-Identifier: Apache-2.0
"""Tables of the aircraft on the ground: touch-downs, and tipping over a skid."""

from heli_flight.studies.results.files import Results
from heli_flight.studies.results.grid import grid

_FELL = 89.0
"""A limit of the tilt, deg, that stands for none."""


def touch_downs(results: Results) -> str:
    """Touch-downs at three speeds on four kinds of ground, and standing in wind."""
    found = results["ground"]
    rows = [
        [
            row["ground"],
            f"{row['sink_mps']:.1f}",
            f"{row['bounce_mm']:.1f}",
            f"{row['skid_m']:.3f}",
            f"{row['tilt_deg']:.1f}",
            row["ended"],
        ]
        for row in found["landings"]
    ]
    head = [
        "ground",
        "sinking at, m/s",
        "bounce, mm",
        "skid, m",
        "largest roll or pitch, deg",
        "end",
    ]
    stands = "; ".join(
        f"{row['ground']}: creep {row['creep_mm']:.2f} mm, estimated level off by "
        f"{row['level_deg']:.2f} deg, heading {row['heading_deg']:.2f} deg, disc "
        f"{row['disc_deg']:.2f} deg"
        for row in found["stands"]
    )
    return (
        f"{grid(head, rows)}\n\nDefault aircraft, no law, still air, from hover's attitude; "
        "the collective goes to idle within 0.5 s from the first touch on. The bounce is the air "
        "below the lowest skid end after it, the skid the way along the ground in 5 s. Standing "
        f"10 s at idle in gusty wind of 5 m/s, seeds {found['seeds'][0]} to {found['seeds'][-1]}, "
        f"standalone receiver, the worst at the end: {stands} (disc: from 2 s on)."
    )


def rollover(results: Results) -> str:
    """Critical bank over a skid, and what lowering the collective saves."""
    found = results["ground"]
    rows = [
        [f"{row['lift']:.2f}", f"{row['statics_deg']:.1f}", f"{row['let_go_deg']:.1f}"]
        for row in found["critical"]
    ]
    stopped = [
        [
            f"{row['stick']:.2f}",
            "never" if row["limit_deg"] > _FELL else f"{row['limit_deg']:.0f} deg",
            f"{row['most_deg']:.1f}",
            row["ended"],
        ]
        for row in found["side_stick"]
    ]
    critical = grid(["lift over weight", "by statics, deg", "let go in the plant, deg"], rows)
    saved = grid(["stick to the right", "collective down at", "largest tilt, deg", "end"], stopped)
    return (
        f"{critical}\n\nBank at which nothing rights the aircraft on its right skid, at rest, "
        f"hover's cyclic and pedal, the skid caught.\n\n{saved}\n\nThe same at 0.90 of the weight "
        "from level ground, stick held; the collective is commanded down 40 ms after the tilt."
    )
