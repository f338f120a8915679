# SPDX-License-Identifier: Apache-2.0
"""A model predictive position controller beside the default: hover, manoeuvres, faults; JSON.

Usage: ./heli python -m evidence.experiments.mpc [--seeds 1..40]

examples/mpc_position.py flies in place of the position controller; attitude controller, sensors and
observer are the default's. Its weights come from the search that gains of the packaged controller
come from: the same axes, cost, floors of margin and grid (`./heli design --search`), and are found
here anew. In the manoeuvres it flies twice: with the reference that every controller is given, and
with the path known ahead. Errors are truth less the receiver's drift at engagement.
"""

import importlib.util
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evidence.experiments.outer_loop import HOVER, LIMITS
from evidence.files import Results
from evidence.registry import MARGIN, NOT_COMPARED, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid, world
from heli_core.linear import stationary
from heli_core.metrics import PATH, hover_errors
from heli_core.python_controller import PythonLaw
from heli_core.rows import REFERENCE, SETPOINT, SHAPED
from heli_core.search import search
from heli_core.ticks import TICK_S
from heli_flight.layers import NODES
from heli_flight.loop import LoopFlight, fly_settings, simulate
from heli_flight.position_axes import NAMES
from heli_flight.result import conditions
from heli_flight.scoring import drift_at_engagement, errors
from heli_flight.settings import Settings, resolve
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.tuning import model_of
from heli_outer_pd.analysis import Axis, Gains, Sampled, disk_margin, law
from heli_outer_pd.parameters import outer_params
from heli_outer_pd.position_law import initial_state, position_law
from heli_outer_pd.reference import shaped_reference_at
from heli_outer_pd.state import OuterParams
from heli_studies.compare import loop_as_flown
from heli_studies.design.position_search import WANTED, PositionLoop, position_loop

EXAMPLE = Path(__file__).parents[2] / "examples" / "mpc_position.py"
DEFAULT, SEARCHED, MPC, AHEAD = "default", "default, searched gains", "MPC", "MPC, path known"
GAINS = {
    "K_P": [2.4, 2.7, 12.0],
    "K_D": [4.7, 5.1, 24.0],
    "disturbance.bandwidth_radps": [0.68, 3.6, 9.1],
    "attitude_lead.lead_s": [0.3, 0.2],
}
"""What the packaged controller's search finds (`./heli design --search`); the default's gains of
forward and right are set by hand."""
WORLDS = ("paper", "honest", "hard")
STARTS: Sequence[Sequence[Sequence[float]]] = (
    ((0.3, 0.1, 1.0, 0.5), (0.3, 0.3, 3.0, 0.8)),
    ((0.3, 0.1, 1.0, 0.5), (0.3, 0.3, 3.0, 0.8)),
    ((0.1, 0.01, 0.05, 1.0), (0.05, 0.005, 0.02, 2.0)),
)
"""Where the search for the weights of each axis begins."""
_UNLIMITED = 1e9
Over = Mapping[str, Mapping[str, Any]]


