# SPDX-License-Identifier: Apache-2.0
"""scripts/uv_install.py: uv gets what pip's configuration says; what uv is told itself counts."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "scripts/uv_install.py"
SHOW = '#!/usr/bin/env bash\nprintf "%s\\n" "$*"\nenv | grep -E "^(UV_|SSL_|HTTPS?_PROXY)" | sort\n'
CONFIGURATION = """
[global]
index-url = https://mirror.example/simple
timeout = 7
[install]
extra-index-url =
    https://one.example/simple
    https://two.example/simple
find-links = /wheels/a /wheels/b
trusted-host = mirror.example
"""


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("uv_install", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def install(tmp_path):
    """Run the script with an uv that shows what it was given; pip's configuration is a file."""
    (tmp_path / "pip.conf").write_text(CONFIGURATION)
    (tmp_path / "uv").write_text(SHOW)
    (tmp_path / "uv").chmod(0o755)

    def run(**settings):
        env = {"PATH": os.environ["PATH"], "PIP_CONFIG_FILE": str(tmp_path / "pip.conf")}
        env |= {"HOME": str(tmp_path)} | settings
        env = {name: value for name, value in env.items() if value}
        done = subprocess.run(
            [sys.executable, SCRIPT, tmp_path / "uv", "-r", "some.txt"],
            env=env,
            capture_output=True,
            text=True,
            timeout=60,
        )
        assert done.returncode == 0, done.stderr
        first, *lines = done.stdout.splitlines()
        return first, dict(line.split("=", 1) for line in lines)

    return run


def test_pips_file_reaches_uv(install):
    arguments, variables = install()
    assert arguments.split() == ["pip", "install", "-r", "some.txt"]
    assert variables["UV_DEFAULT_INDEX"] == "https://mirror.example/simple"
    assert variables["UV_INDEX"] == "https://one.example/simple https://two.example/simple"
    assert variables["UV_INDEX_STRATEGY"] == "unsafe-best-match"
    assert variables["UV_FIND_LINKS"] == "/wheels/a,/wheels/b"
    assert variables["UV_INSECURE_HOST"] == "mirror.example"
    assert variables["UV_HTTP_TIMEOUT"] == "7"


def test_pips_variables_count_more_than_its_file(install):
    arguments, variables = install(
        PIP_INDEX_URL="https://mine.example/simple", PIP_NO_INDEX="1", PIP_PROXY="http://p:3128"
    )
    assert arguments.split() == ["pip", "install", "--no-index", "-r", "some.txt"]
    assert variables["UV_DEFAULT_INDEX"] == "https://mine.example/simple"
    assert variables["HTTP_PROXY"] == variables["HTTPS_PROXY"] == "http://p:3128"


@pytest.mark.parametrize("name", ["UV_DEFAULT_INDEX", "UV_INDEX_URL"])
def test_uvs_own_variables_count_most(install, name):
    _, variables = install(**{name: "https://uv.example/simple"})
    indexes = {variables.get(key) for key in ("UV_DEFAULT_INDEX", "UV_INDEX_URL")} - {None}
    assert indexes == {"https://uv.example/simple"}


def test_without_a_home_that_can_be_written_there_is_no_cache(install, tmp_path):
    (tmp_path / "file").touch()
    for home in (str(tmp_path / "file"), "/dev/null"):
        assert install(HOME=home)[1]["UV_NO_CACHE"] == "1"
    assert "UV_NO_CACHE" not in install(HOME="/dev/null", UV_CACHE_DIR=str(tmp_path / "mine"))[1]
    assert "UV_NO_CACHE" not in install()[1]


def test_a_pip_that_says_nothing_changes_nothing(script):
    assert script.pip_options("") == {}
    assert script.uv_variables({}) == {} and script.uv_arguments({}) == []
