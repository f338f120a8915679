# SPDX-License-Identifier: Apache-2.0
"""The controllers in the attitude test.

A command of `heli` flies it.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from evidence.files import Results
from evidence.registry import TWENTY, produces, table
from evidence.tables import LAWS, grid, world

produces(
    "laws",
    "./heli compare attitude --seeds 1..20 --ideal-navigation --json",
    "The controllers in the attitude test.",
    TWENTY,
)
produces(
    "laws_gusts",
    "./heli compare attitude --seeds 1..20 --ideal-navigation --json --gusts",
    "The controllers in the attitude test with gusts.",
    TWENTY,
)
produces(
    "laws_flap_back",
    "./heli compare attitude --seeds 1..20 --ideal-navigation --json --gusts --flap-back",
    "The same on a rotor that flaps back.",
    TWENTY,
)


IN_WHAT = {
    "navigation": "state estimate",
    "truth": "truth",
    "ideal": "truth, ideal navigation",
}


_AXES = ("roll", "pitch")


_RIVALS = ("hinf_output", "hinf")
"""Controllers whose wins over the PID the short comparison counts."""


# Rows of the short comparison: name, result file, what the error is taken from.
_TESTS = (
    ("attitude test", "laws", "truth"),
    ("gusts", "laws_gusts", "truth"),
    ("gusts, ideal navigation", "laws_gusts", "ideal"),
    ("gusts, flap-back {flap_back:g} rad s/m", "laws_flap_back", "truth"),
)


@table("laws")
def laws(results: Results) -> str:
    """Largest error of each controller, and who wins on how many seeds."""
    head = ["error", "test", *LAWS.values(), *(f"{LAWS[law]} smaller than PID" for law in _RIVALS)]
    rows = []
    for i, axis in enumerate(_AXES):
        for name, file, source in _TESTS:
            record = results[file]
            errors = {law: _errors(record, law, source, i) for law in LAWS}
            rows.append(
                [
                    axis,
                    name.format(flap_back=record["flap_back_radpmps"]),
                    *(_worst(errors[law]) for law in LAWS),
                    *(
                        f"{_won(errors[law], errors['pid'])} of {len(errors['pid'])}"
                        for law in _RIVALS
                    ),
                ]
            )
    return (
        f"{grid(head, rows)}\n\nLargest error from truth over {results.seeds('laws')}, deg, 5 s to "
        "60 s. The controllers do not know of the flap-back.\n"
        f"{_world_of_laws(results)}"
    )


def _world_of_laws(results: Results) -> str:
    return world(
        {
            "attitude test": [results["laws"]["conditions"]],
            "gusts": [results["laws_gusts"]["conditions"]],
        }
    )


@table("laws_in_full")
def laws_in_full(results: Results) -> str:
    """As `laws`, by state estimate, truth and ideal navigation, each against the PID."""
    head = ["test", "controller", *(f"{axis}, {IN_WHAT[s]}" for s in IN_WHAT for axis in _AXES)]
    rows = []
    tests = {"laws": "no gusts", "laws_gusts": "gusts", "laws_flap_back": "gusts, flap-back"}
    for file, name in tests.items():
        record = results[file]
        for law, law_name in LAWS.items():
            cells = []
            for source in IN_WHAT:
                for i in range(len(_AXES)):
                    errors = _errors(record, law, source, i)
                    pid = _errors(record, "pid", source, i)
                    cells.append(
                        _worst(errors) + ("" if law == "pid" else f"; {_won(errors, pid)}")
                    )
            rows.append([name, law_name, *cells])
    return (
        f"{grid(head, rows)}\n\nLargest error over {results.seeds('laws')}, deg, and on how many "
        f"of them it is below the PID's. Flap-back: "
        f"{results['laws_flap_back']['flap_back_radpmps']:g} rad s/m, unknown to the controllers.\n"
        f"{_world_of_laws(results)}"
    )


def _errors(results: Mapping[str, Any], law: str, source: str, axis: int) -> list[float]:
    """Largest error of a controller by seed; inf if the helicopter was lost."""
    flights = {
        flight["seed"]: float("inf") if flight["lost"] else flight["max_deg"][axis]
        for flight in results["flights"]
        if (flight["law"], flight["source"]) == (law, source)
    }
    return [flights[seed] for seed in results["seeds"]]


def _won(errors: Sequence[float], others: Sequence[float]) -> int:
    """On how many seeds a controller's error is smaller than another's."""
    return sum(a < b for a, b in zip(errors, others, strict=True))


def _worst(errors: Sequence[float]) -> str:
    return "lost" if max(errors) == float("inf") else f"{max(errors):.2f}"
