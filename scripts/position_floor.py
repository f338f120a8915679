# SPDX-License-Identifier: Apache-2.0
"""How far the hover is from what any linear position law could reach; JSON.

Usage: ./heli python scripts/position_floor.py [--seeds 1..8]

Standard deviations in the turbulence of each world, as designed axis by axis: of the best linear
law with perfect actuators, behind the attitude loop as flown, and if the gust itself were read; of
the packaged law as predicted; and as flown, after the climb, about the mean. Then largest errors of
the hover test with the nose into the wind, and of aircraft 30 % off in what the loop knows.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from seeds_option import parser_with_seeds

from heli_flight.loop.closed_loop import simulate
from heli_flight.loop.position_axes import NAMES
from heli_flight.loop.result import conditions
from heli_flight.loop.scoring import WINDOWS
from heli_flight.loop.settings import Settings, resolve
from heli_flight.studies.campaign import fly_seeds, inside_of, worst
from heli_flight.studies.compare.flown import loop_as_flown
from heli_flight.studies.design.outer import PositionLoop, position_loop
from heli_inner_hinf.analysis import model_of
from heli_inner_hinf.design import AttitudeConfig
from heli_math.rows import REFERENCE
from heli_outer_pd.axis_analysis import Axis, Gains, deviations, limits_of_performance
from heli_outer_pd.config import outer_kernel

GPS, TRUTH, WORLDS = "rtk", "truth", ("paper", "honest")
SETTLED_S = 30.0
INTO_THE_WIND = {"scenario": {"heading_deg": 45.0}}
"""The scenario's wind blows towards 225 deg."""
DOUBTS, FACTORS = ("mass", "thrust", "servo_speed", "drag"), (0.7, 1.3)


def loop_of(settings: Settings) -> PositionLoop:
    """The position loop about the mean wind of a flight's settings."""
    nodes = settings.nodes
    config = AttitudeConfig.from_parameters(nodes["inner_loop"])
    attitude = loop_as_flown(nodes)
    return position_loop(
        nodes["plant"], nodes["outer_loop"], attitude, model_of(config), config.actuation
    )


def floors(axis: Axis, gains: Gains) -> dict[str, list[float]]:
    """Position, m, and speed, m/s, of each law that is compared."""
    return {
        "perfect_actuators": list(limits_of_performance(axis)),
        "as_flown": list(limits_of_performance(axis, at_once=False)),
        "as_flown_gust_known": list(limits_of_performance(axis, at_once=False, gusts_known=True)),
        "predicted": deviations(axis, gains).tolist(),
    }


def flown(settings: Settings, seeds: Sequence[int]) -> np.ndarray:
    """Standard deviation (2, 3) of position, m, and speed, m/s, forward, right, down, truth."""
    squares = []
    heading = settings.scenario.reference.points[0, REFERENCE.psi]
    c, s = np.cos(heading), np.sin(heading)
    to_heading = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    for seed in seeds:
        record = simulate(settings.with_seed(seed)).record
        settled = record.time_s > SETTLED_S
        error = record.truth_pos_ned_m[settled] - record.reference[settled, REFERENCE.pos]
        speed = record.truth_vel_ned_mps[settled]
        squares.append([(of @ to_heading.T).var(axis=0) for of in (error, speed)])
    return np.sqrt(np.mean(squares, axis=0))


def nose(world: str, into_the_wind: bool, seeds: Sequence[int]) -> dict[str, Any]:
    """Largest errors with the nose as packaged, or into the wind."""
    changes = INTO_THE_WIND if into_the_wind else {}
    settings = resolve("hover", GPS, overrides=changes, world=world)
    return {"world": world, "into_the_wind": into_the_wind, **largest(settings, seeds)}


def doubt(part: str, factor: float, seeds: Sequence[int]) -> dict[str, Any]:
    """Largest errors in the honest world with a part off; its spread is that of the others."""
    changes = {"plant": {f"scale.{part}": factor}}
    settings = resolve("hover", GPS, overrides=changes, world="honest")
    return {"part": part, "factor": factor, **largest(settings, seeds)}


def largest(settings: Settings, seeds: Sequence[int]) -> dict[str, Any]:
    """Largest errors from truth in the scored windows, and how many flights were inside."""
    flights = fly_seeds(settings, seeds)
    found = worst(flights, WINDOWS).values()
    return {
        "lost": sum(bool(f.lost) for f in flights),
        "inside": inside_of(flights, GPS, WINDOWS),
        "max": {s.metric.key: s.max for s in found if s.source == TRUTH},
    }


def axes_of(world: str, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """A row for each axis: the laws' floors, what is predicted, what is flown."""
    settings = resolve("hover", GPS, world=world)
    loop, kernel = loop_of(settings), outer_kernel(settings.nodes["outer_loop"])
    measured = flown(settings, seeds)
    return [
        {
            "world": world,
            "axis": NAMES[i],
            **floors(axis, Gains.of(kernel, i)),
            "flown": measured[:, i].tolist(),
        }
        for i, axis in enumerate(loop.axes)
    ]


def main() -> None:
    """Print the JSON."""
    seeds = parser_with_seeds(__doc__, "1..8").parse_args().seeds
    found: Mapping[str, Any] = {
        "seeds": seeds,
        "conditions": {
            world: conditions(resolve("hover", GPS, world=world)).splitlines() for world in WORLDS
        },
        "axes": [row for world in WORLDS for row in axes_of(world, seeds)],
        "nose": [
            nose(world, into, seeds) for world in ("honest", "hard") for into in (False, True)
        ],
        "doubts": [doubt(part, factor, seeds) for part in DOUBTS for factor in FACTORS],
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main()
