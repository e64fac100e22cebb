#!/usr/bin/env bash
# A secret effect in the truth of a simulated platform: find it, adopt it, watch both errors fall.
here=$(dirname "$0")
# shellcheck source-path=SCRIPTDIR source=common.sh
. "$here/common.sh"

usage() {
    cat <<'TXT'
usage: hidden_effect_demo.sh [options]

Draws an effect that the platform's model does not have and hides it in the simulated hardware. Then, on
real runs over DDS: an experiment, how far the model is off, where, which effect is missing, adopting it,
and the same experiment again with the new model. Prints both falls: prediction and pointing. Five
minutes; everything goes to a folder of its own. DDS stays on this machine, in a ROS domain of its own.

  --effect NAME   harness_spring, bearing_viscous_friction or bearing_coulomb_friction
                  (default: one of the first two is drawn)
  --seed N        which effect, how large, and all noise (default: drawn)
  --out DIR       keeps runs, parameters and pages there (default: removed at the end)
  --no-build      use the binaries that are there
TXT
}

need_value() {
    if [ $# -lt 2 ] || [ -z "$2" ]; then die "$1 needs a value"; fi
}

seed=
keep=
effect=
build=--build
while [ $# -gt 0 ]; do
    case $1 in
        -h | --help) usage; exit 0 ;;
        --effect) need_value "$@"; effect=$2; shift 2 ;;
        --seed) need_value "$@"; seed=$2; shift 2 ;;
        --out) need_value "$@"; keep=$2; shift 2 ;;
        --no-build) build=--no-build; shift ;;
        *) usage >&2; die "unknown option $1" ;;
    esac
done
[ -n "$seed" ] || seed=$RANDOM
case $seed in *[!0-9]*) die "the seed is a whole number, not '$seed'" ;; esac

case $effect in
    '' | harness_spring | bearing_viscous_friction | bearing_coulomb_friction) ;;
    *) die "no secret '$effect'; there are: harness_spring, bearing_viscous_friction, bearing_coulomb_friction" ;;
esac
# Nobody else's nodes: no other machine's, and no other experiment's of this one.
export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_LOCALHOST_ONLY=1
export ROS_DOMAIN_ID=${ROS_DOMAIN_ID:-$((50 + $$ % 50))}

build_programs "$build"

if [ -n "$keep" ]; then
    mkdir -p "$keep"
    work=$(cd "$keep" && pwd)
    [ -z "$(ls -A "$work")" ] || die "$work is not empty"
else
    work=$(mktemp -d -t whorl-hidden-XXXXXX)
fi
child=
finish() {
    status=$?
    trap - EXIT
    trap '' INT TERM
    if [ -n "$child" ] && kill -0 "$child" 2>/dev/null; then
        # It stops the nodes that it started.
        kill -TERM "$child" 2>/dev/null || true
        wait "$child" 2>/dev/null || true
    fi
    if [ -z "$keep" ]; then
        rm -rf "$work"
        [ "$status" -eq 0 ] || printf 'nothing was kept; with --out DIR runs, parameters and pages are\n' >&2
    else
        [ "$status" -eq 0 ] || printf 'kept in %s: %s\n' "$work" "$(cd "$work" && ls | tr '\n' ' ')" >&2
    fi
    exit "$status"
}
interrupt() {
    printf '\nstopped after %d s\n' "$SECONDS" >&2
    exit 130
}
trap finish EXIT
trap interrupt INT TERM

say() { printf '\n== %s  [%d s]\n' "$*" "$SECONDS"; }

# show COMMAND...: prints a command as a user would type it, then runs it.
show() {
    printf '$ whorl'
    printf ' %s' "${@//$work\//}"
    printf '\n'
    (cd "$work" && "$bin/whorl" "$@")
}

