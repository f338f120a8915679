# SPDX-License-Identifier: Apache-2.0
"""`heli compare attitude`: the laws on the same seeds in the paper's attitude test (Fig. 3, 4)."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from rich.console import Console

from heli_dynamics_sim import plant
from heli_flight.loop.closed_loop import Flight, build, fly_loop
from heli_flight.loop.result import conditions
from heli_flight.loop.settings import Settings
from heli_flight.studies.campaign import with_seed
from heli_flight.studies.compare.laws import AXES, Law, attitude_errors_deg, largest, with_law
from heli_flight.studies.compare.robustness import FLAP_BACK_RADPMPS, perturbed
from heli_flight.terminal import table
from heli_math.paper_metrics import ATTITUDE_DEG

SOURCES = ("navigation", "truth", "ideal")
"""On-board record, ground truth, and ground truth of a flight with ideal navigation."""
PAPER_DEG = {law: bound for law, (bound, _) in ATTITUDE_DEG.items()}
RIVAL = "pid"


@dataclass(frozen=True)
class AttitudeFlight:
    """One flight, scored; errors in deg over the scored stretch.

    Attributes
    ----------
    law : str
    seed : int
    source : str
        One of SOURCES.
    max_deg, rms_deg : tuple of two floats
        Roll, pitch; nan if the helicopter was lost.
    lost : str
        Why, one sentence; empty if it was not.
    """

    law: str
    seed: int
    source: str
    max_deg: tuple[float, float]
    rms_deg: tuple[float, float]
    lost: str


@dataclass
class Comparison:
    """All flights, and the first seed's in full for the picture."""

    settings: Settings
    laws: tuple[Law, ...]
    seeds: list[int]
    flap_back: bool = False
    flights: list[AttitudeFlight] = field(default_factory=list)
    shown: dict[str, Flight] = field(default_factory=dict)

    @property
    def sources(self) -> list[str]:
        """Sources that were flown, in order."""
        found = {flight.source for flight in self.flights}
        return [source for source in SOURCES if source in found]

    def of(self, law: str, source: str) -> dict[int, AttitudeFlight]:
        """Flights of a law by seed."""
        return {f.seed: f for f in self.flights if (f.law, f.source) == (law, source)}

    def wins(self, law: str, source: str, axis: int) -> int | None:
        """On how many seeds the law's largest error is below the PID's; None without a PID."""
        mine, rival = self.of(law, source), self.of(RIVAL, source)
        if not rival or law == RIVAL:
            return None
        return sum(
            not mine[s].lost
            and (rival[s].lost != "" or mine[s].max_deg[axis] < rival[s].max_deg[axis])
            for s in self.seeds
        )

    def summary(self) -> list[dict[str, Any]]:
        """One row per law and source: largest and rms over all seeds, wins over the PID."""
        rows = []
        for law in self.laws:
            for source in self.sources:
                flights = list(self.of(law.key, source).values())
                good = [f for f in flights if not f.lost]
                row: dict[str, Any] = {"law": law.key, "source": source}
                for i, axis in enumerate(AXES):
                    row[f"{axis}_max_deg"] = largest([f.max_deg[i] for f in good])
                    row[f"{axis}_rms_deg"] = _pooled([f.rms_deg[i] for f in good])
                    row[f"{axis}_wins_over_pid"] = self.wins(law.key, source, i)
                row["lost"] = len(flights) - len(good)
                rows.append(row)
        return rows

    def as_dict(self) -> dict[str, Any]:
        """For --json."""
        return {
            "scenario": self.settings.scenario_name,
            "seeds": self.seeds,
            "flap_back_radpmps": FLAP_BACK_RADPMPS if self.flap_back else 0.0,
            "conditions": conditions(self.settings).splitlines(),
            "paper_max_deg": PAPER_DEG,
            "summary": self.summary(),
            "flights": [asdict(flight) for flight in self.flights],
        }


