# SPDX-License-Identifier: Apache-2.0
"""Every control preset in the hover test, in three worlds: errors, actuators, margins; JSON.

Usage: ./heli python -m evidence.experiments.laws_hover [--seeds 1..40]

Flights are judged by ground truth less the receiver's drift at engagement, from 5 s to the end,
the climb against the causal reference. Margins are linear: of the attitude loop as flown, and of
each axis of the position loop around it, about the trim in the mean wind of `honest`.
"""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from evidence.experiments.outer_loop import AS_MODELLED, HOVER, LIMITS, margin, variants
from evidence.files import Results
from evidence.registry import MARGIN, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid, world
from heli_core.metrics import hover_errors
from heli_core.rotations import euler_from_quat
from heli_core.rows import ACTUATOR, SETPOINT
from heli_flight.loop import simulate
from heli_flight.position_axes import attitude_lags_s
from heli_flight.result import conditions
from heli_flight.scoring import drift_at_engagement
from heli_flight.settings import Settings, resolve
from heli_studies.compare import AXES, loop_as_flown, margins_as_flown

WORLDS = ("paper", "honest", "hard")
LAWS = ("hinf_output", "hinf", "indi", "lqg", "lqr", "mu", "pid", "paper")
DEFAULT = "hinf_output"
GPS = "rtk"
FROM_S = 5.0
"""As the windows of the hover test begin."""
CLIMB_S, ARRIVED_S = 18.0, 25.0
"""Between them it climbs, out of one mean wind into another."""
ATTITUDE_DEG = 1.7
"""What the paper states of its H-infinity controller, Fig. 3 and 4."""
TRAVEL = {"d_lat": ACTUATOR.lat, "d_lon": ACTUATOR.lon, "d_col": ACTUATOR.col}


def settings_of(law: str, world: str) -> Settings:
    """What is flown, but for the seed."""
    return resolve("hover", GPS, world=world, laws="packaged" if law == DEFAULT else law)


@over(world=WORLDS, law=LAWS)
def flown(world: str, law: str, seed: int) -> dict[str, Any] | None:
    """Figures of a flight; None of one that was lost."""
    flight = simulate(settings_of(law, world).with_seed(seed))
    record = flight.record
    drift = drift_at_engagement(record)
    if flight.sentence or drift is None:
        return None
    scored = record.time_s >= FROM_S
    of = hover_errors(record.truth_pos_ned_m + drift, record.truth_vel_ned_mps, record.reference)
    tilt = np.degrees([euler_from_quat(q)[:2] for q in record.truth_q_nb])
    commanded = record.setpoint[:, [SETPOINT.phi, SETPOINT.theta]]
    behind = np.degrees(commanded[scored]) - tilt[scored]
    # each from its own mean, which is what holds against the mean wind at that height
    phases = [tilt[record.time_s < CLIMB_S][sum(~scored) :], tilt[record.time_s >= ARRIVED_S]]
    departures = np.concatenate([phase - phase.mean(axis=0) for phase in phases])
    moved = np.abs(np.diff(record.u[scored], axis=0)).sum(axis=0)
    return {
        "hover": [float(np.abs(of[metric.key][scored]).max()) for metric in HOVER],
        "attitude": np.abs(departures).max(axis=0).tolist(),
        "behind": np.abs(behind).max(axis=0).tolist(),
        "behind_rms": np.sqrt(np.mean(behind**2, axis=0)).tolist(),
        "travel": (moved[list(TRAVEL.values())] / np.ptp(record.time_s[scored])).tolist(),
    }


def attitude_row(kept: list[Any], its: list[Any], key: str) -> dict[str, Any]:
    """Largest roll and pitch under a key: sizes, how many flights hold both, how many beat its."""
    mine = np.array([flight[key] for flight in kept])
    pairs = [(np.array(flight[key]), np.array(other[key])) for flight, other in its]
    return {
        "deg": {
            axis: {"median": float(np.median(mine[:, i])), "worst": float(mine[:, i].max())}
            for i, axis in enumerate(AXES[:2])
        },
        "inside": int((mine <= ATTITUDE_DEG).all(axis=1).sum()),
        "below_default": [sum(bool(a[i] < b[i]) for a, b in pairs) for i in range(2)],
    }


