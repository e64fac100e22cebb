#!/usr/bin/env bash
# Checks Whorl against independent implementations: Eclipse Cyclone DDS, rosbags and mcap from PyPI.
#
# usage: run.sh [RUN...]      also reads these run directories
#
# Needs built binaries (WHORL_BIN, default target/release) and python3 with venv. Everything stays on the
# loopback interface, in its own ROS domain. WHORL_VENV: where the Python packages go (default .venv).

set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(cd "$here/../.." && pwd)
bin=${WHORL_BIN:-$root/target/release}
venv=${WHORL_VENV:-$root/.venv}
python=$venv/bin/python
work=$(mktemp -d -t whorl-interop-XXXXXX)
pids=()

finish() {
    local status=$?
    trap - EXIT
    trap '' INT TERM
    stop_nodes
    if [ "$status" -ne 0 ]; then
        printf 'interoperability checks failed; last lines of the logs:\n' >&2
        tail -n 5 "$work"/*.log >&2 2>/dev/null || true
    fi
    rm -rf "$work"
    exit "$status"
}
trap finish EXIT
trap 'exit 130' INT TERM

stop_nodes() {
    local pid
    for pid in "${pids[@]}"; do kill -INT "$pid" 2>/dev/null || true; done
    for pid in "${pids[@]}"; do
        for _ in $(seq 50); do
            kill -0 "$pid" 2>/dev/null || break
            sleep 0.1
        done
        kill -KILL "$pid" 2>/dev/null || true
        wait "$pid" 2>/dev/null || true
    done
    pids=()
}

# A domain that no test on this machine has: the lock is that of tests/support/domain.rs.
take_domain() {
    local id
    for id in $(seq 99 -1 20); do
        lock=${TMPDIR:-/tmp}/whorl-test-domain-$id
        # It may belong to another user: only the owner may write to it, but anyone may lock it.
        [ -e "$lock" ] || : >"$lock"
        exec 9<"$lock"
        if flock -n 9; then
            export ROS_DOMAIN_ID=$id
            return
        fi
    done
    printf 'error: no free ROS domain\n' >&2
    exit 1
}

# start NAME ARGUMENTS...: a node in the background. The node does not inherit the lock on the domain.
start() {
    local name=$1
    shift
    "$bin/$name" --ros-args "$@" >"$work/$name.log" 2>&1 9<&- &
    pids+=($!)
}

say() {
    printf '\n-- %s\n' "$*"
}

for name in driver estimator recorder; do
    [ -x "$bin/$name" ] || { printf 'error: %s/%s is not there: build it, or set WHORL_BIN\n' "$bin" "$name" >&2; exit 2; }
done
if [ ! -x "$python" ]; then
    say "Python packages into $venv"
    python3 -m venv "$venv"
fi
"$python" -m pip install --quiet --disable-pip-version-check --requirement "$here/requirements.txt"

unset ROS_LOCALHOST_ONLY ROS_AUTOMATIC_DISCOVERY_RANGE ROS_STATIC_PEERS
take_domain
say "one platform without local control in domain $ROS_DOMAIN_ID"
own=(-r __ns:=/whorl_1 --params-file "$root/params/common.yaml" --params-file "$root/params/whorl_1.yaml")
start recorder --params-file "$root/params/common.yaml" -p formation.platforms:=[whorl_1] -p "run_directory:=$work/run" \
    -p max_file_age_s:=5.0
start driver "${own[@]}" --params-file "$root/params/truth/whorl_1.yaml"
start estimator "${own[@]}"

say "Cyclone DDS reads /whorl_1/attitude/estimate"
"$python" "$here/cyclone.py" read /whorl_1/attitude/estimate whorl_msgs/msg/AttitudeEstimate --count 200 --seconds 30 \
    >"$work/estimates.json"
"$python" - "$work/estimates.json" <<'PY'
import json, math, sys
estimates = [json.loads(line) for line in open(sys.argv[1])]
last = estimates[-1]
q = last["q_world_body"]
assert len(estimates) == 200 and last["health"] == 1, last["health"]
assert abs(math.hypot(q["x"], q["y"], q["z"], q["w"]) - 1.0) < 1e-9, q
assert len(last["covariance"]) == 36 and last["covariance"][0] > 0.0
sequence = [e["sequence"] for e in estimates]
assert sequence == sorted(sequence), "out of order"
print(f"{len(estimates)} estimates, {sequence[-1] - sequence[0] + 1 - len(estimates)} lost")
PY

say "Cyclone DDS sees the nodes and their parameters"
"$python" "$here/cyclone.py" nodes --seconds 3 | tee "$work/nodes.json"
for node in /whorl_1/driver /whorl_1/estimator /recorder; do
    grep -q "\"$node\"" "$work/nodes.json"
done
"$python" "$here/cyclone.py" get /whorl_1/estimator tf_rate_hz
"$python" "$here/cyclone.py" set /whorl_1/estimator tf_rate_hz 10.0 | tee "$work/set.json"
grep -q '"successful": true' "$work/set.json"
"$python" "$here/cyclone.py" set /whorl_1/estimator tf_rate_hz -1.0 | tee "$work/refused.json"
grep -q '"successful": false' "$work/refused.json"

say "the driver obeys Cyclone DDS, then times out"
"$python" "$here/driver_obeys.py" whorl_1

stop_nodes
say "rosbags and mcap read what was recorded meanwhile, in several files"
[ -f "$work/run/bag/bag_1.mcap" ]
"$python" "$here/read_bag.py" "$work/run" --expect-topics /whorl_1/imu/data_raw /whorl_1/attitude/estimate \
    /whorl_1/actuators/command /whorl_1/wheels/state /whorl_1/thrusters/state /diagnostics /tf
for run in "$@"; do
    "$python" "$here/read_bag.py" "$run"
done
say "interoperability checks passed"
