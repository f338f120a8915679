# SPDX-License-Identifier: Apache-2.0
"""Charts of flights laid over each other, a colour each."""

from collections.abc import Callable, Sequence

import numpy as np

from heli_flight.loop.record import FlightRecord
from heli_flight.loop.scoring import NAVIGATION, SOURCE_NAMES, TRUTH, errors
from heli_flight.report.chart import Chart, Panel, Trace
from heli_flight.report.diff import Named
from heli_math.paper_metrics import PATH
from heli_math.rotations import euler_angles
from heli_math.rows import REFERENCE

ROLES = ("nav", "truth", "green", "purple", "bound", "muted")
"""Colours of the flights in turn."""
_ANGLES = ("roll", "pitch", "yaw")
_ACTUATORS = ("lateral", "longitudinal", "pedal", "collective")
_PLACES = {"longitudinal": "longitudinal, m", "lateral": "lateral, m", "altitude": "down, m"}
_ON_PATH = {"position": "distance, m", "heading": "heading error, °"}


def charts(flights: Sequence[Named]) -> list[Chart]:
    """Position error, altitude, attitude and its error, actuators; those that have data."""
    kinds = {named.flight.settings.scenario.kind for named in flights}
    path = kinds == {PATH}
    found = [_position(flights, source, path) for source in (TRUTH, NAVIGATION)]
    found += [_altitude(flights), _attitude(flights), _attitude_error(flights)]
    found.append(_actuators(flights))
    return [chart for chart in found if chart.has_data]


def _overlaid(
    flights: Sequence[Named], signal: Callable[[FlightRecord], np.ndarray]
) -> list[Trace]:
    return [
        Trace(named.flight.record.time_s, signal(named.flight.record), named.name, role, width=1.2)
        for named, role in zip(flights, ROLES, strict=False)
    ]  # fmt: skip


def _position(flights: Sequence[Named], source: str, path: bool) -> Chart:
    kind, labels = (PATH, _ON_PATH) if path else ("hover", _PLACES)

    def of(key: str) -> Callable[[FlightRecord], np.ndarray]:
        return lambda record: errors(record, source, kind)[key]

    return Chart(
        f"position_{source}",
        f"Position error, {SOURCE_NAMES[source]}",
        "Against the point of the path at that moment."
        if path
        else "Position less the reference, in the frame of the reference's heading; an attitude "
        "test holds no position.",
        [Panel(label, _overlaid(flights, of(key))) for key, label in labels.items()],
        "position",
    )


def _altitude(flights: Sequence[Named]) -> Chart:
    traces = _overlaid(flights, lambda r: -_known(r.truth_pos_ned_m, r.nav_pos_ned_m)[:, 2])
    first = flights[0].flight.record
    wanted = -first.reference[:, REFERENCE.pos][:, 2]
    of = f"reference of {flights[0].name}"
    traces.append(Trace(first.time_s, wanted, of, "reference", "dash", width=1.2))
    said = (
        f"By {SOURCE_NAMES[TRUTH]}, where it was recorded, else by the {SOURCE_NAMES[NAVIGATION]}."
    )
    return Chart("altitude", "Altitude", said, [Panel("altitude, m", traces, 1.4)], "position")


def _attitude(flights: Sequence[Named]) -> Chart:
    def of(axis: int) -> Callable[[FlightRecord], np.ndarray]:
        return lambda r: np.degrees(euler_angles(_known(r.truth_q_nb, r.nav_q_nb)))[:, axis]

    said = (
        f"By {SOURCE_NAMES[TRUTH]}, where it was recorded, else by the {SOURCE_NAMES[NAVIGATION]}."
    )
    panels = [Panel(f"{name}, °", _overlaid(flights, of(i))) for i, name in enumerate(_ANGLES)]
    return Chart("attitude", "Attitude", said, panels, "attitude")


def _attitude_error(flights: Sequence[Named]) -> Chart:
    def of(key: str) -> Callable[[FlightRecord], np.ndarray]:
        def error(record: FlightRecord) -> np.ndarray:
            known = np.isfinite(record.truth_q_nb).any()
            return errors(record, TRUTH if known else NAVIGATION, "attitude")[key]

        return error

    panels = [Panel(f"{name} error, °", _overlaid(flights, of(name))) for name in _ANGLES[:2]]
    said = "Roll and pitch less what was commanded."
    return Chart("attitude_error", "Attitude error", said, panels, "attitude")


def _actuators(flights: Sequence[Named]) -> Chart:
    def of(channel: int) -> Callable[[FlightRecord], np.ndarray]:
        return lambda record: record.u[:, channel]

    panels = [Panel(name, _overlaid(flights, of(i)), 0.8) for i, name in enumerate(_ACTUATORS)]
    return Chart("actuators", "Actuators", "Commands to the servos.", panels, "actuators")


def _known(truth: np.ndarray, navigation: np.ndarray) -> np.ndarray:
    return truth if np.isfinite(truth).any() else navigation
