# SPDX-License-Identifier: Apache-2.0
"""Measure set-up: from an empty clone and empty caches to the end of the first flight.

Run it by `./heli python scripts/setup_time.py`. The committed tree is cloned into a temporary
folder, where `./hover_test.sh` finds no environment, no wheel and no compiled kernel. Needs the
network; the times are those of this machine, its load and its way to the package index.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from heli_core.errors import FlightError

ROOT = Path(__file__).resolve().parents[1]
PARTS = ("environment", "uv", "wheels", "packages", "kernels")
# What the environment that runs this script would lend to the set-up in the clone.
_LENT = (
    "AMENT_",
    "COLCON_",
    "HELI_",
    "NUMBA_",
    "OPENBLAS_",
    "PYTHON",
    "RMW_",
    "ROS_",
    "VIRTUAL_ENV",
)
_TOLD = re.compile(r"Set up in (\d+) s: (.*)\.")


def split(said: str) -> dict[str, int]:
    """Seconds of each of `PARTS` in what set-up said; 0 for what was there already.

    Raises
    ------
    FlightError
        Set-up did not say what its time was spent on, or names another part.
    """
    told = _TOLD.search(said)
    if told is None:
        raise FlightError("set-up did not say what its time was spent on: nothing was set up")
    found = {
        name: int(seconds) for name, seconds in re.findall(r"([a-z ]+) (\d+) s(?:, |$)", told[2])
    }
    if not set(found) <= set(PARTS):
        raise FlightError(f"set-up names parts that are unknown here: {told[2]}")
    return {name: found.get(name, 0) for name in PARTS}


def empty_environment(lent: Mapping[str, str], folder: Path) -> dict[str, str]:
    """The user's variables without those of the environment that runs this, with empty caches."""
    own = Path(lent["VIRTUAL_ENV"], "bin") if "VIRTUAL_ENV" in lent else None
    path = [part for part in lent["PATH"].split(os.pathsep) if Path(part) != own]
    kept = {name: value for name, value in lent.items() if not name.startswith(_LENT)}
    caches = {
        "XDG_CACHE_HOME": str(folder / "cache"),
        "UV_CACHE_DIR": str(folder / "uv"),
        "PIP_CACHE_DIR": str(folder / "pip"),
    }
    return kept | caches | {"PATH": os.pathsep.join(path)}


def size_mb(folder: Path) -> float:
    """What the files of a folder hold, MB."""
    sizes = (path.lstat().st_size for path in folder.rglob("*") if path.is_file())
    return sum(sizes) / 1e6


def run(command: list[str], cwd: Path, env: Mapping[str, str]) -> tuple[str, str]:
    """Output and messages of a command; the messages are shown as they come.

    Raises
    ------
    FlightError
        Exit code other than 0 and 1 (a flight outside the paper's figures was flown, too).
    """
    with tempfile.TemporaryFile("w+") as output:
        process = subprocess.Popen(
            command, cwd=cwd, env=env, stdout=output, stderr=subprocess.PIPE, text=True
        )
        assert process.stderr is not None
        said = []
        for line in process.stderr:
            sys.stderr.write(line)
            said.append(line)
        if process.wait() not in (0, 1):
            raise FlightError(f"{' '.join(command)}: exit code {process.returncode}")
        output.seek(0)
        return output.read(), "".join(said)


def measure(root: Path, folder: Path) -> dict[str, Any]:
    """Clone `root` into a folder, set up and fly there; returns what is printed."""
    env = empty_environment(os.environ, folder)
    clone = folder / "clone"
    run(["git", "clone", "--quiet", "--local", str(root), str(clone)], root, env)
    begun = time.monotonic()
    printed, said = run(["./hover_test.sh", "--json", "--out", str(folder / "flight")], clone, env)
    total_s = time.monotonic() - begun
    result = json.loads(printed)
    parts = split(said)
    return {
        "split_s": parts,
        "setup_s": int(_TOLD.findall(said)[0][0]),
        "start_up_s": result["start_up_s"],
        "flown_s": result["flown_s"],
        "flight_s": result["wall_s"],
        "total_s": round(total_s, 1),
        "installed_mb": round(size_mb(clone / ".venv")),
    }


def main() -> int:
    """Returns the exit code."""
    try:
        with tempfile.TemporaryDirectory(prefix="heli_setup_time.") as folder:
            found = measure(ROOT, Path(folder))
    except FlightError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(json.dumps(found, indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
