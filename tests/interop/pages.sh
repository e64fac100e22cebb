#!/usr/bin/env bash
# Makes one page of every kind from simulated runs and looks at all of them (look_at_pages.py).
# usage: pages.sh WHORL FOLDER; pages are left in FOLDER/pages, pictures in FOLDER/pictures

set -euo pipefail

whorl=$(realpath "$1")
mkdir -p "$2/pages"
work=$(realpath "$2")
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
pages=$work/pages
quiet() { "$@" >>"$work/pages.log" || { tail -20 "$work/pages.log" >&2; return 1; }; }

# A hidden friction, so that there is something to explain.
hidden=/whorl_1/driver:truth.effects.bearing_viscous_friction.c_n_m_s:=0.2
for seed in 1 2; do
    quiet "$whorl" simulate --experiment swing -p "$hidden" --seed $seed --out "$work/runs/swing_$seed"
    quiet "$whorl" simulate --experiment leader_follower_short --seed $seed --out "$work/runs/pair_$seed"
done
runs=("$work/runs/swing_1" --held-out "$work/runs/swing_2" --platform whorl_1 --model params/whorl_1.yaml)
cp "$work/runs/pair_1/report.html" "$pages/report.html"
quiet "$whorl" runs "$work/runs" --html "$pages/runs.html"
quiet "$whorl" compare-runs "$work/runs/pair_1" "$work/runs/pair_2" --html "$pages/compare_runs.html"
for command in compare where diagnose; do quiet "$whorl" $command "${runs[@]}" --html "$pages/$command.html"; done
quiet "$whorl" discover "${runs[@]}" --anyway --html "$pages/discover.html"
mkdir -p "$work/params/experiments"
cp params/whorl_1.yaml params/common.yaml "$work/params"
quiet "$whorl" adopt "$work/runs/swing_1" bearing_viscous_friction --held-out "$work/runs/swing_2" --platform whorl_1 \
    --out "$work/params/whorl_1.yaml" --html "$pages/adopt.html"
quiet "$whorl" next "${runs[@]}" --out "$work/params/experiments/separate.yaml" --html "$pages/next.html"
quiet "$whorl" history "$work/runs/swing_1" "$work/runs/swing_2" --platform whorl_1 --html "$pages/history.html"
quiet "$whorl" orbit co_observation --html "$pages/orbit.html"
quiet "$whorl" campaign params/campaigns/link.yaml --seeds 2 --out "$work/campaign"
cp "$work/campaign/percentiles.html" "$pages/campaign.html"
quiet "$whorl" reproduce table_4_3 fig_4_4 fig_4_16 --html "$pages/reproduce.html"
python3 tests/interop/look_at_pages.py --pictures "$work/pictures" "$pages"/*.html
