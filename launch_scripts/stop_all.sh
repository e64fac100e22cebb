#!/usr/bin/env bash
# Stops every node that the scripts in this folder started on this machine in this ROS domain.
here=$(dirname "$0")
# shellcheck source-path=SCRIPTDIR source=common.sh
. "$here/common.sh"

case ${1:-} in
    -h | --help)
        printf 'usage: stop_all.sh\n\nStops every node started by these scripts on this machine, in domain %s (ROS_DOMAIN_ID).\n' "$domain"
        exit 0
        ;;
    '') ;;
    *) die "unknown option $1" ;;
esac

shopt -s nullglob
stopped=0
for file in "$run_state"/*.pid; do
    pid=$(cat "$file")
    label=$(basename "$file" .pid)
    # A process id may have been given to another program since.
    program=$(readlink "/proc/$pid/exe" 2>/dev/null || true)
    case $(basename "${program% (deleted)}") in
        driver | estimator | local_control | coordinator | recorder)
            pids+=("$pid"); labels+=("$label"); logs+=("")
            stopped=$((stopped + 1))
            ;;
        *) rm -f "$file" ;;
    esac
done
stop_started
printf 'stopped %d nodes in domain %s\n' "$stopped" "$domain"
