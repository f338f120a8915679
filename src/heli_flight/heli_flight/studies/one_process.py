# SPDX-License-Identifier: Apache-2.0
"""One flight in this process, scored; nothing is written."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rich.console import Console

from heli_bags.reader import Remark
from heli_flight.graph.live import LiveView
from heli_flight.loop.flight_section import ONE_PROCESS
from heli_flight.loop.laws import own_laws
from heli_flight.loop.record import FlightRecord
from heli_flight.loop.result import Result
from heli_flight.loop.scoring import score
from heli_flight.loop.settings import Settings
from heli_flight.studies.compiles import tell_if_it_compiles
from heli_flight.terminal import flight_time
from heli_math.ticks import seconds
from heli_parameters.python_law import PythonLaw


@dataclass(frozen=True)
class Flown:
    """A flight before it is written: `extra` is what result.json holds beside the result.

    `live` is its live view, if it had one.
    """

    result: Result
    extra: Mapping[str, Any]
    record: FlightRecord
    remarks: Sequence[Remark] = ()
    live: LiveView | None = None


def fly_one_process(settings: Settings, out: Console, laws: Sequence[PythonLaw] = ()) -> Flown:
    """Fly in this process and score; nothing is written.

    Parameters
    ----------
    settings : Settings
    out : Console
        Gets the progress, and is told if the loop is compiled first.
    laws : sequence of PythonLaw
        Flown in the place of those that the settings name.
    """
    from heli_flight.loop.own_loop import fly_settings

    own = bool(laws or own_laws(settings))
    tell_if_it_compiles(out, own)
    if not own:
        # Loads the compiled loop, so that flying is timed.
        fly_settings(replace(settings, scenario=replace(settings.scenario, n_ticks=4)))
    start = time.monotonic()
    with flight_time(out, seconds(settings.scenario.n_ticks)) as progress:
        flight = fly_settings(settings, laws, progress)
    wall_s = time.monotonic() - start
    figures = score(flight.record, settings.scenario)
    result = Result(figures, flight.sentence, settings.rate.seconds(len(flight.record)), wall_s)
    return Flown(result, {"mode": ONE_PROCESS}, flight.record)
