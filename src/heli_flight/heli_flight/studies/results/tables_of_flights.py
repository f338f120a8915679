# SPDX-License-Identifier: Apache-2.0
"""Tables of flights: law against law, identified aircraft; with their world."""

from collections.abc import Mapping, Sequence
from typing import Any

from heli_flight.studies.results.files import Results
from heli_flight.studies.results.grid import grid, world

LAWS = {
    "hinf_output": "output feedback (default)",
    "hinf": "state feedback",
    "hinf_offset_free": "offset-free 0.5",
    "lqr": "LQR",
    "pid": "PID",
}
IN_WHAT = {
    "navigation": "navigation record",
    "truth": "truth",
    "ideal": "truth, ideal navigation",
}
_AXES = ("roll", "pitch")
_RIVALS = ("hinf_output", "hinf")
"""Laws whose wins over the PID the short comparison counts."""


# Rows of the short comparison: name, result file, what the error is taken from.
_TESTS = (
    ("attitude test", "laws", "truth"),
    ("gusts", "laws_gusts", "truth"),
    ("gusts, ideal navigation", "laws_gusts", "ideal"),
    ("gusts, flap-back {flap_back:g} rad s/m", "laws_flap_back", "truth"),
)


def laws(results: Results) -> str:
    """Largest error of each law, and who wins on how many seeds."""
    head = ["error", "test", *LAWS.values(), *(f"{LAWS[law]} smaller than PID" for law in _RIVALS)]
    rows = []
    for i, axis in enumerate(_AXES):
        for name, file, source in _TESTS:
            found = results[file]
            errors = {law: _errors(found, law, source, i) for law in LAWS}
            rows.append(
                [
                    axis,
                    name.format(flap_back=found["flap_back_radpmps"]),
                    *(_worst(errors[law]) for law in LAWS),
                    *(
                        f"{_won(errors[law], errors['pid'])} of {len(errors['pid'])}"
                        for law in _RIVALS
                    ),
                ]
            )
    return (
        f"{grid(head, rows)}\n\nLargest error from truth over {results.seeds('laws')}, deg, 5 s to "
        "60 s. The laws do not know of the flap-back.\n"
        f"{_world_of_laws(results)}"
    )


def _world_of_laws(results: Results) -> str:
    return world(
        {
            "attitude test": [results["laws"]["conditions"]],
            "gusts": [results["laws_gusts"]["conditions"]],
        }
    )


def laws_in_full(results: Results) -> str:
    """As `laws`, by navigation record, truth and ideal navigation, each law against the PID."""
    head = ["test", "law", *(f"{axis}, {IN_WHAT[s]}" for s in IN_WHAT for axis in _AXES)]
    rows = []
    tests = {"laws": "no gusts", "laws_gusts": "gusts", "laws_flap_back": "gusts, flap-back"}
    for file, name in tests.items():
        found = results[file]
        for law, law_name in LAWS.items():
            cells = []
            for source in IN_WHAT:
                for i in range(len(_AXES)):
                    own = _errors(found, law, source, i)
                    pid = _errors(found, "pid", source, i)
                    cells.append(_worst(own) + ("" if law == "pid" else f"; {_won(own, pid)}"))
            rows.append([name, law_name, *cells])
    return (
        f"{grid(head, rows)}\n\nLargest error over {results.seeds('laws')}, deg, and on how many "
        f"of them it is below the PID's. Flap-back: "
        f"{results['laws_flap_back']['flap_back_radpmps']:g} rad s/m, unknown to the laws.\n"
        f"{_world_of_laws(results)}"
    )


def _errors(found: Mapping[str, Any], law: str, source: str, axis: int) -> list[float]:
    """Largest error of a law by seed; inf if the helicopter was lost."""
    flights = {
        flight["seed"]: float("inf") if flight["lost"] else flight["max_deg"][axis]
        for flight in found["flights"]
        if (flight["law"], flight["source"]) == (law, source)
    }
    return [flights[seed] for seed in found["seeds"]]


def _won(errors: Sequence[float], others: Sequence[float]) -> int:
    """On how many seeds a law's error is smaller than another's."""
    return sum(a < b for a, b in zip(errors, others, strict=True))


def _worst(errors: Sequence[float]) -> str:
    return "lost" if max(errors) == float("inf") else f"{max(errors):.2f}"


def robustness(results: Results) -> str:
    """Median and worst error on perturbed aircraft."""
    found = results["robustness"]
    by_key = {(row["perturbation"], row["law"]): row for row in found["outcomes"]}
    rows = []
    for key in dict.fromkeys(row["perturbation"] for row in found["outcomes"]):
        cells = [by_key[key, law] for law in LAWS]
        flown = f"{cells[0]['name']} ({cells[0]['flown']})"
        rows.append([flown, *(_spread(row) for row in cells)])
    beyond = sum(row["flown"] - row["kept"] for row in found["outcomes"])
    flown = sum(row["flown"] for row in found["outcomes"])
    return (
        f"{grid(['aircraft (flown)', *LAWS.values()], rows)}\n\nLargest of roll and pitch error "
        f"from truth, deg, as median / worst; beyond {found['limit_deg']:g} deg or lost: {beyond} "
        f"of {flown} flights.\n{world({'gusts': [found['conditions']]})}"
    )


def _spread(row: Mapping[str, Any]) -> str:
    lost = f"; {row['lost']} lost" if row["lost"] else ""
    return f"{row['median_deg']:.2f} / {row['worst_deg']:.2f}{lost}"


_GROUPS = ("A", "B", "servos", "E", "norms")


def identification(results: Results) -> str:
    """Furthest from the truth over seeds, by kind of number, aircraft by aircraft."""
    head = ["aircraft", "seeds", *_GROUPS, "missed", "hover tests with exit code 0"]
    rows: list[list[str]] = []
    flown: dict[str, list[Any]] = {}
    for file in ("identification", "identification_others"):
        found = results[file]
        flown |= {test: [lines] for test, lines in found["conditions"].items()}
        for aircraft in dict.fromkeys(row["aircraft"] for row in found["rows"]):
            own = [row for row in found["rows"] if row["aircraft"] == aircraft]
            good = sum(row["hover_exit_code"] == 0 for row in own)
            rows.append(
                [
                    aircraft.removesuffix(".yaml"),
                    results.seeds(file).removeprefix("seeds ").removeprefix("seed "),
                    *(_furthest([row["worst"][group] for row in own]) for group in _GROUPS),
                    f"{sum(len(row['missed']) for row in own)} of "
                    f"{sum(row['judged'] for row in own)}",
                    f"{good} of {len(own)}",
                ]
            )
    missed = [
        f"{row['aircraft'].removesuffix('.yaml')}, seed {row['seed']}: {entry['name']} is off by "
        f"{100.0 * abs(entry['deviation']):.2f} % ({100.0 * entry['target']:.0f} % allowed)"
        for file in ("identification", "identification_others")
        for row in results[file]["rows"]
        for entry in row["missed"]
    ]
    return (
        f"{grid(head, rows)}\n\nSignificant number of each kind that is furthest from the "
        f"linearised truth over all seeds. Missed: {'; '.join(missed) or 'none'}. Flown in one "
        f"process.\n{world(flown)}"
    )


def _furthest(entries: Sequence[Mapping[str, Any]]) -> str:
    worst = max(entries, key=lambda entry: abs(entry["deviation"]))
    return f"{100.0 * worst['deviation']:+.1f} % {worst['name']}"
