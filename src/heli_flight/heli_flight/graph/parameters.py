# SPDX-License-Identifier: Apache-2.0
"""What the processes of a supervised flight are given: its parameters, and that somebody leads."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from heli_bags.choice import unrecorded
from heli_bags.parameter_table import NODE_NAME as RECORDER
from heli_flight.graph.live import LiveView
from heli_flight.loop.flight_file import custom_data
from heli_flight.loop.layers import NODES
from heli_flight.loop.scenario import NODE_NAME as SCENARIO
from heli_flight.loop.settings import Settings
from heli_live_view.parameter_table import NODE_NAME as LIVE
from heli_msgs_bridge import topics
from heli_parameters.parameters import ParameterError


def _left_out(settings: Settings) -> tuple[str, ...]:
    return unrecorded(settings.recorder["topics"], settings.recorder["exclude"])


def refuse_unscorable(settings: Settings) -> None:
    """Raise ParameterError if the recorder is to leave out what a flight is scored by."""
    left = _left_out(settings)
    scored = (topics.TRUTH_ODOM, topics.ODOM, topics.REFERENCE, topics.ATTITUDE_SETPOINT)
    lacking = [name for name in scored if name in left]
    if lacking:
        raise ParameterError(f"recorder: leaves out {', '.join(lacking)}: a flight is scored by it")


def of_graph(
    settings: Settings, folder: Path, live: LiveView | None, namespace: str
) -> dict[str, Mapping[str, Any]]:
    """Parameters of each node of a flight.

    Parameters
    ----------
    settings : Settings
    folder : Path
        The flight's folder; gets the bag.
    live : LiveView, optional
    namespace : str
        Of an aircraft that is not alone: its clock is then that of its world.
    """
    peers = (*(node.name for node in NODES), RECORDER, SCENARIO)
    led: dict[str, Mapping[str, Any]] = {
        name: {**values, "autostart": False, "peers": peers, "unrecorded": _left_out(settings)}
        for name, values in settings.nodes.items()
    }
    if namespace:
        led["plant"] = {**led["plant"], "clock": "world"}
    led["inner_loop"] = {**led["inner_loop"], "expects_outer": True}
    bag = str((folder / "bag").absolute())
    told = (*settings.recorder["custom_data"], *custom_data(settings))
    led[RECORDER] = {**settings.recorder, "bag": bag, "custom_data": told}
    if live:
        led[LIVE] = {**live.parameters, "autostart": False, "peers": peers}
    return led