def compare(
    settings: Settings,
    laws: tuple[Law, ...],
    seeds: Sequence[int],
    ideal: bool = False,
    flap_back: bool = False,
    progress: Callable[[int], None] = lambda done: None,
) -> Comparison:
    """Fly every law on every seed.

    Parameters
    ----------
    settings : Settings
        An attitude scenario.
    laws, seeds : sequence
    ideal : bool
        Also with ideal navigation, which shows the law without the estimator.
    flap_back : bool
        The rotor flaps back by FLAP_BACK_RADPMPS more than laws and observer know.
    progress : callable
        Told how many flights are done.
    """
    result = Comparison(settings, laws, list(seeds), flap_back)
    done = 0
    for seed in seeds:
        nominal = plant.PlantConfig.from_parameters(with_seed(settings, seed).nodes["plant"])
        aircraft = perturbed(nominal, ("flap_back",) if flap_back else (), seed=0)
        for law in laws:
            flown = with_law(with_seed(settings, seed), law)
            flight = fly_loop(build(flown, plant_config=aircraft), flown)
            for source in SOURCES[:2]:
                result.flights.append(scored(flight, flown, law, source))
            if seed == seeds[0]:
                result.shown[law.key] = flight
            if ideal:
                best = fly_loop(build(flown, true_navigation=True, plant_config=aircraft), flown)
                result.flights.append(scored(best, flown, law, "ideal"))
            done += 1
            progress(done)
    return result


def scored(flight: Flight, settings: Settings, law: Law, source: str) -> AttitudeFlight:
    """Largest and rms errors of a flight over the scenario's scored stretch."""
    record = flight.record
    mask = settings.scenario.scored(record.time_s)
    nothing = (float("nan"), float("nan"))
    if flight.sentence or not mask.any():
        lost = flight.sentence or "the flight ended before the first scored stretch"
        return AttitudeFlight(law.key, settings.seed, source, nothing, nothing, lost)
    error = attitude_errors_deg(record, "navigation" if source == "navigation" else "truth")[mask]
    worst, rms = np.abs(error).max(axis=0), np.sqrt(np.mean(error**2, axis=0))
    return AttitudeFlight(
        law.key,
        settings.seed,
        source,
        (float(worst[0]), float(worst[1])),
        (float(rms[0]), float(rms[1])),
        "",
    )


def print_comparison(result: Comparison, out: Console) -> None:
    """The table beside the paper's figures, with its conditions."""
    count = len(result.seeds)
    rows = table(
        f"Attitude error over {count} seed{'s' * (count > 1)}: largest (rms), deg; on how many of "
        "them the largest is below the PID's",
        out,
    )
    rows.add_column("law")
    heads = {"navigation": "navigation record", "truth": "truth", "ideal": "ideal navigation"}
    for source in result.sources:
        for axis in AXES:
            rows.add_column(f"{axis}, {heads[source]}", justify="right")
    rows.add_column("paper", justify="right")
    found = {(row["law"], row["source"]): row for row in result.summary()}
    for law in result.laws:
        cells = []
        for source in result.sources:
            row = found[law.key, source]
            for axis in AXES:
                text = f"{row[f'{axis}_max_deg']:.2f} ({row[f'{axis}_rms_deg']:.2f})"
                wins = row[f"{axis}_wins_over_pid"]
                cells.append(text if wins is None else f"{text}; {wins} of {count}")
        paper = f"+-{PAPER_DEG[law.key]:g}" if law.key in PAPER_DEG else ""
        rows.add_row(law.name, *cells, paper)
    out.print(rows)
    out.print(_without_seed(conditions(result.settings)))
    if result.flap_back:
        out.print(f"the rotor flaps back by {FLAP_BACK_RADPMPS:g} rad s/m, which no law knows")
    for flight in result.flights:
        if flight.lost and flight.source == "truth":
            out.print(f"LOST: {flight.law}, seed {flight.seed}: {flight.lost}")


def _without_seed(text: str) -> str:
    first, _, rest = text.partition("; seed")
    return first + "\n" + rest.partition("\n")[2]


def _pooled(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values else float("nan")
