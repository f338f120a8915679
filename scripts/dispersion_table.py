# SPDX-License-Identifier: Apache-2.0
"""The paper's hover test on aircraft up to 20 % off, law by law.

Usage: ./heli python scripts/dispersion_table.py [--world NAME] [--laws hinf,lqr,pid]
                                                 [--flights N] [--workers N] [--rows DIR]

Flies examples/campaign_paper.yaml under each file of laws: the same aircraft, winds and sensor
errors. `--world`, `--flights`: instead of the spec's. `--rows DIR`, or the variable HELI_ROWS,
keeps the rows, a folder per law, and goes on with those that are there. Prints JSON: causes,
failures with their interval, what goes with each figure, quantiles of each.
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import yaml

from heli_flight.errors import FlightError
from heli_flight.studies.dispersion.cluster import fly_by_dask, tasks
from heli_flight.studies.dispersion.explain import explained, influences
from heli_flight.studies.dispersion.row import EXIT_CODE
from heli_flight.studies.dispersion.spec import Spec, spec_of
from heli_flight.studies.dispersion.store import Store
from heli_flight.studies.dispersion.told import Told, read_campaign
from heli_flight.terminal import json_text, long_steps
from heli_parameters.parameters import ParameterError

SPEC = Path(__file__).resolve().parents[1] / "examples" / "campaign_paper.yaml"
LAWS = "hinf,lqr,pid"
LEVELS = [round(level, 4) for level in (*np.linspace(0.0, 0.95, 20), *np.linspace(0.955, 1.0, 10))]
"""Of the quantiles that a cumulative curve is drawn from."""
_SURE = 0.01
"""Correlations that chance makes less often than so are told."""


def spec_with(changes: dict[str, Any], folder: Path) -> tuple[Spec, Path]:
    """The spec with other keys, and its file in a folder; raises ParameterError."""
    told = yaml.safe_load(SPEC.read_text(encoding="utf-8"))
    told |= {key: value for key, value in changes.items() if value is not None}
    file = folder / f"{told['laws']}.yaml"
    file.write_text(yaml.safe_dump(told, sort_keys=False), encoding="utf-8")
    return spec_of(file), file


def flown(changes: dict[str, Any], workers: int, folder: Path) -> Told:
    """Fly what a folder does not hold yet; raises ParameterError, FlightError."""
    spec, file = spec_with(changes, folder)
    rows_of = folder / file.stem
    store = Store.resume(rows_of, spec) if rows_of.exists() else Store.begin(rows_of, spec, file)
    done = store.done()
    count = outside = 0
    with long_steps(f"{file.stem}, flights", len(spec.inputs), len(done)) as progress:
        todo = tasks(spec, done)
        for rows in fly_by_dask(spec, todo, workers, None) if todo else ():
            store.put(rows)
            count += len(rows)
            outside += sum(bool(row[EXIT_CODE]) for row in rows)
            progress(len(done) + count, f"{outside} of {count} outside")
    return read_campaign(rows_of)


def as_dict(told: Told) -> dict[str, Any]:
    """What a campaign found, of the judged figures."""
    found = told.summary
    figures = {}
    for name, (metric, values) in told.figures.items():
        known = values[np.isfinite(values)]
        figures[name] = {
            "bound": metric.paper,
            "outside": int((known > metric.paper).sum()),
            "quantiles": np.quantile(known, LEVELS).tolist() if known.size else [],
            "explained": explained(told.inputs, values),
            "goes_with": [
                {"input": one.name, "rank_correlation": one.rank_correlation}
                for one in influences(told.inputs, values)
                if one.p_value < _SURE
            ],
        }
    return {
        "laws": told.about["flown"]["laws"], "flights": found.flights, "causes": found.causes,
        "failed": found.failed, "interval": found.interval, "figures": figures,
    }  # fmt: skip


def main() -> int:
    """Exit code 2, with a sentence, for a law, folder or count that cannot be."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--laws", default=LAWS)
    parser.add_argument("--world")
    parser.add_argument("--flights", type=int)
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    rows = os.environ.get("HELI_ROWS")
    parser.add_argument("--rows", type=Path, default=rows, help="folder that keeps the rows")
    asked = parser.parse_args()
    changes = {"world": asked.world, "flights": asked.flights}
    with tempfile.TemporaryDirectory(prefix="heli_dispersion_") as passing:
        folder = asked.rows or Path(passing)
        folder.mkdir(parents=True, exist_ok=True)
        try:
            campaigns = [
                flown(changes | {"laws": laws}, asked.workers, folder)
                for laws in asked.laws.split(",")
            ]
        except (ParameterError, FlightError) as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
    flight = {
        key: campaigns[0].about["flown"][key] for key in ("scenario", "world", "gps", "duration_s")
    }
    rows = [as_dict(told) for told in campaigns]
    print(json_text({"spec": SPEC.name, **flight, "levels": LEVELS, "laws": rows}), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
