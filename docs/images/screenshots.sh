#!/usr/bin/env bash
# Makes the pictures of the README from real runs: simulates each experiment, opens its page in headless Chromium, and
# keeps what the first screen shows. usage: docs/images/screenshots.sh [WHORL], by default target/release/whorl

set -euo pipefail

cd "$(dirname "${BASH_SOURCE[0]}")/../.."
whorl=${1:-target/release/whorl}
chromium=${CHROMIUM:-chromium}
work=$(mktemp -d -t whorl-screenshots-XXXXXX)
trap 'rm -rf "$work"' EXIT

# picture EXPERIMENT TIME HEIGHT: the page of its run at that time [s] as docs/images/EXPERIMENT.png.
picture() {
    "$whorl" simulate --experiment "params/experiments/$1.yaml" --out "$work/$1" --seed 1
    "$chromium" --headless --no-sandbox --disable-gpu --disable-dev-shm-usage --hide-scrollbars \
        --user-data-dir="$work/profile" --window-size="1300,$3" --virtual-time-budget=15000 \
        --screenshot="docs/images/$1.png" "file://$work/$1/report.html#t=$2" 2>/dev/null
}

picture leader_follower 45 640
picture behavioural 60 640

# The page of what was adopted: measured and predicted on a run that was not fitted, before and after.
"$whorl" demo --seed 3 --no-open --out "$work/demo"
"$chromium" --headless --no-sandbox --disable-gpu --disable-dev-shm-usage --hide-scrollbars \
    --user-data-dir="$work/profile" --window-size=1300,880 --virtual-time-budget=15000 \
    --screenshot=docs/images/demo_fall.png "file://$work/demo/adopt.html" 2>/dev/null
