# SPDX-License-Identifier: Apache-2.0
"""Chirps flown in closed loop: errors of A and B, and how often their intervals hold the truth.

Usage: ./heli python -m evidence.experiments.identification_proofs [--seeds 1..12]

A chirp on each actuator in its turn, written as a Fourier series so that the stack's own excitation
plays it. Identified by both methods: in the frequency domain, and by output error from there on.

- `linear`: the Blade 360 as a linear system in turbulence that is added; the model is right.
- `blade360`: the same aircraft as this stack's plant, flown by the controller designed for it.
- `helion`: the nonlinear helicopter, flown by the default controller.

The Blade 360's structure is taken as published: entries that are not zero there, and the delay. The
search begins at several places, each entry 30 % off; the best is kept. HeLion's structure, delay,
servos and start come from the record alone.

Main are entries with a Cramer-Rao bound below 20 % and an insensitivity below 10 %, medians over
seeds: the guidelines of Tischler and Remple, Aircraft and Rotorcraft System Identification, 2nd ed.
(AIAA 2012), ch. 12.
"""

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_continuous_are
from scipy.signal import chirp

from evidence.files import Results
from evidence.registry import FIT, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid
from heli_analysis.identification import AperiodicRecord, fit_record
from heli_analysis.identification.aperiodic import spectra_of_record
from heli_analysis.identification.estimator import Estimate, Problem, estimate
from heli_analysis.identification.model import FAST, FastModel, assemble, values_of
from heli_analysis.identification.output_error import (
    BAND_HZ,
    fit_output_error,
    pieces_of_record,
)
from heli_analysis.identification.spectra import Spectra
from heli_analysis.identification.structure import AIR, DELAY, FAST_NAMES, FULL, N_FAST, SCALARS
from heli_core.errors import FlightError, IdentificationError
from heli_core.linear import held
from heli_core.rotations import euler_angles, quat_to_R_nb
from heli_core.rows import ACTUATOR, ACTUATOR_NAMES, IMU
from heli_core.ticks import TICK_S
from heli_dynamics_sim.linear_aircraft import STATES, LinearAircraft
from heli_flight.loop import fly_settings
from heli_flight.settings import resolve
from heli_studies.design.make import aircraft_basis
from heli_studies.identify import fast_of
from heli_studies.published import designed

Array = NDArray[np.float64]
CASES = ("linear", "blade360", "helion")
METHODS = ("frequency", "output_error")
LAW, GPS, WORLD = "hinf_output", "rtk", "paper"

# -------------------------------------------------------------------------------------------------
# Flights.
# -------------------------------------------------------------------------------------------------

CHIRP_S, BEFORE_S, BEHIND_S = 40.0, 20.0, 5.0
LENGTH_S = BEFORE_S + ACTUATOR.size * CHIRP_S + BEHIND_S
FROM_HZ, TO_HZ, HIGHEST_HZ = 0.15, 9.0, 10.5
FADE_S = 3.0
AMPLITUDE = {
    "linear": (0.03, 0.03, 0.2, 0.06),
    "blade360": (0.03, 0.03, 0.2, 0.06),
    "helion": (0.03, 0.03, 0.05, 0.03),
}
CALM = {
    "wind.profile_altitude_m": [0.0],
    "wind.profile_speed_mps": [0.0],
    "wind.turbulence": True,
    "wind.w20_mps": 1.0,
}
"""That of the experiments of `heli identify`."""
READ_FROM = round((BEFORE_S - 5.0) / TICK_S)
_TURBULENCE_MPS, _FADES_S = 0.1, 5.0
_RATE_NOISE, _VELOCITY_NOISE = 1e-3, 0.005
_MOST_U = 0.1  # of the linear-quadratic law: costs as much as 1 rad, 1 rad/s, 1 m/s
DELAY_TICKS = 5  # of the Blade 360: 40 ms, and the stack's own tick
_NO_SERVO_RADPS, _DAMPING = 1e4, 0.7
"""It has no separate servos. What these lag is taken from the delay."""


def chirps(amplitude: Sequence[float]) -> Array:
    """(n, 4): a logarithmic chirp on each actuator in its turn, faded in and out."""
    t = np.arange(round(CHIRP_S / TICK_S)) * TICK_S
    fade = np.clip(np.minimum(t, t[::-1]) / FADE_S, 0.0, 1.0)
    one = chirp(t, FROM_HZ, CHIRP_S, TO_HZ, method="logarithmic", phi=-90.0)
    one *= 0.5 - 0.5 * np.cos(np.pi * fade)
    return np.kron(np.diag(amplitude), one[:, None])


