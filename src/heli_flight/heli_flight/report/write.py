# SPDX-License-Identifier: Apache-2.0
"""Writes report.html of a flight, and figures/ where they are asked for."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_bags.reader import Remark
from heli_bags.tools import LogTopic, ulog
from heli_core.folders import write_whole
from heli_core.foreign_files import FileError, read_json
from heli_core.rcl_yaml import ParameterError
from heli_core.rotations import quat_from_euler
from heli_core.rows import IMU, REFERENCE
from heli_core.ticks import Rate, ticks_in
from heli_flight import loop as closed_loop
from heli_flight.flight_file import NAME
from heli_flight.graph.bag_record import BagFlight, flight_from_bag, judged_truth, lost_with_law
from heli_flight.layers import AUTOPILOTS, ONE_PROCESS, section_of
from heli_flight.record import NAME as RECORD
from heli_flight.record import FlightRecord, read_record
from heli_flight.report.charts import (
    design_charts,
    flight_charts,
    flown_design,
    paper_charts,
    path_charts,
    timeline_charts,
)
from heli_flight.report.data import (
    Band,
    DiagnosticEvent,
    Report,
    Rival,
    bands_of,
    events_of,
    with_bands,
)
from heli_flight.report.first_screen import SECTION as FIRST
from heli_flight.report.first_screen import charts_of as first_charts
from heli_flight.report.page import render
from heli_flight.report.spectra import spectra_of, spectrum_charts
from heli_flight.result import Result
from heli_flight.scoring import Figures, score
from heli_flight.settings import Settings, resolve, sources_commit, without_own

# -------------------------------------------------------------------------------------------------
# Write.
# -------------------------------------------------------------------------------------------------

PAGE = "report.html"
FIGURES = "figures"


def write_report(
    record: FlightRecord,
    settings: Settings,
    result: Result,
    folder: Path,
    how: str = "one process",
    events: Sequence[DiagnosticEvent] = (),
    missing: Sequence[str] = (),
    assumed: bool = False,
    figures: bool = False,
    commit: str | None = None,
    remarks: Sequence[Remark] = (),
    drawn: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Write report.html, and if asked for figures/*.png, *.svg, into a folder.

    Parameters
    ----------
    record : FlightRecord
        NaN stands for what was not recorded.
    settings : Settings
        Resolved parameters of the flight.
    result : Result
    folder : Path
        Must exist.
    how : str
        How it was flown, a few words.
    events : sequence of DiagnosticEvent
        Changes of the nodes' health.
    missing : sequence of str
        Sentences: what is not in the record, and what was taken instead.
    assumed : bool
        True if the settings are not known to be those of the flight.
    figures : bool
        True: the page's charts also as files for a paper, which takes far longer than the page.
    commit : str, optional
        Of the sources that flew, empty if it was not recorded; default: of these.
    remarks : sequence of Remark
        What the nodes said, for the faults that were given in flight.
    drawn : callable, optional
        Told how many figures are drawn, and of how many; the page is written before the first.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    OSError
        The folder cannot be written.
    """
    rival = _rival(settings) if settings.scenario.kind == "attitude" else None
    commit = sources_commit() if commit is None else commit
    bands = bands_of(record, settings, remarks, events)
    report = Report(
        record, settings, result, how, events, rival, tuple(missing), assumed, commit, bands
    )
    design = flown_design(settings)
    charts = [*first_charts(report), *paper_charts(report), *path_charts(report)]
    charts += flight_charts(report)
    if design is not None:
        charts += design_charts(design)
    charts += timeline_charts(report)
    spectra = spectra_of(report)
    charts += spectrum_charts(report, spectra, design)
    charts = with_bands([chart for chart in charts if chart.has_data], bands)
    page = folder / PAGE
    text = render(report, charts, design, spectra, files=figures, folder=folder)
    write_whole(page, text)
    if figures:
        # matplotlib takes half a second to import.
        from heli_flight.report.figures import write_figures

        # The first screen's two are small ones of others.
        whole = [chart for chart in charts if chart.section != FIRST]
        write_figures(whole, report.conditions, folder / FIGURES, drawn)
    return page


def _rival(settings: Settings) -> Rival:
    """The same flight in one process under PID; if PID has flown under output feedback."""
    inner = settings.nodes["inner_loop"]
    law = "hinf_output" if inner["controller"] == "pid" else "pid"
    nodes = {**settings.nodes, "inner_loop": {**inner, "controller": law}}
    # As long as it was ordered, however long the record is.
    n_ticks = ticks_in(settings.scenario_parameters["duration_s"])
    scenario = replace(settings.scenario, n_ticks=n_ticks)
    flight = closed_loop.simulate(without_own(replace(settings, nodes=nodes, scenario=scenario)))
    figures = score(flight.record, settings.scenario, settings.rate)
    return Rival(law, flight.record, figures, flight.sentence)


