# SPDX-License-Identifier: Apache-2.0
"""What stands between the paper's controllers and its figures, one cause at a time; JSON.

Usage: ./heli python -m evidence.experiments.paper_causes [--seeds 1..10] [--worlds paper,honest]

The preset `paper` in both tests with RTK, largest errors from truth; the loop is the linear
one of the aircraft that the controllers know.
"""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from evidence.files import Results
from evidence.registry import MARGIN, produces, table
from evidence.sweep import Options, Place, over, print_result
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
WORLDS = ("paper", "honest")
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
    loop = loop_as_flown(settings.nodes, cause.actuation)
    assert loop is not None  # of the preset `paper` it is known
    report = analyse(loop)
    return {
        "norm": report.norm,
        "disk_input": report.disk_input.alpha,
        "disk_output": report.disk_output.alpha,
    }


def settings_of(world: str, cause: Cause, test: str) -> Settings:
    """A test with a cause taken away."""
    return resolve(test, GPS, overrides={"plant": cause.plant}, world=world, laws="paper")


@over(world=WORLDS, cause=CAUSES, test=TESTS)
def flown(world: str, cause: Cause, test: str, seed: int) -> FlownSeed:
    """Figures of a flight."""
    settings = settings_of(world, cause, test)
    flight = simulate(settings.with_seed(seed), cause.ideal)
    return FlownSeed.of(seed, flight, settings)


def row(place: Place[FlownSeed]) -> dict[str, Any]:
    """Largest errors from truth in the scored windows, and how many flights were inside."""
    worst = worst_of_seeds(place.flights, WINDOWS).values()
    return {
        "lost": sum(bool(f.lost) for f in place.flights),
        "inside": inside_of(place.flights, GPS, WINDOWS),
        "max": {s.metric.key: s.max for s in worst if s.source == TRUTH},
    }


def experiment(options: Options, worlds: Sequence[str]) -> dict[str, Any]:
    """All that the table shows."""
    points = replace(flown, axes={**flown.axes, "world": worlds}).points
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    conditions_of: dict[str, list[str]] = {}
    for place in flown.places(options, points):
        world, cause, test = place.point.values()
        settings = settings_of(world, cause, test)
        if test == TESTS[0]:
            loop = loop_row(cause, settings)
            rows[world, cause.name] = {"world": world, "cause": cause.name, "loop": loop}
        rows[world, cause.name][test] = row(place)
        conditions_of[f"{world}, {test}"] = conditions(settings).splitlines()
    gamma = resolve(laws="paper").nodes["inner_loop"]["gamma"]
    return {
        "gamma": gamma, "seeds": options.seeds, "conditions": conditions_of,
        "rows": list(rows.values())
    }  # fmt: skip


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "paper_causes",
    "./heli python -m evidence.experiments.paper_causes --seeds 1..10",
    "What stands between the paper's controllers and its figures, one cause at a time.",
    tuple(range(1, 11)),
    MARGIN,
)


@table("paper_causes")
def paper_causes(results: Results) -> str:
    """The preset `paper`, as they fly and with one cause taken away, beside the paper."""
    record = results["paper_causes"]
    metrics = [(test, metric) for test in ("hover", "attitude") for metric in METRICS[test]]
    head = ["world, without", "norm", "disk margin in / out"]
    head += [f"{metric.label}, {metric.unit}" for _, metric in metrics]
    head += ["inside, hover / attitude test"]
    rows = [
        ["paper (flight)", f"{record['gamma']:g}", "", *(f"{m.paper:g}" for _, m in metrics), ""]
    ]
    for row in record["rows"]:
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
        f"{grid(head, rows)}\n\nPreset `paper`, RTK. Largest error from truth in the scored "
        f"windows, {results.seeds('paper_causes')}; flights inside, of {len(record['seeds'])}, "
        "count the "
        f"state estimate, too. {world({k: [v] for k, v in record['conditions'].items()})}"
    )


def _beside(row: Mapping[str, Any], metric: PaperMetric) -> str:
    if metric.key not in row["max"]:
        return "lost"
    value = row["max"][metric.key]
    return f"{value:.2f}" if value <= metric.paper else f"**{value:.2f}**"


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..10", worlds=",".join(WORLDS)))