@cache
def example() -> Any:
    """The module of the controller; only where it is flown, as it needs osqp."""
    spec = importlib.util.spec_from_file_location(EXAMPLE.stem, EXAMPLE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# -------------------------------------------------------------------------------------------------
# Weights.
# -------------------------------------------------------------------------------------------------


def linear(axis: Any) -> Sampled:
    """What an axis of the MPC is where no limit acts: position, speed, tilt -> command.

    States: those of its model, last command, estimated speed and disturbance.
    """
    n = len(axis.model.den)
    size, rows = n + 3, []
    still = np.zeros(example().HORIZON)
    for row in np.eye(size + 3):
        axis.x, (axis.last, axis.speed, axis.disturbance) = row[:n].copy(), row[n:size]
        position, speed = row[size], row[size + 1]
        axis.observe(speed, speed, _UNLIMITED)
        made = axis.command(position, speed, still, -_UNLIMITED, _UNLIMITED)
        rows.append([*axis.x, axis.last, axis.speed, axis.disturbance, made])
    k = np.array(rows).T
    return Sampled(k[:size, :size], k[:size, size:], k[size:, :size], k[size:, size:])


def judged(axis: Axis, k: Sampled) -> tuple[float, float, float, float]:
    """Disk margin, and rms of position, m, speed, m/s, and the command's steps, m/s2.

    As `heli_outer_pd.analysis.cost` has them of the packaged controller; 0 and inf if unstable.
    """
    A, B, Q, M, Z = axis.lifted
    closed = np.block([[A + B @ k.D @ M, B @ k.C], [k.B @ M, k.A]])
    if np.max(np.abs(np.linalg.eigvals(closed))) >= 1.0:
        return 0.0, np.inf, np.inf, np.inf
    omega, moved = axis.response
    z = np.exp(1j * omega * axis.dt_s)[:, None, None]
    inner = np.linalg.solve(z * np.eye(len(k.A)) - k.A, np.broadcast_to(k.B, (len(z), *k.B.shape)))
    loop = -np.einsum("mi,mi->m", (k.C @ inner + k.D)[:, 0], moved)
    noise = np.zeros_like(closed)
    noise[: len(A), : len(A)] = Q
    covariance = stationary(closed, noise)
    position_m, speed_mps = np.sqrt(np.diag(Z @ covariance[: len(A), : len(A)] @ Z.T))
    command = np.hstack([k.D @ M, k.C])
    change = command @ closed - command
    step = change @ covariance @ change.T + command @ noise @ command.T
    return disk_margin(loop), float(position_m), float(speed_mps), float(np.sqrt(step[0, 0]))


def price(around: PositionLoop, i: int, k: Sampled) -> float:
    """Cost of a controller on an axis, inf below a floor: `heli_outer_pd.analysis.cost`."""
    wanted, total = WANTED[i], 0.0
    for one in (around.axes[i], *around.others[i]):
        margin, position_m, speed_mps, step_mps2 = judged(one, k)
        nominal = one is around.axes[i]
        floor = wanted.disk_margin if nominal else wanted.disk_margin_of_others
        if not margin >= floor or (nominal and step_mps2 > wanted.step_mps2):
            return np.inf
        total += (position_m / wanted.position_m) ** 2 + (speed_mps / wanted.speed_mps) ** 2
    return total / (1 + len(around.others[i]))


def loop_around(period_ticks: int | None) -> tuple[PositionLoop, OuterParams]:
    """The axes in `honest` at a controller's period, None: as packaged, and the packaged gains."""
    periods: dict[str, dict[str, Any]] = {
        "outer_loop": {"period_ticks": period_ticks, "collective_prediction_s": 0.0},
        "inner_loop": {"outer_period_ticks": period_ticks},
    }
    nodes = resolve(
        "hover", "rtk", world="honest", overrides=periods if period_ticks else None
    ).nodes
    config = AttitudeConfig.from_parameters(nodes["inner_loop"])
    attitude = loop_as_flown(nodes)
    assert attitude is not None  # of the packaged controllers it is known
    parts = nodes["plant"], nodes["outer_loop"], attitude, model_of(config), config.actuation
    return position_loop(*parts), outer_params(nodes["outer_loop"])


def searched() -> list[dict[str, Any]]:
    """Weights of each axis, what they cost and keep, and the same of the packaged gains."""
    as_packaged, packaged = loop_around(None)
    around, _ = loop_around(round(example().DT_S / TICK_S))
    found = []
    for i, axis in enumerate(as_packaged.axes):

        def made(values: Sequence[float], i: int = i) -> Sampled:
            of = example().MODELS[i], example().Weights(*values)
            return linear(example().AxisMpc(*of, _UNLIMITED))

        def cost(values: Sequence[float], i: int = i) -> float:
            return price(around, i, made(values, i))

        best = min((search(start, cost) for start in STARTS[i]), key=cost)
        row: dict[str, Any] = {"axis": NAMES[i], "weights": list(best)}
        for name, loop, k in (
            (MPC, around, made(best)),
            (DEFAULT, as_packaged, law(Gains.of(packaged, i), axis)),
        ):
            row[name] = {
                "cost": price(loop, i, k),
                "as_modelled": judged(loop.axes[i], k)[0],
                "least_of_others": min(judged(one, k)[0] for one in loop.others[i]),
            }
        found.append(row)
    return found


# -------------------------------------------------------------------------------------------------
# Flights.
# -------------------------------------------------------------------------------------------------

_FROM_S = 5.0
MANOEUVRES: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "figure eight, 3 m/s": ("figure_eight", {}),
    "figure eight, 5.15 m/s": (
        "figure_eight", {"path.speed_mps": 5.15, "path.acceleration_mps2": 8.0},
    ),
    "20 m north in 3.4 s": (
        "waypoints",
        {
            "path.waypoints_ned_m": [20.0, 0.0, -10.0],
            "path.speed_mps": 20.0, "path.acceleration_mps2": 8.0, "path.jerk_mps3": 20.0,
            "duration_s": 25.0,
        },
    ),
}  # fmt: skip
"""At the limit of tilt, 40 deg, it is 8.2 m/s2; the second one's tips and the third take 8.0."""
_STAYS = {"climb.start_s": 200.0, "climb.end_s": 202.0, "duration_s": 40.0}
_FAULT_S = 12.0
_LINKS = tuple(
    f"{{what: link, from: any, to: any, kind: {kind}, value: {value}, start_s: {_FAULT_S}}}"
    for kind, value in (("loss", 0.2), ("delay", 0.03))
)
FAULTS: Mapping[str, Over] = {
    "a fifth of all messages lost, each 30 ms late": {
        node.name: {"link_faults": _LINKS} for node in NODES
    },
    "a lateral servo of 0.5 /s": {
        "plant": {"faults": (f"{{what: delta_lat, kind: slow, value: 0.5, start_s: {_FAULT_S}}}",)}
    },
}
"""From 12 s on, in a hover at 10 m."""
FEW_SEEDS = 10
"""So many of the seeds fly manoeuvres and faults."""


