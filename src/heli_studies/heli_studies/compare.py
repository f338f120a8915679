# SPDX-License-Identifier: Apache-2.0
"""`heli compare robustness`: the nominal aircraft's laws on aircraft that differ from it.

Each aircraft is drawn from its own seed, flies in that seed's wind, and is the same for every law.
Observer and laws stay as designed. One process; the compiled loop is reused as it is.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from rich.console import Console

from heli_dynamics_sim import plant
from heli_dynamics_sim.trim import TrimError
from heli_flight.loop.closed_loop import Flight, build, fly_loop
from heli_flight.loop.result import conditions
from heli_flight.loop.settings import Settings
from heli_flight.studies.campaign import with_seed
from heli_flight.studies.compare.laws import Law, attitude_errors_deg, with_law
from heli_flight.terminal import table
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.law_state import AttitudeKernel

LIMIT_DEG = 3.0
SPREAD = 0.3
SLOWER_SERVO = 0.7
FLAP_BACK_RADPMPS = 0.0015
"""Disc tilt per air speed of a rotor like this: (8/3 theta - 2 lambda) / tip speed, in hover."""
_INERTIAS = ("inertia_xx_kgm2", "inertia_yy_kgm2", "inertia_zz_kgm2")
_RANDOM = {
    "inertia": _INERTIAS,
    "rotor": ("hub_stiffness_nmprad",),
    "flapping": ("flap_time_constant_s",),
}


@dataclass(frozen=True)
class Perturbation:
    """What is changed: key, name for tables, parts (of inertia, rotor, flapping, delay, servo,
    flap_back), and the share of the n aircraft that it is flown with."""

    key: str
    name: str
    parts: tuple[str, ...]
    share: float = 0.1


TOGETHER = ("inertia", "rotor", "flapping", "delay", "servo")
PERTURBATIONS = (
    Perturbation("all", "all five together", TOGETHER, 1.0),
    Perturbation("nominal", "nominal aircraft", ()),
    Perturbation("inertia", "inertia +-30 %", ("inertia",)),
    Perturbation("rotor", "rotor stiffness +-30 %", ("rotor",)),
    Perturbation("flapping", "flapping time constant +-30 %", ("flapping",)),
    Perturbation("delay", "one tick of delay more", ("delay",)),
    Perturbation("servo", "servo 30 % slower", ("servo",)),
    Perturbation("flap_back", "rotor that flaps back", ("flap_back",)),
    Perturbation("all_and_flap_back", "all five, and flaps back", (*TOGETHER, "flap_back")),
)


@dataclass(frozen=True)
class Outcome:
    """A law on the aircraft of one perturbation; errors from ground truth, deg, larger axis.

    Attributes
    ----------
    kept : int
        Aircraft that stayed within LIMIT_DEG.
    flown : int
    lost : int
        Aircraft that were lost.
    median_deg, worst_deg : float
        Of the largest error of each aircraft; worst of those that were not lost.
    """

    perturbation: str
    law: str
    kept: int
    flown: int
    lost: int
    median_deg: float
    worst_deg: float

    @property
    def fraction(self) -> float:
        """Share of aircraft that stayed within LIMIT_DEG."""
        return self.kept / self.flown


def perturbed(nominal: plant.PlantConfig, parts: Sequence[str], seed: int) -> plant.PlantConfig:
    """The plant with the named parts changed, random ones drawn from the seed.

    The draw of a part does not depend on which others are changed. Inertias are drawn anew until
    they are those of a rigid body.
    """
    aircraft, changes = nominal.helicopter, {}
    for number, (part, fields) in enumerate(_RANDOM.items()):
        rng = np.random.default_rng([seed, number])
        factors = rng.uniform(1.0 - SPREAD, 1.0 + SPREAD, len(fields))
        if part == "inertia":
            size = np.array([getattr(aircraft, name) for name in fields])
            while 2.0 * np.max(size * factors) > np.sum(size * factors):
                factors = rng.uniform(1.0 - SPREAD, 1.0 + SPREAD, len(fields))
        if part in parts:
            for name, factor in zip(fields, factors, strict=True):
                changes[name] = getattr(aircraft, name) * float(factor)
    if "servo" in parts:
        changes["servo_bandwidth_radps"] = SLOWER_SERVO * aircraft.servo_bandwidth_radps
    if "flap_back" in parts:
        changes["flap_back_radpmps"] = aircraft.flap_back_radpmps + FLAP_BACK_RADPMPS
    return replace(
        nominal,
        helicopter=replace(aircraft, **changes),
        delay_ticks=nominal.delay_ticks + ("delay" in parts),
    )


class Campaign:
    """What stays the same over all flights: observer, outer loop, laws."""

    def __init__(self, settings: Settings, laws: Sequence[Law]) -> None:
        self.settings, self.laws = settings, laws
        self.kernels: dict[str, AttitudeKernel] = {
            law.key: AttitudeConfig.from_parameters(
                with_law(settings, law).nodes["inner_loop"]
            ).kernel
            for law in laws
        }

    def fly(self, parts: Sequence[str], seed: int) -> dict[str, float]:
        """Largest error (deg) of each law on the aircraft of this seed; inf if it was lost."""
        settings = with_seed(self.settings, seed)
        nominal = plant.PlantConfig.from_parameters(settings.nodes["plant"])
        config = perturbed(nominal, parts, seed)
        try:
            loops = {
                key: build(settings, plant_config=config, law=kernel)
                for key, kernel in self.kernels.items()
            }
        except TrimError:
            # No actuator setting holds this aircraft in this wind: no law can.
            return {key: float("inf") for key in self.kernels}
        return {
            key: largest_error_deg(fly_loop(loop, settings), settings)
            for key, loop in loops.items()
        }


def largest_error_deg(flight: Flight, settings: Settings) -> float:
    """Largest roll or pitch error (deg) over the scored stretch, from truth; inf if it was lost."""
    mask = settings.scenario.scored(flight.record.time_s)
    if flight.sentence or not mask.any():
        return float("inf")
    return float(np.abs(attitude_errors_deg(flight.record, "truth")[mask]).max())


def aircraft_of(perturbation: Perturbation, n: int) -> int:
    """How many aircraft a perturbation is flown with."""
    return max(1, round(perturbation.share * n))


def compare(
    settings: Settings,
    laws: Sequence[Law],
    n: int,
    first_seed: int = 1,
    perturbations: Sequence[Perturbation] = PERTURBATIONS,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Outcome]:
    """Fly all perturbations; aircraft i flies in the wind of seed first_seed + i."""
    campaign = Campaign(settings, laws)
    outcomes, done = [], 0
    for perturbation in perturbations:
        errors: dict[str, list[float]] = {law.key: [] for law in laws}
        for i in range(aircraft_of(perturbation, n)):
            for key, error in campaign.fly(perturbation.parts, first_seed + i).items():
                errors[key].append(error)
            done += 1
            progress(done)
        outcomes += [_outcome(perturbation, law, errors[law.key]) for law in laws]
    return outcomes


def _outcome(perturbation: Perturbation, law: Law, errors: list[float]) -> Outcome:
    values = np.array(errors)
    good = values[np.isfinite(values)]
    return Outcome(
        perturbation.key,
        law.key,
        int(np.sum(values <= LIMIT_DEG)),
        values.size,
        int(values.size - good.size),
        float(np.median(values)),
        float(good.max()) if good.size else float("nan"),
    )


def as_dict(outcomes: Sequence[Outcome], settings: Settings, n: int) -> dict[str, Any]:
    """For --json."""
    names = {p.key: p.name for p in PERTURBATIONS}
    rows = [{"name": names[o.perturbation], **asdict(o), "fraction": o.fraction} for o in outcomes]
    for row in rows:
        row["median_deg"] = row["median_deg"] if np.isfinite(row["median_deg"]) else None
        row["worst_deg"] = row["worst_deg"] if np.isfinite(row["worst_deg"]) else None
    return {
        "scenario": settings.scenario_name,
        "n": n,
        "limit_deg": LIMIT_DEG,
        "conditions": conditions(settings).splitlines(),
        "outcomes": rows,
    }


def print_outcomes(
    outcomes: Sequence[Outcome], laws: Sequence[Law], settings: Settings, out: Console
) -> None:
    """The table: aircraft kept, median and worst of the largest errors."""
    rows = table(
        f"Aircraft whose roll and pitch stay within {LIMIT_DEG:g} deg (median / worst of the "
        "largest error, deg)",
        out,
    )
    rows.add_column("aircraft")
    rows.add_column("flown", justify="right")
    for law in laws:
        rows.add_column(law.name, justify="right")
    names = {p.key: p.name for p in PERTURBATIONS}
    by_key = {(o.perturbation, o.law): o for o in outcomes}
    for key in dict.fromkeys(o.perturbation for o in outcomes):
        cells = [by_key[key, law.key] for law in laws]
        rows.add_row(names[key], str(cells[0].flown), *(_cell(o) for o in cells))
    out.print(rows)
    out.print(conditions(settings).replace(f"seed {settings.seed}", "a seed per aircraft"))


def _cell(o: Outcome) -> str:
    text = f"{100.0 * o.fraction:.1f} % ({o.median_deg:.2f} / {o.worst_deg:.2f})"
    return f"{text}, {o.lost} lost" if o.lost else text
