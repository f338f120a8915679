# SPDX-License-Identifier: Apache-2.0
"""Each package names its public face, and the face is true and light."""

import importlib
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = sorted(path.parent.name for path in (ROOT / "src").glob("*/package.xml"))


@pytest.mark.parametrize("package", PACKAGES)
def test_every_name_of_the_face_is_there_and_described(package):
    module = importlib.import_module(package)
    assert module.__doc__
    assert module.__all__
    assert len(set(module.__all__)) == len(module.__all__)
    for name in module.__all__:
        found = getattr(module, name)
        if inspect.isclass(found) or callable(found) or inspect.ismodule(found):
            assert inspect.getdoc(found), f"{package}.{name}"
    assert set(module.__all__) <= set(dir(module))


@pytest.mark.parametrize("package", PACKAGES)
def test_a_name_means_the_same_before_and_after_its_module_is_loaded(package):
    """A function would be hidden by a module of its name as soon as that is imported."""
    modules = sorted(path.stem for path in (ROOT / "src" / package / package).glob("*.py"))
    own = [name for name in modules if name not in ("__init__", "node", "launching")]
    code = (
        f"import importlib, {package} as p\n"
        "before = {name: getattr(p, name) for name in p.__all__}\n"
        f"for name in {own}: importlib.import_module(f'{package}.{{name}}')\n"
        "print([name for name in p.__all__ if getattr(p, name) is not before[name]])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.stdout.strip(), done.returncode) == ("[]", 0), done.stderr


@pytest.mark.parametrize("package", PACKAGES)
def test_an_unknown_name_is_an_attribute_error(package):
    with pytest.raises(AttributeError, match="juggle"):
        importlib.import_module(package).juggle  # noqa: B018


def test_importing_packages_loads_nothing_heavy():
    light = [package for package in PACKAGES if package != "heli_identification"]
    code = f"import sys, {', '.join(light)}\n"
    code += (
        "print([m for m in ('numpy', 'numba', 'scipy', 'rclpy', 'control') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
