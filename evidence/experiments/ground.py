# SPDX-License-Identifier: Apache-2.0
"""The aircraft on the ground: touch-downs, standing in wind, tipping over a skid; JSON.

Usage: ./heli python -m evidence.experiments.ground [--seeds 1..20]
"""

import math
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.optimize import brentq

from evidence.files import Results
from evidence.registry import MARGIN, TWENTY, produces, table
from evidence.sweep import Options, over, print_result
from evidence.tables import grid
from heli_core.rotations import euler_angles, quat_from_euler, quat_to_R_nb
from heli_core.rows import ACTUATOR, MEAS, NAV, PLANT, ROTOR
from heli_dynamics_sim import noise, plant
from heli_dynamics_sim.aircraft import HelicopterParameters, HelicopterParams
from heli_dynamics_sim.airframe import STEP_S, to_ned
from heli_dynamics_sim.ground import N_SKID_POINTS, depth_of_cg, ground_contact
from heli_dynamics_sim.helicopter import WORK_ROWS, derivative_kernel, rk4_step, same_air
from heli_dynamics_sim.trim import critical_bank, trim
from heli_flight.settings import resolve
from heli_observer import observer

SLOPE_DEG = 5.0
_SLOPE = math.tan(math.radians(SLOPE_DEG))
_CALM = {"wind.turbulence": False, "wind.profile_speed_mps": [0.0, 0.0, 0.0]}
_LANDING_S, _STAND_S = 5.0, 10.0
_DOWN_IN_S = 0.5
"""Time over which the collective goes to idle after the first touch."""
_CAUGHT = 100.0
"""Friction of a skid that is caught."""
SINKS_MPS = (0.3, 0.5, 1.0)
GROUNDS: dict[str, dict[str, Any]] = {
    "level": {},
    "level, 0.3 m/s sideways": {"side": 0.3},
    "5 deg down to the right": {"slope": [0.0, -_SLOPE]},
    "5 deg up ahead": {"slope": [_SLOPE, 0.0]},
}
STANDS = {"level": (0.0, 0.0), "5 deg down to the right": (0.0, -_SLOPE)}
"""Slopes that it stands on, by name."""
LIFTS = (0.0, 0.5, 0.8, 0.9, 0.95)
STICKS = (0.03, 0.12)
LIMITS_DEG = (3.0, 5.0, 8.0, 12.0, 90.0)


def config(**changes: Any) -> plant.PlantConfig:
    """The packaged plant with changes of its parameters."""
    values = resolve("hover", world="paper").nodes["plant"]
    return plant.PlantConfig.from_parameters({**values, **changes})


def flown(state: plant.PlantState, k: plant.PlantParams, seconds: float) -> Iterator[float]:
    """Advance tick by tick in still air, with `state.pilot[1:]` for the command; flight times."""
    for tick in range(round(100 * seconds)):
        state.air[:] = 0.0
        plant.advance(state, state.pilot[1:].copy(), k)
        yield (tick + 1) / 100


def lowest(x: np.ndarray, k: HelicopterParams) -> float:
    """Height of the lowest skid end above the ground, m; negative: its spring is pressed."""
    into, ends = k.ground.plane[0], k.ground.points[:N_SKID_POINTS]
    deepest = max(into @ np.array(to_ned(tuple(x[PLANT.quat]), *end)) for end in ends)
    return -float(depth_of_cg(x, k.ground) + deepest)


def lean(x: np.ndarray, k: HelicopterParams) -> float:
    """Angle between the aircraft's vertical axis and the ground's, deg."""
    return math.degrees(math.acos(min(1.0, quat_to_R_nb(x[PLANT.quat])[:, 2] @ k.ground.plane[0])))


