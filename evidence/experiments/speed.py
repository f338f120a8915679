# SPDX-License-Identifier: Apache-2.0
"""Times of the plant and of the whole loop in one process.

`scripts/bench_plant.py` measures it.
"""

from evidence.registry import NOT_COMPARED, produces

produces(
    "speed",
    "./heli python scripts/bench_plant.py --json",
    "Times of the plant and of the whole loop in one process.",
    loose={
        key: NOT_COMPARED
        for key in (
            "step_us",
            "tick_us",
            "noise_row_us",
            "loop_times_real_time",
            "first_compilation_s",
        )
    },
)
