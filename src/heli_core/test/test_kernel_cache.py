# SPDX-License-Identifier: Apache-2.0
"""A change of any source that a kernel depends on starts a fresh cache; other changes do not."""

import os
import shutil
import subprocess
import sys

import pytest

from heli_core import folders, jit

KERNEL = """from heli_core.jit import njit
from {constants} import FACTOR


@njit
def scaled(x):
    return FACTOR * x
"""


@pytest.fixture
def tree(tmp_path):
    """A package with a kernel in a subfolder, a constant elsewhere, and a bystander."""
    for folder in ("probe_pkg", "probe_pkg/deep", "heli_probe"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "__init__.py").write_text("")
    (tmp_path / "heli_probe/constants.py").write_text("FACTOR = 2.0\n")
    (tmp_path / "probe_pkg/bystander.py").write_text("X = 1\n")
    kernel = KERNEL.format(constants="heli_probe.constants")
    (tmp_path / "probe_pkg/deep/kernel.py").write_text(kernel)
    return tmp_path


def call(tree, module="probe_pkg.deep.kernel", name="scaled"):
    """Value of the kernel at 3 and whether it came from the cache, in a fresh process."""
    code = (
        f"from {module} import {name} as f\ny = f(3.0)\nprint(y, sum(f.stats.cache_hits.values()))"
    )
    env = {**os.environ, "PYTHONPATH": str(tree), jit.KERNEL_CACHE: str(tree / "cache")}
    env.pop("NUMBA_CACHE_DIR", None)
    # Python itself takes a change within a second, of the same length, for none.
    env["PYTHONDONTWRITEBYTECODE"] = "1"
    done = subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True
    )
    value, hits = done.stdout.split()
    return float(value), int(hits)


def test_a_kernel_comes_from_the_cache_the_second_time(tree):
    assert call(tree) == (6.0, 0)
    assert call(tree) == (6.0, 1)


def test_whether_it_is_compiled_is_a_question_of_this_source_file(tree, tmp_path):
    """The same sources in another folder share the digest, and nothing else."""

    def waits(top):
        code = (
            "from heli_core.jit import is_compiled; from probe_pkg.deep.kernel import scaled; "
            "print(is_compiled(scaled))"
        )
        env = {**os.environ, "PYTHONPATH": str(top), jit.KERNEL_CACHE: str(tree / "cache")}
        env.pop("NUMBA_CACHE_DIR", None)
        done = subprocess.run(
            [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True
        )
        return done.stdout.strip() == "True"

    twin = tmp_path / "twin"
    for name in ("probe_pkg", "heli_probe"):
        shutil.copytree(tree / name, twin / name)
    assert not waits(tree)
    call(tree)
    assert waits(tree) and not waits(twin)


def test_a_changed_constant_of_another_package_is_compiled_in(tree):
    call(tree)
    (tree / "heli_probe/constants.py").write_text("FACTOR = 5.0\n")
    assert call(tree) == (15.0, 0)


def test_a_moved_kernel_does_not_run_stale(tree):
    """Moved into a subfolder of a subfolder: its callees' changes still count."""
    assert call(tree) == (6.0, 0)
    deeper = tree / "probe_pkg/deep/deeper"
    deeper.mkdir()
    (deeper / "__init__.py").write_text("")
    (tree / "probe_pkg/deep/kernel.py").rename(deeper / "kernel.py")
    assert call(tree, "probe_pkg.deep.deeper.kernel") == (6.0, 0)
    (tree / "heli_probe/constants.py").write_text("FACTOR = 7.0\n")
    assert call(tree, "probe_pkg.deep.deeper.kernel") == (21.0, 0)


def test_a_file_that_no_kernel_imports_leaves_the_cache_alone(tree):
    call(tree)
    (tree / "probe_pkg/bystander.py").write_text("X = 2\n")
    assert call(tree) == (6.0, 1)


@pytest.mark.parametrize(
    "statement",
    [
        "from heli_probe.constants import FACTOR",
        "from heli_probe import constants",
        "from heli_probe import (\n    constants,  # a remark\n)",
        "import heli_probe.constants as c",
        "from .deep import kernel",
        "def f():\n    from heli_probe import constants",
    ],
)
def test_imports_of_every_form_are_followed(tree, monkeypatch, statement):
    monkeypatch.syspath_prepend(str(tree))
    jit._file_of.cache_clear()
    path = tree / "probe_pkg/user.py"
    path.write_text(statement + "\n")
    assert "heli_probe.constants" in jit._sources("probe_pkg.user", path)


def test_third_party_imports_are_not_followed(tree):
    path = tree / "probe_pkg/user.py"
    path.write_text("import numpy as np\nfrom scipy import signal\n")
    assert set(jit._sources("probe_pkg.user", path)) == {"probe_pkg.user"}


@pytest.fixture
def places(tmp_path, monkeypatch):
    """An environment (its `environment`), and a home that can be written to (its `home`)."""
    for name in ("environment", "home", "temporary"):
        (tmp_path / name).mkdir()
    monkeypatch.setattr(jit.sys, "prefix", str(tmp_path / "environment"))
    monkeypatch.setattr(folders.tempfile, "tempdir", str(tmp_path / "temporary"))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for name in ("XDG_CACHE_HOME", jit.KERNEL_CACHE):
        monkeypatch.delenv(name, raising=False)
    return tmp_path


def chosen(places):
    """The part of the cache's path that tells whose it is."""
    return jit.cache_root.__wrapped__().relative_to(places).parts[0]


HOMES = ["", "nowhere/at all", "/dev/null", "/proc", "/proc/nowhere", "a\nline", None]


@pytest.mark.parametrize("variable", ["HOME", "XDG_CACHE_HOME"])
@pytest.mark.parametrize("value", HOMES)
def test_an_environment_keeps_its_kernels_whatever_home_is(places, monkeypatch, variable, value):
    if value is None:
        monkeypatch.delenv(variable, raising=False)
    else:
        monkeypatch.setenv(variable, value)
    assert chosen(places) == "environment"


@pytest.mark.parametrize(
    "value", ["", "nowhere/at all", "/dev/null", "/proc", "/proc/nowhere", None]
)
def test_without_an_environment_or_a_usable_home_the_temporary_folder_serves(
    places, monkeypatch, value
):
    monkeypatch.setattr(jit.sys, "prefix", jit.sys.base_prefix)
    assert chosen(places) == "home"
    monkeypatch.setenv("XDG_CACHE_HOME", str(places / "home of xdg"))
    assert chosen(places) == "home of xdg"
    for variable in ("HOME", "XDG_CACHE_HOME"):
        if value is None:
            monkeypatch.delenv(variable, raising=False)
        else:
            monkeypatch.setenv(variable, value)
    assert chosen(places) == "temporary"


@pytest.mark.parametrize(("named", "used"), [("named", "named"), ("/dev/null", "environment")])
def test_the_user_names_another_folder(places, monkeypatch, named, used):
    monkeypatch.setenv(jit.KERNEL_CACHE, str(places / named))
    assert chosen(places) == used


def test_an_environment_of_somebody_else_is_left_alone(places, monkeypatch):
    monkeypatch.setattr(jit.sys, "prefix", "/proc")
    assert chosen(places) == "home"
