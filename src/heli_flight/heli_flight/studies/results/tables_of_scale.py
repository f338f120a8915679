# SPDX-License-Identifier: Apache-2.0
"""Tables of what flights, tasks and participants cost, and how many of them go together."""

from collections.abc import Mapping
from typing import Any

from heli_flight.studies.results.files import Results
from heli_flight.studies.results.grid import grid
from heli_math.ticks import TICK_S

_PARTS = {
    "resolve_s": "files, layers and checks",
    "build_s": "trim, design, set-up of the loop",
    "fly_s": "flight",
    "score_s": "scoring",
}
_CHUNKS = (1, 10, 100)
_FUZZED = {
    "message": "messages of every topic that is heard",
    "parameters": "parameter files",
    "scenario": "scenario files",
    "campaign": "campaign specs",
    "aircraft": "aircraft files",
    "heli": "commands on damaged bags and folders",
}
# Cores of one node of a cluster, for the table of what a scheduler carries.
_NODE_CORES = 32


def closed_loop(results: Results) -> str:
    """Speed of the loop in one process beside its peer, and the parts of a flight."""
    found = results["closed_loop"]
    rows = [
        ["closed loop", f"{found['times_real_time']:.0f} times real time", "600"],
        [f"peer, {found['peer']}", f"{found['peer_times_real_time']:.1f} times real time", ""],
        ["ratio", f"{found['times_peer']:.0f}", ""],
        *([name, f"{1e3 * found[key]:.1f} ms", ""] for key, name in _PARTS.items()),
        ["`heli hover --one-process --duration 1 --no-report`", f"{found['command_s']:.2f} s", ""],
        ["the same with a report", f"{found['command_with_report_s']:.2f} s", "1.5 s"],
        ["importing numpy, scipy and numba alone", f"{found['imports_s']:.2f} s", ""],
    ]
    return (
        f"{grid(['', 'measured', 'goal'], rows)}\n\nMedians of {found['rounds']} rounds; flights "
        f"of {found['duration_s']:g} s; processor time, the commands wall time."
    )


def graph(results: Results) -> str:
    """Speed of the graph beside the ring, in both shapes."""
    found = results["graph"]
    rows = [
        [
            shape,
            f"{rates['graph']:.0f}",
            f"{rates['graph'] * TICK_S:.1f}",
            f"{rates['objects']:.0f}",
            f"{found['ratios'][shape]['objects']:.2f} ({found['goals'][shape]:g})",
            f"{rates['bytes']:.0f}",
            f"{found['ratios'][shape]['bytes']:.2f}",
        ]
        for shape, rates in found["rates"].items()
    ]
    head = ["nodes in", "graph, ticks/s", "times real time", "ring of objects, cycles/s",
            "ratio (goal)", "ring of bytes, cycles/s", "ratio"]  # fmt: skip
    return (
        f"{grid(head, rows)}\n\nMedians of {found['rounds']} rounds in turn; flights of "
        f"{found['seconds']:g} s, scenario hover, world paper, seed 1, standalone receiver, "
        f"packaged laws, recorded; {_machine(found)}."
    )


def latency(results: Results) -> str:
    """From an IMU sample to its actuators in real time, beside the ring."""
    return _in_real_time(results["latency"])


def latency_400(results: Results) -> str:
    """The same with IMU, observer and inner loop at 400 Hz."""
    return _in_real_time(results["latency_400"])


def _in_real_time(found: Mapping[str, Any]) -> str:
    flown, bare, ratios = found["graph"], found["ring"], found["ratios"]
    rows = [
        ["sensor to actuator, p50, us", f"{flown['p50_us']:.0f}", f"{bare['p50_us']:.0f}",
         f"{ratios['p50_us']:.2f}", "1.5"],
        ["sensor to actuator, p99, us", f"{flown['p99_us']:.0f}", f"{bare['p99_us']:.0f}",
         f"{ratios['p99_us']:.2f}", "1.5"],
        ["ticks missed", f"{flown['missed']:.0f} of {flown['ticks']:.0f}",
         f"{bare['missed']:.0f} of {bare['ticks']:.0f}", "", "0"],
        ["load, share of a core", f"{100.0 * flown['load']:.0f} %", "", "", "60 %"],
    ]  # fmt: skip
    return (
        f"{grid(['', 'graph', 'ring', 'ratio', 'goal'], rows)}\n\n{found['seconds']:g} s of each, "
        f"one after the other, at {found['rate_hz']} Hz, four processes and recorder; "
        f"{_machine(found)}."
    )


def _machine(found: Mapping[str, Any]) -> str:
    machine = found["machine"]
    return f"{machine['cores']} cores, load before {machine['load_before']:.1f}"


def scaling(results: Results) -> str:
    """Participants of one ROS domain on one machine."""
    found = results["scaling"]
    rows = [
        [
            str(row["count"]),
            row["range"],
            f"{row['seen']:.0f}",
            f"{row['wall_s']:.2f}"
            if row["seen"] == row["count"]
            else f"not in {row['wall_s']:.0f}",
            f"{row['cpu_s'] / row['count']:.3f}",
        ]
        for row in found["participants"]
    ]
    head = ["participants", "discovery range", "seen", "until all know all, s", "processor s each"]
    return grid(head, rows)


