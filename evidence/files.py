# SPDX-License-Identifier: Apache-2.0
"""Result files: made by a command, with what is needed to make them again, and compared."""

import json
import math
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from evidence.registry import Producer
from heli_core.errors import FlightError
from heli_flight.result import versions

FOLDER = "docs/results"
_WIDTH = 160
# Below this a number is rounding: residuals, differences of equal things.
_ABSOLUTE = 1e-9
# What decides the last digits of a number besides the code.
_MACHINE = ("processor", "versions")


def checkout() -> Path:
    """Top folder of the checkout that this stands in."""
    return Path(__file__).resolve().parents[1]


class NotMadeError(FlightError):
    """A result file does not exist; the message says how to make it.

    Attributes
    ----------
    name : str
        Of its producer.
    """

    def __init__(self, name: str) -> None:
        super().__init__(f"{FOLDER}/{name}.json is missing; make it: ./heli results make {name}")
        self.name = name


def path_of(root: Path, name: str) -> Path:
    """Result file of a producer."""
    return root / FOLDER / f"{name}.json"


def read(root: Path, name: str) -> dict[str, Any]:
    """Content of a result file.

    Raises
    ------
    NotMadeError
        There is none.
    """
    path = path_of(root, name)
    if not path.is_file():
        raise NotMadeError(name)
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return content


class Results:
    """Result files that a table reads; remembers which."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.read: dict[str, dict[str, Any]] = {}

    def __getitem__(self, name: str) -> Any:
        """What the command of a result file found."""
        content = self.read.setdefault(name, read(self.root, name))
        return content["found"]

    def seeds(self, name: str) -> str:
        """Seeds of a result file in words."""
        seeds = self.read.setdefault(name, read(self.root, name))["seeds"]
        if len(seeds) > 1 and seeds == list(range(seeds[0], seeds[-1] + 1)):
            return f"seeds {seeds[0]} to {seeds[-1]}"
        return "seed" + "s" * (len(seeds) > 1) + " " + ", ".join(map(str, seeds))


def write(root: Path, name: str, content: Mapping[str, Any]) -> Path:
    """Write a result file: rows that fit stand in one line each."""
    path = path_of(root, name)
    path.write_text(_text(content, "") + "\n", encoding="utf-8")
    return path


def _text(value: Any, indent: str) -> str:
    line = json.dumps(value, ensure_ascii=False, allow_nan=False)
    if not isinstance(value, (dict, list)) or len(indent) + len(line) <= _WIDTH and indent:
        return line
    inner = indent + "  "
    if isinstance(value, dict):
        parts = [f"{json.dumps(key)}: {_text(item, inner)}" for key, item in value.items()]
    else:
        parts = [_text(item, inner) for item in value]
    opened, closed = "{}" if isinstance(value, dict) else "[]"
    return opened + "\n" + ",\n".join(inner + part for part in parts) + f"\n{indent}{closed}"


def make(root: Path, producer: Producer) -> dict[str, Any]:
    """Run a producer's command; returns the content of its file, which is not written.

    One thread of linear algebra: more cost time here, and change last digits.

    Raises
    ------
    FlightError
        The command failed, or did not print JSON.
    """
    env = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONWARNINGS": "ignore"}
    done = subprocess.run(
        _argv(root, producer.command), cwd=root, env=env, stdout=subprocess.PIPE, text=True
    )
    if done.returncode not in (0, 1):
        raise FlightError(f"{producer.name}: {producer.command}: exit code {done.returncode}")
    try:
        results = json.loads(done.stdout)
    except ValueError:
        raise FlightError(f"{producer.name}: {producer.command}: printed no JSON") from None
    return {
        "what": producer.what,
        "command": producer.command,
        "commit": commit(root),
        "seeds": list(producer.seeds),
        "versions": versions(),
        "processor": processor(),
        "load": round(os.getloadavg()[0], 1),
        "found": results,
    }


def _argv(root: Path, command: str) -> list[str]:
    """The command with this environment's Python: no set-up in between."""
    _, *words = shlex.split(command)
    if words[0] == "python":
        return [sys.executable, *words[1:]]
    return [sys.executable, "-m", "heli_flight.cli.app", *words]


def commit(root: Path) -> str:
    """The commit that is checked out, with "-dirty" if what computes has been changed since."""

    def git(*words: str) -> str:
        done = subprocess.run(["git", "-C", root, *words], capture_output=True, text=True)
        return done.stdout.strip()

    folders = ("benchmarks", "evidence", "scripts", "requirements", "src")
    changed = git("status", "--porcelain", "--", *folders, ":!*.md")
    return (git("rev-parse", "HEAD") or "unknown") + ("-dirty" if changed else "")


def refuse_changes(root: Path) -> None:
    """Refuse to make a file that could not name the code which made it.

    Raises
    ------
    FlightError
        What computes has been changed since the last commit.
    """
    if commit(root).endswith("-dirty"):
        raise FlightError(
            "results: benchmarks, evidence, scripts, requirements or src are changed; commit them "
            "first, so that a result file can name what made it"
        )


def processor() -> dict[str, Any]:
    """Name of the processor, and what numba compiles for and OpenBLAS is told to compute for.

    Not told, OpenBLAS chooses by the processor; its last bits then are others.
    """
    from numba.core.registry import cpu_target

    compiled_for = cpu_target.target_context.codegen().magic_tuple()[1]
    return {
        "name": _processor_name(),
        "compiled_for": compiled_for,
        "blas": os.environ.get("OPENBLAS_CORETYPE", "by itself"),
        "cores": os.cpu_count(),
    }


def _processor_name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(models, platform.processor() or platform.machine())


def differences(
    stored: Mapping[str, Any], made: Mapping[str, Any], producer: Producer
) -> list[str]:
    """Where a fresh run says something else than the file; empty if nowhere.

    Bit for bit with the same kind of processor and the same versions, else within the producer's
    tolerance.
    """
    same = all(stored.get(key) == made.get(key) for key in _MACHINE)
    relative = 0.0 if same else producer.relative
    return list(_differing("", stored["found"], made["found"], relative, producer.loose))


def _differing(
    where: str, old: Any, new: Any, relative: float, loose: Mapping[str, float]
) -> Iterator[str]:
    if isinstance(old, dict) and isinstance(new, dict) and old.keys() == new.keys():
        for key in old:
            allowed = loose.get(key, relative)
            yield from _differing(f"{where}.{key}", old[key], new[key], allowed, loose)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for i, (a, b) in enumerate(zip(old, new, strict=True)):
            yield from _differing(f"{where}[{i}]", a, b, relative, loose)
    elif not _equal(old, new, relative):
        yield f"{where.lstrip('.')}: {old} in the file, {new} anew"


def _equal(old: Any, new: Any, relative: float) -> bool:
    numbers = isinstance(old, (int, float)) and isinstance(new, (int, float))
    if not numbers or isinstance(old, bool) or isinstance(new, bool):
        return bool(old == new)
    absolute = _ABSOLUTE if relative else 0.0
    return math.isclose(old, new, rel_tol=relative, abs_tol=absolute)
