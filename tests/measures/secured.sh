#!/usr/bin/env bash
# Runs a secured experiment again and again and says how many runs passed, why the others did not, and how busy the computer was.
#
# usage: secured.sh [RUNS] [ARGUMENTS OF whorl run]     (default 20 of leader_follower_short; needs programs built with security)
#
# The exit status is 0 when all passed. WHORL_BUSY_LOOPS=1 computes beside it in as many loops. The ROS domain is ROS_DOMAIN_ID;
# WHORL_TARGET the folder of the programs (default target/release); WHORL_SECURED_DIR where runs and keys are kept (default: they are removed).

set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
runs=${1:-20}
shift || true
whorl=${WHORL_TARGET:-$root/target/release}/whorl
work=${WHORL_SECURED_DIR:-$(mktemp -d -t whorl-secured-XXXXXX)}
loops=()
end() {
    [ ${#loops[@]} -eq 0 ] || kill "${loops[@]}" 2>/dev/null || true
    [ -n "${WHORL_SECURED_DIR:-}" ] || rm -rf "$work"
}
trap end EXIT
mkdir -p "$work"
export ROS_SECURITY_KEYSTORE=${ROS_SECURITY_KEYSTORE:-$work/keystore}
for ((loop = 0; loop < ${WHORL_BUSY_LOOPS:-0}; loop++)); do
    while :; do :; done &
    loops+=($!)
done

passed=0
for ((run = 1; run <= runs; run++)); do
    # By `|| true`: the verdict says what it came to.
    "$whorl" run leader_follower_short --secure --root "$root" --params "$root/params" --out "$work/run_$run" "$@" \
        >"$work/log_$run" 2>&1 </dev/null || true
    verdict=$(grep '^verdict: ' "$work/log_$run" | tail -n 1)
    verdict=${verdict:-$(tail -n 1 "$work/log_$run")}
    case $verdict in "verdict: PASSED"*) passed=$((passed + 1)) ;; esac
    printf 'run %2d, load %s: %s\n' "$run" "$(cut -d ' ' -f 1 /proc/loadavg)" "$verdict"
    again=$(grep -c 'was started again' "$work/log_$run" || true)
    [ "$again" -eq 0 ] || printf '        %d processes were started again\n' "$again"
done
printf 'measured: %d of %d secured runs passed\n' "$passed" "$runs"
[ "$passed" -eq "$runs" ]
