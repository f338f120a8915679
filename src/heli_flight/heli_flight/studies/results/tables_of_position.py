# SPDX-License-Identifier: Apache-2.0
"""Tables of the position loop: what it could reach, and what it makes of doubts."""

from collections.abc import Mapping
from typing import Any

from heli_flight.loop.ground_figures import GROUND_METRICS
from heli_flight.loop.scoring import METRICS, TRUTH, TRUTH_LESS_DRIFT
from heli_flight.studies.results.files import Results
from heli_flight.studies.results.grid import grid, world
from heli_math.paper_metrics import PATH

_LAWS = {
    "perfect_actuators": "least, actuators perfect",
    "as_flown": "least, attitude loop as flown",
    "as_flown_gust_known": "the same, gust read",
    "predicted": "packaged, predicted",
    "flown": "packaged, flown",
}


def position_floor(results: Results) -> str:
    """Standard deviations of the best laws beside those that are predicted and flown."""
    found = results["position_floor"]
    rows = [
        [
            f"{row['world']}, {row['axis']}",
            *(f"{1e3 * row[law][0]:.0f} / {1e3 * row[law][1]:.0f}" for law in _LAWS),
        ]
        for row in found["axes"]
    ]
    return (
        f"{grid(['world, axis', *_LAWS.values()], rows)}\n\nStandard deviation of position, mm, / "
        f"speed, mm/s; flown: about each flight's mean, {results.seeds('position_floor')}, RTK, "
        f"truth. {world({k: [v] for k, v in found['conditions'].items()})}"
    )


def position_doubts(results: Results) -> str:
    """Largest errors with the nose into the wind, and on aircraft that are off."""
    found = results["position_floor"]
    metrics = METRICS["hover"]
    head = ["hover", *(f"{m.label}, {m.unit}" for m in metrics), "inside", "lost"]
    rows = [[_nose(row), *_largest(row)] for row in found["nose"]]
    rows += [
        [f"honest, {row['part'].replace('_', ' ')} x {row['factor']:g}", *_largest(row)]
        for row in found["doubts"]
    ]
    return (
        f"{grid(head, rows)}\n\nLargest error from truth in the scored windows, RTK, "
        f"{results.seeds('position_floor')}, of {len(found['seeds'])} flights; the seed "
        "draws the aircraft, but what has a factor is at it."
    )


def paths(results: Results) -> str:
    """Largest errors along paths from truth, and without the receiver's drift."""
    found = results["paths"]
    near, turn = (f"{m.label}, {m.unit} (goal {m.paper:g})" for m in METRICS[PATH])
    head = ["path", near, "less drift at engagement, m", turn, "inside", "lost"]
    rows = []
    for row in found["rows"]:
        largest = row["max"]
        drifts = largest.get(f"position, {TRUTH_LESS_DRIFT}")
        rows.append(
            [
                f"{row['scenario'].replace('_', ' ')}, {row['world']}, {row['gps']}",
                f"{largest[f'position, {TRUTH}']:.2f}",
                "–" if drifts is None else f"{drifts:.2f}",
                f"{largest[f'heading, {TRUTH}']:.1f}",
                str(row["inside"]),
                str(row["lost"]),
            ]
        )
    winds = {row["world"]: [row["conditions"]] for row in found["rows"]}
    return (
        f"{grid(head, rows)}\n\nLargest from 5 s to the end, truth, {results.seeds('paths')}; "
        f"inside and lost: of {len(found['seeds'])} flights, by the records that a receiver is "
        f"judged by (standalone: navigation alone). {world(winds)}"
    )


_GROUND_HEAD = [f"{m.label}, {m.unit} (goal {m.goal:g})" for m in GROUND_METRICS]


def takeoff(results: Results) -> str:
    """Largest figures of take-off and landing, case by case."""
    found = results["takeoff"]
    head = [
        "ground and wind, world, receiver",
        *_GROUND_HEAD,
        "all inside",
        "take-off broken off",
        "lost",
    ]
    rows = [
        [
            f"{row['case']}, {row['world']}, {row['gps']}",
            *_ground(row),
            str(row["inside"]),
            str(row["broken_off"]),
            str(row["lost"]),
        ]
        for row in found["rows"]
    ]
    return (
        f"{grid(head, rows)}\n\nLargest over {results.seeds('takeoff')}, truth (height: "
        f"navigation record); inside, broken off, lost: of {len(found['seeds'])} flights of 85 s, "
        "wind with the turbulence that belongs to it."
    )


