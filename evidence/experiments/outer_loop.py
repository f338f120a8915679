# SPDX-License-Identifier: Apache-2.0
"""The outer loop with the measured tilt beside the commanded one: margins, hover, paths; JSON.

Usage: ./heli python -m evidence.experiments.outer_loop [--seeds 1..40] [--forms measured,commanded]

Margins are linear, axis by axis, about the trim in the mean wind of two worlds: of the aircraft as
modelled, with commands a tick later, servos 30 % slower, both, and 30 % more or less tilt per
command or acceleration per tilt. Flights are judged by ground truth less the receiver's drift at
engagement, in the scored windows. To try gains out, change `COMMANDED` and fly `--seeds 101..120
--forms measured`.
"""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from evidence.files import Results
from evidence.registry import MARGIN, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import RECEIVERS, grid, world
from heli_core.metrics import METRICS, PATH, POSITIONS, hover_errors
from heli_core.ticks import TICK_S
from heli_flight.loop import simulate
from heli_flight.position_axes import NAMES, position_axes
from heli_flight.result import conditions
from heli_flight.scoring import drift_at_engagement, errors
from heli_flight.settings import Settings, resolve
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.tuning import model_of
from heli_outer_pd.analysis import Axis, Gains, deviations, disk_margin, open_loop
from heli_studies.compare import loop_as_flown

COMMANDED = {
    "outer_loop": {
        "K_P": [1.2, 1.2, 12.0],
        "K_D": [2.2, 2.7, 24.0],
        "attitude_lead.lead_s": [0.43, 0.22],
        "disturbance.bandwidth_radps": [1.3, 2.0, 9.1],
        "disturbance.tilt_standing_s": 0.0,
    },
}
"""The outer loop that explains acceleration by the commanded tilt, with the gains that flew before
the measured one did; down as packaged."""
FORMS: Mapping[str, Mapping[str, Any]] = {"measured": {}, "commanded": COMMANDED}
"""The packaged one takes the measured tilt."""
WORLDS, GPS = ("paper", "honest", "hard"), ("rtk", "standalone")
PATHS = ("figure_eight", "orbit")
PATH_SEEDS = 10
"""So many of the seeds fly them."""
HOVER = METRICS["hover"]
_FIGURES = np.array([metric.paper for metric in HOVER])
_IS_POSITION = np.array([metric.key in POSITIONS for metric in HOVER])
LIMITS = {
    "paper": _FIGURES,
    "half_and_quarter": np.where(_IS_POSITION, 0.25, 0.5) * _FIGURES,
    "tenth_of_positions": np.where(_IS_POSITION, 0.1 * _FIGURES, np.inf),
}
"""Limits (6,) that all errors of a flight are held against together, in the order of `HOVER`."""


def settings_of(scenario: str, world: str, gps: str, form: str) -> Settings:
    """What is flown, but for the seed."""
    return resolve(scenario, gps, overrides=FORMS[form], world=world)


# -------------------------------------------------------------------------------------------------
# Margins.
# -------------------------------------------------------------------------------------------------

AS_MODELLED = "as modelled"


def stronger(axis: Axis, per_command: float, per_tilt: float) -> Axis:
    """The axis with so much more tilt per command, and acceleration per tilt."""
    act = axis.actuation
    C = act.C.copy()
    C[0] *= per_tilt
    return replace(axis, actuation=act._replace(B=act.B * np.array([per_command, 1.0]), C=C))


