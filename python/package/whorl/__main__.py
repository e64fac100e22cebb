"""`python -m whorl campaign FILE --out FOLDER --scheduler ADDRESS`: what `whorl campaign --engine dask` calls."""

from __future__ import annotations

import argparse
import sys

from ._native import WhorlError
from .campaign import Campaign, connected


def main() -> int:
    """Computes what a campaign misses on the workers of a Dask scheduler. Prints the reason where that fails."""
    parser = argparse.ArgumentParser(prog="python -m whorl", description="Campaigns on Dask.")
    commands = parser.add_subparsers(dest="command", required=True)
    campaign = commands.add_parser("campaign", help="computes the missing tasks of a campaign on the workers of a Dask scheduler")
    campaign.add_argument("file", help="campaign file")
    campaign.add_argument("--out", required=True, help="its folder, which every worker sees at the same path")
    campaign.add_argument("--params", help="parameter folder, of campaigns over experiments")
    campaign.add_argument("--seeds", type=int, help="number of seeds, instead of the file's")
    campaign.add_argument("--scheduler", required=True, help="the scheduler, e.g. tcp://scheduler:8786")
    given = parser.parse_args()
    try:
        tasks = Campaign(given.file, given.out, params=given.params, seeds=given.seeds)
        with connected(given.scheduler) as client:
            tasks.run_with(client, progress=sys.stderr.isatty())
    except WhorlError as error:
        print(error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
