# SPDX-License-Identifier: Apache-2.0
"""scripts/setup_env.sh: wheels by uv or by pip, and what it says when neither can get them."""

import socket
import subprocess
import sys
import zipfile
from hashlib import sha256
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NO_UV = "ERROR: No matching distribution: uv"
"""What the recording Python answers where the index has no uv."""


def test_no_network(checkout):
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))  # nobody listens: connections are refused
        index = f"http://127.0.0.1:{closed.getsockname()[1]}/simple"
        result = checkout.start(PYTHON=checkout.base_python, PIP_INDEX_URL=index)
    checkout.one_line_error(result, "package index cannot be reached", "no network")
    assert not (checkout.top / ".venv").exists()


def test_failure_of_uv_and_pip_is_one_line_and_is_redone(checkout):
    checkout.add_python()
    reason = "no such version"
    result = checkout.start(UV_FAILS=reason, PIP_FAILS="1")
    checkout.one_line_error(result, "pip")
    assert f"{checkout.uv_failed}({reason})" in result.stderr
    assert not (checkout.top / ".venv").exists()
    checkout.calls()
    assert checkout.start().returncode == 0
    assert checkout.kinds_of_calls()[:3] == ["venv", "uv_from_pip", "uv"]


def test_without_uv_on_the_index_pip_goes_on_and_says_so(checkout):
    checkout.add_python()
    result = checkout.start(UV_MISSING="1")
    assert result.returncode == 0
    (line,) = (ln for ln in result.stderr.splitlines() if ln.startswith(checkout.uv_failed))
    assert f"({NO_UV})" in line
    assert checkout.kinds_of_calls()[:4] == ["venv", "uv_from_pip", "pip", "links"]


def test_without_network_pip_is_not_tried_as_well(checkout):
    checkout.add_python()
    result = checkout.start(UV_FAILS="error sending request for url")
    checkout.one_line_error(result, "package index cannot be reached", "no network")
    assert "pip" not in checkout.kinds_of_calls()


def test_python_without_pip_gets_uv_by_the_environments_pip(checkout):
    """As Debian's python3 is without python3-pip."""
    checkout.add_python()
    assert checkout.start(PIP_MISSING="1").returncode == 0
    assert checkout.kinds_of_calls()[:4] == ["venv", "ensurepip", "uv_from_pip", "uv"]


def test_uv_on_the_path_is_used(checkout):
    checkout.add_python()
    uv = checkout.add_command("uv", "#!/usr/bin/env bash\n")
    assert checkout.start().returncode == 0
    asked = checkout.calls()
    assert checkout.kinds(asked)[:3] == ["venv", "uv", "links"]
    assert f"uv_install.py {uv} --python {checkout.top}/.venv/bin/python " in asked[1]


def test_uv_that_does_not_run_is_passed_over(checkout):
    checkout.add_python()
    checkout.add_command("uv", "#!/usr/bin/env bash\nexit 1\n")
    assert checkout.start().returncode == 0
    assert checkout.kinds_of_calls()[:3] == ["venv", "uv_from_pip", "uv"]


UV_SAYS = "  cause: Hash mismatch for `toolz==1.2.0`"
PIP_SAYS = """\
ERROR: THESE PACKAGES DO NOT MATCH THE HASHES FROM THE REQUIREMENTS FILE. If you have
    toolz==1.2.0 from https://example.org/toolz-1.2.0-py3-none-any.whl (from -r x):"""


def test_another_file_than_the_known_one_ends_set_up(checkout):
    """Found by uv: pip is not tried, which would bring it from elsewhere perhaps."""
    checkout.add_python()
    result = checkout.start(UV_FAILS=UV_SAYS)
    checkout.one_line_error(result, "toolz==1.2.0 is not the file that requirements/hashes knows")
    assert "pip" not in checkout.kinds_of_calls() and not (checkout.top / ".venv").exists()


def test_another_file_is_named_by_pip_too(checkout):
    checkout.add_python()
    result = checkout.start(UV_MISSING="1", PIP_SAYS=PIP_SAYS, PIP_FAILS="1")
    checkout.one_line_error(result, "toolz==1.2.0 is not the file that requirements/hashes knows")


def test_a_tampered_wheel_is_not_installed(tmp_path):
    """By the real pip, which has nothing but a folder to look in."""
    wheel = tmp_path / "toolz-1.2.0-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as file:
        file.writestr("toolz/__init__.py", "raise SystemExit")
        file.writestr("toolz-1.2.0.dist-info/METADATA", "Name: toolz\nVersion: 1.2.0\n")
        file.writestr("toolz-1.2.0.dist-info/WHEEL", "Wheel-Version: 1.0\nTag: py3-none-any\n")
        file.writestr("toolz-1.2.0.dist-info/RECORD", "")
    lines = (ROOT / "requirements/hashes/flight.txt").read_text().splitlines(keepends=True)
    first = next(i for i, line in enumerate(lines) if line.startswith("toolz=="))
    last = next(i for i in range(first, len(lines)) if not lines[i].endswith("\\\n"))
    wanted = tmp_path / "wanted.txt"
    wanted.write_text("".join(lines[first : last + 1]))
    command = [sys.executable, "-m", "pip", "install", "--no-index", "--find-links", str(tmp_path)]
    command += ["--target", str(tmp_path / "there"), "--no-deps", "--require-hashes"]

    def install():
        return subprocess.run([*command, "-r", wanted], capture_output=True, text=True)

    done = install()
    assert done.returncode, done.stdout
    assert not (tmp_path / "there" / "toolz").exists()
    # It is the hash that keeps it out: by its own it would come in.
    wanted.write_text(f"toolz==1.2.0 --hash=sha256:{sha256(wheel.read_bytes()).hexdigest()}\n")
    done = install()
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "there" / "toolz").exists()
