# SPDX-License-Identifier: Apache-2.0
"""Fly the same flights as other processors would, and say by how much they differ.

Usage: ./heli python -m evidence.experiments.cpu_types [--seeds 1..5] [--only NAME] [--json]

Hover and attitude test, both receivers, one process, 60 s. Each combination of `cpu_types.py`
is compared with this processor as it is. Then two environments that take the choice away: where
qemu-x86_64 (Debian: qemu-user) is installed, an emulated older processor flies under each, and must
give this processor's numbers under the same, bit for bit.

Exit code 0: done, and emulated processors agree; 1: one of them does not; 2: bad input.
"""

import argparse
import json
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from evidence.cpu_types import (
    NATIVE,
    SAME_ON_V2,
    SAME_ON_V3,
    Combination,
    CpuTypeError,
    chosen,
    combinations,
    cpu_name,
    effective,
)
from evidence.files import Results
from evidence.options import parser_with_seeds
from evidence.registry import NOT_COMPARED, produces, table
from evidence.tables import grid
from heli_core.ticks import TICK_S

ROOT = Path(__file__).resolve().parents[2]
PROGRAMS = ("hover", "attitude")
RECEIVERS = ("standalone", "rtk")
# Environment, and the processor that qemu imitates for it.
FIXED = {
    "fixed to x86-64-v3": (SAME_ON_V3, "Haswell-v1"),
    "fixed to x86-64-v2": (SAME_ON_V2, "Nehalem"),
}
_POSITION, _QUATERNION = "truth_pos_ned_m", "truth_q_nb"


@dataclass(frozen=True)
class Row:
    """What one combination changes.

    Attributes
    ----------
    name, against : str
        Combination, and the one it is compared with.
    numbers, differing : int
        How many numbers were recorded, of all flights, and how many of them differ in any bit.
    same_ticks : int
        For how long no flight has a number that differs.
    position_m, position_end_m : float
        Largest difference of the true position, in flight and at its end.
    attitude_rad : float
        Largest rotation between the true attitudes.
    why_not : str
        Why it was not flown; empty if it was.
    """

    name: str
    against: str
    numbers: int = 0
    differing: int = 0
    same_ticks: int = 0
    position_m: float = 0.0
    position_end_m: float = 0.0
    attitude_rad: float = 0.0
    why_not: str = ""


def fly(seeds: Sequence[int], path: Path) -> None:
    """Fly everything in this process and write what was recorded, with this processor's name."""
    from heli_flight.loop import simulate
    from heli_flight.settings import resolve

    arrays: dict[str, Any] = {}
    for program in PROGRAMS:
        for receiver in RECEIVERS:
            for seed in seeds:
                record = simulate(resolve(program, receiver, seed)).record
                for item in fields(record):
                    value = getattr(record, item.name)
                    if value is not None:
                        arrays[f"{program}/{receiver}/{seed}/{item.name}"] = np.asarray(value)
    np.savez(path, processor=np.array(cpu_name()), **arrays)


def flown(combination: Combination, seeds: Sequence[int], path: Path, before: Sequence[str] = ()):
    """The arrays of `fly` in a process of its own, under an emulator if `before` names one.

    Raises
    ------
    CpuTypeError
        It could not fly; the process's last line.
    """
    command = [*before, sys.executable, "-m", "evidence.experiments.cpu_types"]
    command += ["--seeds", ",".join(map(str, seeds))]
    done = subprocess.run(
        [*command, "--fly", str(path)],
        cwd=ROOT,
        env=combination.whole_env,
        capture_output=True,
        text=True,
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"code {done.returncode}"])[-1]
        raise CpuTypeError(f"cannot fly: {last}")
    with np.load(path) as content:
        return dict(content)


def compare(name: str, against: str, one: Mapping[str, Any], other: Mapping[str, Any]) -> Row:
    """How far two sets of flights are apart."""
    numbers, differing, same, position, end, attitude = 0, 0, [], [0.0], [0.0], [0.0]
    for key in (key for key in one if "/" in key):
        a, b = one[key], other[key]
        numbers += a.size
        unequal = (a != b).reshape(len(a), -1)
        differing += int(unequal.sum())
        same.append(int(np.append(np.flatnonzero(unequal.any(axis=1)), len(a))[0]))
        if key.endswith(_POSITION):
            distance = np.linalg.norm(a - b, axis=1)
            position.append(float(distance.max()))
            end.append(float(distance[-1]))
        elif key.endswith(_QUATERNION):
            # |q_a - q_b| = 2 sin(angle / 4), and the angle is tiny.
            attitude.append(2.0 * float(np.linalg.norm(a - b, axis=1).max()))
    sizes = max(position), max(end), max(attitude)
    return Row(name, against, numbers, differing, min(same), *sizes)