def touch_down(sink_mps: float, slope: tuple[float, float] = (0.0, 0.0), side: float = 0.0):
    """From level hover trim at a sinking speed, collective to idle from the first touch on."""
    landing = config(**_CALM, **{"ground.slope": list(slope)})
    state, k = plant.initial_state(landing, 1), landing.params
    x, hover, idle = state.x, state.pilot[1 + ACTUATOR.col], landing.idle_collective
    x[PLANT.down] = 0.0
    x[PLANT.down] = -float(landing.helicopter.gear_height_m) - 0.2
    x[PLANT.down] += max(lowest(x, k.aircraft) - 0.02, 0.0)
    x[PLANT.vel] = quat_to_R_nb(x[PLANT.quat]).T @ [0.0, side, sink_mps]
    touched, place, bounce, tilt, fastest = None, x[PLANT.pos].copy(), 0.0, 0.0, 0.0
    for time in flown(state, k, _LANDING_S):
        speed, skids, _ = ground_contact(x, k.aircraft.ground)
        if touched is None and skids:
            touched, place = time, x[PLANT.pos].copy()
        if touched is not None:
            share = min((time - touched) / _DOWN_IN_S, 1.0)
            state.pilot[1 + ACTUATOR.col] = hover + share * (idle - hover)
            bounce = max(bounce, lowest(x, k.aircraft))
            tilt = max(tilt, math.degrees(np.abs(euler_angles(x[None, PLANT.quat])[0, :2]).max()))
            fastest = max(fastest, speed)
    return {
        "sink_mps": sink_mps,
        "bounce_mm": 1e3 * bounce,
        "skid_m": float(np.linalg.norm((x[PLANT.pos] - place)[:2])),
        "tilt_deg": tilt,
        "rest_deg": lean(x, k.aircraft),
        "left_mps": float(np.linalg.norm(x[PLANT.vel])),
        "ended": plant.PlantStatus(plant.status(state, k)).name,
    }


