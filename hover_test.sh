#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Flies the hover test; makes the environment first if it is missing. Options: ./hover_test.sh --help
set -euo pipefail

HELI_ROOT=$(cd -- "$(dirname -- "$(readlink -f -- "${BASH_SOURCE[0]}")")" && pwd)
# shellcheck source=scripts/setup_env.sh
source "$HELI_ROOT/scripts/setup_env.sh"
trap 'echo interrupted >&2; exit 130' INT  # not before: while a file is read, bash mistakes a trap's text for part of it
heli_setup_env
heli_start hover_test "$@"
