# SPDX-License-Identifier: Apache-2.0
"""The hover test with both receivers.

A command of `heli` flies it.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from evidence.files import Results
from evidence.registry import TWENTY, produces, table
from evidence.tables import RECEIVERS, RECORDS, grid, world
from heli_core.metrics import BY_KEY, CLIMB_METRICS, OVERSHOOT_S
from heli_flight.scoring import DECIDES, WHOLE, WINDOWS

produces(
    "hover",
    "./heli campaign --scenario hover --world paper --seeds 1..20 --json",
    "The hover test with both receivers.",
    TWENTY,
)
produces(
    "attitude",
    "./heli campaign --scenario attitude --seeds 1..20 --json",
    "The attitude test with both receivers.",
    TWENTY,
)


TESTS = ("hover", "attitude")


_NONE = "–"


# Where a flight's row holds the largest magnitudes over a stretch.
_MAX = {WHOLE: "max_whole", WINDOWS: "max"}


@table("paper")
def paper(results: Results) -> str:
    """Hover and attitude test beside the paper, both receivers, over what the files hold."""
    receivers = {test: results[test]["receivers"] for test in TESTS}
    flights = [f for test in TESTS for name in RECEIVERS for f in receivers[test][name]["flights"]]
    stretches = [s for s, key in _MAX.items() if all(key in flight for flight in flights)]
    parts = []
    for stretch in stretches:
        if len(stretches) > 1:
            decides = " They decide the exit code." if stretch == DECIDES else ""
            parts.append(_HEADS[stretch] + decides + _inside(receivers, stretch))
        parts.append(_stretch(receivers, stretch))
    climb = _climb(receivers["hover"])
    if climb:
        parts += [_CLIMB, climb]
    good = sum(flight["exit_code"] == 0 for flight in flights)
    worlds = {
        f"{test} test": [receivers[test][name]["conditions"] for name in RECEIVERS]
        for test in TESTS
    }
    parts.append(
        f"Largest magnitude over {results.seeds('hover')}; on how many of them it is outside the "
        f"paper's figure, if on any. Exit code 0: {good} of {len(flights)} flights.\n"
        f"{world(worlds)}"
    )
    return "\n\n".join(parts)


_HEADS = {
    WHOLE: "**Whole flight**, from engagement to the end, climb included, against the reference "
    "as commanded.",
    WINDOWS: "**Scored windows**: hover alone.",
}


_CLIMB = (
    "**Climb**: smallest to largest value over the seeds. Overshoot beyond the new height within "
    f"{OVERSHOOT_S:g} s of the reference's arrival; time from the command's start until within "
    f"{BY_KEY['altitude'].paper:g} m of it; lag behind the reference at half the climb."
)


def _inside(receivers: Mapping[str, Any], stretch: str) -> str:
    """How many flights are inside, by test and receiver; empty where the files do not say."""
    lines = [
        f"{test} test, {words} {receiver['inside'][stretch]} of {len(receiver['flights'])}"
        for test in TESTS
        for name, words in RECEIVERS.items()
        for receiver in [receivers[test][name]]
        if "inside" in receiver
    ]
    return f" Flights inside: {'; '.join(lines)}." if lines else ""


def _columns(receivers: Mapping[str, Any], key: str) -> Iterator[tuple[str, str]]:
    """Receiver and record of each column that the files hold; less drift: not of RTK."""
    for name in RECEIVERS:
        for record in RECORDS:
            if name == "rtk" and record == "truth_less_drift":
                continue
            rows = [
                f for test in TESTS if test in receivers for f in receivers[test][name]["flights"]
            ]
            if any(place.endswith(f"({record})") for f in rows for place in f[key]):
                yield name, record


def _stretch(receivers: Mapping[str, Any], stretch: str) -> str:
    columns = list(_columns(receivers, _MAX[stretch]))
    head = ["metric", "paper (flight)", *(f"{RECEIVERS[n]}, {RECORDS[r]}" for n, r in columns)]
    rows = []
    for test in TESTS:
        for metric in receivers[test]["standalone"]["metrics"]:
            of = (metric["measured_from"], metric.get("stretch", "windows"))
            if of != ("navigation", stretch):
                continue
            cells = [
                _beside_paper(receivers[test][name], metric, record, _MAX[stretch])
                for name, record in columns
            ]
            label = metric["label"] + (", attitude test" if test == "attitude" else "")
            rows.append([label, f"{metric['paper']:g} {metric['unit']}", *cells])
    return grid(head, rows)


def _beside_paper(
    receiver: Mapping[str, Any], metric: Mapping[str, Any], record: str, place: str
) -> str:
    key = f"{metric['key']} ({record})"
    flown = [flight for flight in receiver["flights"] if not flight["lost"]]
    values = [flight[place][key] for flight in flown if key in flight[place]]
    if flown and not values:
        return _NONE
    lost = len(receiver["flights"]) - len(flown)
    outside = sum(value > metric["paper"] for value in values)
    parts = [f"{max(values):.2f}"] if values else []
    parts += [f"outside on {outside}"] if outside else []
    parts += [f"lost on {lost}"] if lost else []
    return "; ".join(parts)


def _climb(receivers: Mapping[str, Any]) -> str:
    """Figures of the climb; empty where the files hold none."""
    flights = {
        name: [f for f in receivers[name]["flights"] if f.get("climb")] for name in RECEIVERS
    }
    if not any(flights.values()):
        return ""
    columns = list(_columns({"hover": {n: {"flights": f} for n, f in flights.items()}}, "climb"))
    head = ["climb", *(f"{RECEIVERS[name]}, {RECORDS[record]}" for name, record in columns)]
    rows = []
    for metric in CLIMB_METRICS:
        cells = [
            _spread([f["climb"].get(f"{metric.key} ({record})") for f in flights[name]])
            for name, record in columns
        ]
        rows.append([f"{metric.label}, {metric.unit}", *cells])
    return grid(head, rows)


def _spread(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    missed = len(values) - len(known)
    parts = [f"{min(known):.2f} to {max(known):.2f}"] if known else []
    parts += [f"not reached on {missed}"] if missed else []
    return "; ".join(parts)
