# shellcheck shell=bash
# Shared by the scripts in this folder; sourced, not run.
# Shell only: gains, limits and sequences are in params/, logic is in the nodes.

set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
bin=${WHORL_BIN:-${CARGO_TARGET_DIR:-$root/target}/release}
params=$root/params
experiment=leader_follower
platforms="whorl_1 whorl_2"
seed=1
build=yes
domain=${ROS_DOMAIN_ID:-0}
# Process ids of everything started here, one file per process, for stop_all.sh.
run_state=${XDG_RUNTIME_DIR:-/tmp}/whorl-$(id -u)-domain-$domain

# Nodes run ahead of other programs where the machine lets them: as root, or with a limit on nice in
# /etc/security/limits.conf.
ahead=()
if [ -z "$(nice -n -10 true 2>&1)" ]; then ahead=(nice -n -10); fi

die() {
    printf 'error: %s\n' "$*" >&2
    exit 2
}

need_value() {
    if [ $# -lt 2 ] || [ -z "$2" ]; then die "$1 needs a value"; fi
}

# Builds the node set, unless the caller brings binaries (WHORL_BIN) or asked for --no-build.
build_nodes() {
    if [ "$build" != yes ] || [ -n "${WHORL_BIN:-}" ]; then return 0; fi
    command -v cargo >/dev/null || die "cargo is not on the PATH: install a Rust toolchain (https://rustup.rs)"
    (cd "$root" && cargo build --release --locked --workspace --bins)
}

check_binaries() {
    local name
    for name in "$@"; do
        [ -x "$bin/$name" ] || die "$bin/$name is not there: build with 'cargo build --release', or run without --no-build"
    done
}

# The experiment's file: a name in the parameter folder, or a path.
experiment_file() {
    local candidate
    for candidate in "$experiment" "$params/experiments/$experiment.yaml" "$root/params/experiments/$experiment.yaml"; do
        [ -f "$candidate" ] && { printf '%s\n' "$candidate"; return; }
    done
    die "no experiment '$experiment': not a file, and not one of $(cd "$params/experiments" 2>/dev/null && ls ./*.yaml | sed 's|^\./||; s|\.yaml$||' | tr '\n' ' ')"
}

# formation_arguments: sets `formation`, the ROS arguments of what knows all platforms (coordinator, recorder),
# and `truths`, files for the recorder to keep with the run: what simulated hardware takes for true.
formation_arguments() {
    local platform names=
    truths=()
    formation=(--ros-args --params-file "$params/common.yaml")
    for platform in $platforms; do
        [ -f "$params/$platform.yaml" ] || die "no parameter file $params/$platform.yaml for platform '$platform'"
        formation+=(--params-file "$params/$platform.yaml")
        [ ! -f "$params/truth/$platform.yaml" ] || truths+=(--params-file "$params/truth/$platform.yaml")
        names=$names,$platform
    done
    formation+=(--params-file "$experiment_path" -p "formation.platforms:=[${names#,}]")
}

# name_run: sets `run`, the directory of a run that begins now and that nobody has begun yet.
name_run() {
    while
        run=$out/$(date -u +%Y-%m-%dT%H-%M-%SZ)_$(basename "$experiment_path" .yaml)
        [ -e "$run" ]
    do
        sleep 0.2
    done
}

# remember LABEL PID: for stop_all.sh.
remember() {
    mkdir -p "$run_state"
    printf '%s\n' "$2" >"$run_state/$1.pid"
}

# start LABEL LOG PROGRAM ARGS...: runs it in the background and remembers its process id.
start() {
    local label=$1 log=$2
    shift 2
    mkdir -p "$(dirname "$log")"
    "${ahead[@]}" "$@" >"$log" 2>&1 &
    pids+=($!)
    labels+=("$label")
    logs+=("$log")
    remember "$label" "$!"
}

# stop_started: stops what this script started, the recorder last, so that it records how the others end.
stop_started() {
    local i nodes=() recorder=()
    for i in "${!pids[@]}"; do
        if [ "${labels[$i]}" = recorder ]; then recorder+=("$i"); else nodes+=("$i"); fi
    done
    end 30 "${nodes[@]}"
    end 50 "${recorder[@]}"
    rmdir "$run_state" 2>/dev/null || true
}

# end TENTHS INDEX...: terminates these processes and kills what is still there after so many tenths of a second.
# Not with INT, which processes in the background of a script ignore until they say otherwise.
end() {
    local tenths=$1 i
    shift
    for i in "$@"; do kill -TERM "${pids[$i]}" 2>/dev/null || true; done
    for i in "$@"; do
        while kill -0 "${pids[$i]}" 2>/dev/null; do
            if [ "$tenths" -le 0 ]; then
                printf 'warning: %s did not stop, killing it\n' "${labels[$i]}" >&2
                kill -KILL "${pids[$i]}" 2>/dev/null || true
                break
            fi
            sleep 0.1
            tenths=$((tenths - 1))
        done
        wait "${pids[$i]}" 2>/dev/null || true
        rm -f "$run_state/${labels[$i]}.pid"
    done
}

# check_alive: 0 while all run; 1 when one failed, after printing its last words; 3 when one has finished.
check_alive() {
    local i status
    for i in "${!pids[@]}"; do
        if ! kill -0 "${pids[$i]}" 2>/dev/null; then
            status=0
            wait "${pids[$i]}" || status=$?
            [ "$status" -ne 0 ] || { printf '%s has finished\n' "${labels[$i]}"; return 3; }
            printf 'error: %s ended with status %d. Its log, %s, says:\n' "${labels[$i]}" "$status" "${logs[$i]}" >&2
            tail -n 20 "${logs[$i]}" >&2
            return 1
        fi
    done
}

# start_platform_nodes NAME BACKEND SOURCE CHANNELS LOGDIR: driver, estimator and local control of one platform.
start_platform_nodes() {
    local name=$1 backend=$2 source=$3 channels=$4 logdir=$5 file node
    local common=(--ros-args -r "__ns:=/$name")
    for file in "$params/common.yaml" "$params/$name.yaml"; do
        [ -f "$file" ] || die "no parameter file $file for platform '$name'"
        common+=(--params-file "$file")
    done
    local model=("${common[@]}" --params-file "$experiment_path")
    local truth=("${common[@]}")
    [ ! -f "$params/truth/$name.yaml" ] || truth+=(--params-file "$params/truth/$name.yaml")
    truth+=(--params-file "$experiment_path" -p "backend:=$backend" -p "seed:=$seed")
    [ -z "$source" ] || truth+=(-p "replay.source:=$source")
    [ -z "$channels" ] || truth+=(-p "replay.channels:=$channels")
    start "${name}_driver" "$logdir/${name}_driver.log" "$bin/driver" "${truth[@]}"
    # An experiment may have each platform run the law itself.
    local nodes="estimator local_control"
    if grep -Eq '^[[:space:]]*on_platforms:[[:space:]]*true' "$experiment_path"; then nodes="$nodes coordinator"; fi
    for node in $nodes; do
        start "${name}_$node" "$logdir/${name}_$node.log" "$bin/$node" "${model[@]}"
    done
}

pids=()
labels=()
logs=()
