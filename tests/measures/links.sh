#!/usr/bin/env bash
# A formation on three computers (network namespaces) with poor links, cuts up to two minutes and a restart: prints what
# docs/links.md says. Needs root; takes eight minutes.
#   tests/measures/links.sh [REPORT.html]

set -euo pipefail

cd "$(dirname "${BASH_SOURCE[0]}")/../.."
[ "$(id -u)" -eq 0 ] || { printf 'error: network namespaces need root\n' >&2; exit 1; }
export WHORL_LINKS=long WHORL_SLOW_TESTS=1
[ -z "${1:-}" ] || export WHORL_LINKS_REPORT=$1
exec cargo test -p whorl_tests --locked -- ros::links --nocapture