def emulated(name: str, seeds: Sequence[int], here: Mapping[str, Any], folder: Path) -> Row:
    """An emulated processor against this one, both with the choice taken away."""
    env, model = FIXED[name]
    label = f"emulated {model.partition('-')[0]}, {name}"
    qemu = shutil.which("qemu-x86_64")
    if qemu is None:
        return Row(label, name, why_not="needs qemu-x86_64 (Debian: qemu-user)")
    # Compiled for any processor, and here: compiling in the emulator takes minutes.
    combination = Combination(name, {**env, "NUMBA_CPU_NAME": "generic"})
    flown(combination, seeds[:1], folder / "compiled.npz")
    there = flown(combination, seeds, folder / "there.npz", [qemu, "-cpu", model])
    if str(there["processor"]) == cpu_name():
        raise CpuTypeError(f"{label}: this processor itself has flown")
    return compare(label, name, here, there)


def measure(
    wanted: Sequence[Combination], seeds: Sequence[int], say: Callable[[str], None]
) -> list[Row]:
    """All rows: every combination against native, then the emulated processors."""
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        say(NATIVE)
        native = flown(Combination(NATIVE), seeds, folder / "native.npz")
        for combination in (c for c in wanted if c.name != NATIVE):
            say(combination.name)
            try:
                effective(combination)
                arrays = flown(combination, seeds, folder / "one.npz")
            except CpuTypeError as error:
                rows.append(Row(combination.name, NATIVE, why_not=str(error)))
                continue
            rows.append(compare(combination.name, NATIVE, native, arrays))
            if combination.name in FIXED:
                say(f"emulated, {combination.name}")
                few = seeds[:1]
                rows.append(emulated(combination.name, few, _of_seeds(arrays, few), folder))
    return rows


def _of_seeds(arrays: Mapping[str, Any], seeds: Sequence[int]) -> dict[str, Any]:
    return {
        key: value
        for key, value in arrays.items()
        if "/" not in key or int(key.split("/")[2]) in seeds
    }


def print_table(rows: Sequence[Row]) -> None:
    """The rows as Markdown."""
    print("| combination | compared with | numbers that differ | same for, ticks | position, m "
          "| at the end, m | attitude, rad |")  # fmt: skip
    print("|---|---|---|---|---|---|---|")
    for row in rows:
        sizes = (row.position_m, row.position_end_m, row.attitude_rad)
        cells = [f"{row.differing} of {row.numbers}", str(row.same_ticks)]
        cells += [f"{size:.1g}" for size in sizes]
        if row.why_not:
            cells = [row.why_not, *[""] * 4]
        print(f"| {' | '.join((row.name, row.against, *cells))} |")


def main() -> int:
    """Measure; 0 done, 1 an emulated processor flew other numbers, 2 bad input."""
    parser = parser_with_seeds(__doc__, "1..5")
    parser.add_argument("--only", action="append", default=[], metavar="NAME", help="combination")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument("--fly", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    errors = Console(stderr=True, highlight=False, soft_wrap=True)
    if options.fly:
        fly(options.seeds, options.fly)
        return 0
    every = [*combinations(), *(Combination(name, env) for name, (env, _) in FIXED.items())]
    try:
        rows = measure(chosen(options.only, every), options.seeds, errors.print)
    except CpuTypeError as error:
        errors.print(str(error))
        return 2
    if options.json:
        fixed = {name: env for name, (env, _) in FIXED.items()}
        libc = " ".join(platform.libc_ver())
        content = {"libc": libc, "tick_s": TICK_S, "fixed": fixed}
        print(json.dumps({**content, "rows": [asdict(row) for row in rows]}))
    else:
        print_table(rows)
    return int(any(row.against in FIXED and row.differing for row in rows))


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "cpu_types",
    "./heli python -m evidence.experiments.cpu_types --seeds 1..5 --json",
    "The same flights as other processors fly them.",
    tuple(range(1, 6)),
    # What rounding makes of rounding: a number of each kind of processor.
    loose={
        key: NOT_COMPARED
        for key in (
            "differing",
            "same_ticks",
            "position_m",
            "position_end_m",
            "attitude_rad",
        )
    },
)


@table("cpu_types")
def cpu_types(results: Results) -> str:
    """How far the same flights of two processors are apart."""
    record = results["cpu_types"]
    rows = []
    for row in record["rows"]:
        if row["why_not"]:
            rows.append([row["name"], row["against"], row["why_not"], "", "", "", ""])
            continue
        sizes = (row["position_m"], row["position_end_m"], row["attitude_rad"])
        rows.append(
            [
                row["name"],
                row["against"],
                f"{row['differing']} of {row['numbers']}",
                f"{row['same_ticks'] * record['tick_s']:g} s",
                *(f"{size:.0e}" if size else "0" for size in sizes),
            ]
        )
    head = ["changed", "compared with", "recorded numbers that differ", "none differs for"]
    head += ["position, m, largest", "at the end", "attitude, rad"]
    return (
        f"{grid(head, rows)}\n\nHover and attitude test, both receivers, 60 s, one process, "
        f"{results.seeds('cpu_types')} (emulated: the first); {record['libc']}."
    )


if __name__ == "__main__":
    sys.exit(main())
