# SPDX-License-Identifier: Apache-2.0
"""A copy of the tree in which a recipe of CONTRIBUTING is performed, as a contributor would."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.caching import _CacheLocator

from heli_core.jit import cache_root

ROOT = Path(__file__).resolve().parents[2]
COPIED = ("src", "tests", "scripts", "benchmarks", "requirements", "docs")
FILES = ("pyproject.toml", "conftest.py", "README.md", "CONTRIBUTING.md", "LICENSE")
PYTHON_FOLDER = f"lib/python{sys.version_info.major}.{sys.version_info.minor}/site-packages"


class Copy:
    """A copy of the tree with a prefix of its own, in which its packages are linked."""

    def __init__(self, top: Path, prefix: Path) -> None:
        self.top, self.prefix = top, prefix
        self.variables: dict[str, str] = {}

    def path(self, name: str) -> Path:
        return self.top / name

    def write(self, name: str, text: str) -> None:
        path = self.path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def replace(self, name: str, old: str, new: str) -> None:
        """Change one place of a file; it must be there, once."""
        text = self.path(name).read_text(encoding="utf-8")
        assert text.count(old) == 1, f"{name}: {text.count(old)} places of {old!r}"
        self.write(name, text.replace(old, new))

    def link(self) -> None:
        """What set-up does with the packages."""
        site = self.prefix / PYTHON_FOLDER
        site.mkdir(parents=True, exist_ok=True)
        script = self.path("scripts/link_ros_layout.py")
        self.run(script, "--prefix", self.prefix, "--site-packages", site)

    def lend_kernels(self) -> None:
        """Let the copy load what is compiled of sources that it has unchanged.

        numba keeps the kernels of a folder of sources in one that is named after its path.
        """
        cache = self.prefix / "cache"
        self.variables["HELI_KERNEL_CACHE"] = str(cache)
        named = _CacheLocator.get_suitable_cache_subpath
        modules = [file.relative_to(ROOT) for file in ROOT.glob("src/*/heli*/**/*.py")]
        theirs = {named(str(ROOT / file)): named(str(self.top / file)) for file in modules}
        for folder in cache_root().glob("*/*"):
            if folder.name in theirs:
                sources = cache / "heli_hover/kernels" / folder.parent.name
                sources.mkdir(parents=True, exist_ok=True)
                (sources / theirs[folder.name]).symlink_to(folder)

    def run(self, *words, code: int | None = 0, limit_s: float = 580.0):
        """Run the interpreter on the copy's packages; the exit code is checked unless None."""
        packages = [str(path.parent) for path in self.top.glob("src/*/setup.py")]
        packages.append(str(self.top / "tests"))
        env = {
            **os.environ,
            **self.variables,
            "PYTHONPATH": os.pathsep.join(packages),
            "AMENT_PREFIX_PATH": str(self.prefix),
        }
        command = [sys.executable, *map(str, words)]
        done = subprocess.run(
            command, cwd=self.top, env=env, capture_output=True, text=True, timeout=limit_s
        )
        assert code is None or done.returncode == code, done.stdout + done.stderr
        return done

    def packaging(self, *words, code: int | None = 0):
        """Tests of tests/packaging in the copy."""
        names = [f"tests/packaging/{word}" if word.endswith(".py") else word for word in words]
        return self.run("-m", "pytest", "-q", "-p", "no:cacheprovider", *names, code=code)


@pytest.fixture
def copy(tmp_path):
    """The tree as it stands, without what grows in it."""
    top = tmp_path / "tree"
    ignored = shutil.ignore_patterns("__pycache__", "*.egg-info", ".*", "recipes", "build")
    for name in COPIED:
        shutil.copytree(ROOT / name, top / name, ignore=ignored)
    for name in FILES:
        shutil.copy2(ROOT / name, top / name)
    return Copy(top, tmp_path / "prefix")
