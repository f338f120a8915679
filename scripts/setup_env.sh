# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Sourced by hover_test.sh, heli and run_tests.sh, which set HELI_ROOT (top of the repository) and lastpipe first.
#
# heli_setup_env [test]   makes what is missing, then points PATH and HELI_PYTHON at it; "test" adds the test tools.
#
#   without ROS             .venv from the pinned wheels, ROS 2 Jazzy among them; packages linked from src/
#   ROS_DISTRO=jazzy        colcon build --symlink-install against that ROS; what apt's ROS lacks comes from .venv-ros,
#                           which sees the system's packages and keeps numpy below 2 (apt's messages are compiled so)
#
# PYTHON     interpreter to make the environment with; default: that of the environment that stands, or the first
#            suitable one of HELI_PYTHONS. Another one than the environment's makes a new environment.
# HELI_VENV  folder of the environment, if it shall not stand in the repository
#
# The wheels are installed from the lists of requirements/hashes, which hold the SHA-256 of every file: another file of
# the same name ends set-up. (What .venv-ros needs besides apt's packages depends on those, and has no such list.)
# They are installed by uv (the one on PATH, or one brought by pip into the environment's folder); by pip where
# uv cannot be had. An environment counts only when its stamp was written, last of all; an interrupted one is thrown
# away and made anew.

# Should Ctrl-C come while bash reads functions or $(...), bash takes the trap's text for a part of them and fails; should
# it come between a pipe's fork and its end, the trap may run twice or lose the child. So there is no trap while this
# file is read, and what runs at every start (not only when something is missing) starts no other process.
trap - INT

HELI_PYTHONS="python3.13 python3.12 python3.11 python3"

heli_fail() {
    printf 'error: %s\n' "$*" >&2
    exit 2
}

# Prints major.minor; exit code 3: older than 3.11, 4: cannot make environments.
heli_probe() {
    "$1" -c 'import sys
if sys.version_info < (3, 11):
    sys.exit(3)
try:
    import ensurepip, venv
except ImportError:
    sys.exit(4)
print("%d.%d" % sys.version_info[:2])' 2>/dev/null
}

# Sets heli_base_python and heli_base_version.
heli_find_python() {
    local candidates candidate code without_venv=""
    read -ra candidates <<<"$HELI_PYTHONS"
    candidates=("$(heli_recorded_python)" "${candidates[@]}")
    [ -z "${PYTHON:-}" ] || candidates=("$PYTHON")
    for candidate in "${candidates[@]}"; do
        command -v "$candidate" >/dev/null 2>&1 || continue
        code=0
        heli_base_version=$(heli_probe "$candidate") || code=$?
        if [ "$code" = 0 ]; then
            heli_base_python=$(command -v "$candidate")
            return 0
        fi
        [ "$code" != 4 ] || without_venv=${without_venv:-$(command -v "$candidate")}
    done
    [ -z "$without_venv" ] ||
        heli_fail "$without_venv has no venv module; install it (Debian, Ubuntu: apt install python3-venv) or name another interpreter with PYTHON=/path/to/python3"
    heli_fail "no Python 3.11 or newer found (looked for ${PYTHON:-$HELI_PYTHONS}); install one or name it with PYTHON=/path/to/python3"
}

# The interpreter that the environment was made with.
heli_recorded_python() {
    if [ -f "$heli_venv/heli_python" ]; then cat -- "$heli_venv/heli_python"; fi
}

# Runs a command in its own process group, output to the log, so that a signal ends it and all its children at once.
heli_run() {
    local code=0
    set -m
    "$@" </dev/null >>"$heli_log" 2>&1 &
    heli_child=$!
    set +m
    wait "$heli_child" || code=$?
    heli_child=""
    return "$code"
}

heli_last_line() {
    grep -v '^[[:space:]]*$' "$heli_log" | tail -n 1
}

heli_fail_without_network() {
    if grep -qE 'ConnectionError|ConnectTimeout|ReadTimeout|NameResolution|ProxyError|connection broken|error sending request|dns error' "$heli_log"; then
        heli_fail "the Python package index cannot be reached (no network?), and set-up needs it once; its output: $heli_log"
    fi
}

