# SPDX-License-Identifier: Apache-2.0
"""Measure the recorder at several rates (bench_recorder.py), and the bags of a flight; JSON.

Usage: ./heli python -m evidence.experiments.recorder
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import yaml

from evidence.files import Results
from evidence.registry import NOT_COMPARED, produces, table
from evidence.tables import grid

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from bench_recorder import bench

RATES_HZ = (5000.0, 10000.0, 15000.0)
TOPICS, SECONDS = 10, 10.0
STORAGES = (("mcap", "none"), ("mcap", "zstd"), ("sqlite3", "none"))
FLIGHT_S = 25


def bag_of_a_flight(storage: str, compression: str, folder: Path) -> dict[str, Any]:
    """Messages and size of the bag of a flight through the graph.

    Raises
    ------
    SystemExit
        The flight failed; its last line.
    """
    parameters = folder / "recorder.yaml"
    parameters.write_text(
        "/**/recorder:\n  ros__parameters:\n"
        f"    storage: {storage}\n    compression: {compression}\n"
    )
    command = [sys.executable, "-m", "heli_flight.cli.app", "hover", "--no-report", "--duration"]
    command += [str(FLIGHT_S), "--params", str(parameters), "--out", str(folder / "flight")]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise SystemExit(f"recorder_table: {done.stderr.splitlines()[-1]}")
    bag = folder / "flight" / "bag"
    metadata = yaml.safe_load((bag / "metadata.yaml").read_text(encoding="utf-8"))
    return {
        "storage": storage,
        "compression": compression,
        "flight_s": FLIGHT_S,
        "messages": metadata["rosbag2_bagfile_information"]["message_count"],
        "size_mb": sum(path.stat().st_size for path in bag.iterdir()) / 1e6,
    }


def main() -> int:
    """Measure all; 1 if a message was lost."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rates, bags = [], []
    for rate in RATES_HZ:
        with tempfile.TemporaryDirectory(prefix="heli_bench_") as name:
            rates.append(bench(rate, TOPICS, SECONDS, "mcap", "none", Path(name)))
    for storage, compression in STORAGES:
        with tempfile.TemporaryDirectory(prefix="heli_bench_") as name:
            bags.append(bag_of_a_flight(storage, compression, Path(name)))
    print(json.dumps({"rates": rates, "bags": bags}))
    return int(any(row["lost"] for row in rates))


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "recorder",
    "./heli python -m evidence.experiments.recorder",
    "Losses and load of the recorder, sizes of bags.",
    loose={
        "rate_hz": NOT_COMPARED,
        "recorder_cpu": NOT_COMPARED,
        "messages": 0.05,
        "size_mb": 0.1,
    },
)


@table("recorder")
def recorder(results: Results) -> str:
    """Losses and processor time of the recorder, sizes of bags."""
    record = results["recorder"]
    rates = [
        [
            f"{row['rate_hz']:.0f}",
            str(row["sent"]),
            str(row["lost"]),
            f"{100.0 * row['recorder_cpu']:.0f} %",
        ]
        for row in record["rates"]
    ]
    bags = [
        [
            row["storage"] + ("" if row["compression"] == "none" else f", {row['compression']}"),
            f"{row['flight_s']} s",
            str(row["messages"]),
            f"{row['size_mb']:.1f} MB",
        ]
        for row in record["bags"]
    ]
    made = results.read["recorder"]
    return (
        f"{grid(['messages/s, 10 topics, MCAP', 'sent', 'lost', 'of a core'], rates)}\n\n"
        f"{grid(['bag of a flight', 'flight', 'messages', 'size'], bags)}\n\n"
        f"Sender and recorder on {made['processor']['cores']} cores, load {made['load']:g}."
    )


if __name__ == "__main__":
    sys.exit(main())
