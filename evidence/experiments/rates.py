# SPDX-License-Identifier: Apache-2.0
"""The hover test with IMU, observer and inner loop at each rate, over many seeds; JSON.

Usage: ./heli python -m evidence.experiments.rates [--seeds 1..20]
"""

import sys
from typing import Any

from evidence.files import Results
from evidence.registry import TWENTY, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid
from heli_core.ticks import RATES_HZ
from heli_flight.layers import hover_test_world
from heli_flight.loop import simulate
from heli_flight.result import Result, conditions
from heli_flight.scoring import NAVIGATION, TRUTH, score
from heli_flight.settings import Settings, resolve
from heli_inner_hinf.design import AttitudeConfig

RECEIVERS = {"rtk": TRUTH, "standalone": NAVIGATION}


def settings(gps: str, rate_hz: int, seed: int | None = None) -> Settings:
    """The hover test at a rate."""
    world = hover_test_world(None, None, ())
    return resolve("hover", gps, seed, world=world, rate_hz=rate_hz)


@over(gps=tuple(RECEIVERS), rate_hz=RATES_HZ)
def flown(gps: str, rate_hz: int, seed: int) -> dict[str, Any]:
    """Largest figures of a flight, whether all are inside, whether it was lost."""
    scenario = settings(gps, rate_hz, seed)
    flight = simulate(scenario)
    result = Result(
        score(flight.record, scenario.scenario, scenario.rate), flight.sentence, 0.0, 0.0
    )
    windows = [one for one in result.figures.windows if one.source == RECEIVERS[gps]]
    return {
        "lost": bool(flight.status),
        "inside": result.exit_code(gps) == 0,
        "max": [(one.metric.key, one.max) for one in windows],
    }


def row(place: Place[dict[str, Any]]) -> dict[str, Any]:
    """Largest errors over the seeds, how often all are inside, and the controller's margins."""
    scenario, largest = settings(**place.point), dict[str, float]()
    for flight in place.flights:
        for key, value in flight["max"]:
            largest[key] = max(largest.get(key, 0.0), value)
    judged = AttitudeConfig.from_parameters(scenario.nodes["inner_loop"]).judgement
    assert judged is not None
    return {
        **place.point,
        "source": RECEIVERS[place.point["gps"]],
        "conditions": conditions(scenario).splitlines(),
        "inside": sum(flight["inside"] for flight in place.flights),
        "lost": sum(flight["lost"] for flight in place.flights),
        "max": largest,
        "disk_input": judged.disk_input,
        "disk_output": judged.disk_output,
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the table shows."""
    return {"seeds": options.seeds, "rows": [row(place) for place in flown.places(options)]}


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "rates",
    "./heli python -m evidence.experiments.rates --seeds 1..20",
    "The hover test at 100, 200 and 400 Hz with both receivers.",
    TWENTY,
)


@table("rates")
def rates(results: Results) -> str:
    """The hover test at each rate of IMU, observer and inner loop."""
    record = results["rates"]
    keys = ("longitudinal", "lateral", "altitude", "v_x", "v_y", "v_z")
    head = ["receiver, from", "Hz", "forward, m", "lateral, m", "height, m", "forward, m/s",
            "lateral, m/s", "vertical, m/s", "inside", "lost", "disk margin, input",
            "output"]  # fmt: skip
    rows = [
        [
            f"{row['gps']}, {row['source']}",
            str(row["rate_hz"]),
            *(f"{row['max'][key]:.2f}" for key in keys),
            str(row["inside"]),
            str(row["lost"]),
            f"{row['disk_input']:.3f}",
            f"{row['disk_output']:.3f}",
        ]
        for row in record["rows"]
    ]
    return (
        f"{grid(head, rows)}\n\nLargest over {results.seeds('rates')} in the scored windows, one "
        f"process, world honest, packaged controllers; inside the paper's figures, lost: of "
        f"{len(record['seeds'])} flights. A seed's noise is drawn per sample, so at another "
        f"rate it "
        "is another flight in air of the same kind. Disk margins: of the attitude loop as flown, "
        "all channels at once."
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment))
