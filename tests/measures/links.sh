#!/usr/bin/env bash
# A formation on three computers (network namespaces) with poor links, cuts up to two minutes and a restart: prints what
# docs/links.md says. Needs root; takes eight minutes.
#   tests/measures/links.sh [REPORT.html]

set -euo pipefail

cd "$(dirname "${BASH_SOURCE[0]}")/../.."
[ "$(id -u)" -eq 0 ] || { printf 'error: network namespaces need root\n' >&2; exit 1; }
[ -z "${1:-}" ] || export WHORL_LINKS_REPORT=$1
features=()
if pkg-config --exists openssl 2>/dev/null; then features=(--features security); fi
exec cargo test --release --workspace --locked ${features[@]+"${features[@]}"} --test integration -- ros::links --include-ignored --nocapture
