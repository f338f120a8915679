# SPDX-License-Identifier: Apache-2.0
"""`heli compare robustness`: the nominal aircraft's controllers on aircraft that differ from it.

Each aircraft is drawn from its own seed, flies in that seed's wind, and is the same for every
controller. Observer and controllers stay as designed. One process; the compiled loop is reused as
it is.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console

from heli_core.rcl_yaml import ParameterError
from heli_dynamics_sim import plant
from heli_dynamics_sim.trim import TrimError
from heli_flight.loop import LoopFlight, build, fly_loop
from heli_flight.record import FlightRecord
from heli_flight.result import conditions
from heli_flight.scoring import errors
from heli_flight.settings import Settings
from heli_flight.terminal import table
from heli_inner_hinf.controller_state import Actuation, AttitudeParams, ObserverInput
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import Loop, disk_margin, further_delay_s
from heli_inner_hinf.tuning import loops_of, model_of
from heli_studies.campaign.run import with_seed
from heli_studies.design.make import LONGEST_DELAY_S

# -------------------------------------------------------------------------------------------------
# The attitude controllers that `heli compare` flies against each other.
# -------------------------------------------------------------------------------------------------

OFFSET_FREE_RADPS = 0.5
AXES = ("roll", "pitch")


@dataclass(frozen=True)
class ComparedLaw:
    """A controller: key, name for tables, and what it changes in the inner loop's parameters."""

    key: str
    name: str
    changes: Mapping[str, Any]


LAWS = (
    ComparedLaw("hinf_output", "H-infinity, output feedback", {"controller": "hinf_output"}),
    ComparedLaw("hinf", "H-infinity", {"controller": "hinf"}),
    ComparedLaw(
        "hinf_offset_free",
        "H-infinity, offset-free",
        {"controller": "hinf", "offset_free_radps": OFFSET_FREE_RADPS},
    ),
    ComparedLaw("lqr", "LQR", {"controller": "lqr"}),
    ComparedLaw("pid", "PID", {"controller": "pid"}),
)
_BY_KEY = {law.key: law for law in LAWS}


def parse_laws(text: str) -> tuple[ComparedLaw, ...]:
    """Controllers of "hinf,pid".

    Raises
    ------
    ParameterError
        A name is unknown.
    """
    keys = text.split(",")
    for key in keys:
        if key not in _BY_KEY:
            raise ParameterError(
                f"--attitude-controller {text}: {key!r} is none of {', '.join(_BY_KEY)}"
            )
    return tuple(law for law in LAWS if law.key in keys)


def with_law(settings: Settings, law: ComparedLaw) -> Settings:
    """The same flight under another controller; everything else stays as it is."""
    inner = {**settings.nodes["inner_loop"], **law.changes}
    return replace(settings, nodes={**settings.nodes, "inner_loop": inner})


def attitude_errors_deg(record: FlightRecord, source: str) -> np.ndarray:
    """Roll and pitch error (N, 2), deg, from the "navigation" record or ground "truth"."""
    error_by_axis = errors(record, source, "attitude")
    return np.column_stack([error_by_axis[axis] for axis in AXES])


def largest(values: Sequence[float]) -> float:
    """Largest of the values, nan for none."""
    return float(max(values)) if values else float("nan")


# -------------------------------------------------------------------------------------------------
# Robustness.
# -------------------------------------------------------------------------------------------------

LIMIT_DEG = 3.0
SPREAD = 0.3
SLOWER_SERVO = 0.7
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
class PerturbedFlight:
    """A controller on the aircraft of one perturbation; errors from ground truth, deg, larger axis.

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
        changes["terms"] = aircraft.terms._replace(flap_back=True)
    return replace(
        nominal,
        helicopter=replace(aircraft, **changes),
        delay_ticks=nominal.delay_ticks + ("delay" in parts),
    )


class RobustnessSetup:
    """What stays the same over all flights: observer, outer loop, controllers."""

    def __init__(self, settings: Settings, laws: Sequence[ComparedLaw]) -> None:
        self.settings, self.laws = settings, laws
        self.kernels: dict[str, AttitudeParams] = {
            law.key: AttitudeConfig.from_parameters(
                with_law(settings, law).nodes["inner_loop"]
            ).params
            for law in laws
        }

    def fly(self, parts: Sequence[str], seed: int) -> dict[str, float]:
        """Largest error (deg) of each controller on this seed's aircraft; inf if it was lost."""
        settings = with_seed(self.settings, seed)
        nominal = plant.PlantConfig.from_parameters(settings.nodes["plant"])
        config = perturbed(nominal, parts, seed)
        try:
            loops = {
                key: build(settings, plant_config=config, law=kernel)
                for key, kernel in self.kernels.items()
            }
        except TrimError:
            # No actuator setting holds this aircraft in this wind: no controller can.
            return {key: float("inf") for key in self.kernels}
        return {
            key: largest_error_deg(fly_loop(loop, settings), settings)
            for key, loop in loops.items()
        }


