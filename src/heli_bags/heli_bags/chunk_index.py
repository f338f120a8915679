# SPDX-License-Identifier: Apache-2.0
"""What an MCAP file's end says of its chunks, kept beside the file until then instead of in memory.

A chunk's record is some 400 bytes; in real time a flight closes five chunks a second, so a list
of them would grow by 7 MB an hour.
"""

import struct
import tempfile
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

_SIZE = struct.Struct("<I")
# Records in memory until they are moved out.
_RECENT = 64


class ChunkIndex:
    """Records of chunks, as a list that is only added to, read and cut; a file without a name.

    Parameters
    ----------
    folder : Path
        On whose disk it is.
    """

    def __init__(self, folder: Path) -> None:
        self._file = tempfile.TemporaryFile(dir=folder, buffering=0)
        self._end = self._moved = 0
        self._recent: list[bytes] = []

    def append(self, record: BytesIO) -> None:
        """Add a record; where the disk takes none, it stays in memory."""
        self._recent.append(record.getvalue())
        if len(self._recent) >= _RECENT:
            self._move()

    def _move(self) -> None:
        raw = b"".join(_SIZE.pack(len(one)) + one for one in self._recent)
        try:
            self._file.seek(self._end)
            written = self._file.write(raw)
        except OSError:
            return
        if written == len(raw):
            self._end += written
            self._moved += len(self._recent)
            self._recent.clear()

    def __len__(self) -> int:
        return self._moved + len(self._recent)

    def _records(self) -> Iterator[bytes]:
        self._file.seek(0)
        raw, at = self._file.read(self._end), 0
        while at < len(raw):
            (size,) = _SIZE.unpack_from(raw, at)
            at += _SIZE.size
            yield raw[at : at + size]
            at += size
        yield from self._recent

    def __iter__(self) -> Iterator[BytesIO]:
        """Records as the writer of an MCAP file takes them: at their end."""
        for one in self._records():
            record = BytesIO(one)
            record.seek(0, 2)
            yield record

    def __delitem__(self, beyond: slice) -> None:
        """Forget the records from a number on."""
        kept = list(self._records())
        del kept[beyond]
        self._recent, self._end, self._moved = kept, 0, 0

    def close(self) -> None:
        """Give the file back; once is enough."""
        self._file.close()
