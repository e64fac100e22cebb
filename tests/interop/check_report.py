#!/usr/bin/env python3
"""Opens a report in headless Chromium without a network and looks at it.

usage: check_report.py REPORT.html [--screenshot FILE.png]

Checked: the console is free of errors, nothing is fetched, plots are drawn, the replay and the plots show the
same instant, the picture of the page is not blank, and the page is not too large. Needs Chromium (CHROMIUM,
default `chromium` on the PATH) and nothing but Python's library.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import zlib
from collections import Counter
from pathlib import Path


def chromium(*arguments: str) -> subprocess.CompletedProcess:
    program = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        sys.exit("chromium is not installed")
    with tempfile.TemporaryDirectory() as profile:
        return subprocess.run(
            [
                program, "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
                "--hide-scrollbars", f"--user-data-dir={profile}", "--window-size=1280,4000",
                "--virtual-time-budget=20000", "--host-resolver-rules=MAP * ~NOTFOUND",
                "--enable-logging=stderr", "--log-level=0", *arguments,
            ],
            capture_output=True, text=True, timeout=180, check=False,
        )


def console_errors(log: str) -> list[str]:
    """Lines of the page's console that are errors; the browser's own lines are none."""
    lines = [line for line in log.splitlines() if ":CONSOLE" in line or "Failed to load resource" in line]
    return [line for line in lines if re.search(r"uncaught|error|failed to load", line, re.IGNORECASE)]


def colours(png: Path) -> tuple[int, int, Counter]:
    """Width, height and how often each colour occurs in a picture of 8 bits per channel."""
    data = png.read_bytes()
    if data[:8] != b"\x89PNG\r\n\x1a\n":
        sys.exit(f"{png} is no PNG")
    at, packed, header = 8, b"", None
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        body = data[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            header = struct.unpack(">IIBBBBB", body)
        elif kind == b"IDAT":
            packed += body
        at += 12 + length
    width, height, depth, kind, _, _, interlaced = header
    channels = {2: 3, 6: 4}[kind]
    if depth != 8 or interlaced:
        sys.exit(f"{png}: {depth} bits per channel, interlaced {interlaced}")
    raw, row = zlib.decompress(packed), bytearray(width * channels)
    count: Counter = Counter()
    for y in range(height):
        begin = y * (width * channels + 1)
        line = bytearray(raw[begin + 1 : begin + 1 + width * channels])
        undo_filter(raw[begin], line, row, channels)
        row = line
        if y % 4 == 0:
            count.update(bytes(line[x : x + 3]) for x in range(0, len(line), channels * 4))
    return width, height, count


def undo_filter(kind: int, line: bytearray, above: bytearray, step: int) -> None:
    """The PNG filters (RFC 2083, section 6), in place."""
    for i in range(len(line)) if kind else ():
        left = line[i - step] if i >= step else 0
        up = above[i]
        corner = above[i - step] if i >= step else 0
        if kind == 1:
            add = left
        elif kind == 2:
            add = up
        elif kind == 3:
            add = (left + up) // 2
        else:
            guess = left + up - corner
            distances = (abs(guess - left), abs(guess - up), abs(guess - corner))
            add = (left, up, corner)[distances.index(min(distances))]
        line[i] = (line[i] + add) & 255


def replay_problems(page: str, time_s: float) -> list[str]:
    """What is wrong with the replay of a page that was opened at this time: slider, scene and plots must agree."""
    problems = []
    clock = re.search(r'<output id="clock">([0-9.]+) of', page)
    if clock is None or abs(float(clock.group(1)) - time_s) > 0.01:
        problems.append(f"the replay shows {clock and clock.group(1)} s instead of {time_s} s")
    if re.search(r'<canvas id="scene"[^>]*data-drawn="[1-9]', page) is None:
        problems.append("the three-dimensional view is not drawn")
    # The first value of a legend is the time under the shared cursor.
    shown = [float(t) for t in re.findall(r'time \[s\]</div></th><td class="u-value">([0-9.]+)</td>', page)]
    if not shown or any(abs(t - time_s) > 0.5 for t in shown):
        problems.append(f"the plots' cursors are at {shown} s instead of {time_s} s")
    return problems


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("report", type=Path)
    parser.add_argument("--screenshot", type=Path)
    parser.add_argument("--largest-mb", type=float, default=2.0, help="largest size of the page [MB]")
    arguments = parser.parse_args()
    url = arguments.report.resolve().as_uri()
    problems = []
    size_mb = arguments.report.stat().st_size * 1e-6
    if size_mb > arguments.largest_mb:
        problems.append(f"the page has {size_mb:.1f} MB, more than {arguments.largest_mb} MB")

    drawn = chromium("--dump-dom", f"{url}#t=7.5")
    problems += [f"console: {line}" for line in console_errors(drawn.stderr)]
    places = len(re.findall(r'class="plot" id="figure_', drawn.stdout))
    plots = len(re.findall(r'class="uplot', drawn.stdout))
    if plots == 0 or plots < places:
        problems.append(f"{plots} drawings for {places} plots")
    # A row of the legend for every curve, and one for the time.
    paths = len(re.findall(r'class="u-series', drawn.stdout)) - plots
    if paths < 10:
        problems.append(f"only {paths} curves")
    if 'id="scene"' in drawn.stdout:
        problems += replay_problems(drawn.stdout, 7.5)

    with tempfile.TemporaryDirectory() as folder:
        picture = arguments.screenshot or Path(folder) / "report.png"
        pictured = chromium(f"--screenshot={picture}", url)
        if not picture.exists():
            problems.append(f"no picture: {pictured.stderr[-500:]}")
        else:
            width, height, count = colours(picture)
            total, (_, background) = sum(count.values()), count.most_common(1)[0]
            share = 1.0 - background / total
            print(f"{width} x {height} pixels, {len(count)} colours, {share:.1%} not background, {places} plots, {paths} curves")
            if len(count) < 20 or share < 0.01:
                problems.append("the page looks blank")
    for problem in problems:
        print(f"PROBLEM {problem}", file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
