# SPDX-License-Identifier: Apache-2.0
"""Large kernels are called by their address: once in memory, and loadable alone from the cache."""

import json
import os
import subprocess
import sys

import pytest

from heli_core import jit

TERMS = "\n".join(f"    y = y * x + math.sin({i}.5 * x)" for i in range(80))
MODULE = f"""import math

import numba
import numpy as np

from heli_core.jit import njit, njit_counted, njit_inlined


@njit
def large(x):
    y = 0.0
{TERMS}
    return y


@njit_inlined
def inlined(x):
    y = 1.0
{TERMS}
    return y


@njit
def small(x):
    return 2.0 * x


@njit
def through(x):
    return large(x) + large(small(x))


@njit
def top(x):
    return through(x) - large(3.0 * x)


@njit
def with_inlined(x):
    return inlined(x) + small(x)


@njit
def plain(x):
    return small(x) + 1.0


@njit_counted
def of_many_types(x):
    # operators of whole numbers, of numbers with a fraction, of truths and of arrays
    n, many = int(10.0 * x), np.full(3, x)
    return n * n / 7 + n // 2 * x + (x > 0.1) * 2 + (n > 1) + (many * 2.0 + many)[1] + n % 2


@numba.njit(cache=True)
def foreign(x):
    return through(x)
"""
PROBE = r"""import json, re, sys
import numpy as np
from heli_core import compile_once
from heli_probe import kernels

OURS = re.compile(r"define[^@]*@_ZN10heli_probe7kernels\d+([a-z_]+?)B")
answer = {}
for name in sys.argv[1:]:
    kernel = getattr(kernels, name)
    value, python = kernel(0.3), kernel.py_func(0.3)
    hits = sum(kernel.stats.cache_hits.values())
    text = "" if hits else kernel.inspect_llvm(kernel.signatures[0])
    defined = sorted(set(OURS.findall(text)))
    answer[name] = {"value": value, "python": python, "hits": hits, "defined": defined}
large = sorted(library._large.name for library in compile_once._loaded.values())
print(json.dumps({"kernels": answer, "large": large}))
"""
CALLED = ("top", "with_inlined", "plain", "of_many_types", "foreign")


@pytest.fixture(scope="module")
def probe(tmp_path_factory):
    """Call kernels by name in a fresh process: what each gave, and the large ones in memory."""
    folder = tmp_path_factory.mktemp("large")
    (folder / "heli_probe").mkdir()
    (folder / "heli_probe/__init__.py").write_text("")
    (folder / "heli_probe/kernels.py").write_text(MODULE)
    env = {**os.environ, "PYTHONPATH": str(folder), jit.KERNEL_CACHE: str(folder / "cache")}
    env.pop("NUMBA_CACHE_DIR", None)

    def call(*names):
        command = [sys.executable, "-c", PROBE, *names]
        done = subprocess.run(command, env=env, capture_output=True, text=True, check=True)
        return json.loads(done.stdout)

    return call


@pytest.fixture(scope="module")
def compiled(probe):
    """The first process, which compiles."""
    return probe(*CALLED)


def test_a_large_kernel_stands_in_no_caller(compiled):
    """But one that is always inlined does, whatever its size."""
    defined = {name: kernel["defined"] for name, kernel in compiled["kernels"].items()}
    assert defined["top"] == ["top"] and defined["foreign"] == ["foreign"]
    assert defined["with_inlined"] == ["with_inlined"]
    assert compiled["large"] == ["large", "of_many_types", "with_inlined"]


def test_compiled_and_from_the_cache_a_kernel_computes_what_python_does(probe, compiled):
    alone, others = probe("top"), probe(*CALLED[1:], "large")
    for found, hits in (compiled, 0), (alone, 1), (others, 1):
        for kernel in found["kernels"].values():
            assert kernel["value"] == kernel["python"] and kernel["hits"] == hits
    assert alone["large"] == ["large"]
    assert others["large"] == compiled["large"], "each is loaded once"
