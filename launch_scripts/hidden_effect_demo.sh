#!/usr/bin/env bash
# Hides an effect in a simulated platform: an experiment over DDS, find it, adopt it, and the experiment again.
# shellcheck source-path=SCRIPTDIR source=common.sh
. "$(dirname "$0")/common.sh"
whorl demo --dds -- "$@"
