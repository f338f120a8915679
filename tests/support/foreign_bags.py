# SPDX-License-Identifier: Apache-2.0
"""Bags as other recorders leave them: every storage version, topics that nobody here can read.

Storage and metadata versions: ros2/rosbag2, `metadata.hpp` and the SQLite plugin's `CREATE TABLE`;
MCAP: https://mcap.dev/spec, https://mcap.dev/spec/registry.
"""

import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter

from heli_bags.storage_files import Definitions

EVERY_MESSAGES = 10
"""Of each foreign topic there is a message after so many of the others."""


@dataclass(frozen=True)
class Kind:
    """What a topic is: type, the schema's encoding and content, the messages' encoding."""

    type: str
    schema: str
    definition: bytes
    form: str = "cdr"


@dataclass(frozen=True)
class Sent:
    """A message, at a time of the bag, ns."""

    topic: str
    log_ns: int
    raw: bytes


SERVICE_EVENTS = "/heli/plant/get_parameters/_service_event"
FOREIGN: dict[str, tuple[Kind, bytes]] = {
    # As rosbag2 writes them where the definition is not found.
    SERVICE_EVENTS: (
        Kind("rcl_interfaces/srv/GetParameters_Event", "", b""), b"\0\1\0\0" + bytes(8),
    ),
    # As rosbag2 of Jazzy writes them: the service's definition in the place of the event's.
    "/acme/weigh/_service_event": (
        Kind(
            "acme_msgs/srv/Weigh_Event", "ros2msg",
            b"=" * 80 + b"\nSRV: acme_msgs/srv/Weigh\nint64 at\n---\nfloat64 mass\n",
        ),
        b"\0\1\0\0" + bytes(16),
    ),
    "/acme/undefined": (Kind("acme_msgs/msg/Widget", "unknown", b""), b"\0\1\0\0\7\0\0\0"),
    "/acme/lacking": (
        Kind("acme_msgs/msg/Outer", "ros2msg", b"acme_msgs/Inner inner\n"), b"\0\1\0\0\7\0\0\0",
    ),
    "/acme/garbled": (Kind("acme_msgs/msg/Odd", "ros2msg", b"float64[ x y\n@@"), b"\0\1\0\0\0"),
    "/acme/no_type": (Kind("", "", b""), b"\0\1\0\0\1"),
    "/acme/json": (Kind("acme", "jsonschema", b'{"type": "object"}', "json"), b'{"a": 1}'),
    "/acme/protobuf": (Kind("acme.Widget", "protobuf", b"\x0a\xff\xfe\x80", "protobuf"), b"\x08\1"),
    # Of a type that is known, and of other bytes.
    "/acme/cut_off": (Kind("sensor_msgs/msg/Imu", "ros2msg", b""), b"\0\1\0\0\7"),
}  # fmt: skip
SCHEMALESS = "/acme/schemaless"


def ours(types: Mapping[str, str]) -> dict[str, Kind]:
    """Topics with their types' definitions."""
    definitions = Definitions()
    return {
        topic: Kind(name, "ros2msg", definitions.text_and_hash(name)[0].encode())
        for topic, name in types.items()
    }


def among(messages: Sequence[Sent], foreign: Iterable[str] = FOREIGN) -> list[Sent]:
    """The messages with some of each foreign topic in between."""
    mixed: list[Sent] = []
    for number, one in enumerate(messages):
        mixed.append(one)
        if number % EVERY_MESSAGES == 0:
            mixed += [Sent(name, one.log_ns, FOREIGN[name][1]) for name in foreign]
    return mixed


def kinds(types: Mapping[str, str], foreign: Iterable[str] = FOREIGN) -> dict[str, Kind]:
    """All topics of a bag, what they are."""
    known = ours(types) | {name: FOREIGN[name][0] for name in foreign}
    (imu,) = ours({"": "sensor_msgs/msg/Imu"}).values()
    return {
        name: Kind(kind.type, kind.schema, imu.definition) if name == "/acme/cut_off" else kind
        for name, kind in known.items()
    }


def write_mcap(
    path: Path,
    topics: Mapping[str, Kind],
    messages: Iterable[Sent],
    *,
    profile: str = "ros2",
    chunk_bytes: int = 1 << 14,
    summary: bool = True,
    index: IndexType = IndexType.ALL,
) -> None:
    """A file by the library of MCAP; no chunks at 0 bytes, without its summary on demand."""
    with path.open("wb") as stream:
        writer = McapWriter(
            stream,
            chunk_size=chunk_bytes or 1 << 20,
            compression=CompressionType.ZSTD,
            use_chunking=chunk_bytes > 0,
            index_types=index if summary else IndexType.NONE,
            repeat_channels=summary,
            repeat_schemas=summary,
            use_statistics=summary,
            use_summary_offsets=summary,
        )
        writer.start(profile=profile, library="foreign")
        channels = {}
        for name, kind in topics.items():
            has_schema = name != SCHEMALESS and bool(kind.type or kind.schema)
            schema = (
                writer.register_schema(
                    kind.type, kind.schema.replace("unknown", ""), kind.definition
                )
                if has_schema
                else 0
            )
            metadata = {"offered_qos_profiles": ""}
            channels[name] = writer.register_channel(name, kind.form, schema, metadata)
        for number, one in enumerate(messages):
            writer.add_message(channels[one.topic], one.log_ns, one.raw, one.log_ns, number)
        writer.finish()


