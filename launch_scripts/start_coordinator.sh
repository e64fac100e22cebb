#!/usr/bin/env bash
# Starts the coordinator: experiment sequence, relative-attitude law, authority heartbeat. Ctrl-C stops it.
here=$(dirname "$0")
# shellcheck source-path=SCRIPTDIR source=common.sh
. "$here/common.sh"

usage() {
    cat <<'TXT'
usage: start_coordinator.sh [options]

Starts the coordinator: experiment sequence, relative-attitude law, authority heartbeat.

  --experiment NAME|FILE          experiment (default leader_follower)
  --platforms "A B"               platforms (default "whorl_1 whorl_2")
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
        --platforms) need_value "$@"; platforms=$2; shift 2 ;;
        --params) need_value "$@"; params=$2; shift 2 ;;
        --no-auto-start) extra+=(-p experiment.auto_start:=false); shift ;;
        --no-build) build=no; shift ;;
        *) usage >&2; die "unknown option $1" ;;
    esac
done

experiment_path=$(experiment_file)
build_nodes
check_binaries coordinator
formation_arguments
remember coordinator $$
exec "${ahead[@]}" "$bin/coordinator" "${formation[@]}" "${extra[@]}"
