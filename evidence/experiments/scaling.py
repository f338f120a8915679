# SPDX-License-Identifier: Apache-2.0
"""What empty tasks of a campaign and participants of a ROS domain cost.

`benchmarks/scaling.py` measures it.
"""

from evidence.files import Results
from evidence.registry import NOT_COMPARED, produces, table
from evidence.tables import grid

produces(
    "scaling",
    "./heli python benchmarks/scaling.py --json",
    "What empty tasks of a campaign and participants of a ROS domain cost.",
    loose={
        key: NOT_COMPARED
        for key in ("tasks_per_s", "scheduler_s_per_task", "wall_s", "cpu_s", "seen")
    },
)


@table("scaling")
def scaling(results: Results) -> str:
    """Participants of one ROS domain on one machine."""
    record = results["scaling"]
    rows = [
        [
            str(row["count"]),
            row["range"],
            f"{row['seen']:.0f}",
            f"{row['wall_s']:.2f}"
            if row["seen"] == row["count"]
            else f"not in {row['wall_s']:.0f}",
            f"{row['cpu_s'] / row['count']:.3f}",
        ]
        for row in record["participants"]
    ]
    head = ["participants", "discovery range", "seen", "until all know all, s", "processor s each"]
    return grid(head, rows)
