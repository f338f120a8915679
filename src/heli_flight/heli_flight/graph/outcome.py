# SPDX-License-Identifier: Apache-2.0
"""What came of a flight of the graph: from its bag, and from what its nodes said."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from heli_flight.graph.bag_record import BagFlight, flight_from_bag, lost_with_law
from heli_flight.graph.plant_truth import TRUTH_SUMS, foreign_truth
from heli_flight.graph.supervisor import DEAF, NodeStatus
from heli_flight.loop.flight_section import LOCKSTEP, REAL_TIME
from heli_flight.loop.result import Result
from heli_flight.loop.scoring import score
from heli_flight.loop.settings import Settings
from heli_live_view.parameter_table import NODE_NAME as LIVE
from heli_msgs_bridge.diagnostics import FACT_FLOOD, FACT_LAW_FAILED
from heli_msgs_bridge.senders import SENDERS


def _notes(statuses: Mapping[str, Any]) -> Sequence[str]:
    """What nodes complained of at the end, and whether somebody commanded."""
    live = statuses.get(LIVE)
    commands = live.facts.get("commands", "0") if live is not None else "0"
    given = statuses["plant"].facts.get("faults_in_flight", "") if "plant" in statuses else ""
    commanded = [f"commands given in flight: {commands}; it is not the scenario alone"]
    rivals = [
        f"{name}: {value}" if key != FACT_FLOOD else f"{name}: requests refused: {value}"
        for name, status in sorted(statuses.items())
        for key, value in status.facts.items()
        if key.startswith(SENDERS) or key == FACT_FLOOD
    ]
    complaints = [
        f"{name}: {status.message}"
        for name, status in sorted(statuses.items())
        if status.level > 0 and name != "plant" and FACT_LAW_FAILED not in status.facts
    ]
    broken = [f"faults given in flight: {given}"] if given else []
    return [*(commanded if commands != "0" else []), *broken, *rivals, *complaints]


def outcome(
    settings: Settings,
    folder: Path,
    statuses: Mapping[str, NodeStatus],
    killed: Sequence[str],
    start_up_s: float,
    aircraft: str = "",
    composed: bool = False,
) -> tuple[Result, Mapping[str, Any], BagFlight]:
    """The result of a flight that is over.

    Parameters
    ----------
    settings : Settings
    folder : Path
        Holds bag/.
    statuses : mapping
        What each node said last.
    killed : sequence of str
        Who had to be killed.
    start_up_s : float
        Wall time from the start to the first tick.
    aircraft : str
        Its namespace, if others fly beside it.
    composed : bool
        Whether the nodes of the loop were in one process.

    Returns
    -------
    Result, dict, BagFlight
        As `fly_graph`.
    """
    flight = flight_from_bag(folder / "bag", settings)
    record = flight.record
    plant = statuses.get("plant")
    # The plant's own clock: without start-up, and without the recorder's finishing.
    wall = float(plant.facts.get("wall_s", "nan")) if plant is not None else float("nan")
    said = plant.message if plant is not None and plant.level > 1 else ""
    facts = (*(s.facts for _, s in sorted(statuses.items())), *(r.facts for r in flight.remarks))
    lost = lost_with_law(said, facts)
    notes = [*_notes(statuses), *(f"{name} had to be killed" for name in killed)]
    missing = settings.rate.of(settings.scenario.n_ticks) - len(record)
    if missing > 0 and not said:
        notes.append(f"the bag lacks {missing} ticks of ground truth")
    scores, flown_s = score(record, settings.scenario), settings.rate.seconds(len(record))
    forged = foreign_truth(flight, folder / TRUTH_SUMS, settings.rate)
    recorder = statuses.get("recorder")
    partial = recorder.facts.get(DEAF, "") if recorder is not None else ""
    result = Result(scores, lost, flown_s, wall, tuple(notes), aircraft, forged, partial)
    mode = LOCKSTEP if settings.nodes["plant"]["lockstep"] else REAL_TIME
    return result, {"mode": mode, "composed": composed, "start_up_s": start_up_s}, flight
