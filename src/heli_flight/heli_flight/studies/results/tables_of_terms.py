# SPDX-License-Identifier: Apache-2.0
"""Tables of the aircraft's terms: what each does to trim, to A, B, E, to the disc and in flight."""

from collections.abc import Mapping
from typing import Any

from heli_flight.loop.scoring import METRICS, STRETCHES, WINDOWS
from heli_flight.studies.results.files import Results
from heli_flight.studies.results.grid import grid, world

_DEG = ("phi", "theta", "a_s", "b_s")
_NAMES = {"off": "all off", "flap_back": "flap_back", "rotor": "the rotor's four"}
_SLOPES = ("a_s_u", "b_s_v", "a_s_v", "b_s_u")


def term_effects(results: Results) -> str:
    """Per term what changes of the trims and of A, B, E."""
    rows, without = [], []
    for found in results["term_effects"]["terms"]:
        trims = [
            f"{row['air']}: {', '.join(_change(*item) for item in row['changed'].items())}"
            for row in found["trims"]
            if row["changed"]
        ]
        entries = [f"{e['entry']} {e['off']:.4f} to {e['on']:.4f}" for e in found["entries"]]
        if not trims and not entries:
            without.append(f"`{found['term']}`")
            continue
        rows.append([f"`{found['term']}`", "; ".join(trims) or "-", "; ".join(entries) or "-"])
    head = ["term", "change of the trim", "A, B, E in hover, off to on"]
    silent = f" Neither changes with {', '.join(without)}." if without else ""
    return (
        f"{grid(head, rows)}\n\nDefault aircraft, one term at a time; changes below 0.001 (deg; "
        "units of command; rad of d_int) of the trim and 0.0001 of an entry are left out. States "
        "that a term adds are taken as settled in A, B, E; where a kink lies at hover, the entry "
        f"is the mean of its sides.{silent}"
    )


def _change(name: str, value: float) -> str:
    return f"{name} {value:+.3f}" + " deg" * (name in _DEG)


def term_deviations(results: Results) -> str:
    """Published entries beside the linear models with terms."""
    rows = [
        [row["entry"], f"{row['published']:.4f}", *(f"{row[key]:.4f}" for key in _NAMES)]
        for row in results["term_effects"]["deviations"]
    ]
    return (
        f"{grid(['entry', 'published', *_NAMES.values()], rows)}\n\nEntries that a term of the "
        "rotor moves by more than 0.0001; the published model has no column for what it lacks."
    )


def term_tilts(results: Results) -> str:
    """Settled tilt of the disc per air speed across it, beside published ones."""
    rows = [
        [
            row["aircraft"],
            "yes" if row["bar"] else "no",
            *(f"{1e3 * row[key]:+.2f}" if key in row else "-" for key in _SLOPES),
            f"{row['tip_mps']:.0f}",
        ]
        for row in results["term_effects"]["tilts"]
    ]
    head = ["rotor", "bar", "a_s by u", "b_s by v", "a_s by v", "b_s by u", "tip speed, m/s"]
    return (
        f"{grid(head, rows)}\n\nSettled, in hover, rad per 1000 m/s; a_s back, b_s to the right. "
        "The disc's own couplings are left out, as in the published derivatives; those of "
        "`helion.yaml`, identified and of one sign, double what the wake's skew (`inflow`) does."
    )


def term_flights(results: Results) -> str:
    """The hover test on aircraft that the controllers do not know."""
    found = results["term_flights"]
    rows = []
    for row in found["rows"]:
        most = row["max"][WINDOWS]
        inside = [f"{row['inside'][stretch]} of {row['flights']}" for stretch in STRETCHES]
        rows.append([row["aircraft"], row["gps"], str(row["lost"]), *inside, *_largest(most)])
    head = ["aircraft in flight", "GPS", "lost", *(f"inside, {w}" for w in STRETCHES.values())]
    head += [f"{metric.label}, {metric.unit}" for metric in METRICS["hover"]]
    flown = {"Hover test": found["conditions"]}
    return (
        f"{grid(head, rows)}\n\nInside: the paper's figures, navigation record. Largest values "
        f"over the windows and {results.seeds('term_flights')}, navigation record. {world(flown)}"
    )


def _largest(most: Mapping[str, Any]) -> list[str]:
    names = [f"{metric.key} (navigation)" for metric in METRICS["hover"]]
    return [f"{most[name]:.2f}" if name in most else "-" for name in names]