# number FILE KEY [N]: the N-th number of this key in a JSON file.
number() {
    grep -o "\"$2\": *-\{0,1\}[0-9][0-9.eE+-]*" "$1" | sed 's/.*: *//' | sed -n "${3:-1}p"
}

# pointing RUN: RMS angle between attitude and reference over the whole run [rad].
pointing() {
    local table
    rm -rf "$work/topics"
    "$bin/whorl" export csv "$1" --out "$work/topics" --topics >/dev/null
    table=$(find "$work/topics" -name '*control_status*' | head -n 1)
    awk -F, 'NR == 1 { for (i = 1; i <= NF; i++) if ($i ~ /^attitude_error_b_rad/) column[++n] = i; next }
        $column[1] != "NaN" { for (k = 1; k <= n; k++) sum += $column[k] ^ 2; count++ }
        END { printf "%.9f\n", sqrt(sum / count) }' "$table"
    rm -rf "$work/topics"
}

# The secret: drawn here, read only by the driver's simulated hardware.
cp -r "$root/params" "$work/params"
awk -v seed="$seed" -v effect="$effect" '
    # Park and Miller: the same numbers with every awk.
    function draw(low, high) { state = (state * 16807) % 2147483647; return low + (high - low) * state / 2147483647 }
    BEGIN {
        state = seed * 7919 % 2147483646 + 1
        for (i = 0; i < 10; i++) draw(0, 1)
        print "# Drawn by hidden_effect_demo.sh: what the model does not know."
        print "/whorl_1/driver:\n  ros__parameters:\n    truth:"
        printf "      inertia_kg_m2: {xx: %.3f, yy: %.3f, zz: %.3f}\n", 6.2 * draw(0.98, 1.02), 7.5 * draw(0.98, 1.02), 12.1 * draw(0.98, 1.02)
        printf "      gravity_offset_n_m: [%.4f, %.4f, %.3f]\n", draw(-0.023, -0.017), draw(-0.076, -0.064), -2.0 * draw(0.95, 1.05)
        print "      effects:"
        if (effect == "") effect = draw(0, 1) < 0.5 ? "bearing_viscous_friction" : "harness_spring"
        if (effect == "bearing_coulomb_friction")
            printf "        bearing_coulomb_friction: {torque_n_m: %.4f}\n", draw(0.05, 0.08)
        else if (effect == "bearing_viscous_friction")
            printf "        bearing_viscous_friction: {c_n_m_s: %.3f}\n", draw(0.2, 0.3)
        else
            printf "        harness_spring: {k_n_m_rad: %.3f, yaw0_rad: %.3f}\n", draw(0.2, 0.35), (draw(0, 1) < 0.5 ? -1 : 1) * draw(0.45, 0.75)
    }' >"$work/params/truth/whorl_1.yaml"

# experiment FOLDER NAME SEED: one experiment over DDS; sets `recorded`.
experiment() {
    mkdir -p "$work/$1"
    # In the background, so that a signal reaches this script at once.
    "$here/run_experiment.sh" "$2" --platforms whorl_1 --params "$work/params" --out "$work/$1" \
        --seed "$3" --no-build >"$work/$1.log" 2>&1 &
    child=$!
    if ! wait "$child"; then
        tail -n 20 "$work/$1.log" >&2
        die "the experiment failed"
    fi
    child=
    recorded=$(find "$work/$1" -mindepth 1 -maxdepth 1 -type d | head -n 1)
    printf 'recorded %s\n' "${recorded#"$work"/}"
}

say "an experiment, twice: the first run is fitted, the second judges"
experiment first swing "$seed"
first=$recorded
experiment second swing "$((seed + 1))"
second=$recorded
pointing_before=$(pointing "$first")

adopted=$work/params/whorl_1.yaml
judge=(--held-out "$second" --model "$adopted" --platform whorl_1)
say "how far is the model off?"
show compare "$first" "${judge[@]}" --html "$work/compare.html" --json "$work/compare.json" | sed -n '1,14p'
say "where does it fail?"
show where "$first" "${judge[@]}" --html "$work/where.html" | sed -n '1,14p'
say "which effect is missing?"
show diagnose "$first" "${judge[@]}" --json "$work/diagnosis.json" --html "$work/diagnosis.html" | sed -n '1,40p'

