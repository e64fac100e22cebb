#!/usr/bin/env bash
# Starts the node set of one platform: driver, estimator, local control. Ctrl-C stops it.
here=$(dirname "$0")
# shellcheck source-path=SCRIPTDIR source=common.sh
. "$here/common.sh"

usage() {
    cat <<'TXT'
usage: start_platform.sh PLATFORM [options]

Starts driver, estimator and local control in the namespace /PLATFORM (whorl_1, whorl_2, ...).

  --backend sim|replay|hardware   what the driver drives (default sim)
  --source FILE                   recording for --backend replay: run directory, bag or CSV
  --channels FILE                 which column of a CSV recording is what, as params/channels/broad.yaml
  --experiment NAME|FILE          experiment whose parameters apply (default leader_follower)
  --params DIR                    parameter folder (default params/)
  --seed N                        seed of the simulated hardware (default 1)
  --no-build                      use the binaries that are there
TXT
}

platform=
backend=sim
source=
channels=
while [ $# -gt 0 ]; do
    case $1 in
        -h | --help) usage; exit 0 ;;
        --backend) need_value "$@"; backend=$2; shift 2 ;;
        --source) need_value "$@"; source=$2; shift 2 ;;
        --channels) need_value "$@"; channels=$2; shift 2 ;;
        --experiment) need_value "$@"; experiment=$2; shift 2 ;;
        --params) need_value "$@"; params=$2; shift 2 ;;
        --seed) need_value "$@"; seed=$2; shift 2 ;;
        --no-build) build=no; shift ;;
        -*) usage >&2; die "unknown option $1" ;;
        *) [ -z "$platform" ] || die "one platform at a time: '$platform' and '$1'"; platform=$1; shift ;;
    esac
done
[ -n "$platform" ] || { usage >&2; die "which platform?"; }
case $backend in sim | replay | hardware) ;; *) die "backend '$backend' is not sim, replay or hardware" ;; esac

experiment_path=$(experiment_file)
build_nodes
check_binaries driver estimator local_control
trap 'stop_started' EXIT
trap 'exit 130' INT TERM
start_platform_nodes "$platform" "$backend" "$source" "$channels" "$run_state/logs"
printf '%s is up (logs in %s); Ctrl-C stops it\n' "$platform" "$run_state/logs"
alive=0
while [ "$alive" -eq 0 ]; do
    sleep 0.5
    check_alive || alive=$?
done
# 3: one has finished, as a driver at the end of its recording.
[ "$alive" -eq 3 ]
