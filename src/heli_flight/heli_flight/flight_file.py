# SPDX-License-Identifier: Apache-2.0
"""The params.yaml of a flight: what it was, every parameter of it, and how to fly it again."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from heli_bags.parameter_table import NODE_NAME as RECORDER
from heli_flight.loop.commit import sources_commit
from heli_flight.loop.fault_file import flown_faults
from heli_flight.loop.flight_section import NODE_NAME, SHORT_FOR
from heli_flight.loop.layers import Reader, layered
from heli_flight.loop.scenario import NODE_NAME as SCENARIO
from heli_flight.loop.settings import Settings
from heli_flight.loop.worlds import DRAWN
from heli_flight.loop.worlds import NODE_NAME as WORLD
from heli_parameters.entry import NONE
from heli_parameters.parameters import dump_all

NAME = "params.yaml"
_LONGEST = 60
# Decided by the flight itself, or by the scenario: no change of its own.
_DERIVED = {*SHORT_FOR.values(), ("plant", "duration_s")}
_OF_FLIGHT = ("lockstep", "link_seed")
_DERIVED |= {("plant", "initial.pos_ned_m"), ("plant", "initial.psi_deg")}


@dataclass(frozen=True)
class Change:
    """A parameter unlike the packaged one of the flight's scenario, receiver, world and laws."""

    section: str
    key: str
    value: Any
    packaged: Any

    @property
    def name(self) -> str:
        """Section and key in one word."""
        return f"{self.section}.{self.key}"

    def __str__(self) -> str:
        return (
            f"{self.section}: {self.key}: {_short(self.value)} (packaged: {_short(self.packaged)})"
        )


def _short(value: Any) -> str:
    text = str(value.tolist() if isinstance(value, np.ndarray) else value)
    return text if len(text) <= _LONGEST else f"{np.size(value)} numbers"


def sections(settings: Settings) -> dict[str, Mapping[str, Any]]:
    """Parameters by section: the nodes, scenario, world, recorder."""
    return {
        **settings.nodes,
        SCENARIO: settings.scenario_parameters,
        WORLD: settings.world_parameters,
        RECORDER: settings.recorder,
    }


def packaged(settings: Settings) -> Mapping[str, Mapping[str, Any]]:
    """Packaged parameters by section, of the flight's scenario, receiver, world, laws and seed."""
    return layered(
        Reader(),
        settings.scenario_name,
        settings.gps,
        settings.world,
        seed=settings.seed,
        laws=settings.laws,
    ).values


def own_parameters(settings: Settings) -> dict[tuple[str, str], Any]:
    """Parameters by section and key; without seed, law, length and mode, and what these decide."""
    return {
        (section, key): value
        for section, values in sections(settings).items()
        for key, value in values.items()
        if key not in _OF_FLIGHT and (section, key) not in _DERIVED
    }


def changes(settings: Settings) -> list[Change]:
    """What the flight has changed; seed, law, length and mode are told apart from it."""
    before = packaged(settings)
    return [
        Change(section, key, value, before[section][key])
        for (section, key), value in own_parameters(settings).items()
        if not np.array_equal(value, before[section][key])
    ]


def drawn(settings: Settings) -> dict[str, float | int]:
    """What of the aircraft a world may draw, as it was flown; empty in a world that draws nothing.

    Per parameter of the plant: `scale.*`, `delay_ticks`.
    """
    if not any(settings.world_parameters[name] for name in settings.world_parameters
               if name.startswith("draw.")):  # fmt: skip
        return {}
    return {key: settings.nodes["plant"][key] for key in DRAWN}


def drawn_words(settings: Settings) -> str:
    """The same in words, on one line."""
    parts = [
        f"{key.removeprefix('scale.').replace('_', ' ')} {value:.3f}"
        for key, value in drawn(settings).items()
        if key != "delay_ticks"
    ]
    delay = settings.nodes["plant"]["delay_ticks"]
    return f"aircraft flown over that of the controllers: {', '.join(parts)}; delay {delay} ticks"


def custom_data(settings: Settings) -> list[str]:
    """What a bag's metadata say of the flight, each as `name: text`."""
    said = {
        "scenario": settings.scenario_name,
        "gps": settings.gps,
        "seed": settings.seed,
        "world": settings.world,
        "laws": settings.laws,
        **drawn(settings),
    }
    faults = flown_faults(settings)
    if faults:
        said["faults"] = "; ".join(fault.words for fault in faults)
    return [f"{name}: {value}" for name, value in said.items()]


def identity(settings: Settings, changed: Sequence[Change]) -> dict[str, Any]:
    """The section `flight`: what makes this flight this one; `changed` as of `changes`."""
    broken = settings.process_faults
    return {
        "scenario": settings.scenario_name,
        "gps": settings.gps,
        "world": settings.world,
        "laws": settings.laws,
        "mode": settings.mode,
        **({} if broken == (NONE,) else {"process_faults": broken}),
        "seed": settings.seed,
        "controller": settings.nodes["inner_loop"]["controller"],
        "duration_s": settings.scenario_parameters["duration_s"],
        "commit": sources_commit(),
        "changed": tuple(change.name for change in changed),
    }


def write_parameters(settings: Settings, path: Path) -> None:
    """Write the file that flies the same flight again.

    Raises
    ------
    ParameterError
        The file cannot be written.
    """
    changed = changes(settings)
    flight = identity(settings, changed)
    kind = f"{settings.scenario_name}, {settings.gps} GPS, "
    kind += f"world {settings.world}, laws {settings.laws}"
    of_package = f"the packaged parameters of {kind}"
    head = [
        "A flight, all of its parameters; flown again by: ./hover_test.sh --params <this file>",
        f"{kind}, seed {settings.seed}, {flight['controller']}, {flight['duration_s']:g} s, "
        f"{settings.mode}",
        *([drawn_words(settings)] if drawn(settings) else []),
        f"sources: commit {flight['commit']}",
        f"changed from {of_package}:" if changed else f"nothing was changed from {of_package}",
        *(f"  {change}" for change in changed),
    ]
    # rcl does not take an empty array.
    flight["changed"] = flight["changed"] or ("none",)
    dump_all({NODE_NAME: flight, **sections(settings)}, path, head)
