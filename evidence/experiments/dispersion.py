# SPDX-License-Identifier: Apache-2.0
"""The paper's hover test on aircraft up to 20 % off, for each controller.

Usage: ./heli python -m evidence.experiments.dispersion [--control-preset hinf,lqr,pid]
                                    [--world NAME] [--flights N] [--workers N] [--rows DIR]

Flies examples/campaign_paper.yaml under each control preset: the same aircraft, winds and sensor
errors. `--world`, `--flights`: instead of the spec's. `--rows DIR`, or the variable HELI_ROWS,
keeps the rows, a folder per controller, and goes on with those that are there. Prints JSON: causes,
failures with their interval, what goes with each figure, quantiles of each.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from evidence.files import Results
from evidence.registry import MARGIN, produces, table
from evidence.tables import grid
from heli_core.metrics import BY_KEY

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import yaml

from heli_core.errors import FlightError
from heli_core.rcl_yaml import ParameterError
from heli_flight.cli.common import with_new_names
from heli_flight.terminal import json_text, long_steps
from heli_studies.campaign.report import CampaignFolder, read_campaign
from heli_studies.campaign.run import Store, explained_variance, sensitivities
from heli_studies.campaign.spec import EXIT_CODE, Spec, spec_of
from heli_studies.campaign.workers import flier, tasks

SPEC = Path(__file__).resolve().parents[2] / "examples" / "campaign_paper.yaml"
LAWS = "hinf,lqr,pid"
LEVELS = [round(level, 4) for level in (*np.linspace(0.0, 0.95, 20), *np.linspace(0.955, 1.0, 10))]
"""Of the quantiles that a cumulative curve is drawn from."""
_SURE = 0.01
"""Correlations that chance makes less often than so are told."""


def spec_with(changes: dict[str, Any], folder: Path) -> tuple[Spec, Path]:
    """The spec with other keys, and its file in a folder; raises ParameterError."""
    spec = yaml.safe_load(SPEC.read_text(encoding="utf-8"))
    spec |= {key: value for key, value in changes.items() if value is not None}
    file = folder / f"{spec['laws']}.yaml"
    file.write_text(yaml.safe_dump(spec, sort_keys=False), encoding="utf-8")
    return spec_of(file), file


def flown(changes: dict[str, Any], workers: int, folder: Path) -> CampaignFolder:
    """Fly what a folder does not hold yet; raises ParameterError, FlightError."""
    spec, file = spec_with(changes, folder)
    rows_of = folder / file.stem
    store = Store.resume(rows_of, spec) if rows_of.exists() else Store.begin(rows_of, spec, file)
    done = store.done()
    count = outside = 0
    steps = long_steps(f"{file.stem}, flights", len(spec.inputs), len(done))
    with flier(workers) as fly, steps as progress:
        for rows in fly(spec, tasks(spec, done)):
            store.put(rows)
            count += len(rows)
            outside += sum(bool(row[EXIT_CODE]) for row in rows)
            progress(len(done) + count, f"{outside} of {count} outside")
    return read_campaign(rows_of)


def as_dict(campaign: CampaignFolder) -> dict[str, Any]:
    """What a campaign found, of the judged figures."""
    summary = campaign.summary
    figures = {}
    for name, (metric, values) in campaign.figures.items():
        known = values[np.isfinite(values)]
        figures[name] = {
            "bound": metric.paper,
            "outside": int((known > metric.paper).sum()),
            "quantiles": np.quantile(known, LEVELS).tolist() if known.size else [],
            "explained": explained_variance(campaign.inputs, values),
            "goes_with": [
                {"input": one.name, "rank_correlation": one.rank_correlation}
                for one in sensitivities(campaign.inputs, values)
                if one.p_value < _SURE
            ],
        }
    return {
        "laws": campaign.about["flown"]["laws"], "flights": summary.flights,
        "causes": summary.causes,
        "failed": summary.failed, "interval": summary.interval, "figures": figures,
    }  # fmt: skip


def main() -> int:
    """Exit code 2, with a sentence, for a controller, folder or count that cannot be."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--control-preset", default=LAWS)
    parser.add_argument("--world")
    parser.add_argument("--flights", type=int)
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    kept = os.environ.get("HELI_ROWS")
    parser.add_argument("--rows", type=Path, default=kept, help="folder that keeps the rows")
    words = with_new_names(sys.argv[1:], {"--control-preset": 1}, parser.prog)
    asked = parser.parse_args(words)
    changes = {"world": asked.world, "flights": asked.flights}
    with tempfile.TemporaryDirectory(prefix="heli_dispersion_") as passing:
        folder = asked.rows or Path(passing)
        folder.mkdir(parents=True, exist_ok=True)
        try:
            campaigns = [
                flown(changes | {"laws": laws}, asked.workers, folder)
                for laws in asked.control_preset.split(",")
            ]
        except (ParameterError, FlightError) as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
    flight = {
        key: campaigns[0].about["flown"][key] for key in ("scenario", "world", "gps", "duration_s")
    }
    rows = [as_dict(campaign) for campaign in campaigns]
    print(json_text({"spec": SPEC.name, **flight, "levels": LEVELS, "laws": rows}), end="")
    return 0


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "dispersion",
    "./heli python -m evidence.experiments.dispersion",
    "The paper's hover test on 10 000 aircraft up to 20 % off, for each controller.",
    tuple(range(1, 10_001)),
    MARGIN,
)
produces(
    "dispersion_honest",
    "./heli python -m evidence.experiments.dispersion --world honest --flights 2000",
    "The same aircraft's hover test in the honest world.",
    tuple(range(1, 2001)),
    MARGIN,
)