# -------------------------------------------------------------------------------------------------
# A recorded flight, and its report: the bag of the graph's own recorder, one of `ros2 bag record`,
#
# or the record of a flight of one process.
# -------------------------------------------------------------------------------------------------

STEPS = 2  # of a report: the bag read, the page written
_ERROR_LEVEL = 2


@dataclass(frozen=True)
class BagChoice:
    """What the user says of a bag's flight; what is None is looked for beside the bag."""

    scenario: str | None = None
    gps: str | None = None
    seed: int | None = None
    params: Sequence[Path] = ()
    flight: int | None = None
    """Which one of a bag whose clock goes back, from 1 on; None: the last."""


@dataclass(frozen=True)
class RecordedFlight:
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
    events : sequence of DiagnosticEvent
        Changes of the nodes' health.
    missing : sequence of str
        Sentences: what is not in the record, and what was taken instead.
    assumed : bool
        True if the settings are not known to be those of the flight.
    commit : str
        Of the sources that flew; empty if that is not recorded.
    remarks : sequence of Remark
        What the nodes said.
    bag_notes : sequence of str
        Of `missing`, what to know of the bag: which flight was read, what could not be.
    """

    record: FlightRecord
    settings: Settings
    result: Result
    folder: Path
    how: str
    events: Sequence[DiagnosticEvent] = ()
    missing: Sequence[str] = field(default=())
    assumed: bool = False
    commit: str = ""
    remarks: Sequence[Remark] = ()
    bag_notes: Sequence[str] = ()

    @property
    def bands(self) -> list[Band]:
        """Modes, faults, failsafes, health as they were recorded."""
        return bands_of(self.record, self.settings, self.remarks, self.events)


def recorded(path: Path, choice: BagChoice | None = None) -> RecordedFlight:
    """Read a flight: its folder, or its bag.

    Parameters
    ----------
    path : Path
        rosbag2 folder, or the folder of a flight that holds `bag/` or `record.npz`.
    choice : BagChoice, optional

    Raises
    ------
    ParameterError, FlightError
        Each with one line that names the file.
    """
    choice = choice or BagChoice()
    if (path / RECORD).is_file() and not (path / "bag").is_dir():
        return _of_one_process(path, choice)
    bag = path / "bag" if (path / "bag").is_dir() else path
    beside = bag.resolve().parent
    result_json = _result_beside(beside)
    saved = beside / NAME
    known = bool(choice.params) or saved.is_file()
    settings = _settings(choice, result_json, saved)
    flight = flight_from_bag(bag, settings, truth_needed=False, flight=choice.flight)
    record, missing = _completed(flight.record, settings)
    missing += [f"The bag: {note}." for note in flight.notes]
    if flight.foreign:
        missing.append(f"Not of the graph, so not shown: {', '.join(flight.foreign)}.")
    if not known:
        missing.insert(
            0,
            "No params.yaml beside the bag and none given: the packaged parameters of scenario "
            f"{settings.scenario_name} were taken, so wind, seed, limits, scored phases and design "
            "may not be those of this flight.",
        )
        settings = _cut_to_record(settings, record)
    forged, unknown = judged_truth(flight, beside, settings.rate)
    missing += [unknown] if unknown else []
    return RecordedFlight(
        record=record,
        settings=settings,
        result=replace(_result(record, settings, flight, result_json), forged=forged),
        folder=beside if saved.is_file() else bag.with_name(f"{bag.name}_report"),
        how=_how(result_json),
        events=events_of(flight.remarks, settings),
        missing=missing,
        assumed=not known,
        commit=str(result_json.get("commit", "")),
        remarks=flight.remarks,
        bag_notes=flight.notes,
    )


def _how(result_json: Mapping[str, Any]) -> str:
    """How a flight with a bag was flown, as far as its result says so."""
    if (autopilot := AUTOPILOTS.get(str(result_json.get("mode")))) is not None:
        return f"by {autopilot}"
    return f"ROS 2 graph, {result_json['mode']}" if "mode" in result_json else "from a bag"


def _of_one_process(folder: Path, choice: BagChoice) -> RecordedFlight:
    result_json = _result_beside(folder)
    settings = _settings(choice, result_json, folder / NAME)
    flight = BagFlight(read_record(folder / RECORD), (), ())
    known = bool(choice.params) or (folder / NAME).is_file()
    settings = settings if known else _cut_to_record(settings, flight.record)
    result = _result(flight.record, settings, flight, result_json)
    mode = result_json.get("mode", ONE_PROCESS)
    how = mode if mode == ONE_PROCESS else f"ROS 2 graph, {mode}"
    commit = str(result_json.get("commit", ""))
    return RecordedFlight(
        flight.record, settings, result, folder, how, assumed=not known, commit=commit
    )


def report_of_bag(
    path: Path,
    choice: BagChoice | None = None,
    out: Path | None = None,
    progress: Callable[[int], None] = lambda done: None,
    figures: bool = False,
) -> Path:
    """Write the report of a recorded flight.

    Parameters
    ----------
    path : Path
        rosbag2 folder, or the folder of a flight.
    choice : BagChoice, optional
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
    flight: RecordedFlight,
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


