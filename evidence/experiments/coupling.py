# SPDX-License-Identifier: Apache-2.0
"""Whether X, Y and Z are coupled and lag, as the paper says of its flight (section 4); JSON.

Usage: ./heli python -m evidence.experiments.coupling [--seeds 1..10]

Steps: in still air one axis is commanded, on three levels: the aircraft without a controller, the
attitude controller, the whole loop. The answer is the difference to the same flight without the
step, so that sensors' errors are out of it. Hover: coherence of the velocities' errors in the hover
test's second phase, beside that of the wind that drives them.
"""

import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import csd

from evidence.experiments.rotor_states import NO_DRAW, STILL
from evidence.files import Results
from evidence.registry import produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid, world
from heli_core.rows import ACTUATOR, REFERENCE, SETPOINT, TRUTH
from heli_core.ticks import TICK_S
from heli_flight.loop import simulate
from heli_flight.result import conditions
from heli_flight.settings import Settings, resolve
from heli_flight.stepping import CommandLevel, SteppedFlight

Array = NDArray[np.float64]
AXES = ("X", "Y", "Z")
WORLDS = ("paper", "honest")
LAWS = ("packaged", "paper")
PAIRS = ((0, 1), (0, 2), (1, 2))
SETTLED_S = 10.0
FROM_S = 25.0
"""The hover test's second phase, at 20 m."""
BAND_HZ = (0.1, 1.0)
_SEGMENT = 1000  # ticks of 10 ms
_WINDOW = 5  # ticks over which a velocity's difference is its acceleration


class Level(NamedTuple):
    """How an axis is commanded: places of the command, its step, and how long the answer is."""

    name: str
    level: CommandLevel
    places: tuple[int, int, int]
    step: tuple[float, float, float]
    duration_s: float


_TILT = 0.05
LEVELS = (
    Level(
        "no law",
        CommandLevel.ACTUATORS,
        (ACTUATOR.lon, ACTUATOR.lat, ACTUATOR.col),
        (0.02, 0.02, 0.05),
        1.0,
    ),
    Level(
        "attitude law",
        CommandLevel.ATTITUDE,
        (SETPOINT.theta, SETPOINT.phi, SETPOINT.col),
        (_TILT, _TILT, 0.05),
        2.0,
    ),
    Level("whole loop", CommandLevel.GUIDANCE, (0, 1, 2), (1.0, 1.0, 1.0), 5.0),
)


# -------------------------------------------------------------------------------------------------
# Steps.
# -------------------------------------------------------------------------------------------------


def still(world: str, laws: str) -> Settings:
    """Hover in still air with the nominal aircraft and all that a world adds to it."""
    calm: dict[str, Any] = {"wind.profile_speed_mps": [0.0] * 3, "wind.turbulence": False}
    if world != "paper":
        calm = STILL | {"wind.random_gusts.rate_per_min": 0.0}
    changed: dict[str, Mapping[str, Any]] = {"plant": calm, "world": NO_DRAW}
    return resolve("hover", "rtk", overrides=changed, world=world, laws=laws)


def velocities(flight: SteppedFlight, level: Level, axis: int | None) -> Array:
    """Velocity (n, 3) north, east, down from now on, m/s; heading is north. None: no step."""
    base = {
        CommandLevel.ACTUATORS: flight.u.copy(),
        CommandLevel.ATTITUDE: flight.setpoint.copy(),
        CommandLevel.GUIDANCE: np.zeros(4),
    }[level.level]
    if axis is not None:
        base[level.places[axis]] += level.step[axis]
    rows = []
    for _ in range(round(level.duration_s / TICK_S)):
        flight.step(level.level, base)
        rows.append(flight.truth[TRUTH.vel].copy())
    return np.array(rows)


def answer(settings: Settings, level: Level) -> dict[str, Any]:
    """Share of each axis's peak in that of the commanded one, (3, 3), and lags."""
    flight = SteppedFlight(settings)
    while flight.tick < round(SETTLED_S / TICK_S):
        flight.step(CommandLevel.GUIDANCE)
    moment = flight.save()
    quiet = velocities(flight, level, None)
    shares, lags = [], []
    for axis in range(len(AXES)):
        flight.restore(moment)
        moved = velocities(flight, level, axis) - quiet
        peaks = np.abs(moved).max(axis=0)
        shares.append((peaks / peaks[axis]).tolist())
        lags.append(half_time_s(moved[:, axis]))
    return {"shares": shares, "lag_s": lags}


def half_time_s(velocity: Array) -> float:
    """Time until the acceleration is half its largest, s."""
    acceleration = np.abs(velocity[_WINDOW:] - velocity[:-_WINDOW])
    first = int(np.argmax(acceleration >= 0.5 * acceleration.max()))
    return (first + 0.5 * _WINDOW + 1.0) * TICK_S


# -------------------------------------------------------------------------------------------------
# Hover.
# -------------------------------------------------------------------------------------------------


class Spectra(NamedTuple):
    """Cross spectra (3, 3, f) of the velocities' errors and of the wind, and frequencies, Hz."""

    hz: Array
    error: NDArray[np.complex128]
    wind: NDArray[np.complex128]
    segments: int