def settings_of(
    scenario: str, form: str, seed: int, where: str = "honest", over_: Over | None = None
) -> Settings:
    """What is flown, with RTK."""
    nodes = dict(over_ or {})
    if form == SEARCHED:
        nodes["outer_loop"] = {**nodes.get("outer_loop", {}), **GAINS}
    return resolve(scenario, "rtk", world=where, overrides=nodes).with_seed(seed)


def flown_by(settings: Settings, form: str) -> tuple[LoopFlight, Any]:
    """The flight of a controller, and the MPC that flew it, None of the default."""
    if form in (DEFAULT, SEARCHED):
        return simulate(settings), None
    mpc = example().MpcPosition()
    if form == AHEAD:
        mpc.known = known_ahead(settings, mpc.k.shaping_ns)
    return fly_settings(settings, [PythonLaw(mpc)]), mpc


def known_ahead(settings: Settings, window_ns: int) -> Callable[[float], NDArray[np.float64]]:
    """Accelerations (50, 3), NED, m/s2, over the MPC's horizon from a flight time (s) on."""
    path, of, row = settings.scenario.reference, example(), np.zeros(SHAPED.size)

    def ahead(time_s: float) -> NDArray[np.float64]:
        out = np.empty((of.HORIZON, 3))
        for k, later_s in enumerate(of.AHEAD_S):
            at_ns = round((time_s + later_s) * 1e9)
            shaped_reference_at(at_ns, window_ns, 0.0, path.times_ns, path.points, row)
            out[k] = row[SHAPED.acc]
        return out

    return ahead


