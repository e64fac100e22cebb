#!/usr/bin/env bash
# Starts the recorder: every topic into a run directory. Ctrl-C stops it.
# shellcheck source-path=SCRIPTDIR source=common.sh
. "$(dirname "$0")/common.sh"
whorl nodes recorder -- "$@"
