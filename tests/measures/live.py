#!/usr/bin/env python3
"""Measures what `whorl live` takes of a core, and how many frames a second a browser draws, while platforms run over DDS on
this machine.

usage: live.py [--platforms N] [--seconds S] [--whorl PROGRAM]        (built programs and Chromium; ROS_DOMAIN_ID is the domain)
"""

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/interop"))
from look_at_pages import Browser  # noqa: E402


def processor_s(pid: int) -> float:
    """Time of the processor that a process has used so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def live_pid(domain: str) -> int:
    """The process of the live page of this domain."""
    for folder in Path("/proc").iterdir():
        try:
            words = (folder / "cmdline").read_bytes().split(b"\0")
            environment = (folder / "environ").read_bytes().split(b"\0")
        except OSError:
            continue
        if b"live" in words and f"ROS_DOMAIN_ID={domain}".encode() in environment:
            return int(folder.name)
    sys.exit("no process of the live page")


def address_of(log: Path, run: subprocess.Popen, patience_s: float = 60.0) -> str:
    """What the run says where its page is."""
    until = time.monotonic() + patience_s
    while time.monotonic() < until and run.poll() is None:
        if found := re.search(r"https?://\S+#token=\S+", log.read_text()):
            return found[0]
        time.sleep(0.1)
    sys.exit(f"no address of the live page:\n{log.read_text()}")


def measure(address: str, domain: str, seconds: float) -> None:
    with tempfile.TemporaryDirectory() as profile:
        browser = Browser(profile, reached=("127.0.0.1", "localhost"))
        try:
            target = browser.call("Target.createTarget", url=address)["targetId"]
            session = browser.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
            seen = lambda of, name: int(browser.value(session, f"Number(document.{of}?.dataset.{name} || 0)") or 0)
            # The page loads, and connects.
            time.sleep(8)
            if seen("getElementById('scene')", "drawn") < 30:
                sys.exit("the page draws nothing")
            pid = live_pid(domain)
            begin, used, frames = time.monotonic(), processor_s(pid), seen("body", "frames")
            time.sleep(seconds)
            length = time.monotonic() - begin
            share, rate = (processor_s(pid) - used) / length, (seen("body", "frames") - frames) / length
            print(f"whorl live: {100 * share:.1f} % of a core, {rate:.1f} frames a second over {length:.0f} s")
        finally:
            browser.process.terminate()
            browser.process.wait()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--platforms", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--whorl", type=Path, default=ROOT / "target/release/whorl")
    arguments = parser.parse_args()
    domain = os.environ.setdefault("ROS_DOMAIN_ID", "0")
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        command = [arguments.whorl, "platforms", str(arguments.platforms), "--out", work / "params"]
        subprocess.run([*command, "--params", ROOT / "params"], check=True, stdout=subprocess.DEVNULL)
        log = work / "log"
        with open(log, "w") as file:
            run = subprocess.Popen(
                [arguments.whorl, "run", "chain", "--params", work / "params", "--out", work / "runs", "--live", "--live-port", "0"],
                stdout=file, stderr=file, cwd=ROOT,
            )
        try:
            measure(address_of(log, run), domain, arguments.seconds)
        finally:
            run.send_signal(signal.SIGINT)
            run.wait()


if __name__ == "__main__":
    main()
