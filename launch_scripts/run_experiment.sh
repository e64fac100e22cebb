#!/usr/bin/env bash
# Runs one experiment from start to report: node sets of all platforms, coordinator, recorder.
# shellcheck source-path=SCRIPTDIR source=common.sh
. "$(dirname "$0")/common.sh"
whorl run -- "$@"
