# SPDX-License-Identifier: Apache-2.0
"""Flights that cost nothing, some of which end the process that flies them; workers import it."""

import contextlib
import os
import signal
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from heli_core.rcl_yaml import ParameterError
from heli_studies.campaign.spec import CAUSE, FILES_IN, NUMBER, FlightEnding


class Unsendable(Exception):
    """An error that pickles, and cannot be read again."""

    def __init__(self, one: str, other: str) -> None:
        super().__init__(f"{one} {other}")


@dataclass(frozen=True)
class DeadlyFlights:
    """A `FlightBatch`; what its flights do is written into a folder, a file a time.

    Attributes
    ----------
    folder : Path
    count, chunk : int
    deadly, once : frozenset of int
        Flights that end their process, each time or the first time.
    refused, unsendable : frozenset of int
        Flights that raise.
    waits : bool
        Whether flights do not end.
    """

    folder: Path
    count: int = 7
    chunk: int = 3
    deadly: frozenset[int] = frozenset()
    once: frozenset[int] = frozenset()
    refused: frozenset[int] = frozenset()
    unsendable: frozenset[int] = frozenset()
    waits: bool = False

    def fly(self, numbers: Sequence[int]) -> list[dict[str, Any]]:
        """Rows with the process that flew them."""
        return [self._row(number) for number in numbers]

    def _row(self, number: int) -> dict[str, Any]:
        times = 0
        while True:
            with contextlib.suppress(FileExistsError):
                (self.folder / f"{number}_{times}").touch(exist_ok=False)
                break
            times += 1
        if self.waits:
            (Path(os.environ[FILES_IN]) / f"left_by_{number}").touch()
            (self.folder / f"waits_{number}").touch()
            signal.pause()
        if number in self.deadly or (number in self.once and not times):
            os.kill(os.getpid(), signal.SIGKILL)
        if number in self.refused:
            raise ParameterError(f"flight {number}")
        if number in self.unsendable:
            raise Unsendable("flight", str(number))
        return {NUMBER: number, CAUSE: FlightEnding.FLOWN, "process": os.getpid()}

    def killed(self, number: int) -> dict[str, Any]:
        """Its row."""
        return {NUMBER: number, CAUSE: FlightEnding.KILLED}

    def times(self, number: int) -> int:
        """How often a flight was begun."""
        return len(list(self.folder.glob(f"{number}_*")))
