# SPDX-License-Identifier: Apache-2.0
"""A flight's live view: its parameters, its token, where to look."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from heli_core.command_line import config_folder
from heli_core.parameters import load, with_common
from heli_core.rcl_yaml import ParameterError
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_flight.settings import Settings
from heli_live_view.access import new_token
from heli_live_view.parameters import NODE_NAME, TABLE

MODULE = "heli_live_view.node"


@dataclass(frozen=True)
class LiveView:
    """A live view that a flight brings up.

    Attributes
    ----------
    parameters : mapping
        Of the node `live_view`.
    token : str
        Lets its holder command; empty: view only. Handed over by the environment of the process
        alone, never by a file or a topic.
    wait : bool
        Whether the flight waits for the first browser.
    facts : dict
        What the node said last, once the flight is over.
    """

    parameters: Mapping[str, Any]
    token: str = ""
    wait: bool = False
    facts: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class LiveOrder:
    """That a flight is to be shown; None: the parameter's value.

    Attributes
    ----------
    port, foxglove_port : int, optional
        0: any free one. A port for Foxglove opens it.
    allow_commands : bool
        Whether a token is made that lets its holder command.
    wait : bool
        Whether the flight waits for the first browser.
    report : bool
        Whether a report will be written, which the page then shows.
    """

    port: int | None = None
    foxglove_port: int | None = None
    allow_commands: bool = False
    wait: bool = False
    report: bool = False


def live_view(order: LiveOrder, settings: Settings) -> LiveView:
    """The live view of a flight.

    Raises
    ------
    ParameterError
        A value that is not allowed.
    """
    table = with_common(TABLE)
    defaults_file = config_folder("heli_live_view") / f"{NODE_NAME}.yaml"
    values = load(table, [defaults_file, *settings.files], NODE_NAME)
    values |= _of_flight(settings)
    rows = {row.name: row for row in table}
    for name, option in (("port", "--live-port"), ("foxglove_port", "--foxglove-port")):
        value = getattr(order, name)
        if value is not None:
            values[name] = _checked(rows[name], value, option)
    # Closed unless it is asked for: whoever reaches this port can read.
    values["foxglove"] = values["foxglove"] or order.foxglove_port is not None
    if order.allow_commands:
        values["allow_commands"] = True
    values["flight.report"] = order.report and values["stay_s"] > 0.0
    return LiveView(values, new_token() if values["allow_commands"] else "", order.wait)


def _checked(row: Any, value: int, option: str) -> int:
    try:
        return row.check(value)
    except ParameterError as error:
        raise ParameterError(f"{option}: {error}") from None


def _of_flight(settings: Settings) -> dict[str, Any]:
    """What the page says of the flight."""
    plant = settings.nodes["plant"]
    aircraft = plant["aircraft_file"]
    return {
        "lockstep": plant["lockstep"],
        "start_time_s": plant["start_time_s"],
        "flight.scenario": settings.scenario_name,
        "flight.seed": settings.seed,
        "flight.duration_s": plant["duration_s"],
        "flight.windows_s": settings.scenario.windows_s,
        "aircraft.name": Path(aircraft).stem,
        "aircraft.rotor_radius_m": HelicopterParameters.from_yaml(aircraft).main_radius_m,
    }


def addresses(facts: Mapping[str, str], view: LiveView) -> list[str]:
    """Lines for the terminal: where to look, and the token."""
    lines = [f"live view: {facts['page']}"]
    if "foxglove" in facts:
        lines.append(f"Foxglove: {facts['foxglove']} (layout: {layout_file()})")
    if view.token:
        lines.append(f"command token: {view.token}")
    return lines


def viewers(facts: Mapping[str, str]) -> int:
    """How many browsers look, by what the node says in /diagnostics."""
    count = facts.get("viewers", "0")
    return int(count) if count.isdecimal() else 0


def layout_file() -> Path:
    """The ready layout for Foxglove."""
    return config_folder("heli_live_view") / "foxglove_layout.json"
