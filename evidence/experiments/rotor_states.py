# SPDX-License-Identifier: Apache-2.0
"""How far eq. (19) is from a_s, b_s, d_int in flight, and what it owes that to; JSON.

Usage: ./heli python -m evidence.experiments.rotor_states [--seeds 1..5]

Two kinds of ablation. Of the world: the hover test is flown with one thing less or more. Of what
eq. (19) is told: the recorded flights are given to it again with something changed; what flies does
not know. Errors from truth from 8 s on, RTK, default controllers. Beside each error stands that of
a constant, the trim: what a controller that never asked eq. (19) would take for the states.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evidence.files import Results
from evidence.registry import produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid, world
from heli_core.linear import held_and_linear, with_servos
from heli_core.rotations import euler_from_quat
from heli_core.rows import ACTUATOR, MEASURED, ROTOR, UNMEASURED
from heli_core.ticks import TICK_S
from heli_flight.loop import simulate
from heli_flight.record import FlightRecord
from heli_flight.result import conditions
from heli_flight.settings import Settings, resolve
from heli_observer.reduced_order import ReducedOrderModel, reduced_order_model

Array = NDArray[np.float64]
STATES = ROTOR._fields[:2] + ("d_int",)
FROM_S = 8.0
"""Wind has come (5 s in `honest`), and the engagement is over."""
DISTURBANCE_RADPS = 1.0
"""Pole of the constant disturbances that are estimated beside the states."""


@dataclass(frozen=True)
class Cause:
    """What is changed of a world: parameters of the plant, and what the seed draws."""

    name: str
    plant: Mapping[str, Any] = field(default_factory=dict)
    draw: Mapping[str, Any] = field(default_factory=dict)


def _terms(value: bool, *names: str) -> dict[str, Any]:
    return {f"terms.{name}": value for name in names}


_SERVO = ("servo_resolution", "servo_dead_band", "servo_load")
_OTHER = ("ground_effect", "vortex_ring", "rotor_speed", "tail_authority", "fuel")
NO_DRAW: dict[str, Any] = {"draw.delay_ticks": 0} | dict.fromkeys(
    ("draw.mass", "draw.inertia", "draw.rotor_stiffness", "draw.thrust", "draw.servo_speed"), 0.0
)
"""Section `world`: every seed flies the nominal aircraft."""
STILL: dict[str, Any] = {"wind.w20_mps": 0.0, "wind.turbulence": False}
CAUSES: Mapping[str, tuple[Cause, ...]] = {
    "paper": (
        Cause("as it is"),
        Cause("no wind", {"wind.profile_speed_mps": [0.0] * 3, "wind.turbulence": False}),
        Cause("with flap-back", _terms(True, "flap_back")),
        Cause("with inflow", _terms(True, "inflow")),
    ),
    "honest": (
        Cause("as it is"),
        Cause("no wind", STILL | {"wind.random_gusts.rate_per_min": 0.0}),
        Cause("without inflow", _terms(False, "inflow")),
        Cause("without flap-back", _terms(False, "flap_back")),
        Cause("without either", _terms(False, "inflow", "flap_back")),
        Cause("without the servos' terms", _terms(False, *_SERVO)),
        Cause("without the other terms", _terms(False, *_OTHER)),
        Cause("the nominal aircraft", {}, NO_DRAW),
    ),
}
WORLDS = tuple(CAUSES)
PLACES = [{"world": name, "cause": cause} for name, causes in CAUSES.items() for cause in causes]


# -------------------------------------------------------------------------------------------------
# Eq. (19) on a recorded flight.
# -------------------------------------------------------------------------------------------------


def outputs(q_nb: Array, rate_radps: Array) -> Array:
    """y (n, 6) of eq. (10), phi theta p q r psi, absolute, rad and rad/s; psi without jumps."""
    euler = np.array([euler_from_quat(q) for q in q_nb])
    return np.column_stack([euler[:, :2], rate_radps, np.unwrap(euler[:, 2])])


def with_disturbances(model: ReducedOrderModel, A: Array, B: Array, w: float) -> ReducedOrderModel:
    """Eq. (19) with a constant rate of a_s and of b_s estimated beside them.

    The states are a_s, b_s, d_int and the two rates. With A' as it is and
    X = w (-A' - w I) of the flapping states the poles are -w, twice, and those of A' + w I.
    """
    m, u, two = list(MEASURED), list(UNMEASURED), len(UNMEASURED) - 1
    X = w * (-model.A_prime - w * np.eye(len(u)))[:two]
    K = np.vstack([model.K, X @ np.linalg.pinv(A[np.ix_(m, u)])])
    n = len(u) + two
    A_uu, A_mu = np.zeros((n, n)), np.zeros((len(m), n))
    A_uu[: len(u), : len(u)], A_uu[:two, len(u) :] = A[np.ix_(u, u)], np.eye(two)
    A_mu[:, : len(u)] = A[np.ix_(m, u)]
    A_um, B_u = np.zeros((n, len(m))), np.zeros((n, B.shape[1]))
    A_um[: len(u)], B_u[: len(u)] = A[np.ix_(u, m)], B[u]
    A_prime = A_uu - K @ A_mu
    return ReducedOrderModel(A_prime, A_um - K @ A[np.ix_(m, m)] + A_prime @ K, B_u - K @ B[m], K)


def estimates(
    model: ReducedOrderModel, y: Array, u: Array, delay_ticks: int, servo: tuple[float, float]
) -> Array:
    """a_s, b_s, d_int (n, 3) of outputs (n, 6) and commands (n, 3), all from trim.

    u[i] is the command computed at tick i; servo: natural frequency, rad/s (0: none), and damping.
    """
    n = len(model.A_prime)
    if servo[0] > 0.0:
        F, G_u = with_servos(model.A_prime, model.H_prime, *servo)
    else:
        F, G_u = model.A_prime, model.H_prime
    G_y = np.vstack([model.B_prime, np.zeros((len(F) - n, y.shape[1]))])
    Phi, Gu, G0, G1 = held_and_linear(F, G_u, G_y, TICK_S)
    acting = np.vstack([np.repeat(u[:1], delay_ticks, axis=0), u[: len(u) - delay_ticks]])
    pushed = acting[:-1] @ Gu.T + y[:-1] @ G0.T + y[1:] @ G1.T
    w = np.zeros((len(y), len(F)))
    w[0, :n] = -model.K @ y[0]
    for i, push in enumerate(pushed):
        w[i + 1] = Phi @ w[i] + push
    return (w[:, :n] + y @ model.K.T)[:, : len(UNMEASURED)]


def told_otherwise(record: FlightRecord, p: Mapping[str, Any]) -> dict[str, Array]:
    """Estimates (n, 3) on one flight by what eq. (19) is told; p: the observer's parameters."""
    A, B = np.reshape(p["model.A"], (9, 9)), np.reshape(p["model.B"], (9, 3))
    model = reduced_order_model(A, B, p["K"])
    x_trim, u_trim = np.array(p["trim.x"]), np.array(p["trim.u"])[ACTUATOR.attitude]
    y_trim, x_u_trim = x_trim[list(MEASURED)], x_trim[list(UNMEASURED)]
    knows = int(p["u_delay_ticks"]), (p["servo.frequency_radps"], p["servo.damping"])
    known = np.isfinite(record.nav_q_nb[:, 0])
    first = int(np.argmax(known))
    y = outputs(record.nav_q_nb[first:], record.nav_rate_body_radps[first:]) - y_trim
    true_y = outputs(record.truth_q_nb[first:], record.truth_rate_body_radps[first:]) - y_trim
    u = record.u[first:, ACTUATOR.attitude] - u_trim
    late = record.time_s[first:] >= FROM_S
    own = y - y[late].mean(axis=0), u - u[late].mean(axis=0)
    truth = record.truth_rotor[first:][late].mean(axis=0) - x_u_trim
    more = with_disturbances(model, A, B, DISTURBANCE_RADPS)
    told = {
        "as it is": estimates(model, y, u, *knows),
        "true attitude and rates": estimates(model, true_y, u, *knows),
        "neither delay nor servos": estimates(model, y, u, 0, (0.0, 0.0)),
        "this flight's own trim": estimates(model, *own, *knows) + truth,
        "constant disturbances beside": estimates(more, y, u, *knows),
    }
    return {
        name: np.vstack([np.full((first, 3), np.nan), e + x_u_trim]) for name, e in told.items()
    }


# -------------------------------------------------------------------------------------------------
# Flown.
# -------------------------------------------------------------------------------------------------


def settings_of(world: str, cause: Cause) -> Settings:
    """The hover test with a cause changed."""
    changed = {"plant": cause.plant, "world": cause.draw}
    return resolve("hover", "rtk", overrides=changed, world=world)


def figures(record: FlightRecord, p: Mapping[str, Any]) -> dict[str, Any]:
    """By what eq. (19) is told mean and rms of its error (3,), and what a constant errs, (3,)."""
    late = record.time_s >= FROM_S
    truth = record.truth_rotor[late]
    trim = np.array(p["trim.x"])[list(UNMEASURED)]
    told = {"flown": record.nav_rotor} | told_otherwise(record, p)
    errors = {name: (made[late] - truth) for name, made in told.items()}
    return {
        "told": {
            name: {"mean": e.mean(axis=0), "square": np.mean(e**2, axis=0)}
            for name, e in errors.items()
        },
        "constant": np.mean((truth - trim) ** 2, axis=0),
        "spread": truth.std(axis=0),
    }


@over(world=WORLDS, cause=("as it is",))
def flown(world: str, cause: Cause, seed: int) -> dict[str, Any]:
    """Figures of a flight."""
    settings = settings_of(world, cause).with_seed(seed)
    return figures(simulate(settings).record, settings.nodes["observer"])


def row(place: Place[dict[str, Any]]) -> dict[str, Any]:
    """Over the seeds: rms of errors, of the constant's, mean over the flights of |mean error|."""

    def rms(squares: list[Array]) -> list[float]:
        return [float(value) for value in np.sqrt(np.mean(squares, axis=0))]

    flights, told = place.flights, list(place.flights[0]["told"])
    return {
        "world": place.point["world"],
        "cause": place.point["cause"].name,
        "told": {
            name: {
                "rms": rms([f["told"][name]["square"] for f in flights]),
                "bias": [
                    float(v)
                    for v in np.mean([np.abs(f["told"][name]["mean"]) for f in flights], axis=0)
                ],
            }
            for name in told
        },
        "constant": rms([f["constant"] for f in flights]),
        "spread": [float(v) for v in np.mean([f["spread"] for f in flights], axis=0)],
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the tables show."""
    rows = [row(place) for place in flown.places(options, PLACES)]
    as_is = {name: settings_of(name, causes[0]) for name, causes in CAUSES.items()}
    return {
        "states": STATES,
        "seeds": options.seeds,
        "from_s": FROM_S,
        "disturbance_radps": DISTURBANCE_RADPS,
        "conditions": {name: conditions(s).splitlines() for name, s in as_is.items()},
        "rows": rows,
    }


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "rotor_states",
    "./heli python -m evidence.experiments.rotor_states --seeds 1..5",
    "Error of eq. (19) in flight, and what it owes that to.",
    (1, 2, 3, 4, 5),
)


def _cells(row: Mapping[str, Any], told: str) -> list[str]:
    """Per state: error rms (of which bias) beside the constant's, 1e-3; bold where it is worse."""
    cells = []
    for i in range(len(STATES)):
        error, bias = 1e3 * row["told"][told]["rms"][i], 1e3 * row["told"][told]["bias"][i]
        constant = 1e3 * row["constant"][i]
        text = f"{error:.2f} ({bias:.2f})"
        cells.append(f"{text if error <= constant else f'**{text}**'} / {constant:.2f}")
    return cells


@table("rotor_states")
def rotor_states(results: Results) -> str:
    """World by world and cause by cause; then what it is told."""
    record = results["rotor_states"]
    head = ["flown in", *(f"{name}, 1e-3" for name in record["states"])]
    flown_rows = [[f"{r['world']}, {r['cause']}", *_cells(r, "flown")] for r in record["rows"]]
    told_rows = [
        [f"{r['world']}, {told}", *_cells(r, told)]
        for r in record["rows"]
        if r["cause"] == "as it is"
        for told in r["told"]
        if told != "flown"
    ]
    winds = world({k: [v] for k, v in record["conditions"].items()})
    return (
        f"{grid(head, flown_rows)}\n\n"
        f"{grid(['the same flights, told', *head[1:]], told_rows)}\n\n"
        "Error of eq. (19), rms over time and flights (of which bias: mean over the flights of "
        "the size of a flight's mean error) / error of a constant, the trim of the controllers. "
        f"Bold: worse than the constant. From {record['from_s']:g} s on, default controllers, "
        f"{results.seeds('rotor_states')}; a_s and b_s in mrad, d_int in thousandths. This "
        "flight's own trim: means of outputs, commands and states, known only afterwards. Constant "
        "disturbances beside: an unknown constant rate of a_s and of b_s is estimated with them, "
        f"with a pole at -{record['disturbance_radps']:g} rad/s. "
        f"{winds}"
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..5"))
