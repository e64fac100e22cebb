#!/usr/bin/env python3
"""Writes cases whose truth comes from MuJoCo and Basilisk: CSV files, channel map, platform file, and the answer apart.

    python3 -m venv venv && venv/bin/pip install -r requirements.txt
    venv/bin/python make.py cases                        # every case, seed 1
    venv/bin/python make.py cases --seeds 1 3 5 --only ball_damping craft_slosh
"""

import argparse
import sys
from multiprocessing import Pool
from pathlib import Path

import case


def simulators():
    """The cases of each simulator that is installed."""
    found = {}
    for module in ("mujoco_rigs", "basilisk_craft"):
        try:
            found |= {name: module for name in __import__(module).CASES}
        except ImportError as error:
            print(f"left out: {module}: {error}", file=sys.stderr)
    return found


def write(task):
    folder, module, name, seed, seconds = task
    rig, runs, answer, errors = __import__(module).make(name, seed, seconds)
    case.write(folder / f"{name}_{seed}", rig, runs, answer, seed, errors)
    return f"{name}_{seed}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--only", nargs="+", metavar="CASE")
    parser.add_argument("--seconds", type=float, default=60.0, help="length of each run")
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    found = simulators()
    unknown = sorted(set(arguments.only or []) - set(found))
    if unknown:
        parser.error(f"no case {', '.join(unknown)}; there are: {', '.join(sorted(found))}")
    tasks = [
        (arguments.folder, module, name, seed, arguments.seconds)
        for name, module in found.items()
        if not arguments.only or name in arguments.only
        for seed in arguments.seeds
    ]
    with Pool(arguments.jobs) as pool:
        for done, name in enumerate(pool.imap_unordered(write, tasks), 1):
            print(f"{done}/{len(tasks)} {name}", flush=True)


if __name__ == "__main__":
    main()
