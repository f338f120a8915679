# SPDX-License-Identifier: Apache-2.0
"""The report of a flight that has just ended: the page at once, its figures after it."""

import shutil
from collections.abc import Callable
from pathlib import Path

from heli_flight import interrupts
from heli_flight.loop.flight_section import ONE_PROCESS
from heli_flight.loop.settings import Settings
from heli_flight.studies.one_process import Flown
from heli_flight.terminal import in_turn


def report_of_flight(
    flight: Flown, settings: Settings, folder: Path, say: Callable[[str], None], figures: bool
) -> None:
    """Write the report and say where it is; a disk that is full costs the report, not the flight.

    Parameters
    ----------
    flight : Flown
    settings : Settings
        What was flown.
    folder : Path
        The flight's.
    say : callable
        Prints a line.
    figures : bool
        Whether to write the page's charts as files, too; their progress goes to stderr.
    """
    from heli_flight.report import FIGURES, PAGE, events_of, write_report

    mode = flight.extra["mode"]
    how = mode if mode == ONE_PROCESS else f"ROS 2 graph, {mode}"
    how += ", its nodes in one process" if flight.extra.get("composed") else ""
    events, said = events_of(flight.remarks, settings), f"report: {folder / PAGE}"
    try:
        with interrupts.told(), in_turn() as tell:

            def drawn(done: int, total: int) -> None:
                # The page is there before the first of its figures.
                if done == 0:
                    say(said)
                tell("figures", done, total)

            write_report(
                flight.record, settings, flight.result, folder, how, events, figures=figures,
                remarks=flight.remarks, drawn=drawn,
            )  # fmt: skip
    except OSError as error:
        say(f"no report: {error}")
        return
    except KeyboardInterrupt:
        (folder / PAGE).unlink(missing_ok=True)
        shutil.rmtree(folder / FIGURES, ignore_errors=True)
        raise
    if not figures:
        say(said)
