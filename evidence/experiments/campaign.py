# SPDX-License-Identifier: Apache-2.0
"""A campaign on one and two workers, and a worker's memory.

`benchmarks/campaign.py` measures it.
"""

from evidence.files import Results
from evidence.registry import NOT_COMPARED, produces, table
from evidence.tables import grid

produces(
    "campaign",
    "./heli python benchmarks/campaign.py --json",
    "A campaign on one and two workers, and a worker's memory.",
    loose={key: NOT_COMPARED for key in ("rates", "flights_1000_s", "efficiency", "resident_mb")},
)


@table("workers")
def workers(results: Results) -> str:
    """A campaign on one and two workers, and a worker's memory."""
    record = results["campaign"]
    speed, goals = record["speed"], record["goals"]
    looks = record["memory"]["looks"]
    grown_mb = looks[-1]["resident_mb"] - looks[0]["resident_mb"]
    rows = [
        *(
            [f"flights per s, {count} worker{'s' * (count != '1')}", f"{rate:.2f}", ""]
            for count, rate in speed["rates"].items()
        ),
        ["1000 flights", f"{speed['flights_1000_s']:.0f} s", f"{goals['flights_1000_s']:g} s"],
        ["efficiency", f"{speed['efficiency']:.2f}", f"{goals['efficiency']:g}"],
        *(
            [f"memory after {look['flights']} short flights", f"{look['resident_mb']:.0f} MB", ""]
            for look in (looks[0], looks[len(looks) // 2], looks[-1])
        ),
    ]
    return (
        f"{grid(['', 'measured', 'goal'], rows)}\n\nMedians of {speed['rounds']} rounds in turn, "
        f"{speed['flights']} flights of {speed['duration_s']:g} s each; short: "
        f"{record['memory']['duration_s']:g} s, one worker, {grown_mb:+.1f} MB from the first look "
        f"to the last."
    )
