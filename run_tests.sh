#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs every check: lint, format, types, import contracts, tests (on all cores). Arguments go to pytest, which then runs
# in one process (./run_tests.sh src/heli_observer -k bias). --help: tells what it does, and sets nothing up.
set -euo pipefail
shopt -s lastpipe
trap 'echo interrupted >&2; exit 130' INT
self=${BASH_SOURCE[0]}
[ ! -L "$self" ] || readlink -f -- "$self" | read -r self
[[ $self == */* ]] || self=./$self
cd -P -- "${self%/*}/"
HELI_ROOT=$PWD
cd -- "$OLDPWD"
# shellcheck source=scripts/setup_env.sh
source "$HELI_ROOT/scripts/setup_env.sh"

if [ "${1:-}" = --help ]; then
    heli_result setup_size test_disk_mb && test_disk=$heli_number
    heli_result setup_size test_mb
    cat <<END
Usage: ./run_tests.sh [ARGUMENTS OF PYTEST]

  Run every check: ruff (lint, format), mypy, import contracts, then pytest.

  Without arguments all tests run, on all cores, but of the slow ones a tenth,
  another one after each commit. With arguments pytest has one process and gets
  them:

    ./run_tests.sh src/heli_observer -k bias    one package, tests with that word
    ./run_tests.sh tests/flight -x              one folder, until the first failure
    ./run_tests.sh -m slow                      the slow ones, all of them
    ./run_tests.sh -m nightly                   the long forms

  What pytest itself takes: ./heli python -m pytest --help

  exit code: 0 all passed, another one of the first check that failed

Set-up, once: $(heli_told_costs).
The test tools add $heli_number MB to download, $test_disk MB of disk.
END
    exit 0
fi
heli_setup_env test

if [ $# = 0 ]; then
    cd -- "$HELI_ROOT"
    # Of the slow tests a tenth, another one after each commit; `-m slow` runs all.
    HELI_SLOW_TENTH=$(($(git rev-list --count HEAD 2>/dev/null || echo 0) % 10))
    export HELI_SLOW_TENTH
    # A file's tests share what its fixtures have flown, so a file stays in one process. One process more than cores:
    # tests of the graph wait for each other's nodes a fifth of their time.
    set -- -n "$(($(nproc) + 1))" --dist loadfile --no-loadscope-reorder
fi
"$HELI_PYTHON" -m ruff check "$HELI_ROOT"
"$HELI_PYTHON" -m ruff format --check "$HELI_ROOT"
# Types are checked against the pinned numpy; where ROS is sourced there is the system's.
[ "$heli_mode" = ros ] || (cd -- "$HELI_ROOT" && "$HELI_PYTHON" -m mypy)
(cd -- "$HELI_ROOT" && "$HELI_PYTHON" -c "from importlinter.cli import lint_imports_command; lint_imports_command()" --no-logo --no-cache)
exec "$HELI_PYTHON" -m pytest --rootdir="$HELI_ROOT" --config-file="$HELI_ROOT/pyproject.toml" "$@"
