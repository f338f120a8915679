# SPDX-License-Identifier: Apache-2.0
"""Table of the flights over links that lose and delay."""

from heli_flight.studies.results.files import Results
from heli_flight.studies.results.grid import grid


def links(results: Results) -> str:
    """Faults of links in the hover: lost, off, tilt."""
    found = results["links"]
    head = ["fault", "receiver", "lost", "gave up its place", "off, m: median / worst",
            "from its place, m, worst", "tilt, deg, worst", "without the fault"]  # fmt: skip
    rows = []
    for row in found["rows"]:
        most, sound = row["max"], row["sound"]
        rows.append([
            row["fault"], row["gps"], str(row["lost"]), str(row["gave_up"]),
            f"{row['median']['off_m']:.2f} / {most['off_m']:.2f}", f"{most['place_m']:.2f}",
            f"{most['tilt_deg']:.1f}", f"{sound['tilt_deg']:.1f}",
        ])  # fmt: skip
    return (
        f"{grid(head, rows)}\n\nOf {len(found['seeds'])} flights each (seeds {found['seeds'][0]} "
        f"to {found['seeds'][-1]}): hover at 10 m, world {found['world']}, default laws, one "
        f"process, the fault from {found['begin_s']:g} s on, {found['end_s']:g} s long. Off: "
        "largest distance from the same flight without the fault; from its place: from the first "
        "reference; both from truth, lost ones among them until they are. Gave up its place: the "
        "position counted as lost meanwhile, and another one was held when it was found again."
    )
