# SPDX-License-Identifier: Apache-2.0
"""`heli compare aircraft`: designs for published linear aircraft, flown on each in several worlds.

For each aircraft the project's own synthesis makes the attitude controllers, observer and what the
position loop is told, from the file's A, B, E, trim and delay; gains of the position loop stay.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from rich.console import Console

from heli_core.errors import InfeasibleGammaError
from heli_core.metrics import hover_errors
from heli_core.rcl_yaml import ParameterError
from heli_dynamics_sim.linear_aircraft import LinearAircraft, linear_models
from heli_dynamics_sim.trim import TrimError
from heli_flight.loop import fly_settings
from heli_flight.result import Result
from heli_flight.scoring import drift_at_engagement, score
from heli_flight.settings import Settings, resolve
from heli_flight.terminal import table
from heli_inner_hinf.loops import disk_margin
from heli_studies.compare import loop_as_flown
from heli_studies.design.linear import flown_actuation
from heli_studies.design.make import FinishedDesign, make_design

LAWS = ("hinf_output", "hinf")
"""Those that are designed: output feedback, and eq. (17)."""
WORLDS = ("paper", "honest", "hard")
ALL, GPS = "all", "rtk"
_FACTOR = 1.2
"""Bound over gamma* where the packaged one is below it."""
_FROM_S = 5.0
AXES = ("lateral", "longitudinal", "altitude")


@dataclass(frozen=True)
class DesignedLaw:
    """A controller for an aircraft.

    Attributes
    ----------
    aircraft, law : str
    values : mapping
        Parameters of each node that fly it.
    gamma, gamma_star : float
        Bound, and its infimum.
    disk_input, disk_output : float
        Disk margins of the attitude loop, with the aircraft's own delay.
    """

    aircraft: str
    law: str
    values: Mapping[str, Mapping[str, Any]]
    gamma: float
    gamma_star: float
    disk_input: float
    disk_output: float


def names_of(text: str) -> list[str]:
    """Aircraft of "all" or "blade360,heli600"; raises ParameterError for an unknown one."""
    known = linear_models()
    names = known if text == ALL else text.split(",")
    for name in names:
        if name not in known:
            raise ParameterError(
                f"--aircraft {name}: unknown; allowed: {ALL}, or any of {', '.join(known)}"
            )
    return names


@cache
def designed(aircraft: str, law: str) -> DesignedLaw:
    """The controller for an aircraft, by the packaged weights.

    Raises
    ------
    AircraftError, SynthesisError
    """
    try:
        made = make_design(aircraft=aircraft, controller=law)
    except InfeasibleGammaError:
        made = make_design(aircraft=aircraft, controller=law, gamma_factor=_FACTOR)
    return _judged(aircraft, law, made)


def _judged(aircraft: str, law: str, made: FinishedDesign) -> DesignedLaw:
    packaged = resolve(controller=law).nodes
    nodes = {node: {**packaged[node], **made.values[node]} for node in ("inner_loop", "observer")}
    delay_ticks = int(packaged["plant"]["delay_ticks"])
    flown = loop_as_flown(nodes, flown_actuation(LinearAircraft.from_yaml(aircraft), delay_ticks))
    assert flown is not None  # of these controllers it is known
    bound = made.attitude.bound
    assert bound is not None
    margins = [disk_margin(flown, where).alpha for where in ("input", "output")]
    return DesignedLaw(
        aircraft, law, made.values, float(bound.gamma), float(bound.gamma_star.value),
        float(margins[0]), float(margins[1]),
    )  # fmt: skip


def settings_of(aircraft: str, law: str, world: str) -> Settings:
    """The hover test of a controller on its aircraft in a world."""
    overrides = copy.deepcopy(dict(designed(aircraft, law).values))
    return resolve("hover", GPS, world=world, laws=law, overrides=overrides)


def flown(aircraft: str, law: str, world: str, seed: int) -> dict[str, Any]:
    """Figures of a flight: largest drift-corrected errors from 5 s to its end.

    `lost` is the sentence of one that was lost, and nothing else of it counts.
    """
    settings = settings_of(aircraft, law, world).with_seed(seed)
    try:
        flight = fly_settings(settings)
    except TrimError as error:
        return {"lost": str(error)}
    record, drift = flight.record, drift_at_engagement(flight.record)
    if flight.sentence or drift is None:
        return {"lost": flight.sentence or "never engaged"}
    figures = score(record, settings.scenario, settings.rate)
    result = Result(figures, "", settings.rate.seconds(len(record)), 0.0)
    scored = record.time_s >= _FROM_S
    of = hover_errors(record.truth_pos_ned_m + drift, record.truth_vel_ned_mps, record.reference)
    return {
        "lost": "",
        "inside": result.exit_code(GPS) == 0,
        **{axis: float(np.abs(of[axis][scored]).max()) for axis in AXES},
    }


def row_of(
    aircraft: str, law: str, world: str, flights: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """What a controller flew on an aircraft in a world."""
    kept = [flight for flight in flights if not flight["lost"]]
    errors = {axis: [flight[axis] for flight in kept] for axis in AXES}
    return {
        "aircraft": aircraft,
        "law": law,
        "world": world,
        "flown": len(flights),
        "lost": len(flights) - len(kept),
        "why_lost": sorted({flight["lost"] for flight in flights if flight["lost"]}),
        "inside": sum(flight["inside"] for flight in kept),
        "median": {axis: float(np.median(v)) if v else None for axis, v in errors.items()},
        "worst": {axis: max(v) if v else None for axis, v in errors.items()},
    }


def design_row(aircraft: str, law: str) -> dict[str, Any]:
    """What is designed, for --json."""
    made = designed(aircraft, law)
    one = LinearAircraft.from_yaml(aircraft)
    return {
        "aircraft": aircraft,
        "law": law,
        "name": one.name,
        "citation": one.citation,
        "source": one.source,
        "delay_s": one.delay_s,
        "poles": [[float(p.real), float(p.imag)] for p in np.sort_complex(one.poles)],
        **{key: value for key, value in vars(made).items() if isinstance(value, float)},
    }


def compare_aircraft(
    names: Sequence[str],
    worlds: Sequence[str],
    seeds: Sequence[int],
    progress: Callable[[int], None] = lambda done: None,
) -> dict[str, Any]:
    """Design for each aircraft and fly it; raises AircraftError, SynthesisError, ParameterError."""
    rows, done = [], 0
    for aircraft in names:
        for law in LAWS:
            for world in worlds:
                flights = []
                for seed in seeds:
                    flights.append(flown(aircraft, law, world, seed))
                    done += 1
                    progress(done)
                rows.append(row_of(aircraft, law, world, flights))
    designs = [design_row(aircraft, law) for aircraft in names for law in LAWS]
    return {"seeds": list(seeds), "designs": designs, "rows": rows}


def cell(row: Mapping[str, Any], axis: str) -> str:
    """Median / worst; a dash where all were lost."""
    if row["median"][axis] is None:
        return "–"
    return f"{row['median'][axis]:.2f} / {row['worst'][axis]:.2f}"


def print_aircraft(content: Mapping[str, Any], out: Console) -> None:
    """The table: inside the paper's figures, largest errors, lost."""
    rows = table("Hover test, RTK, median / worst of the largest errors (m, truth)", out)
    rows.add_column("aircraft, controller, world")
    for name in ("inside", *AXES, "lost"):
        rows.add_column(name, justify="right")
    for row in content["rows"]:
        rows.add_row(
            f"{row['aircraft']}, {row['law']}, {row['world']}",
            f"{row['inside']} of {row['flown']}",
            *(cell(row, axis) for axis in AXES),
            str(row["lost"]),
        )
    out.print(rows)
