#!/usr/bin/env python3
"""A campaign on a real Slurm: slurmctld and two slurmd on this machine, in a folder and on ports of their own.

    slurm.py WHORL

The submitter is killed, then the daemon of a node: nothing is lost, and the table is that of threads, to the byte. The same for
questions to recordings, one of which cannot be read. Needs slurmctld, slurmd, slurm-client and munge (Debian) and root; exit status 3 where they are missing or do not start.
"""

import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
MISSING = 3
CAMPAIGN = """
/campaign:
  ros__parameters:
    name: on a cluster
    experiments: [leader_follower_short]
    seeds: 12
    sweep:
      delay_s: {key: "/simulation:link.delay_s", values: [0.001, 0.05, 0.1]}
"""


# Each task and the tables that it has: files beneath the campaign's folder.
RECORDINGS = {
    "compare": ["summary.csv", "table/rows.parquet", "channels/rows.parquet"],
    "diagnose": ["summary.csv", "table/rows.parquet", "candidates/rows.parquet"],
}


def free_ports(count):
    held = [socket.socket() for _ in range(count)]
    for one in held:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in held]
    for one in held:
        one.close()
    return ports


class Cluster:
    """munged, slurmctld and two slurmd; ended in the order in which they depend on each other."""

    def __init__(self, folder):
        self.folder = folder
        self.running = {}
        keys = folder / "munge"
        for path in (keys, folder / "state", folder / "spool_n1", folder / "spool_n2"):
            path.mkdir()
        keys.chmod(0o700)
        key = keys / "key"
        key.write_bytes(os.urandom(64))
        key.chmod(0o600)
        host = socket.gethostname().split(".")[0]
        controller, first, second = free_ports(3)
        self.environment = {**os.environ, "SLURM_CONF": str(folder / "slurm.conf")}
        (folder / "slurm.conf").write_text(
            f"""
ClusterName=whorl
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller}
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={keys}/socket
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool_%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd_%n.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
SwitchType=switch/none
SelectType=select/linear
ReturnToService=2
SlurmdTimeout=10
KillWait=2
MinJobAge=10
NodeName=n1 NodeHostname={host} NodeAddr=127.0.0.1 Port={first} CPUs=1
NodeName=n2 NodeHostname={host} NodeAddr=127.0.0.1 Port={second} CPUs=1
PartitionName=all Nodes=n1,n2 Default=YES
"""
        )
        munged = [f"--{name}={keys / file}" for name, file in [("key-file", "key"), ("socket", "socket")]]
        munged += [f"--{name}={keys / name}" for name in ("pid-file", "log-file", "seed-file")]
        self.start("munged", ["--foreground", "--force", *munged])
        wait(lambda: (keys / "socket").exists(), 10, "munged")
        self.start("slurmctld", ["-D", "-i"])
        for node in ("n1", "n2"):
            self.node(node)
        wait(lambda: self.say("sinfo", "-h", "-o", "%T").split() == ["idle"], 30, "two idle nodes")

    def start(self, name, arguments, key=None):
        with open(self.folder / f"{key or name}.log", "ab") as log:
            own = [shutil.which(name, path=os.environ["PATH"] + ":/usr/sbin:/sbin"), *arguments]
            process = subprocess.Popen(own, env=self.environment, stdout=log, stderr=log)
        self.running[key or name] = process

    def node(self, node):
        self.start("slurmd", ["-D", "-N", node], key=f"slurmd {node}")

    def say(self, *command):
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True, check=False)
        return done.stdout

    def end(self):
        for name, process in reversed(self.running.items()):
            if name == "munged":
                self.say("scancel", "--user=root")
            process.terminate()
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def wait(condition, seconds, what):
    until = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > until:
            raise TimeoutError(f"no {what} within {seconds} s")
        time.sleep(0.1)


def record(whorl, folder):
    """Recordings for campaigns over these: two short runs, one with a friction that the model lacks, and one that is torn."""
    friction = "/whorl_1/driver:truth.effects.bearing_viscous_friction.c_n_m_s:="
    for name, value in (("first", 0.3), ("second", 0.0)):
        command = [whorl, "simulate", "--experiment", ROOT / "params/experiments/swing.yaml", "--out", folder / "runs" / name]
        command += ["--no-report", "--longest", "12", "-p", f"{friction}{value}"]
        subprocess.run(command, check=True, capture_output=True)
    (folder / "runs/torn").mkdir()
    (folder / "runs/torn/manifest.yaml").write_text("state: recording\n")