def with_process_events(
    folder: Path, choice: BagChoice | None = None
) -> tuple[dict[str, Any], Settings, bool]:
    """What lies beside a record: result.json's content, the settings, whether these are known.

    Raises
    ------
    ParameterError
        Of the user's choice, or of params.yaml; one line that names the file.
    """
    choice, saved = choice or BagChoice(), folder / NAME
    result_json = _result_beside(folder)
    return (
        result_json,
        _settings(choice, result_json, saved),
        bool(choice.params) or saved.is_file(),
    )


def _result_beside(folder: Path) -> dict[str, Any]:
    """Content of result.json beside the bag, empty if there is none that can be read."""
    try:
        content = read_json(folder / "result.json")
    except FileError:
        return {}
    return content if isinstance(content, dict) else {}


def _settings(choice: BagChoice, result_json: dict[str, Any], saved: Path) -> Settings:
    """Resolved parameters: the user's choice, else what lies beside the bag, else the packaged."""
    files = [*([saved] if saved.is_file() else []), *choice.params]
    # A file written before it said what was flown has the flight's result beside it.
    known = section_of(files)
    scenario = choice.scenario or (None if "scenario" in known else result_json.get("scenario"))
    gps = choice.gps or (None if "gps" in known else result_json.get("gps"))
    try:
        return resolve(scenario, gps, choice.seed, params=files)
    except ParameterError:
        if choice.scenario is None and choice.gps is None and result_json:
            # A scenario that this installation does not know: its parameters are in the file.
            return resolve("hover", "standalone", choice.seed, params=files)
        raise


def _cut_to_record(settings: Settings, record: FlightRecord) -> Settings:
    """Settings of a flight that begins and ends with its record: nobody knows its order."""
    begin_s, end_s = float(record.time_s[0]), float(record.time_s[-1]) + settings.rate.tick_s
    return replace(settings, scenario=settings.scenario.cut_to(begin_s, end_s))


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
    if (autopilot := AUTOPILOTS.get(settings.mode)) is not None:
        missing.append(f"What {autopilot} wanted is not in its protocol: no reference is shown.")
    elif not np.isfinite(record.reference).any():
        trajectory = settings.scenario.reference
        rate = settings.rate
        ticks = np.round(record.time_s * rate.hz).astype(int).tolist()
        rows = [trajectory.at(tick * rate.tick_ns) for tick in ticks]
        record = replace(record, reference=np.array(rows))
        missing.append(
            f"The bag holds no reference: that of scenario {settings.scenario_name} was taken."
        )
    return record, missing


def _result(
    record: FlightRecord, settings: Settings, flight: BagFlight, result_json: dict[str, Any]
) -> Result:
    # Where another autopilot wanted to be, and where it believed to be, nobody has told.
    told = settings.mode not in AUTOPILOTS
    figures = score(record, settings.scenario, settings.rate) if told else Figures()
    plant_errors = [r for r in flight.remarks if r.node == "plant" and r.level >= _ERROR_LEVEL]
    fallen = plant_errors[-1].message if plant_errors else ""
    lost = result_json.get("lost", lost_with_law(fallen, (r.facts for r in flight.remarks)))
    flown = float(record.time_s[-1] - record.time_s[0]) + settings.rate.tick_s
    wall = result_json.get("wall_s")
    wall_s = float(wall) if isinstance(wall, int | float) else math.nan
    notes = tuple(map(str, result_json.get("notes", ())))
    unheard = str(result_json.get("unheard", ""))
    return Result(figures, str(lost), flown, wall_s, notes, flight.aircraft, unheard=unheard)


