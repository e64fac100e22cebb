#!/usr/bin/env bash
# Starts the node set of one platform: driver, estimator, local control, model monitor. Ctrl-C stops it.
# shellcheck source-path=SCRIPTDIR source=common.sh
. "$(dirname "$0")/common.sh"
whorl nodes platform -- "$@"
