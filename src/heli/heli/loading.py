# SPDX-License-Identifier: Apache-2.0
"""`heli.load`: a flight that was recorded."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from heli.flight import Flight
from heli.options import split
from heli_flight.errors import FlightError
from heli_flight.loop.flight_file import NAME
from heli_flight.report import Choice, recorded
from heli_parameters.parameters import ParameterError


def load(
    path: str | os.PathLike[str],
    scenario: str | None = None,
    gps: str | None = None,
    seed: int | None = None,
    params: Any = None,
) -> Flight:
    """Read a flight: the folder of one (`heli hover`, `heli.fly(...).save()`), or a bag alone.

    Parameters
    ----------
    path : path
        Folder of a flight, of the graph or of one process, or a rosbag2 folder.
    scenario, gps, seed : optional
        What was flown, where it is not recorded beside the bag.
    params : path or sequence of paths, optional
        Parameter files it was flown with, where they are not beside the bag.

    Returns
    -------
    Flight

    Raises
    ------
    ParameterError, FlightError
        Each with one sentence that names the file.

    Examples
    --------
    >>> flight = heli.load("flights/my_flight")
    >>> flight.truth.altitude_m.max()
    """
    folder = Path(path)
    if not folder.exists():
        raise FlightError(f"{folder}: there is no such flight")
    files, over = split(params)
    if over:
        raise ParameterError("params: of a recorded flight; allowed: files")
    found = recorded(folder, Choice(scenario, gps, seed, files))
    return Flight(found, found.folder if (found.folder / NAME).is_file() else None)
