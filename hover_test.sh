#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Flies the hover test; makes the environment first if it is missing. Options: ./hover_test.sh --help
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
heli_setup_env
heli_start hover_test "$@"
