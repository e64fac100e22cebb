#!/usr/bin/env bash
# Starts the coordinator: experiment sequence, relative-attitude law, authority heartbeat. Ctrl-C stops it.
here=$(dirname "$0")
. "$here/common.sh"

usage() {
    cat <<'TXT'
usage: start_coordinator.sh [options]

Starts the coordinator: experiment sequence, relative-attitude law, authority heartbeat.

  --experiment NAME|FILE          experiment (default leader_follower)
  --params DIR                    parameter folder (default params/)
  --no-auto-start                 wait for the service /coordinator/start
  --no-build                      use the binaries that are there
TXT
}

extra=()
while [ $# -gt 0 ]; do
    case $1 in
        -h | --help) usage; exit 0 ;;
        --experiment) need_value "$@"; experiment=$2; shift 2 ;;
        --params) need_value "$@"; params=$2; shift 2 ;;
        --no-auto-start) extra+=(-p auto_start:=false); shift ;;
        --no-build) build=no; shift ;;
        *) usage >&2; die "unknown option $1" ;;
    esac
done

experiment_path=$(experiment_file)
build_nodes
check_binaries coordinator
exec "$bin/coordinator" --ros-args --params-file "$params/common.yaml" --params-file "$experiment_path" "${extra[@]}"
