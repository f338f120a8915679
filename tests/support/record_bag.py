# SPDX-License-Identifier: Apache-2.0
"""A flight's folder as a graph would have left it, out of a flight of one process."""

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from heli_bags.reader import Remark
from heli_core.ticks import stamp_at
from heli_flight.flight_file import NAME, write_parameters
from heli_flight.loop import simulate
from heli_flight.record import FlightRecord
from heli_flight.replay import remarks_of, stamps_of, streams_of
from heli_flight.settings import Settings
from heli_msgs_bridge import topics
from heli_msgs_bridge.messages import Encoder


def flown_folder(folder: Path, settings: Settings, result: Mapping[str, Any] | None = None) -> Path:
    """Fly, and write params.yaml and bag/ with all that a page shows.

    Parameters
    ----------
    folder : Path
        Made here.
    settings : Settings
    result : mapping, optional
        Content of result.json, as far as it counts: `lost`.
    """
    record = simulate(settings).record
    stamps = stamps_of(record, stamp_at(settings.nodes["plant"]["start_time_s"]))
    folder.mkdir()
    write_parameters(settings, folder / NAME)
    store = get_typestore(Stores.ROS2_JAZZY)
    entries: list[tuple[int, str, bytes]] = []
    for name, stream in streams_of(record, stamps).items():
        encoder, rows = Encoder(name), stream.rows
        if name == topics.TRUTH_ROTOR:
            rows = np.hstack([rows, np.zeros((len(rows), 4))])
        every = max(1, topics.BY_NAME[name].every_ticks)
        for stamp_ns, row in list(zip(stream.stamp_ns.tolist(), rows, strict=True))[::every]:
            raw = encoder.encode(np.ascontiguousarray(row), stamp_ns)
            entries.append((stamp_ns, name, bytes(raw)))
    for remark in remarks_of(record, stamps, settings, result or {}):
        entries.append((remark.stamp_ns, topics.DIAGNOSTICS, _raw(store, remark)))
    with Writer(folder / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {
            name: writer.add_connection(
                f"/{name.lstrip('/')}", topics.BY_NAME[name].type, typestore=store
            )
            for name in dict.fromkeys(name for _, name, _ in entries)
        }
        for stamp_ns, name, raw in sorted(entries, key=lambda entry: entry[0]):
            writer.write(connections[name], stamp_ns, raw)
    return folder


def _raw(store: Any, remark: Remark) -> bytes:
    """A remark as a message of /diagnostics."""
    kinds = store.types
    pair = kinds["diagnostic_msgs/msg/KeyValue"]
    status = kinds["diagnostic_msgs/msg/DiagnosticStatus"](
        level=remark.level, name=remark.node, message=remark.message, hardware_id="",
        values=[pair(key=key, value=value) for key, value in remark.facts.items()],
    )  # fmt: skip
    stamp = kinds["builtin_interfaces/msg/Time"](*divmod(remark.stamp_ns, 10**9))
    header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    array = kinds["diagnostic_msgs/msg/DiagnosticArray"](header=header, status=[status])
    return bytes(store.serialize_cdr(array, "diagnostic_msgs/msg/DiagnosticArray"))


def rows_of(record: FlightRecord, kept: Any) -> FlightRecord:
    """Rows of a record: a slice, a mask or numbers of rows."""
    arrays = {field.name: getattr(record, field.name) for field in fields(record)}
    return FlightRecord(**{n: None if a is None else a[kept] for n, a in arrays.items()})


def cut_off(bag: Path, share: float = 0.7) -> None:
    """Cut a bag as a power cut does: the file's end is missing, and metadata.yaml."""
    (bag / "metadata.yaml").unlink()
    (file,) = bag.glob("*.mcap")
    content = file.read_bytes()
    file.write_bytes(content[: round(share * len(content))])
