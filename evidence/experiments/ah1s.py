# SPDX-License-Identifier: Apache-2.0
"""JSBSim's AH-1S, identified by us and flown by our loops: what holds and what does not; JSON.

Usage: ./heli python -m evidence.experiments.ah1s [--seeds 1..10]

It needs jsbsim, which set-up does not install. About 130 flights of 3 s each on a core.
"""

import math
import os
import statistics
import sys
from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from evidence.files import Results
from evidence.registry import FIT, produces, table
from evidence.sweep import Options, over, print_result
from evidence.tables import grid

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


@over()
def flown(name: str, observer: bool, what: str, wind_mps: float, seed: int) -> dict[str, Any]:
    """Facts of a flight, or, of a stick's margin, of those that it takes.

    Parameters
    ----------
    name : str
        Attitude controller.
    observer : bool
        Whether our observer navigates.
    what : str
        hover, climb, way, drift, an axis that is stepped, or a stick whose margins are sought.
    wind_mps : float
        Wind of a hover; its turbulence is as strong.
    seed : int
        Of the turbulence, and of our sensors.
    """
    f = _flights()
    controller = f.CONTROLLERS[name]
    facts: dict[str, Any]
    if what in f.STICKS:
        said = f.predicted_margins(controller)[f.STICKS.index(what)]
        margin = f.flown_margin(what, controller)
        facts = {"predicted": _margin_of(said), "flown": _margin_of(margin)}
    elif what in f.AXES:
        facts = f.stepped(what, controller, observer)
    elif what == "hover":
        air = f.diagonal(wind_mps, wind_mps, seed) if wind_mps else f.STILL
        facts = f.away(f.flown(controller=controller, observer=observer, air=air))
    elif what == "drift":
        facts = f.handed_over_early(controller, observer)
    else:
        flies = {"climb": f.climbed, "way": f.went}[what]
        facts = f.away(flies(controller, observer))
    return facts


def _margin_of(margin: Any) -> dict[str, float | None]:
    return {key: _finite(value) for key, value in margin._asdict().items()}


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _point(name: str, observer: bool, what: str, wind_mps: float = 0.0) -> dict[str, Any]:
    return {"name": name, "observer": observer, "what": what, "wind_mps": wind_mps}


def experiment(options: Options) -> dict[str, Any]:
    """All that the tables show."""
    f = _flights()
    names = tuple(f.CONTROLLERS)
    both = [(name, observer) for name in names for observer in (False, True)]
    once = [_point(*who, what) for who in both for what in ("hover", "climb", "way", *f.AXES)]
    once += [_point(names[0], observer, "drift") for observer in (False, True)]
    once += [_point(name, False, stick) for name in names for stick in f.STICKS]
    blown = [_point(*who, "hover", wind) for who in both for wind in WINDS_MPS.get(who, ())]
    places = [*flown.places(options, blown)]
    places += flown.places(replace(options, seeds=options.seeds[:1]), once)
    found = {tuple(place.point.values()): place.flights for place in places}

    def of(what: str) -> list[dict[str, Any]]:
        return [
            {**_place(*who), **found[*who, what, 0.0][0]}
            for who in both
            if (*who, what, 0.0) in found
        ]

    return {
        "jsbsim": version(NEEDS),
        "required": {
            "hover_m": f.HOVER_M,
            "hover_down_m": f.HOVER_DOWN_M,
            "in_wind_m": f.IN_WIND_M,
            "heading_deg": f.HOVER_HEADING_DEG,
            "overshoot": f.OVERSHOOT,
            "coupling": f.COUPLING,
        },
        "identified": f.identified_facts(),
        "designs": [{"controller": name, **f.design_facts(f.CONTROLLERS[name])} for name in names],
        "hover": [
            {
                **_place(*who),
                "wind_mps": wind,
                **_summary(found[*who, "hover", wind], f.IN_WIND_M),
            }
            for who in both
            for wind in (0.0, *WINDS_MPS.get(who, ()))
        ],
        "drift": of("drift"),
        "climb": of("climb"),
        "way": of("way"),
        "steps": [
            {**_place(*who), "axis": axis, **found[*who, axis, 0.0][0]}
            for who in both
            for axis in f.AXES
        ],
        "margins": [
            {"controller": name, "stick": stick, **found[name, False, stick, 0.0][0]}
            for name in names
            for stick in f.STICKS
        ],
    }


def _place(name: str, observer: bool) -> dict[str, Any]:
    return {"controller": name, "navigation": _NAVIGATION[observer]}


def _summary(flights: Sequence[dict[str, Any]], within_m: float) -> dict[str, Any]:
    """Medians and worst of the flights that were not lost."""
    kept = [facts for facts in flights if not facts["lost"]]
    keys = ("horizontal_m", "down_m", "heading_deg", "tilt_deg", "at_limit")
    counted = {"flown": len(flights), "lost": len(flights) - len(kept)}
    if not kept:
        return counted
    return {
        **counted,
        "within_2_m": sum(facts["horizontal_m"] < within_m for facts in kept),
        "median": {key: statistics.median(facts[key] for facts in kept) for key in keys},
        "worst": {key: max(facts[key] for facts in kept) for key in keys},
        "rotor_share": [
            min(facts["rotor_share"][0] for facts in kept),
            max(facts["rotor_share"][1] for facts in kept),
        ],
    }


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


@table("ah1s_designs")
def designs(results: Results) -> str:
    """What was identified in short, and both designs."""
    record = results["ah1s"]
    head = ["controller", "gamma / gamma*", "disk margin, input / output", "lag, pitch / roll, s",
            "K_P, 1/s2", "K_D, 1/s", "disturbance, rad/s", "crossover, rad/s"]  # fmt: skip
    rows = []
    for row in record["designs"]:
        gains = row["position"]
        rows.append(
            [
                _WORDS[row["controller"]],
                f"{row['gamma']:.3g} / {row['gamma_star']:.3g}",
                f"{row['disk_input']:.2f} / {row['disk_output']:.2f}",
                " / ".join(f"{lag_s:.2f}" for lag_s in row["lags_s"]),
                *(
                    ", ".join(f"{value:.2g}" for value in values)
                    for values in (
                        gains["K_P"],
                        gains["K_D"],
                        gains["disturbance.bandwidth_radps"],
                        row["position_crossovers_radps"],
                    )
                ),
            ]
        )
    found = record["identified"]
    return (
        f"{grid(head, rows)}\n\nGains forward, right, down. Identified: {found['mass_kg']:.0f} kg, "
        f"A(p,p) {found['p_p_1ps']:.1f}, A(q,q) {found['q_q_1ps']:.1f}, A(r,r) "
        f"{found['r_r_1ps']:.2f} 1/s; servos of {found['servo_radps']:.0f} rad/s, "
        f"{found['delay_ticks']} ticks of delay; heave damping {found['heave_damping_1ps']:.2f} "
        f"1/s, {found['lift_mps2']:.1f} m/s2 of the collective."
    )


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
    if find_spec(NEEDS) is None:
        print(
            f"ah1s: {NEEDS} is not installed; ./heli python -m pip install --no-deps "
            f"--require-hashes -r {LIST}",
            file=sys.stderr,
        )
        return 2
    os.environ["JSBSIM_DEBUG"] = "0"  # it prints to stdout else
    return print_result(__doc__, experiment, "1..10")


if __name__ == "__main__":
    sys.exit(main())
