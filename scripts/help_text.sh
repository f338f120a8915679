# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Sourced by heli and hover_test.sh after setup_env.sh: help without set-up.
#
# heli_help NAME ARGUMENT...   answers --help out of scripts/help.txt (and `heli` or `heli bag` alone, where a command has to follow,
#                              which is exit code 2), and ends, if there is no environment yet that could answer itself.
#                              Else, and for all that is no question for help, it does nothing.

# Sets heli_words to the names that the arguments begin with; 1: they do not ask for help.
heli_help_is_asked() {
    local word
    heli_words=()
    [ $# -gt 0 ] || return 0
    for word in "$@"; do
        [ "$word" != --help ] || return 0
        [ "$word" != -- ] || return 1
        # What follows a program's name belongs to the program, --help too.
        case "${heli_words[*]-}" in run | python) return 1 ;; esac
        heli_words+=("$word")
    done
    return 1
}

# Prints the text of a command's name; 1: there is none.
heli_print_help() {
    local line found=1
    while IFS= read -r line; do
        if [ "${line:0:1}" = $'\f' ]; then
            [ "$found" = 1 ] || break
            [ "${line:1}" != "$1" ] || found=0
        elif [ "$found" = 0 ]; then
            printf '%s\n' "$line"
        fi
    done <"$HELI_ROOT/scripts/help.txt"
    return "$found"
}

# Whether these words of `heli` are nothing without a command that follows.
heli_is_unfinished() {
    local text
    [ $# = 0 ] || { text=$(heli_print_help "heli $*") && [[ $text == *" COMMAND [ARGS]..."* ]]; }
}

heli_help() {
    local program=$1 name text count unfinished=1
    shift
    [ -z "${_HELI_COMPLETE:-}" ] || return 0
    [ "$program" != heli ] || ! heli_is_unfinished "$@" || unfinished=0
    heli_help_is_asked "$@" || [ "$unfinished" = 0 ] || return 0
    [ "$program" = heli ] || [ $# -gt 0 ] || return 0
    heli_look
    ! heli_all_stands "" || return 0
    if [ "$program" = heli ] && [ ${#heli_words[@]} -gt 0 ] && [[ ${heli_words[0]} != -* ]] &&
        ! heli_print_help "heli ${heli_words[0]}" >/dev/null; then
        printf "heli: No such command '%s'.\n" "${heli_words[0]}" >&2
        exit 2
    fi
    # The longest name that there is: what follows are the command's own arguments.
    for ((count = ${#heli_words[@]}; count >= 0; count--)); do
        name=$program
        [ "$count" = 0 ] || name+=" ${heli_words[*]:0:count}"
        ! text=$(heli_print_help "$name") || break
    done
    text+=$'\n\n'"Nothing is set up yet: this is the stored help. The first command that does something sets up, once:"
    text+=$'\n'"$(heli_told_costs)."
    if [ "$unfinished" = 0 ]; then
        printf '%s\n' "$text" >&2
        exit 2
    fi
    printf '%s\n' "$text"
    exit 0
}
