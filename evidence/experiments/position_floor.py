# SPDX-License-Identifier: Apache-2.0
"""How far the hover is from what any linear position controller could reach; JSON.

Usage: ./heli python -m evidence.experiments.position_floor [--seeds 1..8]

Standard deviations in the turbulence of each world, as designed axis by axis: of the best linear
controller with perfect actuators, behind the attitude loop as flown, and if the gust itself were
read; of the packaged controller as predicted; and as flown, after the climb, about the mean. Then
largest errors of the hover test with the nose into the wind, and of aircraft 30 % off in what the
loop knows.
"""

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from evidence.files import Results
from evidence.registry import MARGIN, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid, world
from heli_core.metrics import METRICS
from heli_core.rows import REFERENCE
from heli_flight.loop import simulate
from heli_flight.position_axes import NAMES
from heli_flight.result import conditions
from heli_flight.scoring import WINDOWS
from heli_flight.settings import Settings, resolve
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.tuning import model_of
from heli_outer_pd.analysis import Axis, Gains, deviations, limits_of_performance
from heli_outer_pd.parameters import outer_params
from heli_studies.campaign.run import FlownSeed, fly_seeds, inside_of, worst_of_seeds
from heli_studies.compare import loop_as_flown
from heli_studies.design.position_search import PositionLoop, position_loop

GPS, TRUTH, WORLDS = "rtk", "truth", ("paper", "honest", "hard")
SETTLED_S = 30.0
INTO_THE_WIND = {"scenario": {"heading_deg": 45.0}}
"""The scenario's wind blows towards 225 deg."""
DOUBTS, FACTORS = ("mass", "thrust", "servo_speed", "drag"), (0.7, 1.3)


def loop_of(settings: Settings) -> PositionLoop:
    """The position loop about the mean wind of a flight's settings."""
    nodes = settings.nodes
    config = AttitudeConfig.from_parameters(nodes["inner_loop"])
    attitude = loop_as_flown(nodes)
    assert attitude is not None  # of the packaged controllers it is known
    return position_loop(
        nodes["plant"], nodes["outer_loop"], attitude, model_of(config), config.actuation
    )


def floors(axis: Axis, gains: Gains) -> dict[str, list[float]]:
    """Position, m, and speed, m/s, of each controller that is compared."""
    predicted = deviations(axis, gains)
    assert predicted is not None  # the packaged controller is stable
    return {
        "perfect_actuators": list(limits_of_performance(axis)),
        "as_flown": list(limits_of_performance(axis, at_once=False)),
        "as_flown_gust_known": list(limits_of_performance(axis, at_once=False, gusts_known=True)),
        "predicted": list(predicted[:2]),
    }


@over(world=WORLDS)
def variances(world: str, seed: int) -> np.ndarray:
    """Variance (2, 3) of position, m2, and speed, m2/s2, forward, right, down, truth."""
    settings = resolve("hover", GPS, world=world)
    heading = settings.scenario.reference.points[0, REFERENCE.psi]
    c, s = np.cos(heading), np.sin(heading)
    to_heading = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    record = simulate(settings.with_seed(seed)).record
    settled = record.time_s > SETTLED_S
    error = record.truth_pos_ned_m[settled] - record.reference[settled, REFERENCE.pos]
    speed = record.truth_vel_ned_mps[settled]
    return np.array([(of @ to_heading.T).var(axis=0) for of in (error, speed)])


@over(world=("honest", "hard"), into_the_wind=(False, True))
def nose(world: str, into_the_wind: bool, seed: int) -> FlownSeed:
    """A flight with the nose as packaged, or into the wind."""
    changes = INTO_THE_WIND if into_the_wind else {}
    return fly_seeds(resolve("hover", GPS, overrides=changes, world=world), [seed])[0]


@over(part=DOUBTS, factor=FACTORS)
def doubt(part: str, factor: float, seed: int) -> FlownSeed:
    """A flight in the honest world with a part off; its spread is that of the others."""
    changes = {"plant": {f"scale.{part}": factor}}
    return fly_seeds(resolve("hover", GPS, overrides=changes, world="honest"), [seed])[0]


