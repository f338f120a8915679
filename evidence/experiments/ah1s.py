# SPDX-License-Identifier: Apache-2.0
"""JSBSim's AH-1S, identified by us and flown by our loops: what holds and what does not; JSON.

Usage: ./heli python -m evidence.experiments.ah1s [--seeds 1..10]

It needs jsbsim, which set-up does not install. About 130 flights of 3 s each on a core.
"""

import json
import math
import os
import statistics
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from importlib.metadata import version
from importlib.util import find_spec
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from evidence.files import Results
from evidence.options import parser_with_seeds
from evidence.registry import FIT, produces, table
from evidence.tables import grid
from heli_flight.terminal import steps

NEEDS = "jsbsim"
LIST = "requirements/hashes/jsbsim.txt"
TEN = tuple(range(1, 11))
WINDS_MPS = {
    ("hinf_output", False): (5.0,),
    ("hinf_output", True): (5.0, 10.0, 15.0, 20.0),
    ("hinf", False): (5.0,),
}
"""By controller, and whether our observer navigates; still air besides."""
_NAVIGATION = ("true", "observer")

produces(
    "ah1s",
    "./heli python -m evidence.experiments.ah1s --seeds 1..10",
    "JSBSim's AH-1S, identified by us and flown by our loops: what holds and what does not.",
    TEN,
    FIT,
    needs=NEEDS,
)


def _flights() -> Any:
    """`support.ah1s_flights`, which imports jsbsim."""
    tests = str(Path(__file__).resolve().parents[2] / "tests")
    if tests not in sys.path:
        sys.path.insert(0, tests)
    from support import ah1s_flights

    return ah1s_flights


# -------------------------------------------------------------------------------------------------
# What is flown.
# -------------------------------------------------------------------------------------------------

Task = tuple[Any, ...]


def _hover(name: str, observer: bool, wind_mps: float, seed: int) -> dict[str, Any]:
    f = _flights()
    controller = f.CONTROLLERS[name]
    air = f.diagonal(wind_mps, wind_mps, seed) if wind_mps else f.STILL
    facts: dict[str, Any] = f.away(f.flown(controller=controller, observer=observer, air=air))
    return facts


def _drift(name: str, observer: bool) -> dict[str, Any]:
    f = _flights()
    facts: dict[str, Any] = f.handed_over_early(f.CONTROLLERS[name], observer)
    return facts


def _climb(name: str, observer: bool) -> dict[str, Any]:
    f = _flights()
    facts: dict[str, Any] = f.away(f.climbed(f.CONTROLLERS[name], observer))
    return facts


def _way(name: str, observer: bool) -> dict[str, Any]:
    f = _flights()
    facts: dict[str, Any] = f.away(f.went(f.CONTROLLERS[name], observer))
    return facts


def _step(name: str, observer: bool, axis: str) -> dict[str, Any]:
    f = _flights()
    facts: dict[str, Any] = f.stepped(axis, f.CONTROLLERS[name], observer)
    return facts


def _margin(name: str, stick: str) -> dict[str, Any]:
    f = _flights()
    controller = f.CONTROLLERS[name]
    said = f.predicted_margins(controller)[f.STICKS.index(stick)]
    return {"predicted": _margin_of(said), "flown": _margin_of(f.flown_margin(stick, controller))}


def _margin_of(margin: Any) -> dict[str, float | None]:
    return {key: _finite(value) for key, value in margin._asdict().items()}


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _run(task: tuple[Callable[..., dict[str, Any]], Task]) -> dict[str, Any]:
    flies, words = task
    return flies(*words)