def played(amplitude: Sequence[float]) -> dict[str, Any]:
    """Parameters of the node `inner_loop` that add `chirps`: their Fourier series."""
    x = chirps(amplitude)
    lines = np.fft.rfft(x, axis=0) * 2.0 / x.shape[0]
    hz = np.fft.rfftfreq(x.shape[0], TICK_S)
    kept = (hz > 0.0) & (hz < HIGHEST_HZ)
    phase = np.angle(1j * lines[kept])
    return {
        "excitation.frequency_hz": hz[kept],
        "excitation.amplitude": np.abs(lines[kept]).ravel(),
        "excitation.phase_rad": phase.ravel(),
        "excitation.start_s": BEFORE_S,
        "excitation.duration_s": x.shape[0] * TICK_S,
        "excitation.fade_s": 0.0,
        "excitation.attitude_limit_deg": 30.0,
    }


def flown(case: str, seed: int) -> AperiodicRecord:
    """A record of the stack's own flight, as measured; raises FlightError."""
    values: dict[str, dict[str, Any]] = {"plant": {}, "inner_loop": {}}
    if case != "helion":
        values |= {node: dict(of) for node, of in designed(case, LAW).values.items()}
    values["plant"] |= CALM
    values["inner_loop"] |= played(AMPLITUDE[case])
    settings = resolve("hover", GPS, seed, LENGTH_S, world=WORLD, controller=LAW, overrides=values)
    flight = fly_settings(settings)
    record = flight.record
    assert record.excitation_u is not None and record.imu is not None
    sent_s = record.time_s[np.any(record.excitation_u != 0.0, axis=1)]
    if flight.sentence or sent_s[-1] < LENGTH_S - BEHIND_S - 1.0:
        raise FlightError(f"{case}, seed {seed}: {flight.sentence or 'excitation given up'}")
    R_nb = np.array([quat_to_R_nb(np.ascontiguousarray(q)) for q in record.nav_q_nb])
    return AperiodicRecord(
        record.u, record.excitation_u, record.imu[:, IMU.rate],
        np.einsum("nji,nj->ni", R_nb, record.nav_vel_ned_mps),
        euler_angles(record.nav_q_nb)[:, :2], ((READ_FROM, len(record)),),
    )  # fmt: skip


def linear_flight(seed: int) -> AperiodicRecord:
    """The Blade 360 as a linear system with a linear-quadratic law; turbulence is added to it."""
    aircraft = LinearAircraft.from_yaml("blade360")
    F, B = aircraft.whole()
    states = ("phi", "theta", *aircraft.states)
    places = {name: states.index(name) for name in states}
    rates, vel = ([places[n] for n in names] for names in (("p", "q", "r"), ("u", "v", "w")))
    weight = np.eye(ACTUATOR.size) / _MOST_U**2
    K = -(_MOST_U**2) * B.T @ solve_continuous_are(F, B, np.eye(len(states)), weight)
    Phi, Gamma = held(F, np.hstack([B, -F[:, vel]]), TICK_S)
    n, rng = round(LENGTH_S / TICK_S), np.random.default_rng(seed)
    added, one = np.zeros((n, ACTUATOR.size)), chirps(AMPLITUDE["linear"])
    first = round(BEFORE_S / TICK_S)
    added[first : first + one.shape[0]] = one
    spread = np.zeros(len(states))
    spread[rates], spread[vel] = _RATE_NOISE, _VELOCITY_NOISE
    noise = spread * rng.standard_normal((n, len(states)))
    stays = np.exp(-TICK_S / _FADES_S)
    gusts = _TURBULENCE_MPS * np.sqrt(1.0 - stays**2) * rng.standard_normal((n, 3))
    x, air = np.zeros(len(states)), np.zeros(3)
    y, u = np.empty((n, len(states))), np.zeros((n + DELAY_TICKS, ACTUATOR.size))
    for k in range(n):
        y[k] = x + noise[k]
        u[k + DELAY_TICKS] = K @ y[k] + added[k]
        air = stays * air + gusts[k]
        x = Phi @ x + Gamma @ np.concatenate([u[k], air])
    return AperiodicRecord(
        u[DELAY_TICKS:], added, y[:, rates], y[:, vel], y[:, :2], ((READ_FROM, n),)
    )


