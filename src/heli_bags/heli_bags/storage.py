# SPDX-License-Identifier: Apache-2.0
"""What a bag's bytes expand to, within the budget.

What is above it is a FileError (`heli_core.foreign_files`).
"""

import contextlib
import os
import struct
import tempfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import lz4.frame
import yaml
import zstandard

from heli_bags.writer import METADATA, SUFFIXES
from heli_core.foreign_files import (
    FileCause,
    FileError,
    budget_bytes,
    open_regular,
    read_yaml,
    too_large,
    within_budget,
)

PACKED = ".zstd"
"""Behind the name of a file that was compressed as a whole."""
MESSAGE_SHARE = 8
"""A message that is taken apart has this part of the budget: its fields are objects."""
# What a record of a chunk costs beside its bytes.
_RECORD_BYTES = 100
# What is kept of a message beside its numbers.
_ROW_BYTES = 256
_HEAD = struct.Struct("<BQ")
MOST_TOPICS, MOST_DEFINITIONS = 4096, 1 << 21
_PIECE = 1 << 20
# What a file may become on the disk: bags' own data become a tenth, zeros a thirty-thousandth.
_MOST_RATIO = 16


def storage_of(path: Path) -> str:
    """Suffix of a storage file, `.mcap` or `.db3`, also of a compressed one; empty for others."""
    suffix = Path(path.stem).suffix if path.suffix == PACKED else path.suffix
    return suffix if suffix in SUFFIXES.values() else ""


def most_expanded(size: int) -> int:
    """Bytes that compressed data of a size may become, on the disk or one after the other."""
    return max(budget_bytes(), _MOST_RATIO * size)


class Kept:
    """How much of a bag's messages is kept: a few bytes may expand to any number of messages.

    Parameters
    ----------
    bag : Path
        Folder or file.
    """

    def __init__(self, bag: Path) -> None:
        files = [bag] if bag.is_file() else [path for path in bag.iterdir() if storage_of(path)]
        self._left = most_expanded(sum(file.stat().st_size for file in files))

    def keep(self, size: int) -> None:
        """Count a message of a size, bytes; raises FileError above what a bag may become."""
        self._left -= size + _ROW_BYTES
        if self._left < 0:
            raise too_large("what is kept of its messages")


# -------------------------------------------------------------------------------------------------
# Decompression.
# -------------------------------------------------------------------------------------------------


def _zstd() -> zstandard.ZstdDecompressor:
    # A window is memory, too.
    return zstandard.ZstdDecompressor(max_window_size=max(1 << 10, budget_bytes()))


def _of_zstd(data: bytes, most: int) -> bytes:
    with _zstd().stream_reader(data, read_across_frames=True) as stream:
        return stream.read(most)


def _of_lz4(data: bytes, most: int) -> bytes:
    return lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most)


EXPANDERS = {"": lambda data, most: data, "zstd": _of_zstd, "lz4": _of_lz4}


def chunk_content(data: bytes, compression: str, size: int, crc: int = 0) -> bytes:
    """Uncompressed content of an MCAP chunk.

    Parameters
    ----------
    data : bytes
    compression : str
        Empty, "lz4" or "zstd".
    size : int
        Bytes that the chunk says it has.
    crc : int
        CRC-32 of the content; 0 for none.

    Raises
    ------
    FileError
        Above the budget, of another size or sum than it says, or of another compression; the
        libraries raise what they raise on damaged bytes.
    """
    within_budget(size, "a chunk")
    if compression not in EXPANDERS:
        raise FileError(FileCause.SYNTAX, f"a chunk is compressed by {compression!r:.20}")
    content = EXPANDERS[compression](data, size + 1)
    if len(content) != size:
        raise FileError(FileCause.SYNTAX, f"a chunk has not the {size} bytes that it says")
    if crc and zlib.crc32(content) != crc:
        raise FileError(FileCause.SYNTAX, "a chunk has another checksum than it says")
    _check_records(content)
    return content


def _check_records(content: bytes) -> None:
    """Raise FileError for a chunk whose records, an object each, are above the budget."""
    left = budget_bytes() - len(content)
    most = left // _RECORD_BYTES
    if len(content) // _HEAD.size <= most:
        return
    at = count = 0
    while at + _HEAD.size <= len(content):
        at += _HEAD.size + _HEAD.unpack_from(content, at)[1]
        count += 1
        if count > most:
            raise too_large(f"a chunk of {len(content) / 2**20:.0f} MB in {count} records or more")


