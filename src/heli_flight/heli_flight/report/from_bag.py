# SPDX-License-Identifier: Apache-2.0
"""A recorded flight, and its report: the bag of the graph's own recorder, one of `ros2 bag record`,
or the record of a flight of one process."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from heli_bags.reader import Remark
from heli_flight.graph.bag_record import BagFlight, flight_from_bag, lost_with_law
from heli_flight.graph.plant_truth import judged_truth
from heli_flight.loop.flight_file import NAME
from heli_flight.loop.flight_section import ONE_PROCESS, flown
from heli_flight.loop.record import FlightRecord
from heli_flight.loop.record_file import NAME as RECORD
from heli_flight.loop.record_file import read_record
from heli_flight.loop.result import Result
from heli_flight.loop.scoring import score
from heli_flight.loop.settings import Settings, resolve
from heli_flight.report.bands import bands_of
from heli_flight.report.chart import Band
from heli_flight.report.data import Event, events_of
from heli_flight.report.write import write_report
from heli_parameters.parameters import ParameterError

STEPS = 2  # of a report: the bag read, the page written
_ERROR_LEVEL = 2


@dataclass(frozen=True)
class Choice:
    """What the user says of a bag's flight; what is None is looked for beside the bag."""

    scenario: str | None = None
    gps: str | None = None
    seed: int | None = None
    params: Sequence[Path] = ()


@dataclass(frozen=True)
class Recorded:
    """A flight as it was recorded.

    Attributes
    ----------
    record : FlightRecord
    settings : Settings
    result : Result
    folder : Path
        Where its report belongs.
    how : str
        How it was flown, a few words.
    events : sequence of Event
        Changes of the nodes' health.
    missing : sequence of str
        Sentences: what is not in the record, and what was taken instead.
    assumed : bool
        True if the settings are not known to be those of the flight.
    commit : str
        Of the sources that flew; empty if that is not recorded.
    remarks : sequence of Remark
        What the nodes said.
    """

    record: FlightRecord
    settings: Settings
    result: Result
    folder: Path
    how: str
    events: Sequence[Event] = ()
    missing: Sequence[str] = field(default=())
    assumed: bool = False
    commit: str = ""
    remarks: Sequence[Remark] = ()

    @property
    def bands(self) -> list[Band]:
        """Modes, faults, failsafes, health as they were recorded."""
        return bands_of(self.record, self.settings, self.remarks, self.events)


def recorded(path: Path, choice: Choice | None = None) -> Recorded:
    """Read a flight: its folder, or its bag.

    Parameters
    ----------
    path : Path
        rosbag2 folder, or the folder of a flight that holds `bag/` or `record.npz`.
    choice : Choice, optional

    Raises
    ------
    ParameterError, FlightError
        Each with one line that names the file.
    """
    choice = choice or Choice()
    if (path / RECORD).is_file() and not (path / "bag").is_dir():
        return _of_one_process(path, choice)
    bag = path / "bag" if (path / "bag").is_dir() else path
    beside = bag.resolve().parent
    told = _result_beside(beside)
    saved = beside / NAME
    known = bool(choice.params) or saved.is_file()
    settings = _settings(choice, told, saved)
    flight = flight_from_bag(bag, settings, truth_needed=False)
    record, missing = _completed(flight.record, settings)
    if flight.foreign:
        missing.append(f"Not of the graph, so not shown: {', '.join(flight.foreign)}.")
    if not known:
        missing.insert(
            0,
            "No params.yaml beside the bag and none given: the packaged parameters of scenario "
            f"{settings.scenario_name} were taken, so wind, seed, limits, scored phases and design "
            "may not be those of this flight.",
        )
    forged, unknown = judged_truth(flight, beside, settings.rate)
    missing += [unknown] if unknown else []
    return Recorded(
        record=record,
        settings=settings,
        result=replace(_result(record, settings, flight, told), forged=forged),
        folder=beside if saved.is_file() else bag.with_name(f"{bag.name}_report"),
        how=f"ROS 2 graph, {told['mode']}" if "mode" in told else "from a bag",
        events=events_of(flight.remarks, settings),
        missing=missing,
        assumed=not known,
        commit=str(told.get("commit", "")),
        remarks=flight.remarks,
    )


def _of_one_process(folder: Path, choice: Choice) -> Recorded:
    told = _result_beside(folder)
    settings = _settings(choice, told, folder / NAME)
    flight = BagFlight(read_record(folder / RECORD), (), ())
    result = _result(flight.record, settings, flight, told)
    known = bool(choice.params) or (folder / NAME).is_file()
    mode = told.get("mode", ONE_PROCESS)
    how = mode if mode == ONE_PROCESS else f"ROS 2 graph, {mode}"
    commit = str(told.get("commit", ""))
    return Recorded(flight.record, settings, result, folder, how, assumed=not known, commit=commit)