def row(place: Place[dict[str, Any] | None], default: list[Any]) -> dict[str, Any]:
    """What a controller flew in a world; on how many seeds its attitude is below the default's."""
    kept = [flight for flight in place.flights if flight is not None]
    errors = np.array([flight["hover"] for flight in kept])
    pairs = [
        (mine, its)
        for mine, its in zip(place.flights, default, strict=True)
        if mine is not None and its is not None
    ]
    return {
        **place.point,
        "flown": len(place.flights),
        "lost": len(place.flights) - len(kept),
        **{key: attitude_row(kept, pairs, key) for key in ("attitude", "behind")},
        "behind_rms_deg": np.median([flight["behind_rms"] for flight in kept], axis=0).tolist(),
        "median": dict(
            zip((m.key for m in HOVER), np.median(errors, axis=0).tolist(), strict=True)
        ),
        "worst": dict(zip((m.key for m in HOVER), errors.max(axis=0).tolist(), strict=True)),
        "inside": {
            name: int((errors <= LIMITS[name]).all(axis=1).sum())
            for name in ("paper", "half_and_quarter")
        },
        "travel_per_s": dict(
            zip(
                TRAVEL,
                np.median([flight["travel"] for flight in kept], axis=0).tolist(),
                strict=True,
            )
        ),
    }