def largest_error_deg(flight: LoopFlight, settings: Settings) -> float:
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
    laws: Sequence[ComparedLaw],
    n: int,
    first_seed: int = 1,
    perturbations: Sequence[Perturbation] = PERTURBATIONS,
    progress: Callable[[int], None] = lambda done: None,
) -> list[PerturbedFlight]:
    """Fly all perturbations; aircraft i flies in the wind of seed first_seed + i."""
    campaign = RobustnessSetup(settings, laws)
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


def _outcome(perturbation: Perturbation, law: ComparedLaw, errors: list[float]) -> PerturbedFlight:
    values = np.array(errors)
    good = values[np.isfinite(values)]
    return PerturbedFlight(
        perturbation.key,
        law.key,
        int(np.sum(values <= LIMIT_DEG)),
        values.size,
        int(values.size - good.size),
        float(np.median(values)),
        float(good.max()) if good.size else float("nan"),
    )


def as_dict(outcomes: Sequence[PerturbedFlight], settings: Settings, n: int) -> dict[str, Any]:
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
    outcomes: Sequence[PerturbedFlight],
    laws: Sequence[ComparedLaw],
    settings: Settings,
    out: Console,
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


def _cell(o: PerturbedFlight) -> str:
    text = f"{100.0 * o.fraction:.1f} % ({o.median_deg:.2f} / {o.worst_deg:.2f})"
    return f"{text}, {o.lost} lost" if o.lost else text


# -------------------------------------------------------------------------------------------------
# The attitude loop as a flight's settings fly it: linear, of the aircraft that its controllers
# know.
# -------------------------------------------------------------------------------------------------


class Margins(NamedTuple):
    """What a loop keeps.

    Attributes
    ----------
    input, output : float
        Disk margins at the plant's input and at its measured outputs, all channels at once.
    delay_s : float
        Further transport delay, in all channels at once, that it survives, at most
        `LONGEST_DELAY_S`.
    """

    input: float
    output: float
    delay_s: float


def loop_as_flown(
    nodes: Mapping[str, Mapping[str, Any]], actuation: Actuation | None = None
) -> Loop | None:
    """Any controller with servos and delay, state feedback also with observer (19), prediction.

    Parameters
    ----------
    nodes : mapping
        Parameters of inner loop and observer.
    actuation : Actuation, optional
        Another one than that which the controller knows.

    Returns
    -------
    Loop or None
        None for a kind of controller whose linear form is not known.
    """
    return _loop(AttitudeConfig.from_parameters(nodes["inner_loop"]), nodes["observer"], actuation)


def margins_as_flown(nodes: Mapping[str, Mapping[str, Any]]) -> Margins | None:
    """Margins of the loop as flown, the observer included; None if its linear form is not known."""
    config = AttitudeConfig.from_parameters(nodes["inner_loop"])
    loop = _loop(config, nodes["observer"])
    if loop is None:
        return None
    return Margins(
        disk_margin(loop, "input").alpha,
        disk_margin(loop, "output").alpha,
        further_delay_s(loop, model_of(config), config.actuation, LONGEST_DELAY_S),
    )


def _loop(
    config: AttitudeConfig, observer: Mapping[str, Any], actuation: Actuation | None = None
) -> Loop | None:
    feed = ObserverInput.from_parameters(observer)
    *_, flown = (None, *loops_of(config, observer["K"], feed, actuation or config.actuation))
    return flown