def flown(seeds: Sequence[int]) -> dict[str, Any]:
    """All that the tables show."""
    f = _flights()
    names = tuple(f.CONTROLLERS)
    hovers = [
        (name, observer, wind_mps)
        for name in names
        for observer in (False, True)
        for wind_mps in (0.0, *WINDS_MPS.get((name, observer), ()))
    ]
    tasks: list[tuple[Callable[..., dict[str, Any]], Task]] = []
    for name, observer, wind_mps in hovers:
        own = seeds if wind_mps else seeds[:1]
        tasks += [(_hover, (name, observer, wind_mps, seed)) for seed in own]
    both = [(name, observer) for name in names for observer in (False, True)]
    early = [(names[0], observer) for observer in (False, True)]
    tasks += [(_climb, words) for words in both] + [(_way, words) for words in both]
    tasks += [(_drift, words) for words in early]
    tasks += [(_step, (*words, axis)) for words in both for axis in f.AXES]
    tasks += [(_margin, (name, stick)) for name in names for stick in f.STICKS]
    about = [_design(f, name) for name in names]  # what the workers share is worked out here
    found: dict[tuple[str, Task], dict[str, Any]] = {}
    workers = len(os.sched_getaffinity(0))
    with (
        ProcessPoolExecutor(workers, get_context("fork")) as pool,
        steps("flights", len(tasks)) as progress,
    ):
        flights = zip(tasks, pool.map(_run, tasks), strict=True)
        for done, ((flies, words), facts) in enumerate(flights, start=1):
            found[flies.__name__, words] = facts
            progress(done)
    rows = []
    for name, observer, wind_mps in hovers:
        own = seeds if wind_mps else seeds[:1]
        of_place = [found["_hover", (name, observer, wind_mps, seed)] for seed in own]
        rows.append({**_place(name, observer), "wind_mps": wind_mps, **_summary(of_place, f)})
    return {
        "jsbsim": version(NEEDS),
        "required": {
            "hover_m": f.HOVER_M, "hover_down_m": f.HOVER_DOWN_M, "in_wind_m": f.IN_WIND_M,
            "heading_deg": f.HOVER_HEADING_DEG, "overshoot": f.OVERSHOOT, "coupling": f.COUPLING,
        },
        "identified": f.identified_facts(),
        "designs": about,
        "hover": rows,
        "drift": [{**_place(*words), **found["_drift", words]} for words in early],
        "climb": [{**_place(*words), **found["_climb", words]} for words in both],
        "way": [{**_place(*words), **found["_way", words]} for words in both],
        "steps": [
            {**_place(*words), "axis": axis, **found["_step", (*words, axis)]}
            for words in both
            for axis in f.AXES
        ],
        "margins": [
            {"controller": name, "stick": stick, **found["_margin", (name, stick)]}
            for name in names
            for stick in f.STICKS
        ],
    }  # fmt: skip


def _place(name: str, observer: bool) -> dict[str, Any]:
    return {"controller": name, "navigation": _NAVIGATION[observer]}


def _summary(flights: Sequence[dict[str, Any]], f: Any) -> dict[str, Any]:
    """Medians and worst of the flights that were not lost."""
    kept = [facts for facts in flights if not facts["lost"]]
    keys = ("horizontal_m", "down_m", "heading_deg", "tilt_deg", "at_limit")
    counted = {"flown": len(flights), "lost": len(flights) - len(kept)}
    if not kept:
        return counted
    return {
        **counted,
        "within_2_m": sum(facts["horizontal_m"] < f.IN_WIND_M for facts in kept),
        "median": {key: statistics.median(facts[key] for facts in kept) for key in keys},
        "worst": {key: max(facts[key] for facts in kept) for key in keys},
        "rotor_share": [
            min(facts["rotor_share"][0] for facts in kept),
            max(facts["rotor_share"][1] for facts in kept),
        ],
    }


def _design(f: Any, name: str) -> dict[str, Any]:
    controller = f.CONTROLLERS[name]
    facts: dict[str, Any] = {"controller": name, **f.design_facts(controller)}
    return facts


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

_WORDS = {"hinf_output": "output feedback", "hinf": "eq. (17)"}


def _who(row: dict[str, Any]) -> str:
    navigation = "true states" if row["navigation"] == "true" else "our observer"
    return f"{_WORDS[row['controller']]}, {navigation}"


