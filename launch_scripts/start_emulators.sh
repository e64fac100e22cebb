#!/usr/bin/env bash
# Emulates the devices of platforms, for --backend hardware: start_emulators.sh whorl_1 whorl_2
# shellcheck source-path=SCRIPTDIR source=common.sh
. "$(dirname "$0")/common.sh"
whorl emulators -- "$@"
