#!/usr/bin/env bash
# Stops every node that the scripts in this folder started on this machine in this ROS domain.
# shellcheck source-path=SCRIPTDIR source=common.sh
. "$(dirname "$0")/common.sh"
build_programs --no-build
exec "$bin/whorl" nodes stop "$@"
