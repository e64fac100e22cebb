#!/usr/bin/env bash
# Measures the whole system on this machine: one experiment over DDS, everything running here.
#
# usage: whole_system.sh [EXPERIMENT]        (default leader_follower_short; needs built binaries)
#
# Prints how long it took until both platforms pointed, the age of sensor samples when commands were made
# from them, the share of one core and the largest memory of every process. The ROS domain is ROS_DOMAIN_ID.

set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
experiment=${1:-leader_follower_short}
work=$(mktemp -d -t whorl-measures-XXXXXX)
trap 'rm -rf "$work"' EXIT
state=${XDG_RUNTIME_DIR:-/tmp}/whorl-$(id -u)-domain-${ROS_DOMAIN_ID:-0}
ticks=$(getconf CLK_TCK)

began=$(date +%s%N)
"$root/launch_scripts/run_experiment.sh" "$experiment" --no-build --out "$work" >"$work/log" 2>&1 &
script=$!

# Process times [ticks] and peak memory [kB] of every node, for as long as it lives.
while kill -0 "$script" 2>/dev/null; do
    for file in "$state"/*.pid; do
        pid=$(cat "$file" 2>/dev/null) || continue
        stat=$(cat "/proc/$pid/stat" 2>/dev/null) || continue
        memory=$(grep VmHWM "/proc/$pid/status" 2>/dev/null | tr -dc 0-9) || continue
        # Fields 14 and 15, counted behind the name in parentheses.
        read -r -a field <<<"${stat##*) }"
        printf '%s %s %s %s\n' "$(basename "$file" .pid)" "$(date +%s%N)" $((field[11] + field[12])) "$memory"
    done >>"$work/samples"
    sleep 0.5
done
wait "$script" || { cat "$work/log"; exit 1; }

run=$(echo "$work"/*_*/)
python3 - "$run" "$work/samples" "$began" "$ticks" <<'PY'
import json, re, sys
run, samples, began, ticks = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
summary = json.load(open(run + "summary.json"))
bag = open(run + "bag/metadata.yaml").read()
first = int(re.search(r"nanoseconds_since_epoch: (\d+)", bag)[1])
for pair in summary["pairs"]:
    light = (first - began) * 1e-9 + pair["acquired_s"]
    print(f"{pair['follower']} to {pair['leader']}: pointing {light:.1f} s after the command; "
          f"in hold {pair['relative_error_rms_rad'] * 57.29578:.4f} deg RMS")
for p in summary["platforms"]:
    print(f"{p['name']}: sensor stamp to command, median {p['sensor_to_command_p50_s'] * 1e3:.2f} ms, "
          f"99 % {p['sensor_to_command_p99_s'] * 1e3:.2f} ms")
first, last = {}, {}
for line in open(samples):
    name, at, cpu, memory = line.split()
    first.setdefault(name, (int(at), int(cpu)))
    last[name] = (int(at), int(cpu), int(memory))
total = 0.0
for name in sorted(last):
    span = (last[name][0] - first[name][0]) * 1e-9
    share = (last[name][1] - first[name][1]) / ticks / span
    total += share
    print(f"{name:24} {100 * share:5.1f} % of a core, at most {last[name][2] / 1024:5.1f} MB")
print(f"{'all processes':24} {100 * total:5.1f} % of a core")
PY