_TABLES = {
    # Foxy before QoS was written; Foxy and Galactic; Humble; Iron and later.
    1: "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
    " serialization_format TEXT NOT NULL);",
    2: "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
    " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);",
}
_TABLES[3] = (
    "CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);"
    "CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL,"
    " metadata TEXT NOT NULL);" + _TABLES[2] + "INSERT INTO schema VALUES (3, 'humble');"
)
_TABLES[4] = (
    _TABLES[3].replace("(3, 'humble')", "(4, 'jazzy')").replace(
        "offered_qos_profiles TEXT NOT NULL",
        "offered_qos_profiles TEXT NOT NULL, type_description_hash TEXT NOT NULL",
    )
    + "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL,"
    " encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL,"
    " type_description_hash TEXT NOT NULL);"
)  # fmt: skip
SQLITE_VERSIONS = tuple(_TABLES)


def write_sqlite(
    path: Path, topics: Mapping[str, Kind], messages: Iterable[Sent], version: int = 4
) -> None:
    """A database of one of the versions of rosbag2's tables."""
    database = sqlite3.connect(path)
    database.executescript(
        _TABLES[version]
        + "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,"
        " timestamp INTEGER NOT NULL, data BLOB NOT NULL);"
        "CREATE INDEX timestamp_idx ON messages (timestamp ASC);"
    )
    numbers = {name: number for number, name in enumerate(topics, 1)}
    more = {1: (), 2: ("",), 3: ("",), 4: ("", "")}[version]
    for name, kind in topics.items():
        row = (numbers[name], name, kind.type, kind.form, *more)
        database.execute(f"INSERT INTO topics VALUES ({','.join('?' * len(row))})", row)
        if version == 4:
            text = kind.definition.decode(errors="replace")
            database.execute(
                "INSERT INTO message_definitions(topic_type, encoding, encoded_message_definition,"
                " type_description_hash) VALUES (?, ?, ?, '')",
                (kind.type, kind.schema, text),
            )
    database.executemany(
        "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)",
        [(numbers[one.topic], one.log_ns, one.raw) for one in messages],
    )
    if version >= 3:
        # The last that is written.
        database.execute("INSERT INTO metadata(metadata_version, metadata) VALUES (5, '')")
    database.commit()
    database.close()


_QOS = {
    "history": "keep_last", "depth": 10, "reliability": "reliable", "durability": "volatile",
    "deadline": {"sec": 0, "nsec": 0}, "lifespan": {"sec": 0, "nsec": 0},
    "liveliness": "automatic", "liveliness_lease_duration": {"sec": 0, "nsec": 0},
    "avoid_ros_namespace_conventions": False,
}  # fmt: skip
_QOS_NUMBERS = _QOS | {"history": 1, "reliability": 1, "durability": 2, "liveliness": 1}
METADATA_VERSIONS = range(1, 10)


def metadata(
    version: int, storage: str, files: Sequence[str], topics: Mapping[str, Kind],
    messages: Sequence[Sent],
) -> dict[str, Any]:  # fmt: skip
    """Content of metadata.yaml of a version, below its first key."""
    times = [one.log_ns for one in messages] or [0]
    counts = {name: sum(one.topic == name for one in messages) for name in topics}

    def topic(name: str, kind: Kind) -> dict[str, Any]:
        row: dict[str, Any] = {
            "name": name, "type": kind.type, "serialization_format": kind.form,
        }  # fmt: skip
        if version >= 4:
            text = yaml.safe_dump([_QOS_NUMBERS])
            row["offered_qos_profiles"] = [_QOS] if version >= 9 else text
        if version >= 7:
            row["type_description_hash"] = ""
        return row

    about: dict[str, Any] = {
        "version": version,
        "storage_identifier": storage,
        "relative_file_paths": list(files),
        "duration": {"nanoseconds": max(times) - min(times)},
        "starting_time": {"nanoseconds_since_epoch": min(times)},
        "message_count": len(messages),
        "topics_with_message_count": [
            {"topic_metadata": topic(name, kind), "message_count": counts[name]}
            for name, kind in topics.items()
        ],
    }
    if version >= 3:
        about |= {"compression_format": "", "compression_mode": ""}
    if version >= 5:
        about["files"] = [
            {
                "path": file, "starting_time": about["starting_time"],
                "duration": about["duration"], "message_count": len(messages),
            }
            for file in files
        ]  # fmt: skip
    if version >= 6:
        about["custom_data"] = None
    if version >= 8:
        about["ros_distro"] = "jazzy"
    return about


class _Plain(yaml.SafeDumper):
    """Writes what is there twice twice, as C++ does."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def write_metadata(folder: Path, about: Mapping[str, Any]) -> None:
    """metadata.yaml of a bag."""
    content = {"rosbag2_bagfile_information": dict(about)}
    text = yaml.dump(content, Dumper=_Plain, sort_keys=False)
    (folder / "metadata.yaml").write_text(text, encoding="utf-8")


def write_bag(
    folder: Path, topics: Mapping[str, Kind], messages: Sequence[Sent], storage: str, **how: Any
) -> Path:
    """A bag: `mcap`, or `sqlite3` of a version (`version=`); metadata.yaml of `metadata=`."""
    folder.mkdir(parents=True)
    about = how.pop("metadata_version", 9)
    if storage == "mcap":
        write_mcap(folder / "bag_0.mcap", topics, messages, **how)
    else:
        write_sqlite(folder / "bag_0.db3", topics, messages, **how)
    (file,) = folder.iterdir()
    write_metadata(folder, metadata(about, storage, [file.name], topics, messages))
    return folder
