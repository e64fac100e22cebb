#!/usr/bin/env bash
# Runs one experiment from start to report: node sets of all platforms, coordinator, recorder.
here=$(dirname "$0")
# shellcheck source-path=SCRIPTDIR source=common.sh
. "$here/common.sh"

usage() {
    cat <<'TXT'
usage: run_experiment.sh EXPERIMENT [options]

Builds, starts the node set of every platform, the coordinator and the recorder, shows a live
status line, stops everything and writes a report. Ctrl-C ends it early and leaves a readable run.

  EXPERIMENT                      a name in params/experiments/ or a file
  --platforms "A B"               platforms (default "whorl_1 whorl_2")
  --backend [PLATFORM=]sim|replay|hardware
                                  what a driver drives, for one platform or all (default sim)
  --source PLATFORM=FILE          recording that a replaying platform is fed from: run, bag or CSV
  --channels PLATFORM=FILE        which column of a CSV recording is what, as params/channels/broad.yaml
  --params DIR                    parameter folder (default params/)
  --out DIR                       folder of run directories (default runs/)
  --seed N                        seed of the simulated hardware (default 1)
  --no-build                      use the binaries that are there
TXT
}

named=
out=$root/runs
declare -A backends=() sources=() channels=()
default_backend=sim
while [ $# -gt 0 ]; do
    case $1 in
        -h | --help) usage; exit 0 ;;
        --platforms) need_value "$@"; platforms=$2; shift 2 ;;
        --backend)
            need_value "$@"
            case ${2#*=} in sim | replay | hardware) ;; *) die "backend '${2#*=}' is not sim, replay or hardware" ;; esac
            case $2 in *=*) backends[${2%%=*}]=${2#*=} ;; *) default_backend=$2 ;; esac
            shift 2
            ;;
        --source)
            need_value "$@"
            case $2 in *=*) sources[${2%%=*}]=${2#*=} ;; *) die "--source takes PLATFORM=FILE" ;; esac
            shift 2
            ;;
        --channels)
            need_value "$@"
            case $2 in *=*) channels[${2%%=*}]=${2#*=} ;; *) die "--channels takes PLATFORM=FILE" ;; esac
            shift 2
            ;;
        --params) need_value "$@"; params=$2; shift 2 ;;
        --out) need_value "$@"; out=$2; shift 2 ;;
        --seed) need_value "$@"; seed=$2; shift 2 ;;
        --no-build) build=no; shift ;;
        -*) usage >&2; die "unknown option $1" ;;
        *) [ -z "$named" ] || die "one experiment at a time: '$named' and '$1'"; named=$1; shift ;;
    esac
done
[ -n "$named" ] || { usage >&2; die "which experiment? There are: $(ls "$params/experiments" | sed 's/\.yaml$//' | tr '\n' ' ')"; }
experiment=$named
for platform in "${!backends[@]}" "${!sources[@]}" "${!channels[@]}"; do
    case " $platforms " in *" $platform "*) ;; *) die "no platform '$platform' among: $platforms" ;; esac
done

experiment_path=$(experiment_file)
build_nodes
check_binaries driver estimator local_control coordinator recorder whorl
formation_arguments

name_run
monitor=
finish() {
    trap - EXIT
    trap '' INT TERM
    [ -z "$monitor" ] || kill -TERM "$monitor" 2>/dev/null || true
    stop_started
    # The report says how far the run came, also when it was ended early.
    if [ -d "$run/bag" ]; then
        "$bin/whorl" report "$run" || true
    fi
    exit "${status:-1}"
}
trap finish EXIT
trap 'status=130; exit 130' INT TERM

status=1
commit=()
if hash=$(git -C "$root" rev-parse HEAD 2>/dev/null); then
    commit=(-p "git_commit:='$hash'")
fi

mkdir -p "$run/logs"
start recorder "$run/logs/recorder.log" "$bin/recorder" "${formation[@]}" "${truths[@]}" \
    -p "run_directory:=$run" -p "seed:=$seed" "${commit[@]}"
for platform in $platforms; do
    start_platform_nodes "$platform" "${backends[$platform]:-$default_backend}" \
        "${sources[$platform]:-}" "${channels[$platform]:-}" "$run/logs"
done
start coordinator "$run/logs/coordinator.log" "$bin/coordinator" "${formation[@]}"

# shellcheck disable=SC2086 # one argument for each platform
"$bin/whorl" monitor $platforms &
monitor=$!
while kill -0 "$monitor" 2>/dev/null; do
    alive=0
    check_alive || alive=$?
    case $alive in
        0) sleep 0.2 ;;
        # The coordinator at the end of the experiment, which the monitor is about to report, or a driver
        # at the end of its recording.
        3) sleep 2; break ;;
        *) exit 1 ;;
    esac
done
status=0
if ! kill -0 "$monitor" 2>/dev/null; then wait "$monitor" || status=$?; fi
exit "$status"