@over(ground=tuple(STANDS))
def stand(ground: str, seed: int) -> dict[str, float]:
    """Ten seconds at idle in gusty wind of 5 m/s: creep, and how the observer has aligned."""
    grounds: dict[str, dict[str, Any]] = {
        "plant": {"start.on_ground": True, "ground.slope": list(STANDS[ground]),
                  "wind.profile_speed_mps": [5.0, 5.0, 5.0]},
        "outer_loop": {"start.on_ground": True},
    }  # fmt: skip
    settings = resolve("hover", world="paper", seed=seed, overrides=grounds)
    standing = plant.PlantConfig.from_parameters(settings.nodes["plant"])
    state, k = plant.initial_state(standing, seed), standing.params
    estimator = observer.ObserverConfig(settings.nodes["observer"])
    known, rows = observer.initial_state(estimator), noise.NoiseStreams(seed)
    y, nav, u, x = np.zeros(MEAS.size), np.zeros(NAV.size), state.pilot[1:].copy(), state.x
    first = x.copy()
    rotor = 0.0
    for tick in range(round(100 * _STAND_S)):
        plant.measure(state, tick, rows.row(), k, y)
        observer.observe(known, tick, y, u, estimator.params, nav)
        if tick >= 200:
            wide = (nav[NAV.rotor] - x[PLANT.rotor])[ROTOR.flapping]
            rotor = max(rotor, float(np.abs(wide).max()))
        plant.advance(state, u, k)
    is_, estimated = (quat_to_R_nb(q) for q in (x[PLANT.quat], nav[NAV.quat]))
    # Turn of the estimate against the aircraft about north, east, down.
    turn = is_ @ estimated.T
    wrong = 0.5 * np.array(
        [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    )
    return {
        "creep_mm": 1e3 * float(np.abs(x[PLANT.pos] - first[PLANT.pos]).max()),
        "level_deg": math.degrees(math.hypot(wrong[0], wrong[1])),
        "heading_deg": math.degrees(abs(wrong[2])),
        "disc_deg": math.degrees(rotor),
    }


def loads(x: np.ndarray, k: HelicopterParams) -> tuple[np.ndarray, np.ndarray]:
    """Force (3,) and moment (3,) of the air on an aircraft at rest, level, away from the ground."""
    level, rates = x.copy(), np.empty(PLANT.size)
    level[PLANT.pos], level[PLANT.vel], level[PLANT.rate] = (0.0, 0.0, -1000.0), 0.0, 0.0
    level[PLANT.quat] = 1.0, 0.0, 0.0, 0.0
    derivative_kernel(level, level[PLANT.servo], same_air(np.zeros(3)), k, rates)
    inertia = np.array([k.body.j_xx, k.body.j_yy, k.body.j_zz])
    force = k.body.mass * (rates[PLANT.vel] - [0.0, 0.0, k.body.gravity])
    return force, inertia * rates[PLANT.rate]


def lifting(aircraft: HelicopterParameters, share: float) -> np.ndarray:
    """State (42,) with hover's cyclic and a collective that lifts `share` of the weight."""
    x, k = trim(aircraft).x.copy(), aircraft.params
    weight = aircraft.mass_kg * aircraft.gravity_mps2

    def lacks(collective: float) -> float:
        x[PLANT.servo_col] = collective
        return loads(x, k)[0][2] + share * weight

    x[PLANT.servo_col] = brentq(lacks, -0.9, 0.9)
    return x


def tips(x: np.ndarray, k: HelicopterParams, bank_rad: float) -> bool:
    """Whether an aircraft at rest on its right skid, at a bank, goes on to the right in 1.5 s."""
    x, work = x.copy(), np.zeros((WORK_ROWS, PLANT.size))
    x[PLANT.quat] = quat_from_euler(bank_rad, 0.0, 0.0)
    x[PLANT.down] = 0.0
    x[PLANT.down] = lowest(x, k) + 1e-3
    u, air = x[PLANT.servo].copy(), same_air(np.zeros(3))
    for _ in range(round(1.5 / STEP_S)):
        rk4_step(x, u, air, k, STEP_S, work)
    return float(euler_angles(x[None, PLANT.quat])[0, 0]) > bank_rad


def critical(lift: float) -> dict[str, float]:
    """Critical bank over the right skid, by statics and by letting the aircraft go."""
    aircraft = HelicopterParameters.from_yaml("helion.yaml")
    x, k = lifting(aircraft, lift), aircraft.params
    k = k._replace(ground=k.ground._replace(friction=_CAUGHT))
    force, moment = loads(x, k)
    statics = critical_bank(aircraft, -force[2], moment[0], force[1])
    low, high = 0.0, 0.9
    while high - low > 1e-4:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if tips(x, k, middle) else (middle, high)
    return {"lift": lift, "statics_deg": math.degrees(statics), "let_go_deg": math.degrees(low)}


def side_stick(stick: float, limit_deg: float) -> dict[str, Any]:
    """Stick to the right at 90 % of the weight with the skid caught; collective down at a tilt.

    40 ms pass until the collective is commanded down; the cyclic then fades as that of a controller
    at rest does.
    """
    aircraft = HelicopterParameters.from_yaml("helion.yaml")
    light = float(lifting(aircraft, 0.9)[PLANT.servo_col])
    start = config(**_CALM, **{"start.on_ground": True, "ground.idle_collective": light})
    state, k = plant.initial_state(start, 1), start.params
    caught = k.aircraft.ground._replace(friction=_CAUGHT)
    k = k._replace(aircraft=k.aircraft._replace(ground=caught))
    u, trimmed, idle = state.pilot[1:], state.pilot[1 + ACTUATOR.lat], config().idle_collective
    u[ACTUATOR.lat] += stick
    late, most = 4, 0.0
    for _ in flown(state, k, 4.0):
        tilt = lean(state.x, k.aircraft)
        most = max(most, tilt)
        late -= late < 4 or tilt > limit_deg
        if late <= 0:
            u[ACTUATOR.col] = idle
            u[ACTUATOR.lat] = trimmed + math.exp(-0.01 / 0.5) * (u[ACTUATOR.lat] - trimmed)
    ended = plant.PlantStatus(plant.status(state, k)).name
    return {"stick": stick, "limit_deg": limit_deg, "most_deg": most, "ended": ended}


def experiment(options: Options) -> dict[str, Any]:
    """All that the tables show."""
    landings = [
        {"ground": name, **touch_down(sink, **ground)}
        for name, ground in GROUNDS.items()
        for sink in SINKS_MPS
    ]
    stands = []
    for place in stand.places(options):
        rows = place.flights
        most = {key: max(row[key] for row in rows) for key in rows[0]}
        stands.append({**place.point, **most})
    return {
        "seeds": options.seeds,
        "landings": landings,
        "stands": stands,
        "critical": [critical(lift) for lift in LIFTS],
        "side_stick": [side_stick(stick, limit) for stick in STICKS for limit in LIMITS_DEG],
    }


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "ground",
    "./heli python -m evidence.experiments.ground --seeds 1..20",
    "Touch-downs, standing in wind, tipping over a skid.",
    TWENTY,
    MARGIN,
)


