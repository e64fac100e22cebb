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
# for --help. With security, which needs OpenSSL, for --secure and where ROS_SECURITY_ENABLE is true. Sets `arguments`: the others.
build_programs() {
    local argument build=yes features=()
    arguments=()
    [ "${ROS_SECURITY_ENABLE:-}" != true ] || features=(--features security)
    for argument in "$@"; do
        case $argument in
            --no-build) build=no ;;
            --secure) features=(--features security); arguments+=("$argument") ;;
            -h | --help) build=no; help=yes; arguments+=("$argument") ;;
            *) arguments+=("$argument") ;;
        esac
    done
    if [ "$build" = yes ] && [ -z "${WHORL_BIN:-}" ]; then
        command -v cargo >/dev/null || die "cargo is not on the PATH: install a Rust toolchain (https://rustup.rs)"
        if [ "${#features[@]}" -gt 0 ] && ! pkg-config --exists openssl 2>/dev/null; then
            die "security needs OpenSSL's headers to build: install libssl-dev and pkg-config (Debian, Ubuntu)"
        fi
        (cd "$root" && cargo build --release --locked -p whorl_cli -p whorl_programs ${features[@]+"${features[@]}"})
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
