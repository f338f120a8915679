# SPDX-License-Identifier: Apache-2.0
"""Whether the 100 Hz step fits into the paper's processor, and what short numbers cost; JSON.

Usage: ./heli python -m evidence.experiments.dsp_budget [--seeds 1..5]

The paper flew a TMS320F2812 (section 1): 150 MHz, fixed point, 18 K words of 16 bit of RAM, 128 K
of flash (TI, TMS320F2812 data manual, SPRS174). Operations of each part of a tick are counted by
`evidence.counting`. Flown: the same hover test with every number that observer and controllers keep
from tick to tick, and every parameter, rounded to what such a processor would hold; what is worked
out within a tick is not rounded. Errors are differences to the float64 flight of the same seed.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evidence.counting import KINDS, STAGES
from evidence.files import Results
from evidence.registry import produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid, world
from heli_core.rotations import euler_from_quat
from heli_flight import loop as flown_loop
from heli_flight.loop import AircraftInLoop, build, fly_loop
from heli_flight.record import FlightRecord
from heli_flight.result import conditions
from heli_flight.settings import Settings, resolve

Array = NDArray[np.float64]
LAWS = ("packaged", "paper")
COUNTED_TICKS, STEADY = 60, 20
"""Ticks that are counted, and from which on the filter is aligned."""
MHZ, RATE_HZ = 150.0, 100.0
RAM_WORDS, FLASH_WORDS, WORDS = 18 * 1024, 128 * 1024, 2
"""Of 16 bit, and how many of them a number of 32 bit takes."""
MULTIPLY_ADD_CYCLES = 7
"""Y = M X + B of 32-bit numbers (TI, C28x student guide, "Numerical Concepts and IQmath", 8-21)."""
SPARE = 10
"""The other operations are priced at so many multiply-adds each: an estimate."""
PARTS = {
    "estimate": ("observer_k", "observer_s"),
    "guide": ("outer_k", "outer_s"),
    "listen": ("estimate_k", "estimate_s"),
    "control": ("inner_k", "inner_s"),
}
INNER = ("inner_k", "inner_s")
ALL = tuple(name for pair in PARTS.values() for name in pair)


# -------------------------------------------------------------------------------------------------
# Numbers as a processor would hold them.
# -------------------------------------------------------------------------------------------------


def float32(values: Array) -> Array:
    """The nearest float32."""
    return values.astype(np.float32).astype(np.float64)


def fixed(values: Array, bits: int, fraction: int | None = None) -> Array:
    """The nearest fixed-point number of so many bits, saturated.

    fraction: bits behind the point; None: as many as the largest of the array leaves room for.
    """
    if fraction is None:
        largest = np.abs(values).max(initial=0.0)
        fraction = bits - 1 - int(np.ceil(np.log2(largest))) if largest > 0.0 else bits - 1
    step, most = 2.0**-fraction, 2.0 ** (bits - 1 - fraction)
    return np.clip(np.round(values / step) * step, -most, most - step)


Rounded = Callable[[Array], Array]
NUMBERS: Mapping[str, tuple[tuple[str, ...], Rounded, Rounded]] = {
    "float32 in all loops": (ALL, float32, float32),
    "float32 in the attitude law": (INNER, float32, float32),
    "Q24 of 32 bit in the attitude law": (
        INNER,
        partial(fixed, bits=32, fraction=24),
        partial(fixed, bits=32, fraction=24),
    ),
    "32 bit, a scale for each array, in the attitude law": (
        INNER,
        partial(fixed, bits=32),
        partial(fixed, bits=32),
    ),
    "16-bit gains, 32-bit memory, a scale for each array": (
        INNER,
        partial(fixed, bits=16),
        partial(fixed, bits=32),
    ),
}
"""By name what is rounded, how its parameters are, and how what it remembers is."""


def rounded(numbers: Any, by: Rounded) -> Any:
    """A tuple of parameters with every array of floats rounded; a copy."""
    if isinstance(numbers, np.ndarray):
        return by(numbers) if numbers.dtype == np.float64 and numbers.size else numbers
    if isinstance(numbers, tuple) and hasattr(numbers, "_fields"):
        return type(numbers)(*(rounded(one, by) for one in numbers))
    return numbers


def arrays(numbers: Any) -> list[Array]:
    """Arrays of floats in a tuple of states or parameters."""
    if isinstance(numbers, np.ndarray):
        return [numbers] if numbers.dtype == np.float64 and numbers.size else []
    if isinstance(numbers, tuple):
        return [array for one in numbers for array in arrays(one)]
    return []


def fly_rounded(settings: Settings, name: str) -> FlightRecord:
    """The record of a flight whose numbers are rounded at every tick."""
    what, parameters, memory = NUMBERS[name]
    loop = build(settings)
    loop = loop._replace(
        **{k: rounded(getattr(loop, k), parameters) for k in what if k.endswith("_k")}
    )
    kept = [a for k in what if k.endswith("_s") for a in arrays(getattr(loop, k))]

    def ticks(loop: AircraftInLoop, first: int, n: int, rows: Array, *rest: Any) -> tuple[int, int]:
        for i in range(n):
            # One more is asked for than flown: `fly` ends where the controller has changed its
            # mode.
            flown, status = flown_loop.fly(loop, first + i, 1, rows[i : i + 1], *rest)
            for array in kept:
                array[...] = memory(array)
            if status != 0 or i + 1 == n:
                return i + flown, status
        return n, 0

    return fly_loop(loop, settings, ticks=ticks).record


# -------------------------------------------------------------------------------------------------
# Flown.
# -------------------------------------------------------------------------------------------------


def settings_of(laws: str) -> Settings:
    """The hover test with RTK."""
    return resolve("hover", "rtk", laws=laws)


def attitude_deg(record: FlightRecord) -> Array:
    """True roll, pitch, heading (n, 3), deg."""
    return np.degrees([euler_from_quat(q) for q in record.truth_q_nb])


@over(laws=LAWS, numbers=tuple(NUMBERS))
def flown(laws: str, numbers: str, seed: int) -> dict[str, float]:
    """Largest differences to the float64 flight, over the whole flight."""
    settings = settings_of(laws).with_seed(seed)
    exact, short = fly_loop(build(settings), settings).record, fly_rounded(settings, numbers)
    n = min(len(exact), len(short))
    angle = np.abs(attitude_deg(exact)[:n] - attitude_deg(short)[:n])
    return {
        "attitude_deg": float(np.minimum(angle, 360.0 - angle).max()),
        "position_m": float(np.abs(exact.truth_pos_ned_m[:n] - short.truth_pos_ned_m[:n]).max()),
        "actuator": float(np.abs(exact.u[:n] - short.u[:n]).max()),
        "ended_early": float(len(exact) != len(short)),
    }


def budget(laws: str) -> dict[str, Any]:
    """Operations and numbers of each part of a tick."""
    command = [sys.executable, "-m", "evidence.counting", laws, str(COUNTED_TICKS)]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    counted = json.loads(done.stdout)
    loop = build(settings_of(laws))
    parts = {}
    for stage in STAGES:
        ticks = counted[stage][STEADY:]
        most = max(ticks, key=lambda tick: sum(tick.values()))
        k, s = PARTS.get(stage, ("", ""))
        parts[stage] = {
            "most": most,
            "mean": {kind: float(np.mean([tick[kind] for tick in ticks])) for kind in KINDS},
            "parameters": sum(a.size for a in arrays(getattr(loop, k))) if k else 0,
            "memory": sum(a.size for a in arrays(getattr(loop, s))) if s else 0,
        }
    window = sum(a.size for a in arrays((loop.observer_s.window, loop.observer_s.pair)))
    return {"laws": laws, "parts": parts, "window": window}


def row(place: Place[dict[str, float]]) -> dict[str, Any]:
    """Largest over the flights."""
    keys = place.flights[0]
    return {**place.point, **{key: max(f[key] for f in place.flights) for key in keys}}


def experiment(options: Options) -> dict[str, Any]:
    """All that the tables show."""
    return {
        "budget": [budget(laws) for laws in LAWS],
        "flown": [row(place) for place in flown.places(options)],
        "conditions": conditions(settings_of(LAWS[0])).splitlines(),
    }


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "dsp_budget",
    "./heli python -m evidence.experiments.dsp_budget --seeds 1..5",
    "Operations and memory of a tick beside the paper's processor; flights with short numbers.",
    (1, 2, 3, 4, 5),
)


def _cycles(count: Mapping[str, float]) -> float:
    """What operations cost, cycles, by the prices above: none is taken for free."""
    products, others = count["multiply"], count["divide"] + count["function"]
    return MULTIPLY_ADD_CYCLES * (products + count["add"] + SPARE * others)


@table("dsp_budget")
def dsp_budget(results: Results) -> str:
    """The busiest tick and the mean one, memory, and what was flown."""
    record = results["dsp_budget"]
    available = 1e6 * MHZ / RATE_HZ
    rows = []
    for laws in record["budget"]:
        parts = laws["parts"]
        whole = {
            when: {kind: sum(p[when][kind] for p in parts.values()) for kind in KINDS}
            for when in ("most", "mean")
        }
        parts = parts | {
            "all": whole
            | {key: sum(p[key] for p in parts.values()) for key in ("parameters", "memory")}
        }
        rows += [
            [
                f"{laws['laws']}: {stage}",
                *(f"{part['most'][kind]:.0f}" for kind in KINDS),
                f"{100.0 * _cycles(part['most']) / available:.1f}",
                f"{100.0 * _cycles(part['mean']) / available:.1f}",
                f"{part['parameters'] * WORDS / 1024:.1f}",
                f"{part['memory'] * WORDS / 1024:.1f}",
            ]
            for stage, part in parts.items()
        ]
    head = ["preset: part of a tick", *KINDS, "busiest tick, % of its 10 ms", "mean tick, %"]
    head += ["parameters, K words", "memory, K words"]
    flights = [
        [
            f"{f['laws']}: {f['numbers'].replace('law', 'controller')}",
            f"{f['attitude_deg']:.1g}",
            f"{f['position_m']:.1g}",
            f"{f['actuator']:.1g}",
        ]
        for f in record["flown"]
    ]
    flown_head = ["preset: numbers", "attitude, deg", "position, m", "actuators, of 1"]
    return (
        f"{grid(head, rows)}\n\n{grid(flown_head, flights)}\n\n"
        f"First table: operations of the busiest tick of each part; cycles of {available:.3g} a "
        f"tick ({MHZ:g} MHz, {RATE_HZ:g} Hz), every multiplication and every addition priced as a "
        f"multiply-add of 32 bit, {MULTIPLY_ADD_CYCLES} cycles (TI's IQmath), divisions and "
        f"functions as {SPARE} of them (estimated). Words of 16 bit, {WORDS} a number; the "
        f"processor has {RAM_WORDS // 1024} K of RAM and {FLASH_WORDS // 1024} K of flash "
        f"(SPRS174). Of the memory {record['budget'][0]['window'] * WORDS / 1024:.1f} K are what "
        "the observer keeps to go back in time with: the window of its fault detection and the "
        "filters of two IMUs. Second table: largest difference to the float64 flight of the "
        f"same seed, {results.seeds('dsp_budget')}. {world({'hover test': [record['conditions']]})}"
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..5"))
