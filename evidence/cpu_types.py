# SPDX-License-Identifier: Apache-2.0
"""What differs between processors of one architecture, as environments that imitate them.

Four pieces of code choose their instructions at run time: OpenBLAS (inside numpy's and scipy's
wheels), numba's compiler, the C library's mathematics, NumPy's own loops. Each has a variable that
takes the choice away. Imported by `sweep_cpu_types` and `experiments.cpu_types`.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

BLAS, THREADS = "OPENBLAS_CORETYPE", "OPENBLAS_NUM_THREADS"
COMPILER, LIBM, LOOPS = "NUMBA_CPU_NAME", "GLIBC_TUNABLES", "NPY_DISABLE_CPU_FEATURES"
# What a caller may have set; a combination begins without.
CHOICES = (BLAS, THREADS, COMPILER, "NUMBA_CPU_FEATURES", LIBM, LOOPS, "NPY_ENABLE_CPU_FEATURES")
WITHOUT_FMA = "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4"
# NumPy's names of what it dispatches to beyond its baseline (x86-64-v2).
BEYOND_V2 = ("X86_V3", "X86_V4", "AVX512_ICL", "AVX512_SPR")
NATIVE = "native"

# Printed by a process that has the environment: what each piece has really chosen.
PROBE = """
import json
import llvmlite.binding
import numba
import scipy.linalg
from numpy.lib.introspect import opt_func_info
from threadpoolctl import threadpool_info
blas = [row for row in threadpool_info() if row["user_api"] == "blas"]
print(json.dumps({
    "blas": "/".join(sorted({row["architecture"] for row in blas})),
    "threads": max(row["num_threads"] for row in blas),
    "compiler": numba.config.CPU_NAME or llvmlite.binding.get_host_cpu_name(),
    "loops": opt_func_info(func_name="^cos$", signature="float64")["cos"]["dd"]["current"],
}))
"""


class CpuTypeError(Exception):
    """This processor or installation cannot do what was asked; one sentence."""


@dataclass(frozen=True)
class Combination:
    """One imitated processor.

    Attributes
    ----------
    name : str
    env : mapping
        Variables that imitate it.
    needs : tuple of str
        Flags of /proc/cpuinfo without which it cannot be imitated.
    blas : tuple of str
        Architectures that OpenBLAS may report for it (some names stand for the same kernels); any
        if there are none.
    """

    name: str
    env: Mapping[str, str] = field(default_factory=dict)
    needs: tuple[str, ...] = ()
    blas: tuple[str, ...] = ()

    @property
    def whole_env(self) -> dict[str, str]:
        """Environment of a process: the caller's without its own choices, and one BLAS thread."""
        kept = {name: value for name, value in os.environ.items() if name not in CHOICES}
        return {**kept, THREADS: "1", **self.env}


@dataclass(frozen=True)
class Effective:
    """What the pieces have chosen under an environment."""

    blas: str
    threads: int
    compiler: str
    libm: str
    loops: str


_AVX512 = ("avx512f", "avx512bw", "avx512dq", "avx512vl", "avx512cd")
# Another processor with AVX2 and FMA (x86-64-v3) flies the same numbers under this environment.
SAME_ON_V3 = {BLAS: "Haswell", LOOPS: " ".join(BEYOND_V2[1:])}
# The same for everything down to x86-64-v2.
SAME_ON_V2 = {BLAS: "Nehalem", LIBM: WITHOUT_FMA, LOOPS: " ".join(BEYOND_V2)}


def combinations() -> list[Combination]:
    """One factor at a time from native, and one corner in which all of them differ at once.

    The factors are separate pieces of code that round differently; a check that survives each of
    them and all together does not depend on a pair of them. So the product is not needed.
    """
    loops = {LOOPS: " ".join(_loops_found())}
    return [
        Combination(NATIVE),
        Combination("2 BLAS threads", {THREADS: "2"}),
        Combination("SkylakeX", {BLAS: "SkylakeX"}, _AVX512, ("SkylakeX",)),
        Combination("Haswell", {BLAS: "Haswell"}, ("avx2", "fma"), ("Haswell",)),
        Combination("Zen", {BLAS: "Zen"}, ("avx2", "fma"), ("Zen", "Haswell")),
        Combination("Nehalem", {BLAS: "Nehalem"}, ("sse4_2",), ("Nehalem",)),
        Combination("Prescott", {BLAS: "Prescott"}, ("pni",), ("Prescott", "Katmai")),
        Combination("numba generic", {COMPILER: "generic"}),
        Combination("libm without FMA", {LIBM: WITHOUT_FMA}, ("fma",)),
        Combination("NumPy baseline", loops, ("avx2",)),
        Combination(
            "all of the oldest",
            {BLAS: "Prescott", THREADS: "2", COMPILER: "generic", LIBM: WITHOUT_FMA, **loops},
            ("avx2", "fma"),
            ("Prescott", "Katmai"),
        ),
    ]


def chosen(names: Iterable[str], among: Sequence[Combination]) -> list[Combination]:
    """Combinations by name, all if there are no names.

    Raises
    ------
    CpuTypeError
        A name that is none of them.
    """
    wanted = list(names)
    rows = {combination.name: combination for combination in among}
    for name in wanted:
        if name not in rows:
            raise CpuTypeError(f"{name!r} is none of {', '.join(rows)}")
    return [rows[name] for name in wanted or rows]


def _loops_found() -> list[str]:
    """What NumPy found beyond its baseline; where there is nothing it leaves the key out."""
    return np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])


def cpu_flags() -> frozenset[str]:
    """What the processor can, as /proc/cpuinfo names it; empty where there are no such names."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return frozenset()
    row = next((line for line in lines if line.startswith("flags")), "")
    return frozenset(row.partition(":")[2].split())


def cpu_name() -> str:
    """Family of the processor, as numba's compiler names it."""
    from llvmlite import binding

    return binding.get_host_cpu_name()


def effective(combination: Combination) -> Effective:
    """Ask a process with the environment what its libraries have chosen.

    Raises
    ------
    CpuTypeError
        The processor lacks what is to be imitated, or OpenBLAS has chosen something else.
    """
    lacking = [flag for flag in combination.needs if flag not in cpu_flags()]
    if lacking:
        raise CpuTypeError(f"this processor has no {' '.join(lacking)}")
    done = subprocess.run(
        [sys.executable, "-c", PROBE], env=combination.whole_env, capture_output=True, text=True
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no words"])[-1]
        raise CpuTypeError(f"cannot be asked what it chose: {last}")
    libm = "without FMA" if LIBM in combination.env or "fma" not in cpu_flags() else "with FMA"
    types = Effective(libm=libm, **json.loads(done.stdout.splitlines()[-1]))
    if combination.blas and types.blas not in combination.blas:
        raise CpuTypeError(f"OpenBLAS has chosen {types.blas}")
    return types
