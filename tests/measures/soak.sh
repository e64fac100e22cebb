#!/usr/bin/env bash
# Runs two platforms over DDS for a long time and says what grew: memory, open files and threads of every process, and how old
# sensor samples were when commands were made from them.
#
# usage: soak.sh [MINUTES] [ARGUMENTS OF whorl run]     (default 480: a night; needs built binaries)
#
# The first ten minutes are left out: buffers and histories fill. The exit status is 1 when anything grew by more than the
# limits below, when a process was started again, or when the experiment did not pass. In less than 40 minutes growth of memory
# is shown and not judged: half an hour is the least in which an hour's growth is more than how allocators breathe.
# The ROS domain is ROS_DOMAIN_ID; WHORL_TARGET the folder of the programs (default target/release); WHORL_SOAK_DIR where the
# run and samples.csv are kept (default: they are removed).

set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
minutes=${1:-480}
shift || true
whorl=${WHORL_TARGET:-$root/target/release}/whorl
work=${WHORL_SOAK_DIR:-$(mktemp -d -t whorl-soak-XXXXXX)}
[ -n "${WHORL_SOAK_DIR:-}" ] || trap 'rm -rf "$work"' EXIT
mkdir -p "$work"
state=${XDG_RUNTIME_DIR:-/tmp}/whorl-$(id -u)-domain-${ROS_DOMAIN_ID:-0}

# Holds with a slow slew of both in between, so that every part has something to do. Each platform holds about the attitude in
# which its model rests: elsewhere gravity would load its wheels all the time, and unloading them empty its tank.
python3 - "$root/params/experiments/hold.yaml" "$minutes" >"$work/soak.yaml" <<'PY'
import sys
text, minutes = open(sys.argv[1]).read(), float(sys.argv[2])
steps = ["      settle: {kind: settle, duration_s: 15.0, yaw_deg: 0.0, pitch_deg: -0.6, roll_deg: 2.0}"]
for k in range(max(1, round((60 * minutes - 15) / 60))):
    steps.append(f"      slew_{k}: {{kind: slew, duration_s: 15.0, yaw_deg: {10.0 * (k % 2)}}}")
    steps.append(f"      hold_{k}: {{kind: hold, duration_s: 45.0}}")
head, rest = text.split("    steps:\n", 1)
tail = rest.split("\n\n", 1)[1]
offset = "offset: {yaw_deg: 20.0, pitch_deg: -2.6, roll_deg: -7.4}"
assert "offset: {yaw_deg: 20.0}" in head
head = head.replace("offset: {yaw_deg: 20.0}", offset)
print(head + "    steps:\n" + "\n".join(steps) + "\n\n" + tail)
PY

"$whorl" run "$work/soak.yaml" --root "$root" --params "$root/params" --out "$work" "$@" >"$work/log" 2>&1 &
experiment=$!

echo "time_s,process,pid,memory_kb,files,threads" >"$work/samples.csv"
began=$SECONDS
while kill -0 "$experiment" 2>/dev/null; do
    for file in "$state"/*.pid; do
        pid=$(cat "$file" 2>/dev/null) || continue
        status=$(cat "/proc/$pid/status" 2>/dev/null) || continue
        files=$(find "/proc/$pid/fd" -mindepth 1 2>/dev/null | wc -l)
        memory=$(sed -n 's/^VmRSS:[^0-9]*\([0-9]*\).*/\1/p' <<<"$status")
        threads=$(sed -n 's/^Threads:[^0-9]*//p' <<<"$status")
        echo "$((SECONDS - began)),$(basename "$file" .pid),$pid,$memory,$files,$threads"
    done >>"$work/samples.csv"
    sleep 5
done
failed=0
wait "$experiment" || failed=$?
grep -E "started again|error|warning" "$work/log" | head -20 || true
tail -n 4 "$work/log"

run=$(find "$work" -maxdepth 1 -name "*_*" -type d | sort | tail -n 1)/
python3 - "$work/samples.csv" "$run" "$failed" <<'PY'
import csv, json, statistics, sys
# Growth over an hour that is no leak: allocators hand memory back late. A recorder keeps an index of its file.
FILLING_S, LEAST_S = 600.0, 1800.0
MOST_MB_H, MOST_MB_H_RECORDER, MOST_AT_ALL_MB = 1.0, 4.0, 1.0
samples, run, failed = sys.argv[1], sys.argv[2], int(sys.argv[3])
rows = {}
for row in csv.DictReader(open(samples)):
    rows.setdefault(row["process"], []).append(row)
wrong = [f"the experiment ended with {failed}"] if failed else []
lasted_s = max((float(own[-1]["time_s"]) for own in rows.values()), default=0.0)
judged = lasted_s >= FILLING_S + LEAST_S
print(f"{'':24} {'MB':>7} {'MB/h':>7} {'files':>7} {'threads':>7}")
for name, own in sorted(rows.items()):
    if len({row["pid"] for row in own}) > 1:
        wrong.append(f"{name} was started again")
    end_s = float(own[-1]["time_s"])
    kept = [row for row in own if float(row["time_s"]) > min(FILLING_S, end_s / 6)]
    hours = (float(kept[-1]["time_s"]) - float(kept[0]["time_s"])) / 3600
    tenth = max(1, len(kept) // 10)
    def grown(key):
        values = [int(row[key]) for row in kept]
        return statistics.median(values[-tenth:]) - statistics.median(values[:tenth])
    # Between the medians of the first and the last tenth lie nine tenths of the time.
    grown_mb = grown("memory_kb") / 1024
    mb_h = grown_mb / max(0.9 * hours, 1e-9)
    files, threads = grown("files"), grown("threads")
    print(f"{name:24} {int(kept[-1]['memory_kb']) / 1024:7.1f} {mb_h:7.2f} {files:+7.0f} {threads:+7.0f}")
    most = MOST_MB_H_RECORDER if name == "recorder" else MOST_MB_H
    if judged and mb_h > most and grown_mb > MOST_AT_ALL_MB:
        wrong.append(f"{name}: {grown_mb:.1f} MB more, {mb_h:.1f} MB an hour")
    if files > 0 or threads > 0:
        wrong.append(f"{name}: {files:+.0f} files, {threads:+.0f} threads")
try:
    for p in json.load(open(run + "summary.json"))["platforms"]:
        print(f"{p['name']}: sensor stamp to command, median {p['sensor_to_command_p50_s'] * 1e3:.2f} ms, "
              f"99 % {p['sensor_to_command_p99_s'] * 1e3:.2f} ms")
except (OSError, KeyError) as error:
    wrong.append(f"no summary: {error}")
fine = "nothing grew" if judged else "no files and threads more; too short to judge memory by (40 minutes)"
print(fine if not wrong else "\n".join(["WRONG"] + wrong))
sys.exit(bool(wrong))
PY