_FELL = 89.0
"""A limit of the tilt, deg, that stands for none."""


@table("touch_downs")
def touch_downs(results: Results) -> str:
    """Touch-downs at three speeds on four kinds of ground, and standing in wind."""
    record = results["ground"]
    rows = [
        [
            row["ground"],
            f"{row['sink_mps']:.1f}",
            f"{row['bounce_mm']:.1f}",
            f"{row['skid_m']:.3f}",
            f"{row['tilt_deg']:.1f}",
            row["ended"],
        ]
        for row in record["landings"]
    ]
    head = [
        "ground",
        "sinking at, m/s",
        "bounce, mm",
        "skid, m",
        "largest roll or pitch, deg",
        "end",
    ]
    stands = "; ".join(
        f"{row['ground']}: creep {row['creep_mm']:.2f} mm, estimated level off by "
        f"{row['level_deg']:.2f} deg, heading {row['heading_deg']:.2f} deg, disc "
        f"{row['disc_deg']:.2f} deg"
        for row in record["stands"]
    )
    return (
        f"{grid(head, rows)}\n\nDefault aircraft, no controller, still air, from hover's attitude; "
        "the collective goes to idle within 0.5 s from the first touch on. The bounce is the air "
        "below the lowest skid end after it, the skid the way along the ground in 5 s. Standing "
        f"10 s at idle in gusty wind of 5 m/s, seeds {record['seeds'][0]} to "
        f"{record['seeds'][-1]}, "
        f"standalone receiver, the worst at the end: {stands} (disc: from 2 s on)."
    )


@table("rollover")
def rollover(results: Results) -> str:
    """Critical bank over a skid, and what lowering the collective saves."""
    record = results["ground"]
    rows = [
        [f"{row['lift']:.2f}", f"{row['statics_deg']:.1f}", f"{row['let_go_deg']:.1f}"]
        for row in record["critical"]
    ]
    stopped = [
        [
            f"{row['stick']:.2f}",
            "never" if row["limit_deg"] > _FELL else f"{row['limit_deg']:.0f} deg",
            f"{row['most_deg']:.1f}",
            row["ended"],
        ]
        for row in record["side_stick"]
    ]
    critical = grid(["lift over weight", "by statics, deg", "let go in the plant, deg"], rows)
    saved = grid(["stick to the right", "collective down at", "largest tilt, deg", "end"], stopped)
    return (
        f"{critical}\n\nBank at which nothing rights the aircraft on its right skid, at rest, "
        f"hover's cyclic and pedal, the skid caught.\n\n{saved}\n\nThe same at 0.90 of the weight "
        "from level ground, stick held; the collective is commanded down 40 ms after the tilt."
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment))
