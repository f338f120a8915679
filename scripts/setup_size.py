# SPDX-License-Identifier: Apache-2.0
"""Add up what set-up downloads: the files of requirements/hashes for this interpreter and machine.

Run it by `./heli python scripts/setup_size.py`. uv asks the index for the sizes of the files that
are pinned; of each package the one is counted that pip and uv would choose here. Needs the network,
and downloads none of the packages.
"""

import json
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from packaging.markers import Marker
from packaging.tags import Tag, sys_tags
from packaging.utils import parse_wheel_filename

from heli_flight.errors import FlightError

LISTS = Path(__file__).resolve().parents[1] / "requirements" / "hashes"
NAMES = ("flight", "uv", "test")


def locked(pins: Path) -> Sequence[Mapping[str, Any]]:
    """Packages of a list with hashes, with the files that the index has of them.

    Raises
    ------
    FlightError
        There is no uv, or it cannot look them up.
    """
    own = Path(sys.prefix) / "heli_uv" / "bin" / "uv"
    uv = str(own) if own.is_file() else shutil.which("uv")
    if not uv:
        raise FlightError("there is no uv")
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    command = [uv, "pip", "compile", "--no-deps", "--no-header", "--format", "pylock.toml"]
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
        ranks = [tags[tag] for tag in parse_wheel_filename(name)[3] if tag in tags]
        if ranks:
            ranked.append((min(ranks), wheel["size"]))
    if ranked:
        return int(min(ranked)[1])
    return int(package["sdist"]["size"])


def measure(folder: Path = LISTS) -> dict[str, Any]:
    """MB that set-up downloads for flying, for uv, and for the test tools, and files of each."""
    tags = {tag: rank for rank, tag in enumerate(sys_tags())}
    found: dict[str, Any] = {}
    for name in NAMES:
        sizes = [chosen_bytes(package, tags) for package in locked(folder / f"{name}.txt")]
        found[f"{name}_mb"] = round(sum(sizes) / 1e6)
        found[f"{name}_files"] = sum(size > 0 for size in sizes)
    return {"download_mb": found["flight_mb"] + found["uv_mb"], **found}


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
