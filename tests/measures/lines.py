#!/usr/bin/env python3
"""How many lines of Rust each package has: all, those without tests, and of these the ones that are neither comments nor blank.

usage: lines.py [PACKAGE...]     (default: all, and their sum)

Tests are files of tests (tests.rs, *_tests.rs, folders tests/), the packages tests/ and tests/challenge, and modules behind
#[cfg(test)] to the end of their file. What Git does not track is not counted.
"""

import collections
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
OF_TESTS = re.compile(r"(^|/)(tests|benches|examples)/|(^|[/_])tests\.rs$")
MODULE = re.compile(r"^\s*#\[cfg\((all\()?test\b.*\n(\s*#\[.*\n)*\s*(pub(\(\w+\))? )?mod \w+ \{", re.M)
FOLDERS = ("crates", "nodes")


def package(path):
    parts = path.split("/")
    return "/".join(parts[:2]) if parts[0] in FOLDERS or path.startswith("tests/challenge/") else parts[0]


def counted():
    listed = subprocess.run(["git", "ls-files", "*.rs"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    lines = collections.defaultdict(lambda: [0, 0, 0])
    for path in listed.split():
        text = (ROOT / path).read_text()
        of = lines[package(path)]
        of[0] += text.count("\n")
        if OF_TESTS.search(path):
            continue
        begin = MODULE.search(text)
        kept = (text[: begin.start()] if begin else text).splitlines()
        of[1] += len(kept)
        of[2] += sum(bool(line.strip()) and not line.lstrip().startswith("//") for line in kept)
    return lines


def main():
    lines = counted()
    chosen = sys.argv[1:] or sorted(lines)
    unknown = [name for name in chosen if name not in lines]
    if unknown:
        sys.exit(f"error: no package {', '.join(unknown)}; allowed: {', '.join(sorted(lines))}")
    print(f"{'':34} {'all':>8} {'no tests':>9} {'code':>8}")
    for name in chosen:
        print(f"{name:34} {lines[name][0]:8,} {lines[name][1]:9,} {lines[name][2]:8,}")
    print(f"{'together':34} " + "{:8,} {:9,} {:8,}".format(*map(sum, zip(*(lines[name] for name in chosen)))))


if __name__ == "__main__":
    main()