# effects FILE: the best set, one a line.
effects() { tr -d '\n' <"$1" | grep -o '"effects": *\[[^]]*\]' | head -n 1 | grep -o '"[a-z_]*"' | tr -d '"' | grep -v '^effects$' || true; }
verdict() { grep -o '"verdict": *"[a-z_]*"' "$1" | sed 's/.*"\([a-z_]*\)"/\1/'; }

fitted=("$first")
if [ "$(verdict "$work/diagnosis.json")" = confounded ] && "$bin/whorl" next --help >/dev/null 2>&1; then
    say "the data leave several explanations: a manoeuvre that separates them"
    show next "$first" "${judge[@]}" --out "$work/params/experiments/separate.yaml" | sed -n '1,12p'
    experiment separate separate "$((seed + 2))"
    fitted+=("$recorded")
    show diagnose "${fitted[@]}" "${judge[@]}" --json "$work/diagnosis.json" --html "$work/diagnosis.html" | sed -n '1,40p'
fi
mapfile -t found < <(effects "$work/diagnosis.json")
[ "${#found[@]}" -gt 0 ] || die "no effect was named: see $work/diagnosis.json (with --out it is kept)"

say "adopting ${found[*]}"
cp "$adopted" "$work/whorl_1_before.yaml"
show adopt "${fitted[@]}" "${found[@]}" "${judge[@]}" --out "$adopted" --json "$work/adopt.json" --html "$work/adopt.html"

say "the same experiment with the adopted model"
experiment third swing "$((seed + 3))"
third=$recorded
pointing_after=$(pointing "$third")
for which in before after; do
    file=$adopted
    [ "$which" = after ] || file=$work/whorl_1_before.yaml
    "$bin/whorl" compare "$third" --model "$file" --platform whorl_1 --json "$work/third_$which.json" \
        --html "$work/third_$which.html" >/dev/null
done
# Of the whitened residual: the square root of chi-squared over its degrees of freedom.
prediction() { number "$1" chi_squared_per_degree; }

say "the secret was"
sed -n '/effects:/,$p' "$work/params/truth/whorl_1.yaml"
printf 'found: %s\n\n' "${found[*]}"
awk -v a="$(prediction "$work/third_before.json")" -v b="$(prediction "$work/third_after.json")" \
    -v c="$pointing_before" -v d="$pointing_after" 'BEGIN {
    degree = 180 / atan2(0, -1)
    printf "%-44s %10s %10s\n", "", "before", "after"
    printf "%-44s %10.2f %10.2f\n", "prediction error of the new run (1 = noise)", sqrt(a), sqrt(b)
    printf "%-44s %10.4f %10.4f\n", "pointing error [deg RMS]", c * degree, d * degree
}'
secret=$(sed -n 's/^        \([a-z_]*\):.*/\1/p' "$work/params/truth/whorl_1.yaml")
awk -v a="$(prediction "$work/third_before.json")" -v b="$(prediction "$work/third_after.json")" \
    'BEGIN { exit !(b < a) }' || die "the prediction error did not fall"
case " ${found[*]} " in *" $secret "*) ;; *) die "found ${found[*]}, but the secret was $secret" ;; esac
[ "${found[*]}" = "$secret" ] || printf 'more was found than the secret: what its formula leaves\n'
awk -v c="$pointing_before" -v d="$pointing_after" 'BEGIN { exit !(d < c) }' || die "the pointing error did not fall"
printf 'both errors fell, in %d s\n' "$SECONDS"
[ -z "$keep" ] || printf 'pages: %s\n' "$work"/{compare,where,diagnosis,adopt,third_after}.html