CAMPAIGNS = ("dispersion", "dispersion_honest")


SHOWN = ("altitude", "lateral", "longitudinal")


_LEVELS = (0.5, 0.99, 1.0)


_NAMED = 3


@table("dispersion")
def dispersion(results: Results) -> str:
    """By world and controller: failures, quantiles of the position's errors, correlations."""
    head = ["world", "controller", "flights", "outside", "at 95 %"]
    head += [f"{BY_KEY[key].label}, {BY_KEY[key].unit}" for key in SHOWN]
    head += ["the lateral error goes with"]
    rows = []
    for name in CAMPAIGNS:
        record = results[name]
        rows.append(["", "bound (paper)", "", "", "", *(f"{BY_KEY[k].paper:g}" for k in SHOWN), ""])
        rows += [_row(record, of_law) for of_law in record["laws"]]
    first = results[CAMPAIGNS[0]]
    return (
        f"{grid(head, _once(rows))}\n\nErrors from truth in the scored windows: median / 99 % / "
        f"largest over the flights. Outside: of the paper's figures in either record, or lost. "
        f"With: inputs' rank correlations, the strongest, where chance makes them in less than 1 % "
        f"of cases. {first['spec']}: {first['scenario']}, {first['duration_s']:g} s, "
        f"{first['gps']}; "
        f"each flight a seed of its own from 1 on, the same for all controllers."
    )


def _once(rows: list[list[str]]) -> list[list[str]]:
    """The bound's row at the top only."""
    return [row for place, row in enumerate(rows) if place == 0 or row != rows[0]]


def _row(results: Mapping[str, Any], of_law: Mapping[str, Any]) -> list[str]:
    low, high = of_law["interval"]
    figures = of_law["figures"]
    at = [results["levels"].index(level) for level in _LEVELS]
    quantiles = [figures[f"{key} (truth)"]["quantiles"] for key in SHOWN]
    with_it = figures["lateral (truth)"]["goes_with"][:_NAMED]
    return [
        results["world"], of_law["laws"], str(of_law["flights"]), str(of_law["failed"]),
        f"{100.0 * low:.2g} to {100.0 * high:.2g} %",
        *(" / ".join(f"{values[k]:.3f}" for k in at) if values else "–" for values in quantiles),
        ", ".join(
            f"`{one['input'].rpartition('.')[2]}` {one['rank_correlation']:+.2f}" for one in with_it
        ) or "none",
    ]  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
