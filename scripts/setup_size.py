# SPDX-License-Identifier: Apache-2.0
"""Add up what set-up downloads and what it takes of the disk, for this interpreter and machine.

Run it by `./heli python scripts/setup_size.py`. uv asks the index for the sizes of the files that
requirements/hashes pins; of each package the one is counted that pip and uv would choose here. Then
it installs them into a temporary environment, as set-up does, and counts the disk's blocks.
"""

import json
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from packaging.markers import Marker
from packaging.tags import Tag, sys_tags
from packaging.utils import parse_wheel_filename

from heli_core.errors import FlightError

LISTS = Path(__file__).resolve().parents[1] / "requirements" / "hashes"
NAMES = ("flight", "uv", "test")


def uv() -> str:
    """The uv that set-up has brought, or the one on PATH.

    Raises
    ------
    FlightError
        There is none.
    """
    own = Path(sys.prefix) / "heli_uv" / "bin" / "uv"
    found = str(own) if own.is_file() else shutil.which("uv")
    if not found:
        raise FlightError("there is no uv")
    return found


def locked(pins: Path) -> Sequence[Mapping[str, Any]]:
    """Packages of a list with hashes, with the files that the index has of them.

    Raises
    ------
    FlightError
        There is no uv, or it cannot look them up.
    """
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    command = [uv(), "pip", "compile", "--no-deps", "--no-header", "--format", "pylock.toml"]
    command += ["--python-version", version, "--quiet", str(pins)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise FlightError(f"uv: {done.stderr.strip()}")
    return tomllib.loads(done.stdout).get("packages", [])


def chosen_bytes(package: Mapping[str, Any], tags: Mapping[Tag, int]) -> int:
    """Size of the file of a package that would be installed; 0 where its marker excludes it.

    Parameters
    ----------
    package : mapping
        Of a pylock.toml.
    tags : mapping of Tag to rank
        What this interpreter can install, the best first.
    """
    if "marker" in package and not Marker(package["marker"]).evaluate():
        return 0
    ranked = []
    for wheel in package.get("wheels", ()):
        name = wheel.get("name") or wheel["url"].rpartition("/")[2]
        *_, offered = parse_wheel_filename(name)
        ranks = [tags[tag] for tag in offered if tag in tags]
        if ranks:
            ranked.append((min(ranks), wheel["size"]))
    if ranked:
        return int(min(ranked)[1])
    return int(package["sdist"]["size"])


def run(command: Sequence[str]) -> None:
    """Run a command, whose output matters only if it fails.

    Raises
    ------
    FlightError
    """
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise FlightError(f"{' '.join(command)}: {done.stderr.strip()}")


def disk_mb(folder: Path) -> float:
    """What the files of a folder take of the disk, MB."""
    files = [folder] if folder.is_file() else folder.rglob("*")
    found = (path.lstat() for path in files if path.is_symlink() or not path.is_dir())
    return sum(512 * status.st_blocks for status in found) / 1e6


def installed_mb(folder: Path = LISTS) -> dict[str, int]:
    """MB of the disk of an environment for flying, with uv; and how much the test tools add."""
    scripts = Path(__file__).resolve().parent
    with tempfile.TemporaryDirectory(prefix="heli_setup_size.") as name:
        made, sizes = Path(name, "venv"), {}
        run([sys.executable, "-m", "venv", "--without-pip", str(made)])
        for kind in ("flight", "test"):
            command = [sys.executable, str(scripts / "uv_install.py"), uv()]
            command += ["--python", str(made / "bin/python"), "--no-deps", "--require-hashes"]
            run([*command, "-r", str(folder / f"{kind}.txt")])
            sizes[kind] = disk_mb(made)
    return {
        "disk_mb": round(sizes["flight"] + disk_mb(Path(uv()))),
        "test_disk_mb": round(sizes["test"] - sizes["flight"]),
    }


def measure(folder: Path = LISTS) -> dict[str, Any]:
    """MB that set-up downloads for flying, for uv, and for the test tools, and files of each."""
    tags = {tag: rank for rank, tag in enumerate(sys_tags())}
    found: dict[str, Any] = {}
    for name in NAMES:
        sizes = [chosen_bytes(package, tags) for package in locked(folder / f"{name}.txt")]
        found[f"{name}_mb"] = round(sum(sizes) / 1e6)
        found[f"{name}_files"] = sum(size > 0 for size in sizes)
    return {"download_mb": found["flight_mb"] + found["uv_mb"], **found, **installed_mb(folder)}


def main() -> int:
    """Returns the exit code."""
    try:
        found = measure()
    except FlightError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(json.dumps(found, indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