def blade_360() -> FastModel:
    """The published fast states; its lag is all delay."""
    aircraft = LinearAircraft.from_yaml("blade360")
    A, _, E9, _ = aircraft.nine()
    E = np.zeros((N_FAST, AIR.size))
    E[:, AIR.velocity] = E9[FAST]
    B = aircraft.B[[STATES.index(name) for name in FAST_NAMES]]
    lag_s = 2.0 * _DAMPING / _NO_SERVO_RADPS
    return FastModel(A[FAST, FAST], B, E, _NO_SERVO_RADPS, _DAMPING, DELAY_TICKS * TICK_S - lag_s)


# -------------------------------------------------------------------------------------------------
# Fits.
# -------------------------------------------------------------------------------------------------

STARTS, OFF = 2, 0.3
_LEAST_SHARE = 0.01


def from_several(spectra: Spectra, truth: FastModel, names: tuple[str, ...], seed: int) -> Estimate:
    """The best of the fits that begin at `STARTS` places, every entry `OFF` away."""
    problem, found = Problem([spectra], names, truth), []
    for start in range(STARTS):
        signs = np.random.default_rng([seed, start]).choice([-1.0, 1.0], len(names))
        try:
            found.append(
                estimate(problem, values_of(names, truth) * (1.0 + OFF * signs),
                         fine=False, joint=False)
            )  # fmt: skip
        except IdentificationError:
            continue
    if not found:
        raise FlightError(f"seed {seed}: from none of {STARTS} starts does the fit lead to numbers")
    best = min(found, key=lambda fit: (fit.distortion, fit.cost))
    return estimate(Problem([spectra], names, truth, best.distortion), best.values)


@over(case=CASES)
def identified(case: str, seed: int) -> dict[str, Any]:
    """Of each entry by each method: relative error, error over sigma, sigma, insensitivity."""
    record = linear_flight(seed) if case == "linear" else flown(case, seed)
    spectra = spectra_of_record(record)
    if case == "helion":
        truth = fast_of(aircraft_basis(resolve(controller=LAW), None))
        model = fit_record(record)
        first, base = model.estimate, model.fast
        judged = {n for n in first.names if n[0] in "AB" and model.share[n] >= _LEAST_SHARE}
        spread = {name: model.sigma[name] for name in judged}
    else:
        truth = base = blade_360()
        free = FULL.actuator_parameters(collective=True)
        names = tuple(n for n in free if n not in SCALARS and values_of((n,), truth)[0] != 0.0)
        names += (SCALARS[-1],)
        first = from_several(spectra, truth, names, seed)
        judged = {name for name in names if name[0] in "ABf"}
        spread = dict(zip(names, first.sigma.tolist(), strict=True))
    judged = {n for n in judged if not (case == "helion" and n.endswith(f"{ACTUATOR_NAMES[-1]})"))}
    problem = Problem([spectra], first.names, base, first.distortion)
    slopes = problem.jacobian(first.values, problem.whiteners(first.values))
    alone = dict(zip(first.names, 1.0 / np.linalg.norm(slopes, axis=0), strict=True))
    in_time = tuple(name for name in first.names if name != DELAY)
    start = assemble(first.names, first.values, base)
    by = {"frequency": (dict(zip(first.names, first.values.tolist(), strict=True)), spread)}
    told = {"distortion": first.distortion, "instrumented": None, "refused": ""}
    try:
        second = fit_output_error(pieces_of_record(record, BAND_HZ), start, in_time)
        by["output_error"] = (
            dict(zip(in_time, second.values.tolist(), strict=True)),
            dict(zip(in_time, second.sigma.tolist(), strict=True)),
        )
        told["instrumented"] = second.instrumented
    except IdentificationError as error:
        told["refused"] = str(error)
    rows = [
        {
            "method": method, "name": name,
            "relative": (values[name] - true) / abs(true),
            "z": (values[name] - true) / sigma[name],
            "bound": sigma[name] / abs(true),
            "insensitivity": float(alone[name]) / abs(true),
        }
        for method, (values, sigma) in by.items()
        for name in first.names
        if name in judged and (true := float(values_of((name,), truth)[0])) != 0.0
    ]  # fmt: skip
    return {"rows": rows, **told}


# -------------------------------------------------------------------------------------------------
# What comes of all seeds.
# -------------------------------------------------------------------------------------------------

BOUND, INSENSITIVITY, TARGET = 0.20, 0.10, 0.05
SIGMAS = 1.96