def asked_of(mpc: Any) -> dict[str, int]:
    """How often OSQP was asked for an axis, and how often it did not get to its tolerance."""
    axes = mpc.axes if mpc is not None else ()
    return {
        "asked": sum(axis.qp.asked for axis in axes),
        "unsolved": sum(axis.qp.unsolved for axis in axes),
    }


@over(world=WORLDS, form=(DEFAULT, SEARCHED, MPC))
def hover(world: str, form: str, seed: int) -> dict[str, Any] | None:
    """Largest errors in the order of `HOVER`; None of a flight that was lost."""
    settings = settings_of("hover", form, seed, world)
    flight, mpc = flown_by(settings, form)
    record = flight.record
    drift = drift_at_engagement(record)
    if flight.sentence or drift is None:
        return None
    of = hover_errors(record.truth_pos_ned_m + drift, record.truth_vel_ned_mps, record.reference)
    scored = settings.scenario.scored(record.time_s)
    return {
        "errors": [float(np.abs(of[metric.key][scored]).max()) for metric in HOVER],
        **asked_of(mpc),
    }


@over(manoeuvre=tuple(MANOEUVRES), form=(DEFAULT, SEARCHED, MPC, AHEAD))
def manoeuvre(manoeuvre: str, form: str, seed: int) -> dict[str, Any] | None:
    """How a path is followed in `honest` with RTK; None of a flight that was lost."""
    scenario, path = MANOEUVRES[manoeuvre]
    settings = settings_of(scenario, form, seed, over_={"scenario": path})
    flight, mpc = flown_by(settings, form)
    record = flight.record
    drift = drift_at_engagement(record)
    if flight.sentence or drift is None:
        return None
    off = np.abs(errors(record, "truth_less_drift", PATH)["position"])
    limits = outer_params(settings.nodes["outer_loop"])
    tilts = record.setpoint[:, [SETPOINT.phi, SETPOINT.theta]] - limits.trim[:2]
    goal = settings.scenario.reference.points[-1, REFERENCE.pos]
    away = np.linalg.norm(record.truth_pos_ned_m + drift - goal, axis=1)
    late = record.time_s[away > 0.5]
    return {
        "worst_m": float(off[settings.scenario.scored(record.time_s)].max()),
        "tilt_deg": float(np.degrees(np.abs(tilts).max())),
        "there_s": float(late[-1] - _FROM_S) if len(late) else 0.0,
        "seconds": float(record.time_s[-1]),
        **asked_of(mpc),
    }


@over(fault=tuple(FAULTS), form=(DEFAULT, SEARCHED, MPC))
def faulty(fault: str, form: str, seed: int) -> float | None:
    """Largest distance from where it was at the fault, m; None of a flight that was lost."""
    over_ = {**FAULTS[fault], "scenario": _STAYS}
    settings = settings_of("hover", form, seed, over_=over_)
    flight, _ = flown_by(settings, form)
    pos, since = flight.record.truth_pos_ned_m, flight.record.time_s >= _FAULT_S
    return (
        None if flight.sentence else float(np.linalg.norm(pos[since] - pos[since][0], axis=1).max())
    )


def spread(values: Sequence[float]) -> dict[str, float | None]:
    """Median and worst; None where no flight was kept."""
    if not len(values):
        return {"median": None, "worst": None}
    return {"median": float(np.median(values)), "worst": float(max(values))}


def hover_row(place: Place[dict[str, Any] | None]) -> dict[str, Any]:
    """Median and worst of each error, and how many flights are inside each of `LIMITS`."""
    flights = [flight for flight in place.flights if flight is not None]
    kept = np.array([flight["errors"] for flight in flights])
    return {
        **place.point,
        "lost": len(place.flights) - len(flights),
        "errors": {m.key: spread(kept[:, i].tolist()) for i, m in enumerate(HOVER)},
        "inside": {name: int((kept <= limit).all(axis=1).sum()) for name, limit in LIMITS.items()},
        "asked": sum(flight["asked"] for flight in flights),
        "unsolved": sum(flight["unsolved"] for flight in flights),
    }


