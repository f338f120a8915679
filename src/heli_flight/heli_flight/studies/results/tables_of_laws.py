# SPDX-License-Identifier: Apache-2.0
"""Tables of whole sets of laws: everywhere against each other, and the paper's cause by cause."""

from collections.abc import Mapping
from itertools import product
from typing import Any

from heli_flight.loop.scoring import METRICS
from heli_flight.studies.compare import everywhere
from heli_flight.studies.compare.laws import AXES
from heli_flight.studies.results.files import Results
from heli_flight.studies.results.grid import grid, world
from heli_flight.studies.robust.prove import BROKEN_AT
from heli_math.paper_metrics import Metric

_ACTUATORS = {"roll": "d_lat", "pitch": "d_lon"}


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


def _beside(row: Mapping[str, Any], metric: Metric) -> str:
    if metric.key not in row["max"]:
        return "lost"
    value = row["max"][metric.key]
    return f"{value:.2f}" if value <= metric.paper else f"**{value:.2f}**"


def laws_everywhere(results: Results) -> str:
    """Worst, median, rms and seeds won of every law at every place; the best of each in bold."""
    found = results["laws_everywhere"]
    rows, won = [], {law: dict.fromkeys(everywhere.FIGURES, 0) for law in found["laws"]}
    for place in found["places"]:
        for axis in AXES:
            own = everywhere.rows_of(found, place["name"], axis)
            least = everywhere.smallest(own)
            cells = [everywhere.cell(row, least, "**{}**") for row in own]
            rows.append([everywhere.title(place, axis), *cells])
            for row, key in product(own, everywhere.FIGURES):
                won[row["law"]][key] += everywhere.is_best(row, least, key)
    counts = ["{} / {}, {}".format(*won[law].values()) for law in found["laws"]]
    rows.append([f"on how many of these {len(rows)} rows it is smallest", *counts])
    rows += [_travel(found, axis, name) for axis, name in _ACTUATORS.items()]
    margins = everywhere.margin_cells(found)
    rows.append(["disk margin as flown, input / output; further delay survived", *margins])
    head = ["place (flights), axis", *everywhere.heads(found)]
    return (
        f"{grid(head, rows)}\n\nLargest error from truth, 5 s to 60 s, deg: worst / median over "
        "the flights, rms; on how many it is below the PID's. Bold: smallest of the row, "
        f"nothing lost. {_conditions(found)}"
    )


def _travel(found: Mapping[str, Any], axis: str, name: str) -> list[str]:
    """What an actuator moves in a second under each law: over all places, least to most."""
    cells = []
    for law in found["laws"]:
        moved = [
            r["travel_per_s"] for r in found["rows"]
            if (r["law"], r["axis"]) == (law, axis) and r["travel_per_s"] is not None
        ]  # fmt: skip
        cells.append(f"{min(moved):.2f} to {max(moved):.2f}" if moved else "–")
    return [f"travel of {name} in a second, over the places", *cells]


def _conditions(found: Mapping[str, Any]) -> str:
    return world({place["name"].split(",")[0]: [place["conditions"]] for place in found["places"]})


def robust(results: Results) -> str:
    """What is proved of the packaged law over the named set, and where other laws lose it."""
    found = results["robust"]
    own = found["packaged"]
    head = ["transport delay, ticks", *(str(case["delay_ticks"]) for case in own["cases"])]
    rows = [
        [name, *(_size(case[key]) for case in own["cases"])]
        for name, key in (
            ("packaged law: proved stable up to", "margin_proved"),
            ("unstable, worst aircraft found, at", "margin_at_most"),
            ("the same, sampled exactly", "exact_onset"),
            ("the same, flown (nonlinear)", "flown_onset"),
        )
    ]
    rows += [
        [f"`{law['laws']}`: unstable, sampled exactly, at", *map(_size, law["at_most"])]
        for law in found["others"]
    ]
    return (
        f"{grid(head, rows)}\n\nIn ranges of the set (config/robust.yaml of heli_flight): 1 is the "
        "set itself, 0: already the nominal aircraft is lost; –: not within 5 % of the line above, "
        f"or none up to three times the set. {_over_the_set(own)}"
    )


def _over_the_set(own: Mapping[str, Any]) -> str:
    gain, disks = own["wind_to_h"], own["inverse_disk_margin"]
    model = f"The linear model is within {100.0 * own['model_residual']:.2f} % of the aircraft."
    if gain is None:
        return f"The whole set is not proved stable, so no worst gain is stated. {model}"
    return (
        f"Over the whole set, at {own['worst_delay_ticks']} ticks: norm from horizontal wind to h: "
        f"at most {gain['proved']:.3f} (an aircraft has {gain['found']:.3f}, the nominal one "
        f"{gain['nominal']:.3f}); disk margin "
        + "; ".join(f"{BROKEN_AT[at]}: {_inverse(disk)}" for at, disk in disks.items())
        + f". {model}"
    )


def _inverse(disk: Mapping[str, float]) -> str:
    return (
        f"at least {1.0 / disk['proved']:.2f} (an aircraft has {1.0 / disk['found']:.2f}, the "
        f"nominal one {1.0 / disk['nominal']:.2f})"
    )


def _size(size: float | None) -> str:
    return "–" if size is None else f"{size:.3f}"


def gamma(results: Results) -> str:
    """What gamma and the weights do to the state feedback and to its flights in gusts."""
    found = results["gamma"]
    head = [
        "variant",
        "gamma",
        "gamma*",
        "wind to angles, deg per m/s",
        "wind to commands, per m/s",
    ]
    head += [f"{axis}, `{name}`, deg" for name in found["flown"] for axis in AXES]
    rows, refused = [], []
    for row in found["rows"]:
        if row["refused"]:
            refused.append(f"- {row['variant']}: {row['refused']}.")
            continue
        rows.append(
            [
                row["variant"],
                f"{row['gamma']:g}",
                f"{row['gamma_star']:.4f}",
                f"{row['angles_deg_per_mps']:.3f}",
                f"{row['commands_per_mps']:.5f}",
                *(
                    f"{row['errors_deg'][name][axis]:.2f}"
                    for name in found["flown"]
                    for axis in AXES
                ),
            ]
        )
    lines = "\n".join(refused)
    seeds = results.read["gamma"]["seeds"]
    return (
        f"{grid(head, rows)}\n\nGains: the largest over frequency, without servos, delay and "
        "observer. Errors: the largest from truth after 5 s, median over seeds "
        f"{seeds[0]} to {seeds[-1]}. "
        f"{world({name: [told] for name, told in found['flown'].items()})}\n\nRefused:\n\n{lines}"
    )