def sequence(results: Results) -> str:
    """Largest figures of the paper's own sequence on the ground."""
    found = results["sequence"]
    head = ["world, receiver", *_GROUND_HEAD, "all inside", "lost"]
    rows = [
        [f"{row['world']}, {row['gps']}", *_ground(row), str(row["inside"]), str(row["lost"])]
        for row in found["rows"]
    ]
    return (
        f"{grid(head, rows)}\n\nLargest over {results.seeds('sequence')}, truth (height: "
        f"navigation record); inside, lost: of {len(found['seeds'])} flights; the scripted pilot "
        "sees the navigation, 0.2 s late."
    )


def sequence_changes(results: Results) -> str:
    """What a change of modes does to the commands, largest over the seeds."""
    found = results["sequence"]
    head = [
        "world, receiver",
        "change",
        "flown",
        "set-point, deg",
        "collective",
        "later set-point, deg",
        "tilt, deg",
    ]
    rows = [
        [
            f"{row['world']}, {row['gps']}",
            one["change"],
            str(one["flown"]),
            f"{one['attitude_deg']:.2f}",
            f"{one['collective']:.4f}",
            f"{one['later_deg']:.2f}",
            f"{one['tilt_deg']:.1f}",
        ]
        for row in found["rows"]
        for one in row["changes"]
    ]
    return (
        f"{grid(head, rows)}\n\nThe first command of the new mode against the last one of the "
        "old, 40 ms before, with what the receiver's noise makes of it, at changes more than 1 m "
        "above the ground; later set-point: the largest step of 40 ms in the 2 s after, sticks and "
        "reference included; tilt: the largest of these. Largest over "
        f"{results.seeds('sequence')}."
    )


def into_wind(results: Results) -> str:
    """Angle between nose and wind, world by world."""
    found = results["into_wind"]
    near = f"within {found['within_deg']:g} deg"
    head = ["world, wind", "median, deg", "largest, deg", near, "after, median, s"]
    rows = [
        [
            f"{row['world']}, {row['wind_mps']:g} m/s",
            f"{row['median_deg']:.0f}",
            f"{row['max_deg']:.0f}",
            str(row["within"]),
            "–" if row["median_took_s"] is None else f"{row['median_took_s']:.0f}",
        ]
        for row in found["rows"]
    ]
    return (
        f"{grid(head, rows)}\n\nAngle between the nose, truth, mean of the last 20 s of flights of "
        "85 s, and the mean wind, which comes from anywhere; the nose points north at first; "
        f"{results.seeds('into_wind')}; within: of {len(found['seeds'])} flights; after: from the "
        "beginning of the hover. Simulated, turbulence on, standalone receiver."
    )


def _ground(row: Mapping[str, Any]) -> list[str]:
    """Largest figures on the ground; a dash for what was never flown."""
    largest = row["max"]
    return [f"{largest[m.key]:.2f}" if m.key in largest else "–" for m in GROUND_METRICS]


def _nose(row: Mapping[str, Any]) -> str:
    return f"{row['world']}, nose {'into the wind' if row['into_the_wind'] else 'north'}"


def _largest(row: Mapping[str, Any]) -> list[str]:
    cells = [f"{row['max'][m.key]:.2f}" if m.key in row["max"] else "–" for m in METRICS["hover"]]
    return [*cells, str(row["inside"]), str(row["lost"])]


def rates(results: Results) -> str:
    """The hover test at each rate of IMU, observer and inner loop."""
    found = results["rates"]
    keys = ("longitudinal", "lateral", "altitude", "v_x", "v_y", "v_z")
    head = ["receiver, from", "Hz", "forward, m", "lateral, m", "height, m", "forward, m/s",
            "lateral, m/s", "vertical, m/s", "inside", "lost", "disk margin, input",
            "output"]  # fmt: skip
    rows = [
        [
            f"{row['gps']}, {row['source']}",
            str(row["rate_hz"]),
            *(f"{row['max'][key]:.2f}" for key in keys),
            str(row["inside"]),
            str(row["lost"]),
            f"{row['disk_input']:.3f}",
            f"{row['disk_output']:.3f}",
        ]
        for row in found["rows"]
    ]
    return (
        f"{grid(head, rows)}\n\nLargest over {results.seeds('rates')} in the scored windows, one "
        f"process, world honest, packaged laws; inside the paper's figures, lost: of "
        f"{len(found['seeds'])} flights. A seed's noise is drawn per sample, so at another rate it "
        "is another flight in air of the same kind. Disk margins: of the attitude loop as flown, "
        "all channels at once."
    )
