# SPDX-License-Identifier: Apache-2.0
"""Small files that ask for much, and what each reader of foreign files makes of them.

`./heli python tests/support/bombs.py FOLDER GROUP ...` makes the files of each group, has every
reader of it read each, and prints a line of JSON for each pair: peak of memory, CPU time,
and the sentence of the refusal. A net under it all ends the process that asks for 3 GB.
"""

import contextlib
import ctypes
import gc
import json
import os
import resource
import shutil
import sqlite3
import struct
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import lz4.frame
import yaml

sys.path.insert(0, str(Path(__file__).parents[1]))

from heli_core.errors import FlightError, ParameterRefusal
from heli_core.foreign_files import BUDGET_MB, FileError

_NET = 3 << 30
_GB, _MB = 1 << 30, 1 << 20
_TB = 1 << 40
MILLIONS = 3_000_000

Make = Callable[[Path], object]
"""Makes the file of this name."""


@dataclass(frozen=True)
class Met:
    """What became of a bomb in a reader.

    Attributes
    ----------
    reader, bomb : str
    peak_mb : float
        Most memory that the process held meanwhile, all of the interpreter and libraries included.
    cpu_s : float
    refused : str
        The sentence; empty if it was read.
    wrong : str
        What was raised that is no refusal.
    """

    reader: str
    bomb: str
    peak_mb: float
    cpu_s: float
    refused: str
    wrong: str


# -------------------------------------------------------------------------------------------------
# Places that are no files, and holes.
# -------------------------------------------------------------------------------------------------


def _sparse(path: Path, head: bytes = b"", tail: bytes = b"") -> None:
    with path.open("wb") as file:
        file.write(head)
        file.seek(_TB - len(tail))
        file.write(tail)
        file.truncate(_TB)


ODD: dict[str, Make] = {
    "/dev/zero": lambda path: path.symlink_to("/dev/zero"),
    "FIFO": lambda path: os.mkfifo(path),
    "folder": lambda path: path.mkdir(),
    "sparse file of 1 TB": _sparse,
}


# -------------------------------------------------------------------------------------------------
# Texts.
# -------------------------------------------------------------------------------------------------


def _aliases(key: str = "a0") -> str:
    lines = [f"{key}: &a0 [x, x, x, x, x, x, x, x, x]"]
    for n in range(1, 12):
        lines.append(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]")
    return "\n".join(lines) + "\nset: *a11\n"


def _text(text: str) -> Make:
    return lambda path: path.write_text(text, encoding="utf-8")


TEXTS: dict[str, str] = {
    "aliases": _aliases(),
    "deep list": "a: " + "[" * 100_000,
    "deep mapping": "a: " + "{a: " * 100_000,
    "deep blocks": "\n".join(" " * n + "a:" for n in range(1000)),
    "long integer": f"flights: {'9' * _MB}",
    "long hexadecimal": f"flights: 0x{'f' * _MB}",
    "long sexagesimal": f"flights: 1{':59' * 300_000}",
    "long integer by its tag": f"flights: !!int '1{':59' * 300_000}'",
    "array of 3 million": f"set: [{'1,' * MILLIONS}]",
    "mapping of 300 thousand": "\n".join(f"k{n}: 1" for n in range(300_000)),
    "8 MB of a letter": f"set: {'x' * (8 * _MB)}",
}
JSONS: dict[str, str] = {
    "deep list": "[" * 100_000,
    "deep object": '{"a":' * 100_000,
    "long integer": f'{{"spec": {"9" * _MB}}}',
    "array of 3 million": f"[{'1,' * MILLIONS}1]",
    "lists of nothing": f"[{'[],' * MILLIONS}[]]",
}


# -------------------------------------------------------------------------------------------------
# Arrays.
# -------------------------------------------------------------------------------------------------