def over_recordings(whorl, folder, cluster):
    """Each question to all recordings by threads, then by Slurm, whose submitter is killed at once: the same tables, to the byte."""
    for task, tables in RECORDINGS.items():
        begun = time.monotonic()
        campaign = folder / f"{task}.yaml"
        campaign.write_text(f"/campaign:\n  ros__parameters:\n    recordings: ['runs/*']\n    task: {task}\n    platforms: [whorl_1]\n")
        command = [whorl, "campaign", campaign, "--out"]
        subprocess.run([*command, folder / f"{task} threads"], check=True, stdout=subprocess.DEVNULL)
        slurm = [*command, folder / f"{task} cluster", "--engine", "slurm", "--tasks", "3"]
        submitter = subprocess.Popen(slurm, env=cluster.environment, stdout=subprocess.PIPE, text=True)
        said = submitter.stdout.readline()
        assert "3 of 3 parts" in said, said
        submitter.send_signal(signal.SIGKILL)
        submitter.wait()
        done = subprocess.run(slurm, env=cluster.environment, capture_output=True, text=True, timeout=240, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "3 of 3 recordings are done" in done.stdout and "runs/torn" in done.stdout, done.stdout
        for table in tables:
            here, there = (folder / f"{task} {engine}" / table for engine in ("threads", "cluster"))
            assert here.read_bytes() == there.read_bytes(), f"{task}: {table} is not that of threads"
        rows = (folder / f"{task} cluster/summary.csv").read_text().splitlines()
        assert len(rows) == 4 and "failed" in rows[3] and "done" in rows[1], rows
        print(f"{task} over recordings: {time.monotonic() - begun:.1f} s; the same tables")


def main():
    whorl = pathlib.Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory(prefix="whorl-slurm-") as name:
        folder = pathlib.Path(name)
        campaign = folder / "a campaign.yaml"
        campaign.write_text(CAMPAIGN)
        command = [whorl, "campaign", campaign, "--params", ROOT / "params"]

        elsewhere = {**os.environ, "PATH": str(folder)}
        slurm = [*command, "--engine", "slurm", "--tasks", "9", "--out", folder / "cluster"]
        done = subprocess.run(slurm, env=elsewhere, capture_output=True, text=True, check=False)
        assert done.returncode == 1 and "there is no `sbatch` on this machine" in done.stderr, done.stderr
        print("without Slurm:", done.stderr.strip())

        programs = ("munged", "slurmctld", "slurmd", "sbatch")
        missing = [p for p in programs if not shutil.which(p, path=os.environ["PATH"] + ":/usr/sbin:/sbin")]
        if missing or os.getuid() != 0:
            print(f"left out: needs root and {', '.join(missing) or 'nothing else'}")
            return MISSING

        begun = time.monotonic()
        subprocess.run([*command, "--out", folder / "threads"], check=True, stdout=subprocess.DEVNULL)
        print(f"threads: {time.monotonic() - begun:.1f} s")
        table = (folder / "threads/summary.csv").read_bytes()
        assert table.count(b"\n") == 37, table.count(b"\n")

        (folder / "slurm").mkdir()
        cluster = None
        try:
            cluster = Cluster(folder / "slurm")
        except TimeoutError as error:
            print(f"left out: {error}")
            return MISSING
        try:
            begun = time.monotonic()
            rows = folder / "cluster/rows"
            submitter = subprocess.Popen(slurm, env=cluster.environment, stdout=subprocess.PIPE, text=True)
            print("submitted:", submitter.stdout.readline().strip())
            wait(lambda: any(rows.glob("*.csv")), 60, "row")
            submitter.send_signal(signal.SIGKILL)
            submitter.wait()
            victim = cluster.running["slurmd n1"]
            victim.kill()
            victim.wait()
            print(f"submitter and node n1 killed after {len(list(rows.glob('*.csv')))} rows")

            follower = subprocess.Popen(slurm, env=cluster.environment, stdout=subprocess.PIPE, text=True)
            time.sleep(12)  # longer than SlurmdTimeout: the node counts as lost
            cluster.node("n1")
            said, _ = follower.communicate(timeout=240)
            print(said.strip())
            assert follower.returncode == 0
            assert "which was submitted before" in said or "36 of 36 runs" in said, said
            assert (folder / "cluster/summary.csv").read_bytes() == table, "another table than that of threads"
            assert not (folder / "cluster/slurm/job").exists()
            print(f"Slurm, with what was killed: {time.monotonic() - begun:.1f} s; the same table")

            done = subprocess.run(slurm, env=cluster.environment, capture_output=True, text=True, check=True)
            assert "job" not in done.stdout.split(";")[0], done.stdout
            print("again:", done.stdout.splitlines()[0])

            # Runs that cannot be computed: given up with where the logs are.
            refused = subprocess.run(
                [*command, "--engine", "slurm", "--sbatch=--partition=none", "--out", folder / "refused"],
                env=cluster.environment, capture_output=True, text=True, check=False,
            )
            assert refused.returncode == 1 and "sbatch: " in refused.stderr and "partition" in refused.stderr
            print("refused:", refused.stderr.strip().splitlines()[0])

            record(whorl, folder)
            over_recordings(whorl, folder, cluster)
        finally:
            cluster.end()
    return 0


if __name__ == "__main__":
    sys.exit(main())