def report_of_bag(
    path: Path,
    choice: Choice | None = None,
    out: Path | None = None,
    progress: Callable[[int], None] = lambda done: None,
    figures: bool = False,
) -> Path:
    """Write the report of a recorded flight.

    Parameters
    ----------
    path : Path
        rosbag2 folder, or the folder of a flight.
    choice : Choice, optional
    out : Path, optional
        Folder for report.html; default: the flight's folder, or <bag>_report.
    progress : callable, optional
        Told how many of the `STEPS` are done.
    figures : bool
        True: also figures/, each chart as PNG and SVG.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    ParameterError, FlightError, OSError
        Each with one line that names the file.
    """
    flight = recorded(path, choice)
    progress(1)
    page = report_of(flight, out, figures)
    progress(STEPS)
    return page


def report_of(
    flight: Recorded,
    out: Path | None = None,
    figures: bool = False,
    drawn: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """The same of a flight that has been read; `drawn` as of `write_report`.

    Raises
    ------
    OSError
        The folder cannot be written.
    """
    folder = out or flight.folder
    folder.mkdir(parents=True, exist_ok=True)
    return write_report(
        flight.record,
        flight.settings,
        flight.result,
        folder,
        flight.how,
        flight.events,
        flight.missing,
        flight.assumed,
        figures,
        commit=flight.commit,
        remarks=flight.remarks,
        drawn=drawn,
    )


def told_beside(
    folder: Path, choice: Choice | None = None
) -> tuple[dict[str, Any], Settings, bool]:
    """What lies beside a record: result.json's content, the settings, whether these are known.

    Raises
    ------
    ParameterError
        Of the user's choice, or of params.yaml; one line that names the file.
    """
    choice, saved = choice or Choice(), folder / NAME
    told = _result_beside(folder)
    return told, _settings(choice, told, saved), bool(choice.params) or saved.is_file()


def _result_beside(folder: Path) -> dict[str, Any]:
    """Content of result.json beside the bag, empty if there is none that can be read."""
    try:
        content = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _settings(choice: Choice, told: dict[str, Any], saved: Path) -> Settings:
    """Resolved parameters: the user's choice, else what lies beside the bag, else the packaged."""
    files = [*([saved] if saved.is_file() else []), *choice.params]
    # A file written before it said what was flown has the flight's result beside it.
    known = flown(files)
    scenario = choice.scenario or (None if "scenario" in known else told.get("scenario"))
    gps = choice.gps or (None if "gps" in known else told.get("gps"))
    try:
        return resolve(scenario, gps, choice.seed, params=files)
    except ParameterError:
        if choice.scenario is None and choice.gps is None and told:
            # A scenario that this installation does not know: its parameters are in the file.
            return resolve("hover", "standalone", choice.seed, params=files)
        raise


def _completed(record: FlightRecord, settings: Settings) -> tuple[FlightRecord, list[str]]:
    """The record with the scenario's reference where none was recorded, and what is missing."""
    missing = []
    parts = (
        (record.truth_pos_ned_m, "ground truth: no errors of the estimates, no scores from truth"),
        (record.nav_pos_ned_m, "odom: nothing can be scored as the paper did"),
        (record.wind_ned_mps, "wind: it is not shown"),
        (record.u, "actuators: they are not shown"),
        (record.setpoint, "attitude setpoint: attitude errors are not shown"),
    )
    for array, words in parts:
        if not np.isfinite(array).any():
            missing.append(f"The bag holds no {words}.")
    if not np.isfinite(record.reference).any():
        way = settings.scenario.reference
        rate = settings.rate
        ticks = np.round(record.time_s * rate.hz).astype(int).tolist()
        rows = [way.at(tick * rate.tick_ns) for tick in ticks]
        record = replace(record, reference=np.array(rows))
        missing.append(
            f"The bag holds no reference: that of scenario {settings.scenario_name} was taken."
        )
    return record, missing


def _result(
    record: FlightRecord, settings: Settings, flight: BagFlight, told: dict[str, Any]
) -> Result:
    figures = score(record, settings.scenario).finite()
    said = [r for r in flight.remarks if r.node == "plant" and r.level >= _ERROR_LEVEL]
    fallen = said[-1].message if said else ""
    lost = told.get("lost", lost_with_law(fallen, (r.facts for r in flight.remarks)))
    flown = float(record.time_s[-1] - record.time_s[0]) + settings.rate.tick_s
    wall = told.get("wall_s")
    wall_s = float(wall) if isinstance(wall, int | float) else math.nan
    notes = tuple(map(str, told.get("notes", ())))
    partial = str(told.get("partial", ""))
    return Result(figures, str(lost), flown, wall_s, notes, flight.aircraft, partial=partial)