def tasks(results: Results) -> str:
    """Flights per second that one scheduler carries, and what that keeps busy."""
    empty, flown = results["scaling"]["empty_tasks"], results["closed_loop"]
    flight_s = sum(flown[key] for key in _PARTS)
    most = 1.0 / empty["scheduler_s_per_task"]
    rows = [
        [
            str(chunk),
            f"{most * chunk:.0f}",
            f"{most * chunk * flight_s:.0f}",
            f"{most * chunk * flight_s / _NODE_CORES:.1f}",
        ]
        for chunk in _CHUNKS
    ]
    head = ["flights a task", "flights per s", "cores kept busy", f"nodes of {_NODE_CORES} cores"]
    return (
        f"{grid(head, rows)}\n\nReckoned from {1e6 * empty['scheduler_s_per_task']:.0f} us of "
        f"scheduler and client for an empty task ({empty['tasks']} of them, "
        f"{empty['tasks_per_s']:.0f} per second came back from two workers on two cores) and "
        f"{1e3 * flight_s:.0f} ms for a flight of {flown['duration_s']:g} s."
    )


def workers(results: Results) -> str:
    """A campaign on one and two workers, and a worker's memory."""
    found = results["campaign"]
    told, goals = found["speed"], found["goals"]
    looks = found["memory"]["looks"]
    grown_mb = looks[-1]["resident_mb"] - looks[0]["resident_mb"]
    rows = [
        *(
            [f"flights per s, {count} worker{'s' * (count != '1')}", f"{rate:.2f}", ""]
            for count, rate in told["rates"].items()
        ),
        ["1000 flights", f"{told['flights_1000_s']:.0f} s", f"{goals['flights_1000_s']:g} s"],
        ["efficiency", f"{told['efficiency']:.2f}", f"{goals['efficiency']:g}"],
        *(
            [f"memory after {look['flights']} short flights", f"{look['resident_mb']:.0f} MB", ""]
            for look in (looks[0], looks[len(looks) // 2], looks[-1])
        ),
    ]
    return (
        f"{grid(['', 'measured', 'goal'], rows)}\n\nMedians of {told['rounds']} rounds in turn, "
        f"{told['flights']} flights of {told['duration_s']:g} s each; short: "
        f"{found['memory']['duration_s']:g} s, one worker, {grown_mb:+.1f} MB from the first look "
        f"to the last."
    )


def fuzz(results: Results) -> str:
    """Damaged input by kind: how many cases, and what became of them."""
    found = results["fuzz"]
    kinds: dict[str, list[Mapping[str, Any]]] = {}
    for row in found["rows"]:
        kinds.setdefault(row["target"].split()[0], []).append(row)
    rows = [
        [
            _FUZZED.get(kind, kind),
            str(len(own)),
            *(str(sum(row[key] for row in own)) for key in ("cases", "taken", "refused")),
            str(sum(row["sentences"] for row in own)),
            str(sum(row["failed"] for row in own)),
        ]
        for kind, own in kinds.items()
    ]
    head = ["what", "targets", "cases", "taken", "refused", "beginnings of refusals", "failed"]
    return (
        f"{grid(head, rows)}\n\nFailed: a traceback, an output that is not finite or out of range, "
        f"or a refusal that is not one sentence."
    )


def soak(results: Results) -> str:
    """Memory of long flights, what they left, many starts and many Ctrl-C."""
    found = results["soak"]
    flights = {"lockstep": found["lockstep"], "real time": found["realtime"]}
    rows = [
        [process, *(cell for flight in flights.values() for cell in _memory(flight, process))]
        for process in sorted(found["lockstep"]["memory"])
    ]
    head = ["process"]
    for name, flight in flights.items():
        head += [f"{name} {flight['seconds']:g} s: at its end, MB", "slope, MB per hour"]
    told = [
        f"{name}: messages that are not the schedule's {flight['wrong_counts'] or 'none'}, "
        f"left behind {_left(flight)}, beside it {flight['beside']:.1f} cores were busy"
        for name, flight in flights.items()
    ]
    starts, stops = found["starts"], found["interrupts"]
    told.append(
        f"{starts['count']} flights of 1 s one after the other: exit codes other than 0 "
        f"{starts['odd_exit_codes'] or 'none'}, median {starts['median_s']:.1f} s, longest "
        f"{starts['longest_s']:.1f} s, left behind {_left(starts)}, beside them "
        f"{starts['beside']:.1f} cores were busy"
    )
    told.append(
        f"{stops['count']} Ctrl-C at random times (seed {stops['seed']}): {stops['hung']} hung, "
        f"exit codes other than 130 {stops['odd_exit_codes'] or 'none'}, ended after "
        f"{stops['median_s']:.1f} s (longest {stops['longest_s']:.1f} s), left behind "
        f"{_left(stops)}, beside them {stops['beside']:.1f} cores were busy"
    )
    lines = "\n".join(f"- {line}" for line in told)
    return f"{grid(head, rows)}\n\n{lines}"


def _memory(flight: Mapping[str, Any], process: str) -> list[str]:
    row = flight["memory"].get(process)
    return [f"{row['last_mb']:.1f}", f"{row['slope_mb_per_h']:+.2f}"] if row else ["", ""]


def _left(found: Mapping[str, Any]) -> str:
    return ", ".join(found["left"]) or "nothing"
