# SPDX-License-Identifier: Apache-2.0
"""Tables of handling qualities: manoeuvres flown and scored, responses to sweeps."""

from collections.abc import Mapping
from typing import Any

from heli_flight.studies.results.files import Results
from heli_flight.studies.results.grid import grid, world
from heli_handling.scoring import Level

_LEVELS = [level.value for level in Level]
_FULL = "full"


def mte(results: Results) -> str:
    """Levels of the manoeuvres over all seeds, and the worst value of each criterion."""
    found = results["mte"]
    head = ["manoeuvre", "world, receiver", *_LEVELS, "not as defined", "worst of all flights"]
    rows = [[_manoeuvre(row), _place(row), *_flights(row)] for row in _flown(found)]
    refused = [
        f"{row['manoeuvre']} at full size ({row['refused'].partition('takes ')[2]})"
        for row in {r["manoeuvre"]: r for r in found["rows"] if "refused" in r}.values()
    ]
    flown_in = {row["world"]: [row["conditions"]] for row in _flown(found)}
    return (
        f"{grid(head, rows)}\n\nOf {len(found['seeds'])} flights each, {results.seeds('mte')}, the "
        "default law; worst values by ground truth, in brackets where the worst is only "
        "adequate, in bold where it is neither. Refused: "
        f"{'; '.join(refused)}. {world(flown_in)}"
    )


def mte_short(results: Results) -> str:
    """Where not every flight is desired: the criteria, per size and receiver."""
    lines = []
    for scale in dict.fromkeys(row["scale"] for row in _flown(results["mte"])):
        for gps in dict.fromkeys(row["gps"] for row in _flown(results["mte"])):
            rows = [r for r in _flown(results["mte"]) if (r["scale"], r["gps"]) == (scale, gps)]
            short = {
                level: _names(rows, level) for level in (Level.NEITHER.value, Level.ADEQUATE.value)
            }
            said = "; ".join(f"{level} in some flights: {', '.join(n)}" if n else f"{level}: none"
                             for level, n in short.items())  # fmt: skip
            all_of = sum(sum(row["levels"].values()) + len(row["missing"]) for row in rows)
            desired = sum(row["levels"][Level.DESIRED.value] for row in rows)
            lines.append(f"- {_size(scale)}, {gps}: {desired} of {all_of} flights desired; {said}.")
    return "\n".join(lines)


def response(results: Results) -> str:
    """Bandwidth, phase delay, quickness and disturbance rejection by law and axis."""
    found = results["response"]
    head = [
        "law, axis",
        "bandwidth, rad/s",
        "6 dB of gain, rad/s",
        "phase delay, s",
        "DRB, rad/s",
        "DRP, dB",
        "quickness, 1/s, step of 20, 10 deg",
    ]
    rows = [
        [
            f"`{row['laws']}`, {row['axis']}",
            *(
                _beside(row["flown"][key], row["linear"][key])
                for key in ("phase_radps", "gain_radps", "phase_delay_s")
            ),
            *(
                _beside(row["rejection"][key], row["linear_rejection"][key])
                for key in ("bandwidth_radps", "peak_db")
            ),
            ", ".join(_span(step["quickness_per_s"]) for step in row["steps"]),
        ]
        for row in found["rows"]
    ]
    command, rejection = (
        max(row[key] for row in found["rows"])
        for key in ("rms_difference_db", "rejection_difference_db")
    )
    return (
        f"{grid(head, rows)}\n\nFlown, of {len(found['seeds'])} flights "
        f"({results.seeds('response')}) the least and the largest, in calm air, RTK; in brackets "
        "the linear model of the same loop. Gains of both differ over the coherent lines by "
        f"{command:.1f} dB rms at most (response to the command, "
        f"{_span(found['rows'][0]['coherent_radps'])} rad/s for the first) and {rejection:.1f} dB "
        "(rejection of disturbances)."
    )


def _beside(flown: list[float] | None, linear: float | None) -> str:
    """What was flown, and in brackets the linear model's."""
    return f"{'not reached' if flown is None else _span(flown)} ({_number(linear)})"


def _span(ends: list[float]) -> str:
    low, high = (_number(end) for end in ends)
    return low if low == high else f"{low} to {high}"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"


def _flown(found: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [row for row in found["rows"] if "refused" not in row]


def _size(scale: str) -> str:
    return "full size" if scale == _FULL else "scaled"


def _manoeuvre(row: Mapping[str, Any]) -> str:
    return f"{row['manoeuvre']}, {_size(row['scale'])}"


def _place(row: Mapping[str, Any]) -> str:
    return f"{row['world']}, {row['gps']}"


def _flights(row: Mapping[str, Any]) -> list[str]:
    worst = ", ".join(_worst(criterion) for criterion in row["criteria"])
    undefined = row["not_as_defined"] + len(row["missing"]) + row["lost"]
    return [*(str(row["levels"][level]) for level in _LEVELS), str(undefined), worst]


def _worst(criterion: Mapping[str, Any]) -> str:
    """Name and worst value, marked by its level."""
    value = criterion["worst"]
    said = "–" if value is None else f"{value:.3g} {criterion['unit']}"
    if criterion["levels"][Level.NEITHER.value]:
        said = f"**{said}**"
    elif criterion["levels"][Level.ADEQUATE.value]:
        said = f"({said})"
    return f"{criterion['name']} {said}"


def _names(rows: list[Mapping[str, Any]], level: str) -> list[str]:
    """Criteria of manoeuvres that were at a level in a flight."""
    return list(
        dict.fromkeys(
            f"{row['manoeuvre']} {criterion['name']}"
            for row in rows
            for criterion in row["criteria"]
            if criterion["levels"][level]
        )
    )
