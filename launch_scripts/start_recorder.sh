#!/usr/bin/env bash
# Starts the recorder: every topic into a run directory. Ctrl-C stops it.
here=$(dirname "$0")
# shellcheck source-path=SCRIPTDIR source=common.sh
. "$here/common.sh"

usage() {
    cat <<'TXT'
usage: start_recorder.sh [options]

Starts the recorder: every topic into a run directory.

  --experiment NAME|FILE          experiment (default leader_follower)
  --platforms "A B"               platforms (default "whorl_1 whorl_2")
  --params DIR                    parameter folder (default params/)
  --out DIR                       folder of run directories (default runs/)
  --no-build                      use the binaries that are there
TXT
}

out=$root/runs
while [ $# -gt 0 ]; do
    case $1 in
        -h | --help) usage; exit 0 ;;
        --experiment) need_value "$@"; experiment=$2; shift 2 ;;
        --platforms) need_value "$@"; platforms=$2; shift 2 ;;
        --params) need_value "$@"; params=$2; shift 2 ;;
        --out) need_value "$@"; out=$2; shift 2 ;;
        --no-build) build=no; shift ;;
        *) usage >&2; die "unknown option $1" ;;
    esac
done

experiment_path=$(experiment_file)
build_nodes
check_binaries recorder
formation_arguments
name_run
remember recorder $$
exec "${ahead[@]}" "$bin/recorder" "${formation[@]}" "${truths[@]}" -p "run_directory:=$run"