# Ends set-up if a file is not the one that is known; uv and pip name it each in its own way.
heli_fail_for_another_file() {
    local line name="a package"
    grep -qE 'Hash mismatch|DO NOT MATCH THE HASHES' "$heli_log" || return 0
    while read -r line; do
        case "$line" in
            *"Hash mismatch for "*) name=${line##*for } && break ;;
            *" from "*:) name=${line%% *} && break ;;
        esac
    done <"$heli_log"
    heli_fail "${name//\`/} is not the file that requirements/hashes knows: the index has another one, or it was changed on its way; all of the output: $heli_log"
}

# pip with what set-up always wants of it: heli_pip PYTHON ARGUMENT...
heli_pip() {
    local python=$1
    shift
    heli_run env PIP_REQUIRE_VIRTUALENV=0 "$python" -m pip install --no-input --no-user --no-compile --retries 3 \
        --disable-pip-version-check --no-warn-script-location "$@"
}

# Sets heli_uv; 1: it cannot be had.
heli_find_uv() {
    local python
    heli_uv=$(command -v uv) && "$heli_uv" --version >/dev/null 2>&1 && return 0
    heli_uv=$heli_venv/heli_uv/bin/uv
    [ ! -x "$heli_uv" ] || return 0
    python=$heli_base_python
    "$python" -m pip --version >/dev/null 2>&1 || {
        python=$heli_venv/bin/python
        heli_run "$python" -m ensurepip || return 1
    }
    heli_pip "$python" --no-deps --require-hashes -r "$HELI_ROOT/requirements/hashes/uv.txt" \
        --target "$heli_venv/heli_uv" && [ -x "$heli_uv" ] && heli_mark uv
}

heli_install_with_uv() {
    heli_find_uv || return 1
    heli_run "$heli_base_python" "$HELI_ROOT/scripts/uv_install.py" "$heli_uv" --python "$heli_venv/bin/python" "$@"
}

heli_install_with_pip() {
    local python=$heli_venv/bin/python
    "$python" -m pip --version >/dev/null 2>&1 || heli_run "$python" -m ensurepip ||
        heli_fail "$python -m ensurepip: $(heli_last_line)"
    heli_pip "$python" "$@" && return 0
    heli_fail_without_network
    heli_fail_for_another_file
    heli_fail "pip: $(grep -E '^ *ERROR' "$heli_log" | tail -n 1 | grep . || heli_last_line); all of its output: $heli_log"
}

# Installs what the arguments of pip say; a failure becomes one line.
heli_install() {
    # The system's packages that a ROS environment shows are packages to pip, but not to uv.
    if [ "$heli_mode" = wheels ]; then
        heli_install_with_uv "$@" && return 0
        heli_fail_without_network
        heli_fail_for_another_file
        printf 'uv cannot do it (%s); going on with pip, which takes longer ...\n' "$(heli_last_line)" >&2
    fi
    heli_install_with_pip "$@"
}

# Moved away first: an interrupted removal never leaves half an environment in its place.
heli_discard_environment() {
    rm -rf -- "$heli_venv.old"
    [ ! -e "$heli_venv" ] || mv -- "$heli_venv" "$heli_venv.old"
    rm -rf -- "$heli_venv.old"
}

# At the end of set-up, however it came: no child goes on, nothing half-made stays.
heli_leave_setup() {
    local code=$?
    [ "$code" -lt 128 ] || rm -f -- "$heli_log" "$heli_log.pins"
    if [ -n "$heli_child" ]; then
        kill -KILL -- "-$heli_child" 2>/dev/null || true
        wait "$heli_child" 2>/dev/null || true
    fi
    if [ -e "$heli_venv/heli_made_here" ] && [ ! -e "$heli_venv/heli_stamp" ]; then
        heli_discard_environment
    fi
}

