# SPDX-License-Identifier: Apache-2.0
"""What a flight's processes are given: the resolved parameters, and that a supervisor leads."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from heli_flight.graph.live import LiveView
from heli_flight.loop.flight_file import custom_data
from heli_flight.loop.layers import NODES
from heli_flight.loop.scenario import NODE_NAME as SCENARIO
from heli_flight.loop.settings import Settings
from heli_live_view.parameter_table import NODE_NAME as LIVE


def graph_parameters(
    settings: Settings, folder: Path, namespace: str = "", live: LiveView | None = None
) -> Mapping[str, Mapping[str, Any]]:
    """Parameters per process.

    Parameters
    ----------
    settings : Settings
    folder : Path
        The flight's; gets bag/.
    namespace : str
        Of an aircraft that is not alone: its clock is then that of its world.
    live : LiveView, optional
        Shows the flight.
    """
    peers = (*(node.name for node in NODES), "recorder", SCENARIO)
    led: dict[str, Mapping[str, Any]] = {
        name: {**values, "autostart": False, "peers": peers}
        for name, values in settings.nodes.items()
    }
    if namespace:
        led["plant"] = {**led["plant"], "clock": "world"}
    led["inner_loop"] = {**led["inner_loop"], "expects_outer": True}
    bag = str((folder / "bag").absolute())
    told = (*settings.recorder["custom_data"], *custom_data(settings))
    led["recorder"] = {**settings.recorder, "bag": bag, "custom_data": told}
    if live:
        led[LIVE] = {**live.parameters, "autostart": False, "peers": peers}
    return led
