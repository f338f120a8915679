# SPDX-License-Identifier: Apache-2.0
"""The hover test with IMU, observer and inner loop at each rate, over many seeds; JSON.

Usage: ./heli python scripts/rates_table.py [--seeds 1..20]
"""

import json
from typing import Any

from seeds_option import parser_with_seeds

from heli_flight.loop.closed_loop import simulate
from heli_flight.loop.flight_section import hover_test_world
from heli_flight.loop.result import Result, conditions
from heli_flight.loop.scoring import NAVIGATION, TRUTH, score
from heli_flight.loop.settings import resolve
from heli_inner_hinf.design import AttitudeConfig
from heli_math.ticks import RATES_HZ

RECEIVERS = {"rtk": TRUTH, "standalone": NAVIGATION}


def row(gps: str, rate_hz: int, seeds: list[int]) -> dict[str, Any]:
    """Largest figures over the seeds, how often all are inside, and what the law is worth."""
    world, largest, inside, lost = hover_test_world(None, None, ()), {}, 0, 0
    settings = resolve("hover", gps, world=world, rate_hz=rate_hz)
    for seed in seeds:
        own = resolve("hover", gps, seed, world=world, rate_hz=rate_hz)
        flight = simulate(own)
        result = Result(score(flight.record, own.scenario), flight.sentence, 0.0, 0.0)
        lost += bool(flight.status)
        inside += result.exit_code(gps) == 0
        for one in result.figures.windows:
            if one.source == RECEIVERS[gps]:
                key = one.metric.key
                largest[key] = max(largest.get(key, 0.0), one.max)
    judged = AttitudeConfig.from_parameters(settings.nodes["inner_loop"]).judgement
    assert judged is not None
    return {
        "gps": gps,
        "rate_hz": rate_hz,
        "source": RECEIVERS[gps],
        "conditions": conditions(settings).splitlines(),
        "inside": inside,
        "lost": lost,
        "max": largest,
        "disk_input": judged.disk_input,
        "disk_output": judged.disk_output,
    }


def main() -> None:
    """Print the rows."""
    seeds = parser_with_seeds(__doc__, "1..20").parse_args().seeds
    rows = [row(gps, hz, seeds) for gps in RECEIVERS for hz in RATES_HZ]
    print(json.dumps({"seeds": seeds, "rows": rows}, indent=2))


if __name__ == "__main__":
    main()
