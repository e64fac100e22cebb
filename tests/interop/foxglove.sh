#!/usr/bin/env bash
# Foxglove's own client reads a running formation through `whorl live --foxglove`. Needs node and npm.
# usage: foxglove.sh FOLDER_OF_PROGRAMS WORK_FOLDER

set -euo pipefail

programs=$(realpath "$1")
mkdir -p "$2"
work=$(realpath "$2")
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
export ROS_DOMAIN_ID=${ROS_DOMAIN_ID:-217} ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
pids=()
stop() {
    local pid
    for pid in "${pids[@]}"; do kill -INT "$pid" 2>/dev/null || true; done
    wait
}
trap stop EXIT

mkdir -p "$work/client"
cp tests/interop/foxglove/{package.json,client.mjs} "$work/client"
npm install --silent --no-audit --no-fund --prefix "$work/client"

"$programs/whorl" run leader_follower_short --out "$work/runs" >"$work/run.log" 2>&1 &
pids+=($!)
"$programs/whorl" live whorl_1 whorl_2 --port 0 --read-only --foxglove >"$work/live.log" 2>&1 &
pids+=($!)
for _ in $(seq 100); do
    address=$(sed -n 's/^Foxglove at //p' "$work/live.log")
    [ -z "$address" ] || break
    sleep 0.1
done
node "$work/client/client.mjs" "${address:?whorl live did not start: $(cat "$work/live.log")}" params/views/formation.foxglove.json whorl_1 whorl_2