# -------------------------------------------------------------------------------------------------
# A recorded flight as a ULog with PX4's names, for PX4 Flight Review and PlotJuggler.
#
# Topics and fields as in https://docs.px4.io/main/en/msg_docs/: NED and FRD, SI, rad, quaternions
# (w, x, y, z) body -> NED. Only what means the same as PX4's bears PX4's name.
# -------------------------------------------------------------------------------------------------

HELICOPTER = 4
"""MAV_TYPE_HELICOPTER of MAVLink."""
_SERVOS = 8  # of actuator_servos; NaN where there is none
_Array = NDArray[np.float64]


def ulog_of(flight: RecordedFlight) -> bytes:
    """The flight's log; a row is left out while its numbers are unknown."""
    record = flight.record
    time_us = np.round(record.time_s * 1e6).astype(np.uint64)
    tables = [
        *_motion("", record.nav_pos_ned_m, record.nav_vel_ned_mps, record.nav_q_nb,
                 record.nav_rate_body_radps),
        *_motion("_groundtruth", record.truth_pos_ned_m, record.truth_vel_ned_mps,
                 record.truth_q_nb, record.truth_rate_body_radps),
        _place("vehicle_local_position_setpoint", record.reference[:, REFERENCE.pos],
               record.reference[:, REFERENCE.vel], {"yaw": record.reference[:, REFERENCE.psi]}),
        _setpoint(record.setpoint),
        _servos(record.u),
    ]  # fmt: skip
    if record.imu is not None:
        tables.append(_sensed(record.imu, flight.settings.rate))
    infos = {"sys_name": "heli-hover", "ver_sw": flight.commit or "unknown"}
    return ulog(time_us, tables, infos, _parameters(flight.settings.nodes))


def _table(name: str, fields: Mapping[str, _Array]) -> LogTopic:
    """A table of floats, with the rows that are known."""
    known = np.all([np.isfinite(a).reshape(len(a), -1).all(axis=1) for a in fields.values()], 0)
    return LogTopic(name, {key: a.astype(np.float32) for key, a in fields.items()}, known)


def _place(name: str, pos: _Array, vel: _Array, more: Mapping[str, _Array]) -> LogTopic:
    axes = zip(("x", "y", "z", "vx", "vy", "vz"), np.hstack([pos, vel]).T, strict=True)
    return _table(name, {**dict(axes), **more})


def _motion(suffix: str, pos: _Array, vel: _Array, quat: _Array, rate: _Array) -> list[LogTopic]:
    w, x, y, z = quat.T
    heading = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    place = _place(f"vehicle_local_position{suffix}", pos, vel, {"heading": heading})
    valid = np.ones(len(pos), dtype=bool)
    flags = dict.fromkeys(("xy_valid", "z_valid", "v_xy_valid", "v_z_valid"), valid)
    return [
        LogTopic(place.name, {**place.fields, **flags}, place.present),
        _table(f"vehicle_attitude{suffix}", {"q": quat}),
        _table(f"vehicle_angular_velocity{suffix}", {"xyz": rate}),
    ]


def _setpoint(euler: _Array) -> LogTopic:
    quat = np.array([quat_from_euler(*angles) for angles in euler])
    names = ("roll_body", "pitch_body", "yaw_body")
    return _table(
        "vehicle_attitude_setpoint", {**dict(zip(names, euler.T, strict=True)), "q_d": quat}
    )


def _servos(u: _Array) -> LogTopic:
    known = _table("actuator_servos", {"control": u})
    control = np.full((len(u), _SERVOS), np.nan, dtype=np.float32)
    control[:, : u.shape[1]] = u
    return LogTopic(known.name, {"control": control}, known.present)


def _sensed(imu: _Array, rate: Rate) -> LogTopic:
    table = _table(
        "sensor_combined", {"gyro_rad": imu[:, IMU.rate], "accelerometer_m_s2": imu[:, IMU.force]}
    )
    step = np.full(len(imu), rate.tick_ns // 1000, dtype=np.uint32)
    steps = {"gyro_integral_dt": step, "accelerometer_integral_dt": step}
    return LogTopic(table.name, {**table.fields, **steps}, table.present)


def _parameters(nodes: Mapping[str, Mapping[str, Any]]) -> dict[str, int | float]:
    """Every number of every node as `node.name`; lists and texts have no place in a ULog."""
    return {"MAV_TYPE": HELICOPTER} | {
        f"{node}.{name}": int(value) if isinstance(value, bool) else value
        for node, values in nodes.items()
        for name, value in values.items()
        if isinstance(value, (int, float))
    }
