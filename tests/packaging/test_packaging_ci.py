# SPDX-License-Identifier: Apache-2.0
""".ci/run: keeps the tests' exit code, and is not silent about tests that it could not run."""

import importlib.util
import os
import re
import shutil
import subprocess
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

from support.fuzz_parsers import PARSERS

ROOT = Path(__file__).resolve().parents[2]
PYTEST_SAYS = "==== 812 passed, 3 skipped in 500.00s ===="
TESTS = f"""#!/usr/bin/env bash
echo "{PYTEST_SAYS}"
exit "$TESTS_CODE"
"""
OUT_OF_REACH, NO_PACKAGE = "E: Failed to fetch", "E: Unable to locate package chromium"
SKIPPED = "browser tests were skipped"
APT = """#!/usr/bin/env bash
echo "apt-get $1" >>"$CALLS"
case "$1" in
    update) echo "$OUT_OF_REACH"; exit "$UPDATE_CODE" ;;
    install) echo "$NO_PACKAGE" >&2; exit "$INSTALL_CODE" ;;
esac
"""


@pytest.fixture
def run(tmp_path):
    """Run a copy of .ci/run among fakes; gives the finished process and what apt-get was asked."""
    (tmp_path / ".ci").mkdir()
    shutil.copy2(ROOT / ".ci/run", tmp_path / ".ci/run")
    bin_folder = tmp_path / "bin"
    bin_folder.mkdir()
    for tool in ("bash", "dirname", "env", "mktemp", "rm", "tail"):
        (bin_folder / tool).symlink_to(shutil.which(tool))

    def add(path, text):
        path.write_text(text)
        path.chmod(0o755)

    def start(*commands, tests=0, update=0, install=0, user=0):
        for name in commands:
            add(bin_folder / name, APT if name == "apt-get" else "#!/usr/bin/env bash\n")
        add(bin_folder / "id", f"#!/usr/bin/env bash\necho {user}\n")
        add(tmp_path / "run_tests.sh", TESTS)
        codes = {"TESTS_CODE": tests, "UPDATE_CODE": update, "INSTALL_CODE": install}
        settings = {name: str(code) for name, code in codes.items()}
        folders = {
            "PATH": str(bin_folder),
            "TMPDIR": str(tmp_path),
            "CALLS": str(tmp_path / "calls"),
            "OUT_OF_REACH": OUT_OF_REACH,
            "NO_PACKAGE": NO_PACKAGE,
        }
        done = subprocess.run(
            ["bash", tmp_path / ".ci/run"],
            env=settings | folders,
            cwd=os.sep,
            capture_output=True,
            text=True,
            timeout=60,
        )
        log = tmp_path / "calls"
        return done, log.read_text().splitlines() if log.exists() else []

    return start


@pytest.mark.parametrize("name", ["chromium", "google-chrome-stable"])
def test_with_a_browser_the_tests_have_the_last_word(run, name):
    done, asked = run(name, "apt-get")
    assert (done.returncode, done.stdout) == (0, f"{PYTEST_SAYS}\n")
    assert asked == []


def test_a_missing_browser_is_installed(run):
    done, asked = run("apt-get")
    assert asked == ["apt-get update", "apt-get install"]
    assert (done.returncode, done.stdout) == (0, f"{PYTEST_SAYS}\n")


@pytest.mark.parametrize("tests_code", [0, 1, 5])
def test_packages_out_of_reach_are_told_after_the_tests(run, tests_code):
    done, asked = run("apt-get", update=100, tests=tests_code)
    assert asked == ["apt-get update"]
    lines = done.stdout.splitlines()
    assert lines[0] == PYTEST_SAYS and len(lines) == 2
    assert SKIPPED in lines[1] and OUT_OF_REACH in lines[1]
    assert done.returncode == tests_code


@pytest.mark.parametrize("how", [{"user": 1000}, {}], ids=["no root", "no apt-get"])
def test_no_right_to_install_is_told_after_the_tests(run, how):
    done, asked = run(*(["apt-get"] if how else []), **how)
    assert asked == []
    assert done.returncode == 0
    assert SKIPPED in done.stdout.splitlines()[-1]


