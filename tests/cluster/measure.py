#!/usr/bin/env python3
"""What an engine adds to a task: campaigns whose runs end as they begin, by threads, by Slurm and by Dask.

    measure.py WHORL [--runs 10 100 1000] [--parts 16] [--engines threads slurm dask]

Prints processor time (of the program, its tasks and the engine's own daemons, from start to end) and time on the clock for each
number of runs, and the machine's load. Slurm: two slurmd on this machine, as in slurm.py. Dask: two workers; it needs the Python
package of the same version. Engines that are not there are left out.
"""

import argparse
import ctypes
import os
import pathlib
import resource
import subprocess
import sys
import tempfile
import time

import slurm

CAMPAIGN = """
/campaign:
  ros__parameters:
    name: nothing
    experiments: [leader_follower]
    seeds: {runs}
    longest_s: 0.01
"""
PR_SET_CHILD_SUBREAPER = 36


def processor_s():
    """Of everything that has ended below this process, tasks of daemons included: they become ours."""
    try:
        while os.waitpid(-1, os.WNOHANG) != (0, 0):
            pass
    except ChildProcessError:
        pass
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def by_threads(command, _):
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def by_slurm(command, parts):
    with tempfile.TemporaryDirectory(prefix="whorl-slurm-") as name:
        cluster = slurm.Cluster(pathlib.Path(name))
        try:
            subprocess.run([*command, "--engine", "slurm", "--tasks", str(parts)], check=True, env=cluster.environment, stdout=subprocess.DEVNULL)
        finally:
            cluster.end()
            time.sleep(1)


def by_dask(command, _):
    _, _, file, _, params, _, out = command
    script = (
        "import sys, whorl\nfrom dask import distributed\n"
        "if __name__ == '__main__':\n"
        "    with distributed.LocalCluster(2, processes=True, threads_per_worker=1, dashboard_address=None) as cluster:\n"
        "        with distributed.Client(cluster) as client:\n"
        f"            whorl.Campaign({str(file)!r}, {str(out)!r}, params={str(params)!r}).run_with(client)\n"
    )
    with tempfile.NamedTemporaryFile("w", suffix=".py") as program:
        program.write(script)
        program.flush()
        subprocess.run([sys.executable, program.name], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


ENGINES = {"threads": by_threads, "slurm": by_slurm, "dask": by_dask}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("whorl", type=pathlib.Path)
    parser.add_argument("--runs", type=int, nargs="+", default=[10, 100, 1000])
    parser.add_argument("--parts", type=int, default=16)
    parser.add_argument("--engines", nargs="+", choices=ENGINES, default=list(ENGINES))
    given = parser.parse_args()
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    print("engine   runs  processor/run  clock/run  bytes/run  load")
    for engine in given.engines:
        for runs in given.runs:
            with tempfile.TemporaryDirectory(prefix="whorl-measure-") as name:
                folder = pathlib.Path(name)
                file = folder / "nothing.yaml"
                file.write_text(CAMPAIGN.format(runs=runs))
                out = folder / "out"
                command = [given.whorl.resolve(), "campaign", file, "--params", slurm.ROOT / "params", "--out", out]
                before, begun = processor_s(), time.monotonic()
                try:
                    ENGINES[engine](command, given.parts)
                except (FileNotFoundError, TypeError, TimeoutError, subprocess.CalledProcessError) as error:
                    print(f"{engine}: left out: {error}")
                    break
                clock_s, used_s = time.monotonic() - begun, processor_s() - before
                size = sum(path.stat().st_size for path in (out / "rows").iterdir())
                print(
                    f"{engine:8} {runs:4}  {1e3 * used_s / runs:10.1f} ms {1e3 * clock_s / runs:7.1f} ms {size / runs:8.0f}   "
                    f"{os.getloadavg()[0]:.1f}", flush=True,
                )
    return 0


if __name__ == "__main__":
    sys.exit(main())