def spectra(signal: Array) -> tuple[Array, NDArray[np.complex128]]:
    """Frequencies (f,) and cross spectra (3, 3, f) of (n, 3)."""
    full = [
        csd(signal[:, i], signal[:, j], 1.0 / TICK_S, nperseg=_SEGMENT) for i, j in np.ndindex(3, 3)
    ]
    return full[0][0], np.array([one[1] for one in full]).reshape(3, 3, -1)


@over(world=WORLDS, laws=LAWS)
def flown(world: str, laws: str, seed: int) -> Spectra:
    """Spectra of one hover test."""
    record = simulate(settings_of(world, laws).with_seed(seed)).record
    late = record.time_s >= FROM_S
    error = record.truth_vel_ned_mps[late] - record.reference[late][:, REFERENCE.vel]
    hz, of_error = spectra(error)
    segments = int(np.count_nonzero(late) - _SEGMENT // 2) // (_SEGMENT // 2)
    return Spectra(hz, of_error, spectra(record.wind_ned_mps[late])[1], segments)


def settings_of(world: str, laws: str) -> Settings:
    """The hover test with RTK."""
    return resolve("hover", "rtk", world=world, laws=laws)


def coherence(cross: NDArray[np.complex128]) -> Array:
    """Magnitude-squared coherence (3, 3, f)."""
    own = np.real(np.einsum("iif->if", cross))
    return np.asarray(np.abs(cross) ** 2 / (own[:, None] * own[None]))


def hover_row(place: Place[Spectra]) -> dict[str, Any]:
    """Mean coherence over the band, pair by pair, and what independent axes have by chance."""
    first = place.flights[0]
    band = (first.hz >= BAND_HZ[0]) & (first.hz <= BAND_HZ[1])
    n = sum(f.segments for f in place.flights) * 0.5  # overlapping by half: not all are new

    def means(crosses: Sequence[NDArray[np.complex128]]) -> list[float]:
        gamma = coherence(np.sum(crosses, axis=0))[:, :, band]
        return [float(gamma[i, j].mean()) for i, j in PAIRS]

    return {
        **place.point,
        "velocity": means([f.error for f in place.flights]),
        "wind": means([f.wind for f in place.flights]),
        "chance_mean": 1.0 / n,
        "chance_95": 1.0 - 0.05 ** (1.0 / (n - 1.0)) if n > 1.0 else math.nan,
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the tables show."""
    rows = [hover_row(place) for place in flown.places(options)]
    steps = [
        {"world": world, "laws": laws, "level": level.name, **answer(still(world, laws), level)}
        for world in WORLDS
        for level in LEVELS
        for laws in (LAWS if level is LEVELS[2] else LAWS[:1])
    ]
    winds = {name: conditions(settings_of(name, LAWS[0])).splitlines() for name in WORLDS}
    return {
        "axes": AXES, "seeds": options.seeds, "band_hz": BAND_HZ, "from_s": FROM_S,
        "conditions": winds, "steps": steps, "hover": rows,
    }  # fmt: skip


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "coupling",
    "./heli python -m evidence.experiments.coupling --seeds 1..10",
    "Cross-responses, lags and coherence of X, Y and Z in hover.",
    tuple(range(1, 11)),
)


@table("coupling")
def coupling(results: Results) -> str:
    """Steps, then hover."""
    record = results["coupling"]
    axes = record["axes"]
    head = ["commanded with", "world"]
    head += [f"{a} moves {b}, %" for a in axes for b in axes if a != b]
    head += [f"lag {a}, s" for a in axes]
    rows = []
    for step in record["steps"]:
        laws = "" if step["level"] != LEVELS[2].name else f", {step['laws']}"
        shares = step["shares"]
        level = step["level"].replace("law", "controller")
        rows.append(
            [
                f"{level}{laws}",
                step["world"],
                *(f"{100 * shares[i][j]:.0f}" for i in range(3) for j in range(3) if i != j),
                *(f"{lag:.2f}" for lag in step["lag_s"]),
            ]
        )
    pairs = [f"{axes[i]}{axes[j]}" for i, j in PAIRS]
    hover_head = [
        "world",
        "controller",
        *(f"velocity {p}" for p in pairs),
        *(f"wind {p}" for p in pairs),
    ]
    hover = [
        [r["world"], r["laws"], *(f"{c:.2f}" for c in [*r["velocity"], *r["wind"]])]
        for r in record["hover"]
    ]
    low, high = record["band_hz"]
    by_chance = record["hover"][0]
    return (
        f"{grid(head, rows)}\n\n{grid(hover_head, hover)}\n\n"
        "Steps: peak of the other axis's velocity in percent of the commanded one's, in still air, "
        "nominal aircraft; no controller: actuators held but for d_lon, d_lat, d_col, over 1 s; "
        "attitude controller: theta, phi, collective, over 2 s; whole loop: 1 m/s, over 5 s. Lag: "
        "until the commanded axis has half of its largest acceleration. Hover: mean "
        f"magnitude-squared coherence from {low:g} to {high:g} Hz, from {record['from_s']:g} s on, "
        f"truth, {results.seeds('coupling')}; independent axes have {by_chance['chance_mean']:.2f} "
        "in the "
        f"mean and stay below {by_chance['chance_95']:.2f} at 95 % of the frequencies. "
        f"{world({k: [v] for k, v in record['conditions'].items()})}"
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..10"))
