# SPDX-License-Identifier: Apache-2.0
"""Print what gamma and the weights do to the state feedback and to its flights in gusts, as JSON.

Usage: ./heli python -m evidence.experiments.gamma [--seeds 1..10]

Every variant is flown by the controller `hinf` in the scenario `attitude_gusts` with RTK, in the
world `paper`, whose aircraft is the model, and in `honest`, whose rotor flaps back; errors are of
truth, in the scored window. Beside them: gamma*, and how much of wind comes through to the angles
and to the commands at the worst frequency, by the linear model without servos, delay and observer.
"""

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from evidence.files import Results
from evidence.registry import produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid, world
from heli_core.errors import SynthesisError
from heli_flight.result import conditions
from heli_flight.scoring import DECIDES
from heli_flight.settings import Settings, resolve
from heli_inner_hinf.design import AttitudeConfig
from heli_studies.campaign.run import FlownSeed, fly_seeds

SCENARIO, LAWS, GPS = "attitude_gusts", "hinf", "rtk"
WORLDS = ("paper", "honest")
AXES = ("roll", "pitch")
GAMMA = 0.0632
C11 = np.diag([13.0, 11.0, 1.0, 1.0])
D11 = np.diag([12.0, 11.0, 31.0])
VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "gamma 0.2": {"gamma": 0.2},
    "as packaged": {},
    "gamma 0.056": {"gamma": 0.056},
    "angles three times as dear": {
        "gamma": 0.2,
        "C11": (C11 * np.array([3.0, 3.0, 1.0, 1.0])).ravel().tolist(),
    },
    "commands four times as dear": {"gamma": 0.5, "D11": (4.0 * D11).ravel().tolist()},
    "commands a quarter as dear": {"D11": (0.25 * D11).ravel().tolist()},
    "gamma 0.05": {"gamma": 0.05},
}
LABELS = {
    "angles three times as dear": "weights on roll and pitch times 3",
    "commands four times as dear": "weights on the commands times 4",
    "commands a quarter as dear": "weights on the commands divided by 4",
}
"""What the table calls a variant whose name in the result file says less."""
FREQUENCIES_RADPS = np.geomspace(0.01, 300.0, 400)


def gains(design: AttitudeConfig) -> tuple[float, float]:
    """Largest gain over frequency, wind in m/s to roll and pitch in rad, and to the commands."""
    closed = design.A + design.B @ design.synthesis.F
    per_wind = [
        np.linalg.solve(1j * frequency * np.eye(9) - closed, design.E)
        for frequency in FREQUENCIES_RADPS
    ]
    angles, commands = (
        max(float(np.linalg.norm(output @ states, 2)) for states in per_wind)
        for output in (np.eye(9)[:2], design.synthesis.F)
    )
    return angles, commands


@over(variant=tuple(VARIANTS), world=WORLDS)
def flown(variant: str, world: str, seed: int) -> FlownSeed:
    """Figures of a flight."""
    return fly_seeds(settings_of(world, VARIANTS[variant]), [seed])[0]


def errors(flights: Sequence[FlownSeed]) -> dict[str, float]:
    """Median over the flights of the largest error of an axis, deg."""
    scores = [s for f in flights for s in f.figures.of(DECIDES)]
    return {
        axis: float(
            np.median([s.max for s in scores if (s.metric.key, s.source) == (axis, "truth")])
        )
        for axis in AXES
    }


def settings_of(world: str, changes: Mapping[str, Any]) -> Settings:
    """The flight of a variant in a world."""
    overrides = {"inner_loop": changes}
    return resolve(SCENARIO, gps=GPS, laws=LAWS, world=world, overrides=overrides)


def designed(changes: Mapping[str, Any]) -> AttitudeConfig | str:
    """The design of a variant, or the sentence that refuses it."""
    try:
        settings = [settings_of(world, changes) for world in WORLDS]
        return AttitudeConfig.from_parameters(settings[0].nodes["inner_loop"])
    except SynthesisError as error:
        return str(error)


def row(
    name: str, design: AttitudeConfig | str, places: Sequence[Place[FlownSeed]]
) -> dict[str, Any]:
    """One variant: its design and its flights, or the sentence that refuses it."""
    gamma = VARIANTS[name].get("gamma", GAMMA)
    variant: dict[str, Any] = {"variant": name, "gamma": gamma, "refused": ""}
    if isinstance(design, str):
        return {**variant, "refused": design}
    angles, commands = gains(design)
    return {
        **variant,
        "gamma": design.gamma,
        "gamma_star": design.synthesis.gamma_star.value,
        "angles_deg_per_mps": float(np.degrees(angles)),
        "commands_per_mps": commands,
        "errors_deg": {
            place.point["world"]: errors(place.flights)
            for place in places
            if place.point["variant"] == name
        },
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the table shows."""
    designs = {name: designed(changes) for name, changes in VARIANTS.items()}
    kept = [p for p in flown.points if not isinstance(designs[p["variant"]], str)]
    places = list(flown.places(options, kept))
    flights = {world: conditions(settings_of(world, {})).splitlines() for world in WORLDS}
    return {"rows": [row(name, of, places) for name, of in designs.items()], "flown": flights}


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "gamma",
    "./heli python -m evidence.experiments.gamma --seeds 1..10",
    "What gamma and the weights do to the state feedback and to its flights in gusts.",
    tuple(range(1, 11)),
)


@table("gamma")
def gamma(results: Results) -> str:
    """What gamma and the weights do to the state feedback and to its flights in gusts."""
    record = results["gamma"]
    head = [
        "variant",
        "gamma",
        "gamma*",
        "wind to angles, deg per m/s",
        "wind to commands, per m/s",
    ]
    head += [f"{axis}, `{name}`, deg" for name in record["flown"] for axis in AXES]
    rows, refused = [], []
    for row in record["rows"]:
        label = LABELS.get(row["variant"], row["variant"])
        if row["refused"]:
            refused.append(f"- {label}: {row['refused']}.")
            continue
        rows.append(
            [
                label,
                f"{row['gamma']:g}",
                f"{row['gamma_star']:.4f}",
                f"{row['angles_deg_per_mps']:.3f}",
                f"{row['commands_per_mps']:.5f}",
                *(
                    f"{row['errors_deg'][name][axis]:.2f}"
                    for name in record["flown"]
                    for axis in AXES
                ),
            ]
        )
    lines = "\n".join(refused)
    seeds = results.read["gamma"]["seeds"]
    return (
        f"{grid(head, rows)}\n\nGains: the largest over frequency, without servos, delay and "
        "observer. Errors: the largest from truth after 5 s, median over seeds "
        f"{seeds[0]} to {seeds[-1]}. "
        f"{world({name: [air] for name, air in record['flown'].items()})}\n\n"
        f"Refused:\n\n{lines}"
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..10"))
