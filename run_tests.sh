#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs every check: lint, format, types, import contracts, tests (on all cores). Arguments go to pytest, which then runs
# in one process (./run_tests.sh src/heli_observer -k bias).
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
heli_setup_env test

if [ $# = 0 ]; then
    cd -- "$HELI_ROOT"
    # A file's tests share what its fixtures have flown, so a file stays in one process.
    set -- -n auto --dist loadfile --no-loadscope-reorder
fi
"$HELI_PYTHON" -m ruff check "$HELI_ROOT"
"$HELI_PYTHON" -m ruff format --check "$HELI_ROOT"
(cd -- "$HELI_ROOT" && "$HELI_PYTHON" -m mypy)
(cd -- "$HELI_ROOT" && "$HELI_PYTHON" -c "from importlinter.cli import lint_imports_command; lint_imports_command()" --no-logo --no-cache)
exec "$HELI_PYTHON" -m pytest --rootdir="$HELI_ROOT" --config-file="$HELI_ROOT/pyproject.toml" "$@"
