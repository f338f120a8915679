# SPDX-License-Identifier: Apache-2.0
"""ULog, the format of PX4's flight logs: tables written into one file. No ROS.

Source: https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_MAGIC, _VERSION = b"ULog\x01\x12\x35", 1
_NAMES = {"u8": "uint64_t", "u4": "uint32_t", "i4": "int32_t", "f4": "float", "b1": "bool"}
_HEAD = [("size", "<u2"), ("kind", "S1"), ("number", "<u2")]
_INT32 = 2**31


@dataclass(frozen=True)
class Table:
    """One topic of a log.

    Attributes
    ----------
    name : str
        Of the topic.
    fields : dict
        Name to (N,) or (N, size) array: bool, int32, uint32 or float32.
    present : (N,) ndarray of bool
        Rows that are written.
    """

    name: str
    fields: Mapping[str, NDArray[np.generic]]
    present: NDArray[np.bool_]


def ulog(
    time_us: NDArray[np.uint64],
    tables: Sequence[Table],
    infos: Mapping[str, str],
    parameters: Mapping[str, int | float],
) -> bytes:
    """Content of a log.

    Parameters
    ----------
    time_us : (N,) ndarray of uint64
        Times of all tables' rows, us, ascending.
    tables : sequence of Table
    infos : dict
        What is said of the whole log.
    parameters : dict
        An int outside int32 is written as a float, which has 24 bits.

    Returns
    -------
    bytes
    """
    first = int(time_us[0]) if time_us.size else 0
    parts = [_MAGIC, bytes([_VERSION]), struct.pack("<Q", first), _message(b"B", bytes(40))]
    for key, text in infos.items():
        raw = text.encode()
        parts.append(_message(b"I", _keyed(f"char[{len(raw)}] {key}") + raw))
    for key, value in parameters.items():
        whole = isinstance(value, int) and -_INT32 <= value < _INT32
        kind, code = ("int32_t", "<i") if whole else ("float", "<f")
        parts.append(_message(b"P", _keyed(f"{kind} {key}") + struct.pack(code, value)))
    blocks = [_block(number, table, time_us) for number, table in enumerate(tables)]
    for table, block in zip(tables, blocks, strict=True):
        parts.append(_message(b"F", _format(table.name, block.dtype)))
    for number, table in enumerate(tables):
        parts.append(_message(b"A", struct.pack("<BH", 0, number) + table.name.encode()))
    widths = [block.itemsize for block in blocks]
    raw_rows = [block.view(np.uint8).reshape(time_us.size, -1) for block in blocks]
    kept = np.repeat(np.column_stack([table.present for table in tables]), widths, axis=1)
    # Row by row, so that the messages of all topics are in the order of their times.
    parts.append(np.hstack(raw_rows)[kept].tobytes())
    return b"".join(parts)


def _message(kind: bytes, content: bytes) -> bytes:
    return struct.pack("<Hc", len(content), kind) + content


def _keyed(key: str) -> bytes:
    raw = key.encode()
    return bytes([len(raw)]) + raw


def _block(number: int, table: Table, time_us: NDArray[np.uint64]) -> NDArray[np.void]:
    """Data messages of a table, one per row."""
    columns = {"timestamp": time_us, **table.fields}
    layout = [(name, array.dtype, array.shape[1:]) for name, array in columns.items()]
    block = np.zeros(time_us.size, dtype=np.dtype([*_HEAD, *layout]))
    block["size"], block["kind"], block["number"] = block.itemsize - 3, b"D", number
    for name, array in columns.items():
        block[name] = array
    return block


def _format(name: str, dtype: np.dtype[np.void]) -> bytes:
    texts = []
    for column in (dtype.names or ())[len(_HEAD) :]:
        field = dtype[column]
        kind = _NAMES[field.base.str[1:]]
        size = f"[{field.shape[0]}]" if field.shape else ""
        texts.append(f"{kind}{size} {column};")
    return f"{name}:{''.join(texts)}".encode()
