# SPDX-License-Identifier: Apache-2.0
"""Count the arithmetic of each part of a tick, by flying it with numbers that count; JSON.

Usage: NUMBA_DISABLE_JIT=1 ./heli python -m evidence.counting [LAWS] [TICKS]

The kernels run as plain Python on `Counted` in place of floats: every multiplication, addition,
division and function of `math` that a tick needs is counted where it happens. Plant and sensors,
which no flight computer has, run on floats.
"""

import json
import math
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

KINDS = ("multiply", "add", "divide", "function")
STAGES = ("estimate", "guide", "listen", "control", "command")
_FUNCTIONS = ("sqrt", "sin", "cos", "tan", "atan2", "asin", "acos", "exp", "log", "hypot", "pow")
COUNT = dict.fromkeys(KINDS, 0)


class Counted:
    """A float that counts what is done with it."""

    __slots__ = ("v",)

    def __init__(self, v: Any) -> None:
        self.v = float(v)

    def __float__(self) -> float:
        return self.v

    def __int__(self) -> int:
        return int(self.v)

    def __bool__(self) -> bool:
        return bool(self.v)

    def __hash__(self) -> int:
        return hash(self.v)

    def __neg__(self) -> "Counted":
        return Counted(-self.v)

    def __abs__(self) -> "Counted":
        return Counted(abs(self.v))


def _operator(kind: str, work: Callable[[float, float], float], turned: bool) -> Any:
    def operator(self: Counted, other: Any) -> Counted:
        COUNT[kind] += 1
        a, b = self.v, float(other)
        return Counted(work(b, a) if turned else work(a, b))

    return operator


def _comparison(work: Callable[[float, float], bool]) -> Any:
    return lambda self, other: work(self.v, float(other))


for _name, _kind, _work in (
    ("mul", "multiply", lambda a, b: a * b),
    ("add", "add", lambda a, b: a + b),
    ("sub", "add", lambda a, b: a - b),
    ("truediv", "divide", lambda a, b: a / b),
    ("mod", "divide", lambda a, b: a % b),
    ("floordiv", "divide", lambda a, b: a // b),
    ("pow", "multiply", lambda a, b: a**b),
):
    setattr(Counted, f"__{_name}__", _operator(_kind, _work, False))
    setattr(Counted, f"__r{_name}__", _operator(_kind, _work, True))
for _name, _holds in (
    ("lt", lambda a, b: a < b),
    ("le", lambda a, b: a <= b),
    ("gt", lambda a, b: a > b),
    ("ge", lambda a, b: a >= b),
    ("eq", lambda a, b: a == b),
    ("ne", lambda a, b: a != b),
):
    setattr(Counted, f"__{_name}__", _comparison(_holds))


def counting(numbers: Any) -> Any:
    """The same numbers, arrays and tuples of them, that count; integers and flags as they are."""
    if isinstance(numbers, np.ndarray) and numbers.dtype == np.float64:
        array = np.empty(numbers.shape, dtype=object)
        for place in np.ndindex(numbers.shape):
            array[place] = Counted(numbers[place])
        return array
    if isinstance(numbers, tuple) and hasattr(numbers, "_fields"):
        return type(numbers)(*map(counting, numbers))
    return Counted(numbers) if isinstance(numbers, float) else numbers


class _Empty:
    """numpy, whose `empty` gives scratch for counted numbers while `on`."""

    on = False

    def __getattr__(self, name: str) -> Any:
        return getattr(np, name)

    def empty(self, shape: Any) -> Any:
        """As numpy's."""
        if not self.on:
            return np.empty(shape)
        array = np.empty(shape, dtype=object)
        array[...] = 0.0
        return array


def _count_functions() -> None:
    """Have `math` count, and numpy's tests of finiteness take counted numbers."""

    def counted(work: Callable[..., float]) -> Callable[..., Any]:
        def function(*values: Any) -> Any:
            if not any(isinstance(value, Counted) for value in values):
                return work(*values)
            COUNT["function"] += 1
            return Counted(work(*map(float, values)))

        return function

    def plain(work: Callable[..., Any]) -> Callable[..., Any]:
        def test(x: Any, *more: Any, **options: Any) -> Any:
            return work(np.asarray(x, dtype=float), *more, **options)

        return test

    for name in _FUNCTIONS:
        setattr(math, name, counted(getattr(math, name)))
    for name in ("isfinite", "isnan"):
        setattr(np, name, plain(getattr(np, name)))


def counts(laws: str, ticks: int) -> dict[str, list[dict[str, int]]]:
    """By stage of the tick what each of the first `ticks` ticks of the hover test counts."""
    from heli_core import jit
    from heli_dynamics_sim.noise import NoiseStreams
    from heli_flight import loop as flown
    from heli_flight.settings import resolve

    empty = _Empty()
    vars(jit)["np"] = empty
    settings = resolve("hover", "rtk", laws=laws)
    plain = flown.build(settings)
    noise_rows = NoiseStreams(settings.seed).rows(ticks)
    setpoint, u = map(counting, flown.first_commands(plain, settings))
    way = settings.scenario.reference
    points, truth = counting(way.points.copy()), np.zeros(19)
    _count_functions()
    simulated = {"plant_k", "plant_s", "fallback_k", "fallback_s", "excitation_k", "links"}
    loop = plain._replace(
        **{k: counting(v) for k, v in plain._asdict().items() if k not in simulated}
    )
    found: dict[str, list[dict[str, int]]] = {stage: [] for stage in STAGES}

    def stage(name: str, part: Callable[..., Any], *arguments: Any) -> None:
        before, empty.on = dict(COUNT), True
        part(loop, *arguments)
        empty.on = False
        found[name].append({kind: COUNT[kind] - before[kind] for kind in KINDS})

    for tick in range(ticks):
        flown.sense(plain, tick, noise_rows[tick], truth)
        loop.rows.y[:] = counting(plain.rows.y)
        stage("estimate", flown.estimate_navigation, None, tick, u, truth)
        stage("guide", flown.guide, None, tick, way.times_ns, points, setpoint)
        stage("listen", flown.listen, None, tick, setpoint)
        stage("control", flown.control, tick)
        stage("command", flown.command_actuators, tick, u)
        flown.act(plain, None, tick, np.array(list(map(float, u))))
    return found


def main() -> int:
    """Print the counts."""
    laws, ticks = [*sys.argv[1:], *("packaged", "60")[len(sys.argv) - 1 :]]
    print(json.dumps(counts(laws, int(ticks))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
