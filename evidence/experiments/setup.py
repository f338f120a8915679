# SPDX-License-Identifier: Apache-2.0
"""Set-up of a fresh clone with empty caches, to the end of its first flight.

`scripts/setup_time.py` measures it.
"""

from evidence.files import Results
from evidence.registry import NOT_COMPARED, produces, table

produces(
    "setup",
    "./heli python scripts/setup_time.py",
    "Set-up of a fresh clone with empty caches, to the end of its first flight.",
    loose={
        "installed_mb": 0.1,
        **{
            key: NOT_COMPARED for key in ("split_s", "setup_s", "start_up_s", "flight_s", "total_s")
        },
    },
)


@table("setup")
def setup(results: Results) -> str:
    """What the first call of a command costs."""
    record, made, size = results["setup"], results.read["setup"], results["setup_size"]
    split = ", ".join(f"{name} {seconds} s" for name, seconds in record["split_s"].items())
    return (
        "From a fresh clone with empty caches `./hover_test.sh` ends after "
        f"{record['total_s']:.0f} s on {made['processor']['cores']} cores (load {made['load']:g}): "
        f"{record['setup_s']} s of "
        f"set-up ({split}), {record['start_up_s']:.0f} s until all nodes are up, "
        f"{record['flown_s']:g} s flown in {record['flight_s']:.1f} s, then the report. "
        f"It downloads {size['download_mb']} MB; the environment takes {size['disk_mb']} MB of "
        "disk. "
        f"The test tools add {size['test_mb']} MB and {size['test_disk_mb']} MB."
    )