def expanded(data: bytes, most: int | None = None) -> bytes:
    """What a zstd frame holds, as far as it goes; raises FileError above the budget.

    Parameters
    ----------
    data : bytes
    most : int, optional
        Bytes; default: what a message may have.
    """
    limit = budget_bytes() // MESSAGE_SHARE if most is None else most
    content = bytearray()
    with _zstd().stream_reader(data) as stream:
        try:
            while len(content) <= limit and (piece := stream.read(min(_PIECE, limit + 1))):
                content += piece
        except zstandard.ZstdError:
            if not content:
                raise
    if len(content) > limit:
        raise too_large("a compressed message", most=limit)
    return bytes(content)


def checked_message(raw: bytes) -> bytes:
    """The bytes of a message that is to be taken apart; raises FileError if they are too many."""
    within_budget(len(raw), "a message", share=MESSAGE_SHARE)
    return raw


def expand_file(path: Path, to: Path, cut: bool = False) -> bool:
    """Expand a file that was compressed as a whole; True if it is whole.

    Parameters
    ----------
    path, to : Path
    cut : bool
        Take what there is of a damaged one.

    Raises
    ------
    FileError
        It becomes too large, or is damaged and not to be cut.
    """
    with open_regular(path) as packed, open(to, "wb") as plain:
        most, done = most_expanded(os.fstat(packed.fileno()).st_size), 0
        try:
            with _zstd().stream_reader(packed, read_across_frames=True, closefd=False) as stream:
                while piece := stream.read(_PIECE):
                    done += len(piece)
                    if done > most:
                        raise too_large("what it expands to", path, most)
                    plain.write(piece)
        except zstandard.ZstdError as error:
            if not cut:
                raise FileError(FileCause.SYNTAX, f"no zstd file: {error}", path) from None
            return False
    return True


# -------------------------------------------------------------------------------------------------
# A bag whose files were compressed as wholes (`ros2 bag record --compression-mode file`).
# -------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def unpacked(bag: Path) -> Iterator[Path]:
    """The bag itself, or a copy of one whose files are compressed; the copy is gone afterwards.

    Raises
    ------
    FileError
        metadata.yaml cannot be read, or a file is damaged or becomes too large.
    """
    if bag.is_file() and bag.suffix == PACKED:
        with tempfile.TemporaryDirectory(prefix="heli_bag_") as folder:
            plain = Path(folder) / bag.stem
            expand_file(bag, plain)
            yield plain
        return
    content = read_yaml(bag / METADATA) if bag.is_dir() else {}
    about = content.get("rosbag2_bagfile_information") if isinstance(content, dict) else None
    mode = about.get("compression_mode") if isinstance(about, dict) else None
    if not isinstance(about, dict) or str(mode).lower() != "file":
        yield bag
        return
    with tempfile.TemporaryDirectory(prefix="heli_bag_") as folder:
        _unpack(bag, Path(folder), about)
        yield Path(folder)


def _unpack(bag: Path, folder: Path, about: dict[str, Any]) -> None:
    if about.get("compression_format") != "zstd":
        problem = f"its files are compressed by {about.get('compression_format')!r:.20}"
        raise FileError(FileCause.SYNTAX, f"{problem}; allowed: zstd")
    listed = about.get("relative_file_paths")
    names = [Path(str(name)).name for name in listed] if isinstance(listed, list) else []
    if len(names) > MOST_TOPICS:
        raise FileError(FileCause.TOO_MANY, f"it lists {len(names)} files")
    for name in names:
        if name.endswith(PACKED):
            expand_file(bag / name, folder / Path(name).stem)
        else:
            os.symlink((bag / name).resolve(), folder / name)
    about = {**about, "compression_mode": "", "compression_format": ""}
    about["relative_file_paths"] = [name.removesuffix(PACKED) for name in names]
    text = yaml.safe_dump({"rosbag2_bagfile_information": about}, sort_keys=False)
    (folder / METADATA).write_text(text, encoding="utf-8")
