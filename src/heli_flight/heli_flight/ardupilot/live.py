# SPDX-License-Identifier: Apache-2.0
"""The live view's page of a flight that another autopilot flies. No ROS.

Who flies only leaves what is newest in a slot; a thread of its own looks into it 30 times a second
and shows it. So nothing that is shown is waited for, and what comes faster than that is dropped.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.ticks import TICK_NS, stamp_at
from heli_flight.ardupilot.physics import Physics
from heli_flight.ardupilot.recording import rows_of
from heli_flight.flight_file import flown_faults
from heli_flight.graph.live import LiveOrder, LiveView, live_view
from heli_flight.layers import AUTOPILOTS
from heli_flight.settings import Settings
from heli_live_view.access import Access
from heli_live_view.server import PageServer, web_folder
from heli_live_view.state import SHOWN, STATE_HZ, Screen, compact
from heli_msgs_bridge import topics

_ERROR = 2


class ShownMoment(NamedTuple):
    """What was at a tick of 10 ms of a flight.

    Attributes
    ----------
    flight : int
        From 1 on.
    stamp_ns : int
    row : (37,) array
        Places of `STEP`.
    loss : str
        Why the helicopter was lost, one sentence; empty if it was not.
    """

    flight: int
    stamp_ns: int
    row: NDArray[np.float64]
    loss: str


class FlightPage:
    """The page of a vehicle, on 127.0.0.1, from its making until `close`.

    Parameters
    ----------
    order : LiveOrder
    settings : Settings
        Of the vehicle; its mode is one of `layers.AUTOPILOTS`.

    Raises
    ------
    ParameterError, PortError, MissingFileError
        A value that is not allowed, a port in use, or a page that is not installed.

    Attributes
    ----------
    view : LiveView
        Once it is closed with what `serve_after` asks for.
    page : PageServer
    """

    def __init__(self, order: LiveOrder, settings: Settings) -> None:
        view = live_view(order, settings)
        values = {**view.parameters, "lockstep": False, "allow_commands": False}
        self.view: LiveView = replace(view, parameters=values, token="")
        self._start_ns = stamp_at(values["start_time_s"])
        self._faults = "; ".join(fault.words for fault in flown_faults(settings))
        name = AUTOPILOTS[settings.mode]
        self._screen = Screen(values, self._start_ns, commands=False, autopilot=name)
        self.page = PageServer(
            web_folder(), values["port"], Access(""), self._screen.hello, self._screen.obey
        )
        self._physics: Physics | None = None
        self._flights = 0
        self._newest: ShownMoment | None = None
        self._shown: ShownMoment | None = None
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run, name="flight_page", daemon=True)

    def start(self) -> None:
        """Begin to serve."""
        self.page.start()
        self._thread.start()

    def watch(self, physics: Physics) -> None:
        """Take a step that was made; what was not shown meanwhile is dropped."""
        tick, rest = divmod(physics.tick - 1, physics.rate.fold)
        if physics is not self._physics:
            self._physics, self._flights = physics, self._flights + 1
        if not rest:
            stamp_ns = self._start_ns + tick * TICK_NS
            loss = physics.status.sentence if physics.status else ""
            self._newest = ShownMoment(self._flights, stamp_ns, physics.row.copy(), loss)

    def show(self, wall_s: float) -> None:
        """Send what is newest to the browsers.

        Parameters
        ----------
        wall_s : float
            Time of a clock that only goes on.
        """
        moment, screen = self._newest, self._screen
        if moment is not None and moment is not self._shown:
            if self._shown is not None and self._shown.flight != moment.flight:
                screen.live.reset()
                screen.begin_anew()
                self.page.send(screen.hello())
            self._take(moment, wall_s)
            self._shown = moment
        row = screen.row(wall_s)
        for event in screen.events():
            self.page.send(compact(event))
        self.page.send_state(compact(row))

    def _take(self, moment: ShownMoment, wall_s: float) -> None:
        live = self._screen.live
        live.take_clock(moment.stamp_ns, wall_s)
        live.take_arrival(topics.CLOCK, moment.stamp_ns, wall_s)
        for name, part in rows_of(moment.row).items():
            if name in SHOWN:
                live.take(name, part, wall_s)
            else:
                live.take_arrival(name, moment.stamp_ns, wall_s)
        facts = {"faults": self._faults}
        if moment.loss:
            live.take_status("plant", _ERROR, moment.loss, {**facts, "over": "true"})
        else:
            live.take_status("plant", 0, "flying", facts)

    def _run(self) -> None:
        while not self._ends.wait(1.0 / STATE_HZ):
            self.show(time.monotonic())

    def close(self) -> None:
        """Show how it has ended, and end the page; harmless twice."""
        if self._thread.is_alive():
            self._ends.set()
            self._thread.join()
        if "page" in self.view.facts:
            return
        self.view.facts.update(page=self.page.url, viewers=str(self.page.viewers))
        live = self._screen.live
        if live.now_ns and not live.end:
            over = {"faults": self._faults, "over": "true"}
            live.take_status("plant", 0, f"flight over after {live.time_s:.2f} s", over)
        self.show(time.monotonic())
        self.page.stop()


def opened(
    order: LiveOrder | None, settings: Settings, say: Callable[[str], None]
) -> FlightPage | None:
    """The page that is asked for, serving; None for none. Raises as `FlightPage`."""
    if order is None:
        return None
    shown = FlightPage(order, settings)
    shown.start()
    say(f"live view: {shown.page.url}")
    return shown


def stay(shown: FlightPage | None, folder: Path, say: Callable[[str], None]) -> None:
    """Serve report and replay of a flight that was watched to its end, while somebody looks."""
    if shown is not None and shown.view.parameters["flight.report"]:
        from heli_flight.replay import serve_after

        serve_after(folder, shown.view, say)