def _npy(claim: str, dtype: str = "<f8") -> bytes:
    head = f"{{'descr': {dtype!r}, 'fortran_order': False, 'shape': {claim}, }}".encode()
    head += b" " * (-(len(head) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head


def _deflated(head: bytes, zeros: int) -> bytes:
    """A deflate stream of a head and so many zeros, a thousandth of them."""
    press = zlib.compressobj(9, zlib.DEFLATED, -15)
    first = press.compress(head) + press.flush(zlib.Z_FULL_FLUSH)
    piece = press.compress(bytes(_MB)) + press.flush(zlib.Z_FULL_FLUSH)
    return first + piece * (zeros // _MB) + b"\x03\x00"


def _zip(path: Path, name: str, data: bytes, size: int, kind: int = 8) -> None:
    """A zip file of one member that says that it has a size."""
    sizes = struct.pack("<IIIHH", 0, len(data), size, len(name), 0)
    common = struct.pack("<HHHHH", 20, 0, kind, 0, 0) + sizes
    local = b"PK\x03\x04" + common + name.encode() + data
    central = b"PK\x01\x02\x14\x00" + common + struct.pack("<HHHII", 0, 0, 0, 0, 0) + name.encode()
    end = struct.pack("<HHHHIIH", 0, 0, 1, 1, len(central), len(local), 0)
    path.write_bytes(local + central + b"PK\x05\x06" + end)


def _npz_bomb(claim: str, zeros: int, size: int, dtype: str = "<f8") -> Make:
    head = _npy(claim, dtype)
    return lambda path: _zip(path, "time_s.npy", _deflated(head, zeros), size)


ARRAYS: dict[str, Make] = {
    "zip of 2 GB": _npz_bomb(f"({2 * _GB // 8},)", 2 * _GB, 2 * _GB + 128),
    "zip of 2 GB that says 1 MB": _npz_bomb(f"({2 * _GB // 8},)", 2 * _GB, _MB),
    "count that lies": _npz_bomb("(400000000000,)", _MB, _MB + 128),
    "count of nothing": _npz_bomb("(9000000000000000000,)", _MB, _MB + 128, "|V0"),
    "array of 3 million texts": _npz_bomb("(3000000,)", 2 * _GB, _GB, "<U1000"),
    "zip of lzma": lambda path: _zip(path, "time_s.npy", bytes(100), 1000, 14),
    "no zip": lambda path: path.write_bytes(bytes(1000)),
}


# -------------------------------------------------------------------------------------------------
# MCAP.
# -------------------------------------------------------------------------------------------------

_MAGIC = b"\x89MCAP0\r\n"
_RULE = "=" * 80
_ARRAY = f"""std_msgs/MultiArrayLayout layout
float64[] data
{_RULE}
MSG: std_msgs/MultiArrayLayout
std_msgs/MultiArrayDimension[] dim
uint32 data_offset
{_RULE}
MSG: std_msgs/MultiArrayDimension
string label
uint32 size
uint32 stride
"""


def zstd_zeros(size: int) -> bytes:
    """A zstd frame of so many zeros, 4 bytes for each 128 kB (RFC 8878, blocks of one byte)."""
    blocks = size // 131072
    one = (131072 << 3 | 1 << 1).to_bytes(3, "little") + b"\0"
    last = (1).to_bytes(3, "little")
    return b"\x28\xb5\x2f\xfd\x00\x38" + one * blocks + last


def lz4_zeros(size: int) -> bytes:
    """An LZ4 frame of so many zeros."""
    one = lz4.frame.compress(bytes(4 * _MB), block_size=7, block_linked=False, store_size=False)
    return one[:7] + one[7:-4] * (size // (4 * _MB)) + one[-4:]


def _record(opcode: int, *parts: bytes) -> bytes:
    body = b"".join(parts)
    return struct.pack("<BQ", opcode, len(body)) + body


def _string(text: str | bytes) -> bytes:
    raw = text if isinstance(text, bytes) else text.encode()
    return struct.pack("<I", len(raw)) + raw


@dataclass(frozen=True)
class Chunk:
    """A chunk, and the size that it says it has."""

    data: bytes
    size: int
    compression: str = ""
    start_ns: int = 1
    end_ns: int = 2


def message(data: bytes, stamp_ns: int = 1, channel: int = 1) -> bytes:
    """A record of a message."""
    return _record(5, struct.pack("<HIQQ", channel, 0, stamp_ns, stamp_ns), data)


def _channel(number: int, topic: str, qos: str) -> bytes:
    about = _string(_string("offered_qos_profiles") + _string(qos))
    return _record(4, struct.pack("<HH", number, 1), _string(topic), _string("cdr"), about)


def mcap(
    *chunks: Chunk,
    indexed: bool = True,
    definition: str = _ARRAY,
    qos: str = "",
    topics: int = 1,
    extra: bytes = b"",
    compressed_size: int | None = None,
    kind: str = "std_msgs/msg/Float64MultiArray",
    topic: str = "/chat",
) -> bytes:
    """A file of these chunks; its index says what it is told to."""
    schema = _record(
        3, struct.pack("<H", 1), _string(kind), _string("ros2msg"), _string(definition)
    )
    channels = b"".join(_channel(n + 1, f"{topic}{n or ''}", qos) for n in range(topics))
    out, index = _MAGIC + _record(1, _string("ros2"), _string("")) + schema + channels, []
    for chunk in chunks:
        times = struct.pack("<QQ", chunk.start_ns, chunk.end_ns)
        head = times + struct.pack("<QI", chunk.size, 0) + _string(chunk.compression)
        raw = _record(6, head, struct.pack("<Q", len(chunk.data)), chunk.data)
        told = len(chunk.data) if compressed_size is None else compressed_size
        counts = _record(7, struct.pack("<H", 1), _string(struct.pack("<QQ", 1, 0)))
        places = _string(struct.pack("<HQ", 1, len(out) + len(raw)))
        where = struct.pack("<QQ", len(out), len(raw)) + places + struct.pack("<Q", len(counts))
        sizes = struct.pack("<QQ", told, chunk.size)
        index.append(_record(8, times, where, _string(chunk.compression), sizes))
        out += raw + counts
    out += _record(15, bytes(4))
    at = len(out) if indexed else 0
    if indexed:
        statistics = struct.pack("<QHIIIIQQ", len(chunks), 1, topics, 0, 0, len(chunks), 1, 2)
        count = _string(struct.pack("<HQ", 1, len(chunks)))
        out += schema + channels + b"".join(index) + _record(11, statistics, count) + extra
    return out + _record(2, struct.pack("<QQI", at, 0, 0)) + _MAGIC


def _doubles(count: int, told: int | None = None) -> bytes:
    head = b"\0\1\0\0" + struct.pack("<III4x", 0, 0, count if told is None else told)
    return head + b"\1" * (8 * count)


def _zstd(data: bytes, size: int | None = None, **others: int) -> Chunk:
    import zstandard

    return Chunk(zstandard.compress(data), len(data) if size is None else size, "zstd", **others)


def _small_messages() -> bytes:
    return message(b"") * (BUDGET_MB * _MB // 40)


_QOS = "".join(
    f"- &a{n} [{', '.join([f'*a{n - 1}'] * 9) if n else 'x'}]\n" for n in range(10)
)  # fmt: skip

MCAPS: dict[str, Callable[[], bytes]] = {
    "zstd chunk of 6 GB": lambda: mcap(Chunk(zstd_zeros(6 * _GB), 6 * _GB, "zstd")),
    "zstd chunk of 6 GB that says 1 MB": lambda: mcap(Chunk(zstd_zeros(6 * _GB), _MB, "zstd")),
    "zstd chunk of 6 GB without an index": lambda: mcap(
        Chunk(zstd_zeros(6 * _GB), 6 * _GB, "zstd"), indexed=False
    ),
    "lz4 chunk of 1 GB": lambda: mcap(Chunk(lz4_zeros(_GB), _GB, "lz4")),
    "lz4 chunk of 1 GB that says 1 MB": lambda: mcap(Chunk(lz4_zeros(_GB), _MB, "lz4")),
    "chunk of millions of messages": lambda: mcap(_zstd(_small_messages())),
    "chunk of millions of records": lambda: mcap(Chunk(zstd_zeros(100 * _MB), 100 * _MB, "zstd")),
    "twenty chunks of a time": lambda: mcap(
        *[Chunk(zstd_zeros(100 * _MB), 100 * _MB, "zstd", 1, 100)] * 20
    ),
    "chunk that says it is larger than the file": lambda: mcap(
        Chunk(bytes(100), 100), compressed_size=1 << 62
    ),
    "record that says it is larger than the file": lambda: mcap(
        Chunk(b"", 0), extra=struct.pack("<BQ", 9, 1 << 62)
    ),
    "aliases in QoS": lambda: mcap(_zstd(message(_doubles(3))), qos=_QOS),
    "QoS of 300 thousand": lambda: mcap(
        _zstd(message(_doubles(3))), qos="- {history: 1}\n" * 300_000
    ),
    "ten thousand topics": lambda: mcap(_zstd(message(_doubles(3))), topics=10_000),
    "definition of 40 MB": lambda: mcap(
        _zstd(message(_doubles(3))), definition="float64 x\n" * (4 * _MB)
    ),
    "array of 3 million": lambda: mcap(_zstd(message(_doubles(MILLIONS)))),
    "array of 1 million": lambda: mcap(_zstd(message(_doubles(10**6)))),
    "array whose count lies": lambda: mcap(_zstd(message(_doubles(3, 2**32 - 1)))),
    "array of a constant length that lies": lambda: mcap(
        _zstd(message(_doubles(3))), definition="float64[900000000000] data\n"
    ),
    "chunk a little below the budget": lambda: mcap(
        _zstd(message(_doubles(120_000)) * (BUDGET_MB - 1))
    ),
    "message of 6 GB": lambda: mcap(_zstd(message(zstd_zeros(6 * _GB)))),
}


_CHAT = ("/chat", "std_msgs/msg/Float64MultiArray")


def _sparse_mcap(path: Path) -> None:
    whole = mcap(indexed=False)
    foot = len(_record(2, bytes(20))) + len(_MAGIC)
    _sparse(path, whole[:-foot], whole[-foot:])


def _diagnostics() -> bytes:
    """A chunk of statuses that hold thousands of pairs of short texts."""
    pairs = [_string(f"{n:03x}\0") + _string("v\0") + b"\0\0" for n in range(4000)]
    head = b"\0\1\0\0" + struct.pack("<iI", 1, 0) + _string(b"\0") + bytes(3)
    texts = b"".join(_string(text) for text in (b"/ab\0", b"mno\0", b"heli\0\0\0\0"))
    status = struct.pack("<I4x", 1) + texts + struct.pack("<I", len(pairs))
    one = message(head + status + b"".join(pairs))
    return mcap(
        _zstd(one * (60 * _MB // len(one))),
        kind="diagnostic_msgs/msg/DiagnosticArray", topic="/diagnostics", definition="uint8 x\n",
    )  # fmt: skip


def _metadata(
    folder: Path, file: str, storage: str, mode: str = "", topic: tuple[str, str] = _CHAT
) -> None:
    profile = {
        "name": topic[0], "type": topic[1], "serialization_format": "cdr",
        "offered_qos_profiles": [], "type_description_hash": "",
    }  # fmt: skip
    about = {
        "version": 9, "storage_identifier": storage, "duration": {"nanoseconds": 1},
        "starting_time": {"nanoseconds_since_epoch": 1}, "message_count": 1,
        "topics_with_message_count": [{"topic_metadata": profile, "message_count": 1}],
        "compression_format": "zstd" if mode else "", "compression_mode": mode,
        "relative_file_paths": [file], "files": [],
    }  # fmt: skip
    text = yaml.safe_dump({"rosbag2_bagfile_information": about})
    (folder / "metadata.yaml").write_text(text, encoding="utf-8")


# -------------------------------------------------------------------------------------------------
# SQLite.
# -------------------------------------------------------------------------------------------------

_TOPICS = (
    "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,"
    " offered_qos_profiles TEXT);"
    "INSERT INTO topics VALUES(1, '/chat', 'std_msgs/msg/Float64MultiArray', 'cdr', '');"
    "CREATE TABLE metadata(id INTEGER, metadata_version INTEGER, metadata TEXT);"
)
_MESSAGES = (
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
)
_ENDLESS = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT "
SQLS: dict[str, str] = {
    "messages that are a view without end": (
        f"{_TOPICS}CREATE VIEW messages AS {_ENDLESS}x id, 1 topic_id, x timestamp,"
        " zeroblob(1000) data FROM c;"
    ),
    "definitions that are a view without end": (
        f"{_TOPICS}{_MESSAGES}CREATE TABLE schema(schema_version INTEGER, ros_distro TEXT);"
        "INSERT INTO schema VALUES(4, 'jazzy');"
        f"CREATE VIEW message_definitions AS {_ENDLESS}x id, 'a' topic_type, 'ros2msg' encoding,"
        " 'float64 x' encoded_message_definition, '' type_description_hash FROM c;"
    ),
    "messages that are computed": (
        f"{_TOPICS}CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp"
        " INTEGER, data BLOB AS (zeroblob(900000000)));"
        "INSERT INTO messages(id, topic_id, timestamp) VALUES(1, 1, 1), (2, 1, 2), (3, 1, 3);"
    ),
    "aliases in QoS": _TOPICS.replace("'cdr', ''", f"'cdr', '{_QOS}'") + _MESSAGES,
}  # fmt: skip


def _database(sql: str) -> Make:
    def make(path: Path) -> None:
        with contextlib.closing(sqlite3.connect(path)) as database:
            database.executescript(sql)
            database.commit()

    return make


def _bags() -> dict[str, Make]:
    """By name what makes the folder of a bag."""

    def of_file(name: str, make: Make, mode: str = "") -> Make:
        def folder_of(path: Path) -> None:
            path.mkdir()
            make(path / name)
            storage = "sqlite3" if ".db3" in name else "mcap"
            _metadata(path, name, storage, mode)

        return folder_of

    def content(make: Callable[[], bytes]) -> Make:
        return lambda path: path.write_bytes(make())

    def of_metadata(make: Make) -> Make:
        def folder_of(path: Path) -> None:
            path.mkdir()
            (path / "x_0.mcap").write_bytes(mcap(_zstd(message(_doubles(3)))))
            make(path / "metadata.yaml")

        return folder_of

    bags = {f"mcap: {name}": of_file("x_0.mcap", content(make)) for name, make in MCAPS.items()}
    bags["mcap: message of 6 GB, compressed by itself"] = of_file(
        "x_0.mcap", content(MCAPS["message of 6 GB"]), "message"
    )
    bags["mcap: file of 6 GB, compressed as a whole"] = of_file(
        "x_0.mcap.zstd", content(lambda: zstd_zeros(6 * _GB)), "file"
    )
    bags["db3: file of 6 GB, compressed as a whole"] = of_file(
        "x_0.db3.zstd", content(lambda: zstd_zeros(6 * _GB)), "file"
    )
    bags["mcap: sparse file of 1 TB"] = of_file("x_0.mcap", _sparse_mcap)
    bags["db3: sparse file of 1 TB"] = of_file("x_0.db3", _sparse)
    bags |= {f"db3: {name}": of_file("x_0.db3", _database(sql)) for name, sql in SQLS.items()}
    for name in ("/dev/zero", "FIFO"):
        bags[f"file: {name}"] = of_file("x_0.mcap", ODD[name])
        bags[f"file of another name: {name}"] = of_file("x_0.bag", ODD[name])
    bags |= {f"metadata: {name}": of_metadata(make) for name, make in ODD.items()}
    bags |= {f"metadata: {name}": of_metadata(_text(text)) for name, text in TEXTS.items()}
    return bags


def _told(path: Path) -> None:
    """A bag of statuses, of which a report keeps every word."""
    path.mkdir()
    (path / "x_0.mcap").write_bytes(_diagnostics())
    topic = ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
    _metadata(path, "x_0.mcap", "mcap", topic=topic)


# -------------------------------------------------------------------------------------------------
# The table: groups of bombs, and who reads them.
# -------------------------------------------------------------------------------------------------

Read = Callable[[Path], object]


def _command(*words: str) -> Read:
    """A command in this process; ValueError with its sentence where it refuses."""

    def read(path: Path) -> None:
        from support.fuzz_files import run_command

        out = path.with_name("out")
        filled = [word.format(path=path, out=out) for word in words]
        try:
            sentence = run_command(*filled)
        finally:
            shutil.rmtree(out, ignore_errors=True)
        if sentence:
            raise ValueError(sentence)

    return read


def _parameters(path: Path) -> None:
    from heli_core.rcl_yaml import read

    read(path)


def _aircraft(path: Path) -> None:
    from heli_dynamics_sim.aircraft import HelicopterParameters

    HelicopterParameters.from_yaml(path)


def _campaign(path: Path) -> None:
    from heli_studies.campaign.spec import spec_of

    spec_of(path)


def _faults(path: Path) -> None:
    from heli_flight.flight_file import read_faults

    read_faults(path)


def _about(path: Path) -> None:
    from heli_studies.campaign.run import about_of

    about_of(path.parent)


def _result(path: Path) -> None:
    from heli_flight.report.write import _result_beside

    if not _result_beside(path.parent):
        raise ValueError("left out")


def _record_of(path: Path) -> None:
    from heli_flight.record import read_record

    read_record(path)


def _sums(path: Path) -> None:
    from heli_msgs_bridge.signatures import read_checksums

    read_checksums(path)


@dataclass(frozen=True)
class Group:
    """Bombs, and readers by name with the file's name that each wants."""

    bombs: Callable[[], dict[str, Make]]
    readers: dict[str, tuple[str, Read]]


def _yamls() -> dict[str, Make]:
    return ODD | {name: _text(text) for name, text in TEXTS.items()}


GROUPS: dict[str, Group] = {
    "yaml": Group(
        _yamls,
        {
            "parameters": ("p.yaml", _parameters),
            "aircraft": ("a.yaml", _aircraft),
            "campaign": ("c.yaml", _campaign),
            "faults": ("f.yaml", _faults),
        },
    ),
    "json": Group(
        lambda: ODD | {name: _text(text) for name, text in JSONS.items()},
        {"campaign.json": ("campaign.json", _about), "result.json": ("result.json", _result)},
    ),
    "arrays": Group(lambda: ODD | ARRAYS, {"record.npz": ("record.npz", _record_of)}),
    "sums": Group(lambda: ODD, {"truth.sums": ("truth.sums", _sums)}),
    "bags": Group(
        _bags,
        {
            "bag info": ("bag", _command("bag", "info", "{path}")),
            "bag csv": ("bag", _command("bag", "csv", "{path}", "--out", "{out}")),
        },
    ),
    "bags in full": Group(
        lambda: _bags() | {"mcap: millions of words in diagnostics": _told},
        {
            "bag echo": ("bag", _command("bag", "echo", "{path}", "/chat", "--full")),
            "bag repair": ("bag", _command("bag", "repair", "{path}", "--out", "{out}")),
            "report": ("bag", _command("report", "{path}", "--out", "{out}")),
            "score": ("bag", _command("score", "{path}", "--mte", "hover")),
        },
    ),
}
_REFUSALS = (FileError, ParameterRefusal, FlightError, ValueError)


def _peak_mb() -> float:
    for line in Path("/proc/self/status").read_text(encoding="utf-8").splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024
    raise RuntimeError("no VmHWM")


def _met(reader: str, read: Read, bomb: str, path: Path) -> Met:
    gc.collect()
    gc.freeze()
    ctypes.CDLL(None).malloc_trim(0)
    # From now on the peak is counted anew.
    Path("/proc/self/clear_refs").write_text("5", encoding="utf-8")
    begun, refused, wrong = time.process_time(), "", ""
    try:
        read(path)
    except _REFUSALS as error:
        refused = str(error)
    except BaseException as error:
        wrong = f"{type(error).__name__}: {error}"[:300]
    return Met(reader, bomb, _peak_mb(), time.process_time() - begun, refused, wrong)


def run(folder: Path, group: Group) -> Iterator[Met]:
    """Every reader of a group on every bomb of it."""
    for bomb, make in group.bombs().items():
        place = Path(tempfile.mkdtemp(dir=folder))
        for name, (file, read) in group.readers.items():
            if not os.path.lexists(place / file):
                make(place / file)
            yield _met(name, read, bomb, place / file)
        shutil.rmtree(place)


def main() -> None:
    """Print what became of the bombs of some groups."""
    resource.setrlimit(resource.RLIMIT_AS, (_NET, _NET))
    for name in sys.argv[2:]:
        for met in run(Path(sys.argv[1]), GROUPS[name]):
            print(json.dumps(asdict(met)), flush=True)


if __name__ == "__main__":
    main()
