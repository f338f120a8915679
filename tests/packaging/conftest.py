# SPDX-License-Identifier: Apache-2.0
"""A checkout to set up, for the tests of scripts/setup_env.sh."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TOOLS = (
    "bash cat chmod cp cut dirname env flock grep mkdir mktemp mv readlink rm rmdir "
    "sha256sum sort tail true"
).split()

# Answers like a Python that works, and writes down what it was asked to do.
RECORDING_PYTHON = """#!/usr/bin/env bash
first_line="${*%%$'\\n'*}"
echo "$first_line" >>"$CALLS"
case "$first_line" in
    "-c import sys") echo 3.11 ;;
    "-c import rclpy") exit "${RCLPY_MISSING:-0}" ;;
    "-m venv "*) mkdir -p "${!#}/bin"; cp "$0" "${!#}/bin/python" ;;
    "-m pip --version") exit "${PIP_MISSING:-0}" ;;
    "-m pip "*" --target "*)
        [ -z "${UV_MISSING:-}" ] || { echo "ERROR: No matching distribution: uv"; exit 1; }
        uv=${!#}/bin/uv; mkdir -p "${uv%/uv}"; : >"$uv"; chmod +x "$uv" ;;
    "-m pip "*) echo "${PIP_SAYS:-}"; exit "${PIP_FAILS:-0}" ;;
    */uv_install.py*) [ -z "${UV_FAILS:-}" ] || { echo "$UV_FAILS"; exit 1; } ;;
esac
"""


class Checkout:
    """A copy of what set-up reads, with an empty home and a PATH that holds no Python."""

    limit_s = 150
    uv_failed = "uv cannot do it "
    """Begins the line that names what uv said."""
    base_python = os.path.realpath(sys.executable)
    """An interpreter that is not itself an environment with ROS's start-up hook."""

    def __init__(self, top: Path) -> None:
        self.top = top
        for name in ("scripts", "requirements"):
            shutil.copytree(ROOT / name, top / name, ignore=shutil.ignore_patterns("__pycache__"))
        results = top / "docs/results"
        results.mkdir(parents=True)
        for name in ("setup", "setup_size"):
            shutil.copy2(ROOT / f"docs/results/{name}.json", results)
        for name in ("heli", "hover_test.sh", "run_tests.sh"):
            shutil.copy2(ROOT / name, top / name)
        for setup in (ROOT / "src").glob("*/setup.py"):
            package = top / "src" / setup.parent.name
            package.mkdir(parents=True)
            shutil.copy2(setup, package)
            shutil.copy2(setup.with_name("package.xml"), package)
        bin_folder = top.parent / "bin"
        bin_folder.mkdir()
        for tool in TOOLS:
            (bin_folder / tool).symlink_to(shutil.which(tool))

    def add_command(self, name: str, text: str) -> Path:
        command = self.top.parent / "bin" / name
        command.write_text(text)
        command.chmod(0o755)
        return command

    def add_python(self, more: str = "", name: str = "python3") -> Path:
        """A Python that works, and writes down what it was asked to do; `more` ends its script."""
        return self.add_command(name, RECORDING_PYTHON + more)

    def environment(self, **extra: str) -> dict[str, str]:
        folders = {"HOME": str(self.top.parent), "TMPDIR": str(self.top.parent)}
        return {
            "PATH": str(self.top.parent / "bin"),
            "CALLS": str(self.top.parent / "calls"),
            "PIP_CONFIG_FILE": os.devnull,
            **folders,
            **extra,
        }

    def start(self, script: str = "hover_test.sh", *words: str, **extra: str):
        return subprocess.run(
            [self.top / script, *words],
            env=self.environment(**extra),
            capture_output=True,
            text=True,
            timeout=self.limit_s,
            stdin=subprocess.DEVNULL,
        )

    def calls(self) -> list[str]:
        """What the recording Python was asked to do since the last look."""
        log = self.top.parent / "calls"
        lines = log.read_text().splitlines() if log.exists() else []
        log.unlink(missing_ok=True)
        return [line for line in lines if not line.startswith(("-c", "-m pip --version"))]

    def kinds_of_calls(self) -> list[str]:
        return self.kinds(self.calls())

    @staticmethod
    def kinds(asked: list[str]) -> list[str]:
        """What each call was about, in a word."""
        words = {
            "-m venv": "venv",
            "--target": "uv_from_pip",
            "uv_install.py": "uv",
            "-m ensurepip": "ensurepip",
            "-m pip": "pip",
            "link_ros_layout.py": "links",
            "graph.warm_up": "kernels",
            "heli_flight.start": "flight",
        }
        return [next((k for word, k in words.items() if word in line), line) for line in asked]

    @staticmethod
    def one_line_error(result, *words: str) -> None:
        assert result.returncode == 2, result.stderr
        progress = ("Setting up ", Checkout.uv_failed)
        errors = [line for line in result.stderr.splitlines() if not line.startswith(progress)]
        assert len(errors) == 1, result.stderr
        assert errors[0].startswith("error: ")
        for word in words:
            assert word in errors[0]


@pytest.fixture
def checkout(tmp_path):
    return Checkout(tmp_path / "checkout")