@table("ah1s_hover")
def hover(results: Results) -> str:
    """Largest distances from the reference, in still air, in wind, on the climb and on the way."""
    record = results["ah1s"]
    head = ["controller, navigation", "flown", "wind, m/s", "lost", "horizontal, m", "vertical, m",
            "heading, deg", "a stick at its limit, % of the time"]  # fmt: skip
    rows = []
    for row in record["hover"]:
        cells = [_who(row), "hover", f"{row['wind_mps']:g}", f"{row['lost']} of {row['flown']}"]
        rows.append(cells + _distances(row, row["flown"] > 1))
    for key, words, wind in (
        ("climb", "climb of 10 m", "0"),
        ("way", "15 m north, 15 m east", "0"),
        ("drift", "handed over at {speed_mps:.1f} m/s", "5, steady"),
    ):
        for row in record[key]:
            lost = f"{int(bool(row['lost']))} of 1"
            distances = {} if row["lost"] else {"median": row, "worst": row}
            cells = [_who(row), words.format(**row), wind, lost]
            rows.append(cells + _distances(distances, False))
    return (
        f"{grid(head, rows)}\n\nJSBSim {record['jsbsim']}; in wind {results.seeds('ah1s')} of its "
        "turbulence (MIL-F-8785C, as strong as the wind at 20 ft), from 45 deg off the nose; world "
        "`paper` for our sensors, RTK. Largest distances from the reference from 5 s on, of 60 s: "
        "median / worst of the flights that were not lost."
    )


def _distances(row: dict[str, Any], several: bool) -> list[str]:
    if "worst" not in row:
        return ["–"] * 4
    cells = []
    for key, digits, times in (
        ("horizontal_m", 2, 1.0), ("down_m", 2, 1.0), ("heading_deg", 1, 1.0), ("at_limit", 0, 1e2)
    ):  # fmt: skip
        median, worst = (f"{times * row[of][key]:.{digits}f}" for of in ("median", "worst"))
        cells.append(f"{median} / {worst}" if several else worst)
    return cells


@table("ah1s_steps")
def attitude_steps(results: Results) -> str:
    """Of a step of 5 deg of roll and of pitch."""
    record = results["ah1s"]
    head = ["controller, navigation", "axis", "90 % after, s", "within 10 % after, s",
            "overshoot, %", "the other axis, %"]  # fmt: skip
    rows = [
        [_who(row), row["axis"], _seconds(row["rise_s"]), _seconds(row["settling_s"]),
         f"{100.0 * row['overshoot']:.0f}", f"{100.0 * row['coupling']:.0f}"]
        for row in record["steps"]
    ]  # fmt: skip
    required = record["required"]
    return (
        f"{grid(head, rows)}\n\nSteps of 5 deg, 4 s long, in still air. Asked for: overshoot below "
        f"{100.0 * required['overshoot']:.0f} % (a damping ratio of 0.35, ADS-33E-PRF 3.3.2.2.2), "
        f"the other axis below {100.0 * required['coupling']:.0f} % (3.3.9.2, Level 1)."
    )


def _seconds(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"


@table("ah1s_margins")
def margins(results: Results) -> str:
    """What the identified model says, beside what was flown with gain and delay on one stick."""
    head = ["controller", "stick", "gain, dB: model", "flown", "delay, ms: model", "flown"]
    rows = []
    for row in results["ah1s"]["margins"]:
        cells = [_WORDS[row["controller"]], row["stick"]]
        for key, times, digits in (("gain_up_db", 1.0, 1), ("delay_s", 1e3, 0)):
            for of in ("predicted", "flown"):
                value = row[of][key]
                beyond = "none" if of == "predicted" else "beyond what was tried"
                cells.append(beyond if value is None else f"{times * value:.{digits}f}")
        rows.append(cells)
    return (
        f"{grid(head, rows)}\n\nGain up, and delay, of one stick, the others as they are. lat, "
        "lon, ped: attitude loop; col: vertical axis of the position loop. Flown: still air, steps "
        "of 2 deg of roll; with more it does not come to rest within 12 s of the last one. Tried "
        "up to 30 dB, in steps of 0.5 dB, and 600 ms, in steps of 10 ms."
    )


def main() -> int:
    """Print the record; 2 without jsbsim."""
    asked = parser_with_seeds(__doc__).parse_args()
    if find_spec(NEEDS) is None:
        print(
            f"ah1s: {NEEDS} is not installed; ./heli python -m pip install --no-deps "
            f"--require-hashes -r {LIST}",
            file=sys.stderr,
        )
        return 2
    os.environ["JSBSIM_DEBUG"] = "0"  # it prints to stdout else
    print(json.dumps(flown(asked.seeds), allow_nan=False))
    return 0


if __name__ == "__main__":
    sys.exit(main())
