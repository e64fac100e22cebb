#!/usr/bin/env bash
# Runs the whole test command again and again beside two busy loops: a test that depends on being scheduled in time fails here.
#   tests/measures/ten_times.sh [TIMES]      (default 10; the exit status is 1 when any run failed)

set -euo pipefail

cd "$(dirname "${BASH_SOURCE[0]}")/../.."
times=${1:-10}
log=$(mktemp -t whorl-ten-times-XXXXXX)
loops=()

finish() {
    [ "${#loops[@]}" -eq 0 ] || kill "${loops[@]}" 2>/dev/null || true
    rm -f "$log"
}
trap finish EXIT
trap 'exit 130' INT TERM

command=(cargo test --release --workspace --locked --no-fail-fast)
if pkg-config --exists openssl 2>/dev/null; then command+=(--features security); fi
"${command[@]}" --no-run

for _ in 1 2; do
    (while :; do :; done) &
    loops+=($!)
done
failed=0
for ((run = 1; run <= times; run++)); do
    begun=$SECONDS
    if "${command[@]}" >"$log" 2>&1; then result=green; else
        result="FAILED: $(sed -n 's/^test \(.*\) \.\.\. FAILED$/\1/p' "$log" | sort -u | tr '\n' ' ')"
        failed=$((failed + 1))
    fi
    passed=$(awk "/^test result:/ {n += \$4} END {print n + 0}" "$log")
    printf 'run %d of %d: %s; %s tests passed in %d s\n' "$run" "$times" "$result" "$passed" "$((SECONDS - begun))"
done
printf 'all: %d of %d green beside two busy loops, on %d cores\n' "$((times - failed))" "$times" "$(nproc)"
[ "$failed" -eq 0 ]