# Sets heli_number to the number of a key in a committed result, or to "?".
heli_result() {
    heli_number="?"
    heli_read "$HELI_ROOT/docs/results/$1.json"
    [[ ! $heli_text =~ \"$2\":\ *([0-9]+) ]] || heli_number=${BASH_REMATCH[1]}
}

# Prints what set-up costs, as it was measured.
heli_told_costs() {
    local download installed seconds cores name load
    heli_result setup_size download_mb && download=$heli_number
    heli_result setup_size disk_mb && installed=$heli_number
    heli_result setup setup_s && seconds=$heli_number
    heli_result setup cores && cores=$heli_number
    [[ ! $heli_text =~ \"name\":\ *\"([^\"]+)\" ]] || name=${BASH_REMATCH[1]}
    [[ ! $heli_text =~ \"load\":\ *([0-9.]+) ]] || load=${BASH_REMATCH[1]}
    printf 'it downloads %s MB, takes %s MB of disk, and took %s s from empty caches on %s cores of an %s at load %s (docs/results/setup.json)' \
        "$download" "$installed" "$seconds" "$cores" "${name:-?}" "${load:-?}"
}

# Says how much of the disk the environment takes, where there is du.
heli_tell_size() {
    local size
    ! size=$(du --summarize --block-size=MB -- "$heli_venv" 2>/dev/null) ||
        printf '%s takes %s MB of disk.\n' "$heli_venv" "${size%%MB*}" >&2
}

# Notes what the time since the last mark was spent on.
heli_mark() {
    heli_split+="${heli_split:+, }$1 $((SECONDS - heli_marked_s)) s"
    heli_marked_s=$SECONDS
}

# Makes the environment $heli_venv with the given option of venv, installs what the further arguments of pip say.
heli_make_environment() {
    local option=$1
    shift
    heli_find_python
    rmdir -- "$heli_venv" 2>/dev/null || true
    if [ -e "$heli_venv" ] && [ ! -e "$heli_venv/heli_made_here" ]; then
        heli_fail "$heli_venv exists but was not made by this set-up; move it away, or choose another folder with HELI_VENV=/path"
    fi
    printf 'Setting up %s with Python %s, once: %s ...\n' "$heli_venv" "$heli_base_version" "$(heli_told_costs)" >&2
    heli_discard_environment
    { mkdir -p -- "$heli_venv" && : >"$heli_venv/heli_made_here"; } 2>/dev/null || heli_fail "cannot write $heli_venv"
    printf '%s\n' "$heli_base_python" >"$heli_venv/heli_python"
    heli_run "$heli_base_python" -m venv "$option" "$heli_venv" ||
        heli_fail "$heli_base_python -m venv: $(heli_last_line)"
    heli_mark environment
    heli_install "$@"
    heli_mark wheels
}

heli_link_layout() {
    heli_run "$heli_venv/bin/python" "$HELI_ROOT/scripts/link_ros_layout.py" ||
        heli_fail "linking the packages into $heli_venv: $(heli_last_line)"
}

# Interfaces are compiled: where this ROS has its generators, and there is a compiler.
heli_can_generate() {
    local folder folders
    command -v c++ >/dev/null 2>&1 || return 1
    IFS=: read -ra folders <<<"${AMENT_PREFIX_PATH:-}"
    for folder in "${folders[@]}"; do
        [ ! -d "$folder/share/rosidl_default_generators" ] || return 0
    done
    return 1
}

heli_colcon_build() {
    local without=(--packages-ignore heli_interfaces)
    ! heli_can_generate || without=()
    heli_run env -C "$HELI_ROOT" colcon build --symlink-install --base-paths src "${without[@]}" ||
        heli_fail "colcon build failed (if build/ and install/ are of another kind of build, remove them); its output: $heli_log"
}

# Compiles the kernels into numba's cache, so that the first flight need not.
heli_warm_up() {
    [ -f "$HELI_ROOT/src/heli_flight/heli_flight/graph/warm_up.py" ] || return 0
    heli_run "$heli_venv/bin/python" -m heli_flight.graph.warm_up ||
        heli_fail "compiling the kernels: $(heli_last_line)"
}

# Sets heli_text to the text of the files that there are; read ends with 1 at the end of a file.
heli_read() {
    local file part
    heli_text=""
    for file in "$@"; do
        [ -f "$file" ] || continue
        IFS= read -rd '' part <"$file" || true
        heli_text+=$part
    done
}

heli_stamp_is() {
    heli_read "$1"
    [ "$heli_text" = "$2" ]
}

# Sets heli_mode and heli_venv.
heli_choose_mode() {
    heli_mode=wheels
    heli_venv=${HELI_VENV:-$HELI_ROOT/.venv}
    if [ "${ROS_DISTRO:-}" = jazzy ]; then
        heli_mode=ros
        heli_venv=${HELI_VENV:-$HELI_ROOT/.venv-ros}
        HELI_PYTHONS=python3
    fi
}

# Sets MPLCONFIGDIR to a folder of this user's alone: a file in it may name code that is loaded.
heli_private_matplotlib() {
    local place=${TMPDIR:-/tmp}/heli_hover-$UID
    mkdir -m 700 -- "$place" 2>/dev/null || true
    if [ -d "$place" ] && [ ! -L "$place" ] && [ -O "$place" ] && chmod 700 -- "$place"; then
        export MPLCONFIGDIR=$place/matplotlib
    elif place=$(mktemp -d 2>/dev/null); then
        export MPLCONFIGDIR=$place
    fi
}

# Drops what another ROS, or a parent started by the wheels, left in the environment.
heli_clean_environment() {
    unset _ROS_WHEELS_BOOTSTRAP_COMPLETE PYTHONHOME
    # Wheels are installed without byte code: a flight imports a fifth of their modules, and those are compiled once,
    # when they are first imported. Without writing it each start would compile them anew, which takes two seconds.
    unset PYTHONDONTWRITEBYTECODE
    # Without a home that can be written to, matplotlib would complain at every start.
    [ -w "${HOME:-/nowhere}/." ] || [ -n "${MPLCONFIGDIR:-}" ] || heli_private_matplotlib
    # Matrices are small here. Threads of the linear algebra wait for each other: beside other processes a matrix
    # exponential takes ten times as long with them.
    export OPENBLAS_NUM_THREADS="${OPENBLAS_NUM_THREADS:-1}"
    [ "$heli_mode" = wheels ] || return 0
    [ -z "${ROS_DISTRO:-}" ] || unset LD_LIBRARY_PATH ROS_DISTRO ROS_VERSION ROS_PYTHON_VERSION
    unset PYTHONPATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH
    export AMENT_PREFIX_PATH="$heli_venv" RMW_IMPLEMENTATION=rmw_fastrtps_cpp
}

heli_check_ros() {
    "${PYTHON:-python3}" -c 'import rclpy' 2>/dev/null ||
        heli_fail "ROS_DISTRO=jazzy is set, but ${PYTHON:-python3} cannot import rclpy; source Jazzy's setup.bash, or unset ROS_DISTRO to use the wheels from PyPI"
    command -v colcon >/dev/null 2>&1 ||
        heli_fail "colcon not found; install it (apt install python3-colcon-common-extensions), or unset ROS_DISTRO to use the wheels from PyPI"
}

heli_source_workspace() {
    [ "$heli_mode" = ros ] || return 0
    set +u
    # shellcheck disable=SC1091
    source "$HELI_ROOT/install/local_setup.bash"
    set -u
}

# Without PYTHON any interpreter will do.
heli_python_is_wanted() {
    local wanted="" recorded=""
    [ -n "${PYTHON:-}" ] || return 0
    command -v "$PYTHON" | read -r wanted || return 1
    read -r recorded <"$heli_venv/heli_python" || return 1
    [ "$wanted" -ef "$recorded" ]
}

heli_environment_stands() {
    heli_stamp_is "$heli_venv/heli_stamp" "$heli_want_env" && [ -x "$heli_venv/bin/python" ] && heli_python_is_wanted
}

heli_layout_stands() {
    heli_stamp_is "$heli_venv/heli_layout_stamp" "$heli_want_layout" &&
        { [ "$heli_mode" = wheels ] || [ -f "$HELI_ROOT/install/local_setup.bash" ]; }
}

heli_all_stands() {
    heli_environment_stands && heli_layout_stands &&
        { [ "$1" != test ] || heli_stamp_is "$heli_venv/heli_test_stamp" "$heli_want_env"; }
}

# Makes what is missing; each stamp is written when its part is complete.
heli_make_missing() {
    local requirements=$HELI_ROOT/requirements pins=$HELI_ROOT/requirements/constraints.txt
    local packages option=--without-pip
    heli_split="" heli_marked_s=$SECONDS
    local begun_s=$SECONDS
    if [ "$heli_mode" = ros ]; then
        heli_check_ros
        pins=$heli_log.pins
        grep -vE '^(numpy|cvxpy|highspy|sparsediffpy)==' "$requirements/constraints.txt" >"$pins"
        echo 'numpy<2' >>"$pins"
        option=--system-site-packages
        packages=(-c "$pins" -r "$requirements/python.txt")
    else
        packages=(--no-deps --require-hashes -r "$requirements/hashes/flight.txt")
    fi
    heli_environment_stands || heli_make_environment "$option" "${packages[@]}"
    if ! heli_layout_stands; then
        if [ "$heli_mode" = ros ]; then heli_colcon_build; else heli_link_layout; fi
        heli_mark packages
        heli_source_workspace
        heli_warm_up
        heli_mark kernels
        printf '%s' "$heli_want_layout" >"$heli_venv/heli_layout_stamp"
    fi
    rm -f -- "$heli_venv/heli_blocks_signals"
    ! env --block-signal=INT true 2>/dev/null || : >"$heli_venv/heli_blocks_signals"
    printf '%s' "$heli_want_env" >"$heli_venv/heli_stamp"
    if [ "$1" = test ]; then
        heli_result setup_size test_mb
        printf 'Adding the test tools, once: %s MB to download ...\n' "$heli_number" >&2
        heli_base_python=$heli_venv/bin/python
        packages=(-c "$pins" -r "$requirements/test.txt")
        [ "$heli_mode" = ros ] || packages=(--no-deps --require-hashes -r "$requirements/hashes/test.txt")
        heli_install "${packages[@]}"
        printf '%s' "$heli_want_env" >"$heli_venv/heli_test_stamp"
        heli_mark "test tools"
    fi
    printf 'Set up in %d s: %s.\n' "$((heli_marked_s - begun_s))" "$heli_split" >&2
    heli_tell_size
}

# An environment of another user's may stand, but its Python lie where only that user may go.
heli_fail_unwritable() {
    local python=$heli_venv/bin/python
    if { [ -e "$python" ] || [ -L "$python" ]; } && [ ! -x "$python" ]; then
        heli_fail "cannot execute $(readlink -m -- "$python"), the Python of $heli_venv, as this user; for an environment of your own choose a folder with HELI_VENV=/path"
    fi
    heli_fail "cannot write $heli_venv"
}

# One set-up at a time; whoever waited looks again at what is missing.
heli_make_missing_alone() {
    heli_child=""
    heli_log=$(mktemp "${TMPDIR:-/tmp}/heli_setup.XXXXXX") || heli_fail "cannot write a temporary file"
    mkdir -p -- "$(dirname -- "$heli_venv")" 2>/dev/null || true
    { exec 9>"$heli_venv.lock"; } 2>/dev/null || heli_fail_unwritable
    if ! flock -n 9; then
        printf 'Another set-up is under way, waiting for it ...\n' >&2
        flock 9
    fi
    if ! heli_all_stands "$1"; then
        trap heli_leave_setup EXIT
        trap 'exit 143' TERM HUP
        heli_make_missing "$1"
        trap - EXIT TERM HUP
    fi
    exec 9>&-
    rm -f -- "$heli_log" "$heli_log.pins"
}

# Sets what set-up wants, and cleans the environment for what is started.
heli_look() {
    heli_choose_mode
    heli_clean_environment
    heli_read "$HELI_ROOT"/requirements/*.txt
    heli_want_env=$heli_text$heli_venv
    heli_read "$HELI_ROOT"/scripts/link_ros_layout.py "$HELI_ROOT"/src/*/{setup.py,CMakeLists.txt,action/*.action}
    printf -v heli_want_layout '%s\n' "$HELI_ROOT"/src/*/{package.xml,resource,config,web,launch/*.py,scripts/*}
    heli_want_layout+=$heli_text
    if [ "$heli_mode" = ros ] && heli_can_generate; then heli_want_layout+=generated; fi
}

heli_setup_env() {
    heli_look
    heli_all_stands "${1:-}" || heli_make_missing_alone "${1:-}"
    export VIRTUAL_ENV="$heli_venv" PATH="$heli_venv/bin:$PATH"
    heli_source_workspace
    export ROS_AUTOMATIC_DISCOVERY_RANGE="${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}"
    # shellcheck disable=SC2034  # the caller runs it
    HELI_PYTHON=$heli_venv/bin/python
}

# Becomes the command of that name. Ctrl-C is held back until Python can take it: an interpreter that is still
# starting would answer with a traceback.
heli_start() {
    local held_back=()
    [ ! -e "$heli_venv/heli_blocks_signals" ] || held_back=(env --block-signal=INT)
    exec "${held_back[@]}" "$HELI_PYTHON" -m heli_flight.start "$@"
}

trap 'echo interrupted >&2; exit 130' INT
