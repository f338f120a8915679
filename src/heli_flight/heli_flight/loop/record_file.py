# SPDX-License-Identifier: Apache-2.0
"""The record of a flight in a file: what a flight of one process leaves in the place of a bag."""

import zipfile
from dataclasses import fields
from pathlib import Path

import numpy as np

from heli_flight.errors import FlightError
from heli_flight.loop.record import FlightRecord

NAME = "record.npz"


def write_record(record: FlightRecord, folder: Path) -> Path:
    """Write the arrays of a record into a folder; what was not recorded is left out.

    Raises
    ------
    OSError
        The folder cannot be written.
    """
    arrays = {field.name: getattr(record, field.name) for field in fields(record)}
    path = folder / NAME
    with path.open("wb") as file:
        np.savez(file, **{name: array for name, array in arrays.items() if array is not None})
    return path


def read_record(path: Path) -> FlightRecord:
    """Read what `write_record` wrote.

    Raises
    ------
    FlightError
        The file cannot be read, or holds no record; one sentence.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        record = FlightRecord(**arrays)
    except (OSError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise FlightError(f"{path}: holds no record of a flight: {error}") from None
    wrong = [name for name, array in arrays.items() if array.shape[:1] != record.time_s.shape]
    if wrong or record.time_s.ndim != 1:
        raise FlightError(f"{path}: {wrong or 'time_s'} and time_s differ in length")
    return record