def variants(settings: Settings) -> tuple[dict[str, Sequence[Axis]], Sequence[Gains]]:
    """Axes as modelled and as they may be, and the gains of each."""
    nodes = settings.nodes
    config = AttitudeConfig.from_parameters(nodes["inner_loop"])
    attitude = loop_as_flown(nodes)
    assert attitude is not None  # of the packaged controllers it is known
    around = position_axes(nodes["plant"], nodes["outer_loop"], attitude, model_of(config))
    as_is = config.actuation
    late = replace(as_is, delay_s=as_is.delay_s + TICK_S)
    found: dict[str, Sequence[Axis]] = {
        AS_MODELLED: around.axes(as_is),
        "a tick later": around.axes(late),
        "servos 30 % slower": around.axes(replace(as_is, servo_radps=0.7 * as_is.servo_radps)),
        "both": around.axes(replace(late, servo_radps=0.7 * as_is.servo_radps)),
    }
    for percent in (30, -30):
        factor = 1.0 + percent / 100.0
        each = [[stronger(axis, *of) for axis in found[AS_MODELLED]]
                for of in ((factor, 1.0), (1.0, factor))]  # fmt: skip
        found[f"{percent:+d} % tilt per command"], found[f"{percent:+d} % force per tilt"] = each
    return found, [Gains.of(around.params, i) for i in range(len(NAMES))]


def margins(world: str, form: str) -> list[dict[str, Any]]:
    """Disk margins about the trim in a world's mean wind, broken at the commanded acceleration."""
    found, gains = variants(settings_of("hover", world, "rtk", form))
    return [
        {
            "world": world,
            "form": form,
            "axis": NAMES[i],
            "variant": name,
            "disk_margin": margin(axes[i], gains[i]),
        }
        for name, axes in found.items()
        for i in range(len(NAMES))
    ]


def margin(axis: Axis, gains: Gains) -> float:
    """Disk margin; 0 of a loop that is not stable."""
    return 0.0 if deviations(axis, gains) is None else disk_margin(open_loop(axis, gains)[1])


# -------------------------------------------------------------------------------------------------
# Flights.
# -------------------------------------------------------------------------------------------------


@over(form=tuple(FORMS), world=WORLDS, gps=GPS)
def hover(form: str, world: str, gps: str, seed: int) -> list[float] | None:
    """Largest errors in the order of `HOVER`; None of a flight that was lost."""
    settings = settings_of("hover", world, gps, form).with_seed(seed)
    flight = simulate(settings)
    record = flight.record
    drift = drift_at_engagement(record)
    if flight.sentence or drift is None:
        return None
    of = hover_errors(record.truth_pos_ned_m + drift, record.truth_vel_ned_mps, record.reference)
    scored = settings.scenario.scored(record.time_s)
    return [float(np.abs(of[metric.key][scored]).max()) for metric in HOVER]


@over(form=tuple(FORMS), path=PATHS, world=("honest",))
def path(form: str, path: str, world: str, seed: int) -> float | None:
    """Largest distance from the path's point with RTK, truth less drift, m; None: lost."""
    settings = settings_of(path, world, "rtk", form).with_seed(seed)
    flight = simulate(settings)
    if flight.sentence:
        return None
    of = errors(flight.record, "truth_less_drift", PATH)["position"]
    return float(np.abs(of[settings.scenario.scored(flight.record.time_s)]).max())


def hover_row(place: Place[list[float] | None]) -> dict[str, Any]:
    """Median and worst of each error, and how many flights are inside each of `LIMITS`."""
    kept = np.array([flight for flight in place.flights if flight is not None])
    return {
        **place.point,
        "flown": len(place.flights),
        "lost": len(place.flights) - len(kept),
        "median": dict(zip((m.key for m in HOVER), np.median(kept, axis=0).tolist(), strict=True)),
        "worst": dict(zip((m.key for m in HOVER), kept.max(axis=0).tolist(), strict=True)),
        "inside": {name: int((kept <= limit).all(axis=1).sum()) for name, limit in LIMITS.items()},
    }


def path_row(place: Place[float | None]) -> dict[str, Any]:
    """Median and worst distance of a path."""
    kept = [flight for flight in place.flights if flight is not None]
    return {
        **place.point,
        "lost": len(place.flights) - len(kept),
        "median": float(np.median(kept)),
        "worst": max(kept),
    }