def margins_of(law: str) -> dict[str, Any]:
    """Linear: how fast commands are followed, margins of the attitude loop, of the axes around."""
    settings = settings_of(law, "honest")
    attitude, loop = margins_as_flown(settings.nodes), loop_as_flown(settings.nodes)
    assert attitude is not None and loop is not None  # of the packaged controllers they are known
    found, gains = variants(settings)
    return {
        "law": law,
        "lag_s": attitude_lags_s(loop).tolist(),
        "input": attitude.input,
        "output": attitude.output,
        "delay_s": attitude.delay_s,
        "outer": {
            name: [margin(axis, of) for axis, of in zip(found[name], gains, strict=True)]
            for name in (AS_MODELLED, "both")
        },
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the tables and the picture show."""
    rows, default = [], dict[str, list[Any]]()
    for place in flown.places(options):
        # of a world the default comes first
        default.setdefault(place.point["world"], place.flights)
        rows.append(row(place, default[place.point["world"]]))
    return {
        "seeds": options.seeds,
        "laws": list(LAWS),
        "conditions": {w: conditions(settings_of(DEFAULT, w)).splitlines() for w in WORLDS},
        "margins": [margins_of(law) for law in LAWS],
        "rows": rows,
    }


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "laws_hover",
    "./heli python -m evidence.experiments.laws_hover --seeds 1..40",
    "Every control preset in the hover test: attitude, place, actuators, margins.",
    tuple(range(1, 41)),
    MARGIN,
)


def attitude_cells(r: Mapping[str, Any], key: str) -> list[str]:
    """Roll and pitch, flights inside, flights below the default's."""
    found = r[key]
    return [
        *(f"{a['median']:.2f} / {a['worst']:.2f}" for a in found["deg"].values()),
        str(found["inside"]),
        "–" if r["law"] == DEFAULT else "{}, {}".format(*found["below_default"]),
    ]


@table("laws_hover")
def laws_hover(results: Results) -> str:
    """Attitude, place and actuators of the hover, world by world and for each controller."""
    record = results["laws_hover"]
    head = ["world, controller", "roll, deg", "pitch, deg", f"inside {ATTITUDE_DEG}",
            "below default's", *(f"{m.label}, {m.unit}" for m in HOVER),
            "inside the paper's", "half, quarter", "travel of d_lat, d_lon, d_col, 1/s",
            "lost"]  # fmt: skip
    body = [
        [
            f"{r['world']}, {r['law']}",
            *attitude_cells(r, "attitude"),
            *(f"{r['median'][m.key]:.2f} / {r['worst'][m.key]:.2f}" for m in HOVER),
            str(r["inside"]["paper"]),
            str(r["inside"]["half_and_quarter"]),
            ", ".join(f"{moved:.2f}" for moved in r["travel_per_s"].values()),
            str(r["lost"]),
        ]
        for r in record["rows"]
    ]
    return (
        f"{grid(head, body)}\n\nHover test with RTK, {results.seeds('laws_hover')}, "
        "drift-corrected, from 5 s to the end, the climb against its reference. Roll and "
        f"pitch: largest departure in a hover phase from its mean, median / worst; on how many of "
        f"{len(record['seeds'])} both are inside the {ATTITUDE_DEG} deg that the paper states; on "
        "how many roll, pitch are below the default's. Then "
        "largest errors, median / worst, and how many flights are inside the paper's figures, "
        "inside half of its speeds and a quarter of its positions. "
        f"{world({k: [v] for k, v in record['conditions'].items()})}"
    )


@table("laws_hover_behind")
def laws_hover_behind(results: Results) -> str:
    """How far the attitude is from what the position loop commands, in the same flights."""
    record = results["laws_hover"]
    head = ["world, controller", "roll, deg", "pitch, deg", f"inside {ATTITUDE_DEG}",
            "below default's", "rms, deg"]  # fmt: skip
    body = [
        [
            f"{r['world']}, {r['law']}",
            *attitude_cells(r, "behind"),
            "{:.2f}, {:.2f}".format(*r["behind_rms_deg"]),
        ]
        for r in record["rows"]
    ]
    return (
        f"{grid(head, body)}\n\nThe same flights: largest distance of roll and pitch (truth) from "
        f"their commands at the same tick, from 5 s to the end, the climb included, median / "
        f"worst; on how many of {len(record['seeds'])} both are inside {ATTITUDE_DEG} deg; on how "
        "many roll, pitch are below the default's; rms, median."
    )


@table("laws_hover_margins")
def laws_hover_margins(results: Results) -> str:
    """Lag and margins of every controller."""
    head = ["controller", "lag of pitch, roll, s", "disk margin, input / output",
            "further delay, ms", "position loop, as modelled",
            "a tick later and servos 30 % slower"]  # fmt: skip
    body = [
        [
            r["law"],
            "{:.2f}, {:.2f}".format(*r["lag_s"]),
            f"{r['input']:.2f} / {r['output']:.2f}",
            f"{1e3 * r['delay_s']:.0f}",
            *(" / ".join(f"{m:.2f}" for m in r["outer"][name]) for name in (AS_MODELLED, "both")),
        ]
        for r in results["laws_hover"]["margins"]
    ]
    return (
        f"{grid(head, body)}\n\nLinear. Of the position loop: disk margin of forward, right, down "
        "about the trim in the mean wind of `honest`, with the controller's own gains."
    )


def draw(content: dict[str, Any], path: Path) -> None:
    """Attitude and place of every controller in the three worlds: median, line up to the worst."""
    from matplotlib import colormaps

    from heli_flight.report.figures import picture

    panels = {
        "largest of roll and pitch (deg)": lambda r, of: max(
            a[of] for a in r["attitude"]["deg"].values()
        ),
        "largest of lateral and\nlongitudinal error (m)": lambda r, of: max(
            r[of][key] for key in ("lateral", "longitudinal")
        ),
        "vertical speed - reference (m/s)": lambda r, of: r[of]["v_z"],
    }
    with picture(path, len(panels), 1, (9.0, 8.0), sharex=True) as (figure, axes):
        for (axis,), (label, value) in zip(axes, panels.items(), strict=True):
            for n, law in enumerate(content["laws"]):
                rows = [r for r in content["rows"] if r["law"] == law]
                x = np.arange(len(rows)) + 0.8 * ((n + 0.5) / len(content["laws"]) - 0.5)
                median, worst = ([value(r, of) for r in rows] for of in ("median", "worst"))
                colour = colormaps["tab10"](n)
                axis.vlines(x, median, worst, color=colour, lw=1.5)
                axis.plot(x, median, "o", color=colour, ms=5, label=law)
                axis.plot(x, worst, "_", color=colour, ms=8)
            axis.set_yscale("log")
            axis.yaxis.set_major_formatter("{x:g}")
            axis.yaxis.set_minor_formatter("")
            axis.set_ylabel(label)
            axis.grid(False, axis="x")
            axis.set_xticks(range(len(WORLDS)), WORLDS)
        handles, labels = axes[0, 0].get_legend_handles_labels()
        title = "Hover test, RTK. Mark: median over the flights; line: up to the worst"
        figure.legend(handles, labels, loc="outside upper center", ncols=4, title=title)


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..40"))
