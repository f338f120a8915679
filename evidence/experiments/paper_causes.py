# SPDX-License-Identifier: Apache-2.0
"""What stands between the paper's laws and its figures, one cause at a time; JSON.

Usage: ./heli python -m evidence.experiments.paper_causes [--seeds 1..10] [--worlds paper,honest]

The laws `paper` in both tests with RTK, largest errors from truth; the loop is the linear one
of the aircraft that the laws know.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from evidence.files import Results
from evidence.options import parser_with_seeds
from evidence.registry import MARGIN, produces, table
from evidence.tables import grid, world
from heli_core.metrics import METRICS, PaperMetric
from heli_flight.loop import simulate
from heli_flight.result import conditions
from heli_flight.scoring import WINDOWS
from heli_flight.settings import Settings, resolve
from heli_inner_hinf.controller_state import Actuation
from heli_inner_hinf.tuning import analyse
from heli_studies.campaign.run import FlownSeed, inside_of, worst_of_seeds
from heli_studies.compare import loop_as_flown

GPS, TRUTH = "rtk", "truth"
TESTS = ("hover", "attitude")
FASTER = 5.0
"""Servos are called fast that are so many times as fast."""


@dataclass(frozen=True)
class Cause:
    """What is taken away: parameters of the plant, the navigation's errors."""

    name: str
    plant: Mapping[str, Any] = field(default_factory=dict)
    ideal: bool = False

    @property
    def actuation(self) -> Actuation:
        """The linear loop's, nominal but for this."""
        nominal = Actuation()
        ticks = self.plant.get("delay_ticks", 1)
        return replace(
            nominal,
            delay_s=ticks * nominal.delay_s,
            servo_radps=self.plant.get("scale.servo_speed", 1.0) * nominal.servo_radps,
        )


_NO_DELAY: dict[str, Any] = {"delay_ticks": 0}
_FAST: dict[str, Any] = {"scale.servo_speed": FASTER}
CAUSES = (
    Cause("as it flies"),
    Cause("no delay of the commands", _NO_DELAY),
    Cause("fast servos", _FAST),
    Cause("ideal navigation and observer", {}, ideal=True),
    Cause("all three", _NO_DELAY | _FAST, ideal=True),
)


def loop_row(cause: Cause, settings: Settings) -> dict[str, Any]:
    """Norm and disk margins of the loop behind observer (19); none where that is left out."""
    if cause.ideal:
        return {}
    report = analyse(loop_as_flown(settings.nodes, cause.actuation))
    return {
        "norm": report.norm,
        "disk_input": report.disk_input.alpha,
        "disk_output": report.disk_output.alpha,
    }


def flights(
    cause: Cause, scenario: str, world: str, seeds: Sequence[int]
) -> tuple[dict[str, Any], Settings]:
    """Largest errors from truth in the scored windows, and how many flights were inside."""
    settings = resolve(scenario, GPS, overrides={"plant": cause.plant}, world=world, laws="paper")
    flown = [
        FlownSeed.of(seed, simulate(settings.with_seed(seed), cause.ideal), settings.scenario)
        for seed in seeds
    ]
    found = worst_of_seeds(flown, WINDOWS).values()
    row = {
        "lost": sum(bool(f.lost) for f in flown),
        "inside": inside_of(flown, GPS, WINDOWS),
        "max": {s.metric.key: s.max for s in found if s.source == TRUTH},
    }
    return row, settings


def main() -> None:
    """Print the JSON."""
    parser = parser_with_seeds(__doc__, "1..10")
    parser.add_argument("--worlds", default="paper,honest", help="names or files")
    given = parser.parse_args()
    seeds, rows, told = given.seeds, [], {}
    for place in given.worlds.split(","):
        for cause in CAUSES:
            found = {test: flights(cause, test, place, seeds) for test in TESTS}
            for test, (_, settings) in found.items():
                told[f"{place}, {test}"] = conditions(settings).splitlines()
            own = {test: row for test, (row, _) in found.items()}
            loop = loop_row(cause, found[TESTS[0]][1])
            rows.append({"world": place, "cause": cause.name, "loop": loop, **own})
    gamma = resolve(laws="paper").nodes["inner_loop"]["gamma"]
    print(json.dumps({"gamma": gamma, "seeds": seeds, "conditions": told, "rows": rows}))


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "paper_causes",
    "./heli python -m evidence.experiments.paper_causes --seeds 1..10",
    "What stands between the paper's laws and its figures, one cause at a time.",
    tuple(range(1, 11)),
    MARGIN,
)


@table("paper_causes")
def paper_causes(results: Results) -> str:
    """The laws `paper`, as they fly and with one cause taken away, beside the paper."""
    found = results["paper_causes"]
    metrics = [(test, metric) for test in ("hover", "attitude") for metric in METRICS[test]]
    head = ["world, without", "norm", "disk margin in / out"]
    head += [f"{metric.label}, {metric.unit}" for _, metric in metrics]
    head += ["inside, hover / attitude test"]
    rows = [
        ["paper (flight)", f"{found['gamma']:g}", "", *(f"{m.paper:g}" for _, m in metrics), ""]
    ]
    for row in found["rows"]:
        loop = row["loop"]
        inside = " / ".join(str(row[test]["inside"]) for test in ("hover", "attitude"))
        rows.append(
            [
                f"{row['world']}, {row['cause']}",
                f"{loop['norm']:.3f}" if loop else "–",
                f"{loop['disk_input']:.2f} / {loop['disk_output']:.2f}" if loop else "–",
                *(_beside(row[test], metric) for test, metric in metrics),
                inside,
            ]
        )
    return (
        f"{grid(head, rows)}\n\nLaws `paper`, RTK. Largest error from truth in the scored windows, "
        f"{results.seeds('paper_causes')}; flights inside, of {len(found['seeds'])}, count the "
        f"navigation record, too. {world({k: [v] for k, v in found['conditions'].items()})}"
    )


def _beside(row: Mapping[str, Any], metric: PaperMetric) -> str:
    if metric.key not in row["max"]:
        return "lost"
    value = row["max"][metric.key]
    return f"{value:.2f}" if value <= metric.paper else f"**{value:.2f}**"


if __name__ == "__main__":
    main()
