#!/usr/bin/env bash
# Starts the coordinator: experiment sequence, relative-attitude law, authority heartbeat. Ctrl-C stops it.
# shellcheck source-path=SCRIPTDIR source=common.sh
. "$(dirname "$0")/common.sh"
whorl nodes coordinator -- "$@"