def manoeuvre_row(place: Place[dict[str, Any] | None]) -> dict[str, Any]:
    """The same of a path; `asked`: share of the steps of an axis."""
    flights = [flight for flight in place.flights if flight is not None]
    steps = sum(flight["seconds"] for flight in flights) / example().DT_S * len(NAMES)
    return {
        **place.point,
        "lost": len(place.flights) - len(flights),
        **{key: spread([f[key] for f in flights]) for key in ("worst_m", "there_s", "tilt_deg")},
        "asked": sum(flight["asked"] for flight in flights) / steps,
        "unsolved": sum(flight["unsolved"] for flight in flights),
    }


# -------------------------------------------------------------------------------------------------
# What it costs.
# -------------------------------------------------------------------------------------------------


@contextmanager
def timed(owner: Any, name: str, calls: list[tuple[float, Any]]) -> Iterator[None]:
    """Every call of a method appends its CPU time, us, and its arguments."""
    method = getattr(owner, name)

    def clocked(*arguments: Any) -> Any:
        begin = time.process_time_ns()
        made = method(*arguments)
        calls.append(((time.process_time_ns() - begin) * 1e-3, arguments))
        return made

    setattr(owner, name, clocked)
    try:
        yield
    finally:
        setattr(owner, name, method)


def cpu() -> dict[str, float]:
    """CPU time of a step of 40 ms, us: the MPC's, one program of OSQP, the packaged controller's.

    Over a flight of the manoeuvre that asks OSQP most.
    """
    scenario, path = list(MANOEUVRES.values())[-1]
    settings = settings_of(scenario, MPC, 1, over_={"scenario": path})
    mpc = example().MpcPosition()
    steps, programs = list[tuple[float, Any]](), list[tuple[float, Any]]()
    with timed(mpc, "plan", steps), timed(example().Qp, "solve", programs):
        fly_settings(settings, [PythonLaw(mpc)])
    packaged, packaged_us, out = initial_state(mpc.k), list[float](), np.zeros(SETPOINT.size)
    for _, (nav, reference, _) in steps:
        begin = time.process_time_ns()
        position_law(nav, reference, mpc.k, packaged, out)
        packaged_us.append((time.process_time_ns() - begin) * 1e-3)
    steps_us = [us for us, _ in steps]
    return {
        "step_median_us": float(np.median(steps_us)),
        "step_longest_us": max(steps_us),
        "solve_median_us": float(np.median([us for us, _ in programs])),
        "packaged_median_us": float(np.median(packaged_us)),
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the tables show."""

    few = replace(options, seeds=options.seeds[:FEW_SEEDS])
    return {
        "seeds": options.seeds,
        "conditions": {
            world: conditions(resolve("hover", "rtk", world=world)).splitlines() for world in WORLDS
        },
        "weights": searched(),
        "hover": [hover_row(place) for place in hover.places(options)],
        "manoeuvres": [manoeuvre_row(place) for place in manoeuvre.places(few)],
        "faults": [
            {
                **place.point,
                "lost": sum(flight is None for flight in place.flights),
                "away_m": spread([flight for flight in place.flights if flight is not None]),
            }
            for place in faulty.places(few)
        ],
        "cpu": cpu(),
    }


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "mpc",
    "./heli python -m evidence.experiments.mpc --seeds 1..40",
    "A model predictive position controller beside the default: hover, manoeuvres, faults, cost.",
    tuple(range(1, 41)),
    MARGIN,
    {
        key: NOT_COMPARED
        for key in ("step_median_us", "step_longest_us", "solve_median_us", "packaged_median_us")
    },
)


def _pair(of: Mapping[str, float | None], digits: int = 2) -> str:
    """Median / worst."""
    return " / ".join("–" if v is None else f"{v:.{digits}f}" for v in of.values())


@table("mpc_hover")
def mpc_hover(results: Results) -> str:
    """Largest errors of the hover, default and MPC."""
    record = results["mpc"]
    head = ["world", "position controller", *(f"{m.label}, {m.unit}" for m in HOVER),
            "inside the paper's", "half, quarter", "tenth", "lost"]  # fmt: skip
    body = [
        [
            row["world"],
            row["form"],
            *(_pair(row["errors"][m.key]) for m in HOVER),
            *(str(row["inside"][name]) for name in LIMITS),
            str(row["lost"]),
        ]
        for row in record["hover"]
    ]
    return (
        f"{grid(head, body)}\n\nHover test with RTK, {results.seeds('mpc')}: largest error of a "
        "flight in the scored windows, median / worst, drift-corrected; then how many of "
        f"{len(record['seeds'])} are inside the paper's figures, inside half of its speeds and a "
        "quarter of its positions, inside a tenth of its positions. "
        f"{world({k: [v] for k, v in record['conditions'].items()})}"
    )


@table("mpc_manoeuvres")
def mpc_manoeuvres(results: Results) -> str:
    """Paths near the limit of tilt, and hover with faults."""
    record = results["mpc"]
    head = ["manoeuvre", "position controller", "distance from the path's point, m",
            "at its end to 0.5 m after, s", "largest tilt command, deg", "steps at a limit, %",
            "lost"]  # fmt: skip
    body = [
        [
            row["manoeuvre"],
            row["form"],
            _pair(row["worst_m"]),
            _pair(row["there_s"], 1),
            f"{row['tilt_deg']['worst']:.1f}",
            "–" if row["form"] in (DEFAULT, SEARCHED) else f"{100.0 * row['asked']:.1f}",
            str(row["lost"]),
        ]
        for row in record["manoeuvres"]
    ]
    return (
        f"{grid(head, body)}\n\nWorld `honest`, RTK, seeds 1 to {FEW_SEEDS}, drift-corrected: "
        "largest distance of a flight from 5 s on, when it was inside 0.5 m of the path's end for "
        "good (after 5 s, when the path begins), median / worst; largest commanded tilt from trim; "
        "share of an axis' steps at which a limit acts within the horizon, so that OSQP is asked."
    )


@table("mpc_faults")
def mpc_faults(results: Results) -> str:
    """Hover with faults, default and MPC."""
    rows = results["mpc"]["faults"]
    head = ["fault from 12 s on", "position controller", "away, m", "lost"]
    body = [[row["fault"], row["form"], _pair(row["away_m"]), str(row["lost"])] for row in rows]
    return (
        f"{grid(head, body)}\n\nHover at 10 m in `honest`, RTK, 40 s, seeds 1 to {FEW_SEEDS}: "
        "largest distance from where it was at 12 s, median / worst of those not lost."
    )


@table("mpc_weights")
def mpc_weights(results: Results) -> str:
    """The searched weights, and what they are worth on the linear axes."""
    rows = results["mpc"]["weights"]
    head = ["axis", "speed, command, change, bandwidth", "cost", "disk margin, as modelled",
            "least of the others"]  # fmt: skip
    body = [
        [
            row["axis"],
            ", ".join(f"{value:g}" for value in row["weights"]),
            *(
                f"{row[DEFAULT][key]:.2f} / {row[MPC][key]:.2f}"
                for key in ("cost", "as_modelled", "least_of_others")
            ),
        ]
        for row in rows
    ]
    return (
        f"{grid(head, body)}\n\nLinear, where no limit acts, about the trim in the mean wind of "
        "`honest`; default / MPC. Others: commands a tick later, that and servos 30 % slower, 30 % "
        "more and less acceleration per command. The floors of the search are 0.6 and 0.4."
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..40"))