def experiment(options: Options, forms: Sequence[str]) -> dict[str, Any]:
    """All that the tables show."""
    flown = [point for point in hover.points if point["form"] in forms]
    along = [point for point in path.points if point["form"] in forms]
    of_paths = replace(options, seeds=options.seeds[:PATH_SEEDS])
    return {
        "seeds": options.seeds,
        "conditions": {
            world: conditions(resolve("hover", "rtk", world=world)).splitlines() for world in WORLDS
        },
        "margins": [row for form in forms for world in WORLDS[1:] for row in margins(world, form)],
        "hover": [hover_row(place) for place in hover.places(options, flown)],
        "paths": [path_row(place) for place in path.places(of_paths, along)],
    }


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "outer_loop",
    "./heli python -m evidence.experiments.outer_loop --seeds 1..40",
    "The outer loop with the measured tilt beside the commanded one: margins, hover, paths.",
    tuple(range(1, 41)),
    MARGIN,
)


@table("outer_margins")
def outer_margins(results: Results) -> str:
    """Disk margins of each axis, commanded and measured tilt."""
    rows = results["outer_loop"]["margins"]
    places = list(dict.fromkeys((row["world"], row["axis"]) for row in rows))
    at = {
        (row["world"], row["axis"], row["form"], row["variant"]): row["disk_margin"] for row in rows
    }
    head = ["variant", *(f"{axis}, {world}" for world, axis in places)]
    body = [
        [
            variant,
            *(
                f"{at[*place, 'commanded', variant]:.2f} / {at[*place, 'measured', variant]:.2f}"
                for place in places
            ),
        ]
        for variant in dict.fromkeys(row["variant"] for row in rows)
    ]  # fmt: skip
    return (
        f"{grid(head, body)}\n\nDisk margin of each axis broken at its commanded acceleration, "
        "about the trim in the world's mean wind: commanded tilt / measured tilt, as packaged."
    )


@table("outer_hover")
def outer_hover(results: Results) -> str:
    """Largest errors of the hover, commanded and measured tilt."""
    record = results["outer_loop"]
    head = ["world, receiver", "tilt", *(f"{m.label}, {m.unit}" for m in HOVER),
            "inside the paper's", "half, quarter", "tenth", "lost"]  # fmt: skip
    body = [
        [
            f"{row['world']}, {RECEIVERS[row['gps']]}",
            row["form"],
            *(f"{row['median'][m.key]:.2f} / {row['worst'][m.key]:.2f}" for m in HOVER),
            *(str(row["inside"][name]) for name in LIMITS),
            str(row["lost"]),
        ]
        for row in sorted(record["hover"], key=lambda row: (WORLDS.index(row["world"]), row["gps"]))
    ]
    return (
        f"{grid(head, body)}\n\nLargest error of a flight in the scored windows, median / worst, "
        f"{results.seeds('outer_loop')}, drift-corrected errors; then how many of "
        f"{len(record['seeds'])} are inside the paper's figures, inside half of its speeds and a "
        "quarter of its positions, inside a tenth of its positions. "
        f"{world({k: [v] for k, v in record['conditions'].items()})}"
    )


@table("outer_paths")
def outer_paths(results: Results) -> str:
    """Distances from paths, commanded and measured tilt."""
    rows = results["outer_loop"]["paths"]
    head = ["path, world", "commanded tilt", "measured tilt"]
    cells = {
        (row["path"], row["world"], row["form"]): f"{row['median']:.2f} / {row['worst']:.2f}"
        for row in rows
    }
    body = [
        [f"{name.replace('_', ' ')}, {world}", cells[name, world, "commanded"],
         cells[name, world, "measured"]]
        for name, world in dict.fromkeys((row["path"], row["world"]) for row in rows)
    ]  # fmt: skip
    return (
        f"{grid(head, body)}\n\nLargest distance from the path's point from 5 s on, m, median / "
        f"worst of the first {PATH_SEEDS} seeds, RTK, drift-corrected."
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..40", forms=",".join(FORMS)))
