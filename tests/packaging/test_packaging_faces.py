# SPDX-License-Identifier: Apache-2.0
"""Each package names its public face, and the face is true and light."""

import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = sorted(path.parent.name for path in (ROOT / "src").glob("*/setup.py"))
# Packages inside of packages that have a face of their own.
INNER = sorted(
    ".".join(path.parent.relative_to(ROOT / "src").parts[1:])
    for path in (ROOT / "src").glob("*/*/*/__init__.py")
    if "face(" in path.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("package", [*PACKAGES, *INNER])
def test_every_name_of_the_face_is_there_and_described(package):
    module = importlib.import_module(package)
    assert module.__doc__
    assert module.__all__
    assert len(set(module.__all__)) == len(module.__all__)
    for name in module.__all__:
        member = getattr(module, name)
        if inspect.isclass(member) or callable(member) or inspect.ismodule(member):
            assert inspect.getdoc(member), f"{package}.{name}"
        # The kernels' cache follows imports from module to module (heli_core.jit): a kernel that is
        # imported by a name of the face would run stale when its source changes.
        assert type(member).__name__ != "CPUDispatcher", f"{package}.{name}"
    assert set(module.__all__) <= set(dir(module))


@pytest.mark.parametrize("package", PACKAGES)
def test_a_name_means_the_same_before_and_after_its_module_is_loaded(package):
    """A function would be hidden by a module of its name as soon as that is imported."""
    modules = sorted(path.stem for path in (ROOT / "src" / package / package).glob("*.py"))
    loaded = [name for name in modules if name not in ("__init__", "node", "launching")]
    code = (
        f"import importlib, {package} as p\n"
        "before = {name: getattr(p, name) for name in p.__all__}\n"
        f"for name in {loaded}: importlib.import_module(f'{package}.{{name}}')\n"
        "print([name for name in p.__all__ if getattr(p, name) is not before[name]])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.stdout.strip(), done.returncode) == ("[]", 0), done.stderr


def section(package, title):
    """Text under a heading of a package's README; empty if there is none of this name."""
    text = (ROOT / "src" / package / "README.md").read_text(encoding="utf-8")
    match = re.search(rf"^## {title}\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
    return match[1] if match else ""


@pytest.mark.parametrize("package", PACKAGES)
def test_the_readme_names_the_face(package):
    """Section "Public names": all of them and no other, each between backticks."""
    named = re.findall(r"`(\w+)`", section(package, "Public names"))
    assert named == sorted(named, key=str.casefold)
    assert set(named) == set(importlib.import_module(package).__all__)


@pytest.mark.parametrize("package", PACKAGES)
def test_the_readme_describes_what_is_there(package):
    """What a bullet of "Design", or a row of its table of modules, begins with, is there."""
    top = ROOT / "src" / package / package
    there = {path.stem for path in top.rglob("*") if "__pycache__" not in path.parts}
    there |= set(importlib.import_module(package).__all__)
    design = section(package, "Design")
    bullets = re.findall(r"^- ((?:`[^`]+`(?:, | and )?)+)", design, re.MULTILINE)
    for table in re.findall(r"^\| (?:module|call) \|.*\n(?:\|.*\n)+", design, re.MULTILINE):
        bullets += [row.split("|")[1] for row in table.splitlines()[2:]]
    named = {re.split(r"[.(/]", name)[0] for name in re.findall(r"`([^`]+)`", " ".join(bullets))}
    assert named - there == set()


@pytest.mark.parametrize("package", PACKAGES)
def test_examples_import_from_the_face(package):
    """Python in a README imports what the package offers."""
    text = (ROOT / "src" / package / "README.md").read_text(encoding="utf-8")
    for module, names in re.findall(r"^ {4}from ([\w.]+) import ([\w, ]+)", text, re.MULTILINE):
        top, *inside = module.split(".")
        face = importlib.import_module(top).__all__
        for name in names.split(", "):
            assert (inside and inside[0] in face) or name in face, f"{module} {name}"


@pytest.mark.parametrize("package", PACKAGES)
def test_an_unknown_name_is_an_attribute_error(package):
    with pytest.raises(AttributeError, match="juggle"):
        importlib.import_module(package).juggle  # noqa: B018


def test_importing_packages_loads_nothing_heavy():
    code = f"import sys, {', '.join(PACKAGES)}\n"
    code += (
        "print([m for m in ('numpy', 'numba', 'scipy', 'rclpy', 'control') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