def entries_of(flights: Sequence[Mapping[str, Any]], method: str) -> list[dict[str, Any]]:
    """Of each entry over all seeds."""
    rows = [row for flight in flights for row in flight["rows"] if row["method"] == method]
    found = []
    for name in dict.fromkeys(row["name"] for row in rows):
        own = [row for row in rows if row["name"] == name]
        of = {key: np.array([row[key] for row in own]) for key in own[0] if key not in
              ("method", "name")}  # fmt: skip
        bound, alone = float(np.median(of["bound"])), float(np.median(of["insensitivity"]))
        found.append(
            {
                "name": name,
                "flights": len(own),
                "bound": bound,
                "insensitivity": alone,
                "main": bound < BOUND and alone < INSENSITIVITY,
                "inside": int(np.sum(np.abs(of["z"]) < SIGMAS)),
                "bias": float(of["z"].mean()),
                "spread": float(of["z"].std(ddof=1)) if len(own) > 1 else 0.0,
                "median": float(np.median(np.abs(of["relative"]))),
                "largest": float(of["relative"][np.argmax(np.abs(of["relative"]))]),
                "within": int(np.sum(np.abs(of["relative"]) <= TARGET)),
            }
        )
    return found


def proofs(options: Options) -> dict[str, Any]:
    """All that the tables show."""
    return {"cases": [_case(place) for place in identified.places(options)]}


def _case(place: Place[dict[str, Any]]) -> dict[str, Any]:
    flights = place.flights
    return {
        "case": place.point["case"],
        "flights": len(flights),
        "distortion": max(flight["distortion"] for flight in flights),
        "not_instrumented": sum(flight["instrumented"] is False for flight in flights),
        "refused": sorted({flight["refused"] for flight in flights if flight["refused"]}),
        "methods": {method: entries_of(flights, method) for method in METHODS},
    }


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "identification_proofs",
    "./heli python -m evidence.experiments.identification_proofs --seeds 1..12",
    "Chirps in closed loop: errors of A and B by both methods, and what their intervals hold.",
    tuple(range(1, 13)),
    FIT,
)
_WORDS = {"frequency": "frequency domain", "output_error": "output error"}


@table("identification_proofs")
def summary_table(results: Results) -> str:
    """A row for each case and method."""
    head = ["flight", "method", "main entries", "within 5 %", "furthest", "95 % interval holds",
            "of all entries"]  # fmt: skip
    rows = []
    for case in results["identification_proofs"]["cases"]:
        for method, entries in case["methods"].items():
            main = [entry for entry in entries if entry["main"]]
            furthest = max(main, key=lambda entry: abs(entry["largest"]))
            rows.append(
                [
                    case["case"], _WORDS[method], f"{len(main)} of {len(entries)}",
                    _share(main, "within"),
                    f"{100.0 * furthest['largest']:+.1f} % {furthest['name']}",
                    _share(main, "inside"), _share(entries, "inside"),
                ]
            )  # fmt: skip
    return (
        f"{grid(head, rows)}\n\nOver {results.seeds('identification_proofs')}. Within 5 %, and "
        "held: of the main entries of all flights."
    )


@table("identification_proofs_entries")
def entries_table(results: Results) -> str:
    """A row for each entry of the Blade 360, by both methods."""
    head = ["entry", "method", "bound", "insensitivity", "median error", "furthest",
            "interval holds", "bias / sigma", "spread / sigma"]  # fmt: skip
    (case,) = (c for c in results["identification_proofs"]["cases"] if c["case"] == "blade360")
    rows = [
        [
            entry["name"], _WORDS[method], f"{100.0 * entry['bound']:.2g} %",
            f"{100.0 * entry['insensitivity']:.2g} %", f"{100.0 * entry['median']:.2g} %",
            f"{100.0 * entry['largest']:+.2g} %", f"{entry['inside']} of {entry['flights']}",
            f"{entry['bias']:+.1f}", f"{entry['spread']:.1f}",
        ]
        for method, entries in case["methods"].items()
        for entry in entries
    ]  # fmt: skip
    return grid(head, rows)


def _share(entries: Sequence[Mapping[str, Any]], key: str) -> str:
    count, held = sum(entry["flights"] for entry in entries), sum(entry[key] for entry in entries)
    return f"{held} of {count} ({100.0 * held / count:.1f} %)"


if __name__ == "__main__":
    sys.exit(print_result(__doc__, proofs))
