# shellcheck shell=bash
# Shared by the scripts in this folder; sourced, not run. What they do is in `whorl run`, `whorl nodes` and `whorl demo`.

set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
bin=${WHORL_BIN:-${CARGO_TARGET_DIR:-$root/target}/release}

die() {
    printf 'error: %s\n' "$*" >&2
    exit 2
}

# build_programs ARGUMENTS...: builds everything, unless the caller brings programs (WHORL_BIN), says --no-build or asks
# for --help. Sets `arguments`: the others.
build_programs() {
    local argument build=yes
    arguments=()
    for argument in "$@"; do
        case $argument in
            --no-build) build=no ;;
            -h | --help) build=no; help=yes; arguments+=("$argument") ;;
            *) arguments+=("$argument") ;;
        esac
    done
    if [ "$build" = yes ] && [ -z "${WHORL_BIN:-}" ]; then
        command -v cargo >/dev/null || die "cargo is not on the PATH: install a Rust toolchain (https://rustup.rs)"
        (cd "$root" && cargo build --release --locked --workspace --bins)
    fi
    [ -x "$bin/whorl" ] || die "$bin/whorl is not there: build with 'cargo build --release', or run without --no-build"
}

# whorl COMMAND... -- ARGUMENTS...: builds if need be, and becomes that command.
whorl() {
    local command=() help=
    while [ "$1" != -- ]; do command+=("$1"); shift; done
    shift
    build_programs "$@"
    if [ -n "$help" ]; then
        printf '%s [options]: builds Whorl, then runs "whorl %s"; with --no-build it takes the programs that are there.\n\n' \
            "$(basename "$0")" "${command[*]}"
    fi
    exec "$bin/whorl" "${command[@]}" --root "$root" ${arguments[@]+"${arguments[@]}"}
}
