# SPDX-License-Identifier: Apache-2.0
"""scripts/setup_time.py: a clone of what is committed, empty caches, and what is read of it."""

import importlib.util
import json
import subprocess
from pathlib import Path

import pytest

from evidence import files
from evidence.experiments.setup import setup
from heli_core.errors import FlightError

ROOT = Path(__file__).resolve().parents[2]
SETUP_ENV = (ROOT / "scripts/setup_env.sh").read_text(encoding="utf-8")
SAID = "Set up in 31 s: environment 1 s, uv 2 s, wheels 6 s, packages 0 s, kernels 22 s."
SIZES = {"download_mb": 321, "disk_mb": 987, "test_mb": 65, "test_disk_mb": 43}
FLIGHT = {"start_up_s": 3.2, "flown_s": 60.0, "wall_s": 4.58}
# Stands for the real one: refuses what would make a set-up shorter than a new user's.
HOVER_TEST = f"""#!/usr/bin/env bash
[ -z "${{VIRTUAL_ENV:-}}${{HELI_VENV:-}}${{AMENT_PREFIX_PATH:-}}" ] || exit 3
case "$PATH" in *lent*) exit 4 ;; esac
[ ! -e edited ] && [ ! -e .venv ] || exit 5
for folder in "$XDG_CACHE_HOME" "$UV_CACHE_DIR" "$PIP_CACHE_DIR"; do
    [ -n "$folder" ] && [ ! -e "$folder" ] || exit 6
done
mkdir .venv && head -c 3000000 /dev/zero >.venv/wheel
echo '{SAID}' >&2
echo '{json.dumps(FLIGHT)}'
exit "${{FLIGHT_CODE:-1}}"
"""


@pytest.fixture
def script():
    spec = importlib.util.spec_from_file_location("setup_time", ROOT / "scripts/setup_time.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def measure(script, tmp_path, monkeypatch):
    """`measure` on a small repository, called from within an environment."""
    root, lent = tmp_path / "repository", tmp_path / "lent"
    root.mkdir()
    (root / "hover_test.sh").write_text(HOVER_TEST)
    (root / "hover_test.sh").chmod(0o755)
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "a"]):
        who = ["-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false"]
        subprocess.run(["git", "-C", root, *who, *words], check=True)
    (root / "edited").write_text("")
    monkeypatch.setenv("VIRTUAL_ENV", str(lent))
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(lent))
    monkeypatch.setenv("PATH", str(lent / "bin"), prepend=":")
    folder = tmp_path / "folder"
    folder.mkdir()
    return lambda: script.measure(root, folder)


def test_a_fresh_clone_is_set_up_with_empty_caches(measure):
    times = measure()
    assert times["split_s"] == {
        "environment": 1, "uv": 2, "wheels": 6, "packages": 0, "kernels": 22
    }  # fmt: skip
    assert (times["setup_s"], times["installed_mb"]) == (31, 3)
    assert (times["start_up_s"], times["flown_s"], times["flight_s"]) == (3.2, 60.0, 4.58)
    assert 0.0 <= times["total_s"] < 60.0


def test_a_flight_that_was_not_flown_is_no_result(measure, monkeypatch):
    monkeypatch.setenv("FLIGHT_CODE", "2")
    with pytest.raises(FlightError, match=r"hover_test\.sh .*: exit code 2"):
        measure()


def test_the_parts_are_those_of_set_up(script):
    for part in script.PARTS:
        assert f"heli_mark {part}" in SETUP_ENV
    assert script.split(SAID.replace(" uv 2 s,", ""))["uv"] == 0
    for output in ("", "Set up in 3 s: environment 1 s, test tools 2 s."):
        with pytest.raises(FlightError, match="set-up"):
            script.split(output)


def test_the_sentence_has_every_number(measure, tmp_path):
    (tmp_path / files.FOLDER).mkdir(parents=True)
    content = {"found": measure(), "processor": {"cores": 2}, "load": 0.4}
    content["found"]["total_s"] = 46.7
    files.write(tmp_path, "setup", content)
    files.write(tmp_path, "setup_size", {"found": SIZES})
    text = setup(files.Results(tmp_path))
    for words in ("ends after 47 s on 2 cores (load 0.4)", "31 s of set-up", "kernels 22 s)",
                  "60 s flown in 4.6 s", "takes 987 MB", "downloads 321 MB",
                  "add 65 MB and 43 MB"):  # fmt: skip
        assert words in text