def test_packages_in_reach_without_the_browser_are_a_failure(run):
    done, asked = run("apt-get", install=100)
    assert asked == ["apt-get update", "apt-get install"]
    assert done.returncode == 1 and SKIPPED not in done.stdout
    assert "chromium" in done.stderr.replace(NO_PACKAGE, "") and NO_PACKAGE in done.stderr


@pytest.mark.parametrize("tests_code", [1, 2, 5])
def test_the_exit_code_is_that_of_the_tests(run, tests_code):
    """5 is pytest's word for: no test has run."""
    assert run("chromium", tests=tests_code)[0].returncode == tests_code


def test_nothing_stays_behind(run, tmp_path):
    run("apt-get")
    kept = {".ci", "bin", "calls", "run_tests.sh"}
    assert {path.name for path in tmp_path.iterdir()} == kept


@pytest.mark.parametrize("name", ["ci", "nightly", "pages"])
def test_a_workflow_runs_what_there_is(name):
    """They cannot run here: what they call exists, on a Python that set-up takes, and it ends."""
    flow = yaml.safe_load((ROOT / f".github/workflows/{name}.yml").read_text())
    assert flow["permissions"] == {"contents": "read"}
    commands = []
    for job in flow["jobs"].values():
        assert job["timeout-minutes"] <= 360
        steps = job["steps"]
        # A tag may be moved to other code, a commit may not.
        used = [step["uses"] for step in steps if "uses" in step]
        assert all(re.fullmatch(r"actions/[a-z-]+@[0-9a-f]{40}", action) for action in used), used
        commands += [step["run"] for step in steps if "run" in step]
    for command in commands:
        first, *words = command.split()
        assert first in ("bandit", "docker", "pip-audit", "python") or os.access(
            ROOT / first, os.X_OK
        ), command
        files = [word for word in words if word.endswith((".txt", ".py"))]
        assert all((ROOT / file).is_file() for file in files), command
    if name == "nightly":
        assert "./run_tests.sh -m nightly" in commands
        assert any("evidence.experiments.fuzz --cases 10000" in command for command in commands)
        for parser in PARSERS:
            assert any(f"fuzz_atheris.py {parser} " in command for command in commands)
        kinds = ("flight", "test", "uv", "fuzz", "interfaces")
        lists = {f"requirements/hashes/{kind}.txt" for kind in kinds}
        (audit,) = [command for command in commands if command.startswith("pip-audit")]
        assert lists <= set(audit.split()) and "--require-hashes" in audit


def test_the_site_is_published_by_a_job_that_does_nothing_else():
    """What is built strictly is what is uploaded; the right to write is of the last job alone."""
    flow = yaml.safe_load((ROOT / ".github/workflows/pages.yml").read_text())
    # YAML 1.1 reads the key `on` as true.
    assert flow[True]["push"] == {"branches": ["main"]}
    build, deploy = flow["jobs"]["build"], flow["jobs"]["deploy"]
    assert "permissions" not in build and deploy["needs"] == "build"
    assert deploy["permissions"] == {"pages": "write", "id-token": "write"}
    assert deploy["environment"]["name"] == "github-pages"
    (step,) = deploy["steps"]
    assert step["uses"].startswith("actions/deploy-pages@") and step["id"] == "deployment"
    *_, made, upload = build["steps"]
    assert upload["uses"].startswith("actions/upload-pages-artifact@")
    assert made["run"] == f"./heli python scripts/build_docs.py --out {upload['with']['path']}"


def test_the_slow_tests_of_a_file_are_dealt_to_the_tenths_in_turn():
    """So a tenth costs what another does, as far as a file's tests cost alike."""
    spec = importlib.util.spec_from_file_location("of_all_tests", ROOT / "conftest.py")
    conftest = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(conftest)
    names = [f"tests/{file}::{i}" for file in ("a.py", "b.py", "c.py") for i in range(20)]
    dealt = list(conftest.tenths([SimpleNamespace(nodeid=name) for name in names]))
    for first in range(0, len(names), 20):
        assert Counter(dealt[first : first + 20]) == dict.fromkeys(range(10), 2)
    alone = list(conftest.tenths([SimpleNamespace(nodeid=f"tests/{i}.py::a") for i in range(50)]))
    assert len(set(alone)) == 10