def largest(place: Place[FlownSeed]) -> dict[str, Any]:
    """Largest errors from truth in the scored windows, and how many flights were inside."""
    flights = place.flights
    worst = worst_of_seeds(flights, WINDOWS).values()
    return {
        **place.point,
        "lost": sum(bool(f.lost) for f in flights),
        "inside": inside_of(flights, GPS, WINDOWS),
        "max": {s.metric.key: s.max for s in worst if s.source == TRUTH},
    }


def axes_of(place: Place[np.ndarray]) -> list[dict[str, Any]]:
    """A row for each axis: the controllers' floors, what is predicted, what is flown."""
    settings = resolve("hover", GPS, **place.point)
    loop, kernel = loop_of(settings), outer_params(settings.nodes["outer_loop"])
    measured = np.sqrt(np.mean(place.flights, axis=0))
    return [
        {
            **place.point,
            "axis": NAMES[i],
            **floors(axis, Gains.of(kernel, i)),
            "flown": measured[:, i].tolist(),
        }
        for i, axis in enumerate(loop.axes)
    ]


def experiment(options: Options) -> dict[str, Any]:
    """All that the tables show."""
    return {
        "seeds": options.seeds,
        "conditions": {
            world: conditions(resolve("hover", GPS, world=world)).splitlines() for world in WORLDS
        },
        "axes": [row for place in variances.places(options) for row in axes_of(place)],
        "nose": [largest(place) for place in nose.places(options)],
        "doubts": [largest(place) for place in doubt.places(options)],
    }


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "position_floor",
    "./heli python -m evidence.experiments.position_floor --seeds 1..8",
    "The hover beside the least that any linear position controller leaves; nose into the wind; "
    "mass, thrust, servos, drag 30 % off.",
    tuple(range(1, 9)),
    MARGIN,
)


_LAWS = {
    "perfect_actuators": "least, actuators perfect",
    "as_flown": "least, attitude loop as flown",
    "as_flown_gust_known": "the same, gust read",
    "predicted": "packaged, predicted",
    "flown": "packaged, flown",
}


@table("position_floor")
def position_floor(results: Results) -> str:
    """Standard deviations of the best controllers beside those that are predicted and flown."""
    record = results["position_floor"]
    rows = [
        [
            f"{row['world']}, {row['axis']}",
            *(f"{1e3 * row[law][0]:.0f} / {1e3 * row[law][1]:.0f}" for law in _LAWS),
        ]
        for row in record["axes"]
    ]
    return (
        f"{grid(['world, axis', *_LAWS.values()], rows)}\n\nStandard deviation of position, mm, / "
        f"speed, mm/s; flown: about each flight's mean, {results.seeds('position_floor')}, RTK, "
        f"truth. {world({k: [v] for k, v in record['conditions'].items()})}"
    )


@table("position_doubts")
def position_doubts(results: Results) -> str:
    """Largest errors with the nose into the wind, and on aircraft that are off."""
    record = results["position_floor"]
    metrics = METRICS["hover"]
    head = ["hover", *(f"{m.label}, {m.unit}" for m in metrics), "inside", "lost"]
    rows = [[_nose(row), *_largest(row)] for row in record["nose"]]
    rows += [
        [f"honest, {row['part'].replace('_', ' ')} x {row['factor']:g}", *_largest(row)]
        for row in record["doubts"]
    ]
    return (
        f"{grid(head, rows)}\n\nLargest error from truth in the scored windows, RTK, "
        f"{results.seeds('position_floor')}, of {len(record['seeds'])} flights; the seed "
        "draws the aircraft, but what has a factor is at it."
    )


def _nose(row: Mapping[str, Any]) -> str:
    return f"{row['world']}, nose {'into the wind' if row['into_the_wind'] else 'north'}"


def _largest(row: Mapping[str, Any]) -> list[str]:
    cells = [f"{row['max'][m.key]:.2f}" if m.key in row["max"] else "–" for m in METRICS["hover"]]
    return [*cells, str(row["inside"]), str(row["lost"])]


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..8"))
