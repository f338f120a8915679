# SPDX-License-Identifier: Apache-2.0
"""Tables of campaigns: the dispersed hover test law by law, and how probable rare failures are."""

from collections.abc import Mapping
from typing import Any

from heli_flight.studies.results.files import Results
from heli_flight.studies.results.grid import grid
from heli_math.paper_metrics import BY_KEY

CAMPAIGNS = ("dispersion", "dispersion_honest")
SHOWN = ("altitude", "lateral", "longitudinal")
_LEVELS = (0.5, 0.99, 1.0)
_NAMED = 3


def dispersion(results: Results) -> str:
    """Of each world and law: how many fail, quantiles of the position's errors, what goes along."""
    head = ["world", "laws", "flights", "outside", "at 95 %"]
    head += [f"{BY_KEY[key].label}, {BY_KEY[key].unit}" for key in SHOWN]
    head += ["the lateral error goes with"]
    rows = []
    for name in CAMPAIGNS:
        found = results[name]
        rows.append(["", "bound (paper)", "", "", "", *(f"{BY_KEY[k].paper:g}" for k in SHOWN), ""])
        rows += [_row(found, of_law) for of_law in found["laws"]]
    told = results[CAMPAIGNS[0]]
    return (
        f"{grid(head, _once(rows))}\n\nErrors from truth in the scored windows: median / 99 % / "
        f"largest over the flights. Outside: of the paper's figures in either record, or lost. "
        f"With: inputs' rank correlations, the strongest, where chance makes them in less than 1 % "
        f"of cases. {told['spec']}: {told['scenario']}, {told['duration_s']:g} s, {told['gps']}; "
        f"each flight a seed of its own from 1 on, the same for all laws."
    )


def _once(rows: list[list[str]]) -> list[list[str]]:
    """The bound's row at the top only."""
    return [row for place, row in enumerate(rows) if place == 0 or row != rows[0]]


def _row(found: Mapping[str, Any], of_law: Mapping[str, Any]) -> list[str]:
    low, high = of_law["interval"]
    figures = of_law["figures"]
    at = [found["levels"].index(level) for level in _LEVELS]
    told = [figures[f"{key} (truth)"]["quantiles"] for key in SHOWN]
    with_it = figures["lateral (truth)"]["goes_with"][:_NAMED]
    return [
        found["world"], of_law["laws"], str(of_law["flights"]), str(of_law["failed"]),
        f"{100.0 * low:.2g} to {100.0 * high:.2g} %",
        *(" / ".join(f"{values[k]:.3f}" for k in at) if values else "–" for values in told),
        ", ".join(
            f"`{one['input'].rpartition('.')[2]}` {one['rank_correlation']:+.2f}" for one in with_it
        ) or "none",
    ]  # fmt: skip


def rare(results: Results) -> str:
    """Level by level how probable it is to be beyond."""
    found = results["rare"]["rare"]
    rows = [
        [f"{level['threshold']:.3f}", f"{level['probability']:.2g}", f"{level['cov']:.2f}",
         str(level["flights"])]
        for level in found["levels"]
    ]  # fmt: skip
    head = [f"{found['metric']} beyond, {found['unit']}", "probability", "coefficient of variation",
            "flights"]  # fmt: skip
    causes = ", ".join(f"{count} {cause}" for cause, count in found["causes"].items())
    if found["probability"] is None:
        answer = f"{found['ended']}; beyond {found['bound']:g} {found['unit']} is rarer"
    else:
        low, high = found["interval"]
        answer = (
            f"P(beyond {found['bound']:g} {found['unit']}) = {found['probability']:.2g}, "
            f"95 %: {low:.2g} to {high:.2g}"
        )
    return (
        f"{grid(head, rows)}\n\n{answer}. {found['flights']} flights ({causes}); paper's bound "
        f"{found['paper']:g} {found['unit']}; `{results['rare']['spec']}`, search's seed "
        f"{found['seed']}."
    )


def worst_case(results: Results) -> str:
    """The largest figure that each search found, and where."""
    found = results["rare"]["worst"]
    searches = found["searches"]
    rows = [
        ["largest", *(_largest(one, found["unit"]) for one in searches.values())],
        ["found by flight", *(f"{s['after']} of {s['flights']}" for s in searches.values())],
        *(
            [f"`{name}`", *(f"{one['inputs'][name]:.3f}" for one in searches.values())]
            for name in found["dispersed"]
        ),
    ]
    return (
        f"{grid([found['metric'], *searches], rows)}\n\nWithin {found['sigma']:g} sigma of each; "
        f"bound (paper) {found['paper']:g} {found['unit']}; `{results['rare']['spec']}`, wind and "
        f"sensors of seed {found['flight_seed']}, search's seed {found['seed']}."
    )


def _largest(search: Mapping[str, Any], unit: str) -> str:
    return "not flown to the end" if search["lost"] else f"{search['value']:.3f} {unit}"
