#!/usr/bin/env python3
"""What the pages say that commands print is what they print: runs the commands of a page and writes their outputs into it.

    docs/book/outputs.py [PAGE...] [--whorl PROGRAM] [--check] [--keep FOLDER]

A block of commands is run if the line above it is `<!-- run -->`; the block without a language that follows it is its output, or lines of
it: `...` stands for those that are left out. All commands of a page run one after the other, in one folder with a copy of params/ and of
the workbench's example, in which a folder of their own stands for /tmp. Without --check the pages are written: each line that was shown is looked up by its words,
and gets its new numbers; a line that nothing is like any more is an error, and its excerpt has to be chosen anew. With --check
nothing is written, and it fails where words differ, or a number by more than {PERCENT} % and its last digit (other processors round
otherwise). Without PAGE: all pages of docs/ that have such a block, and the README.
"""

import argparse
import difflib
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "crates/whorl_workbench/assets/example"
MARK = "<!-- run -->"
LEFT_OUT = "..."
NUMBER = re.compile(r"(?<![A-Za-z_\d.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![A-Za-z_\d])")
# Largest difference of a number from the page's, beside one in its last digit.
TOLERANCE = 0.02
# Lines of which fewer words are the same are different ones.
LIKE = 0.6
LONGEST_S = 1800


def words(line):
    """A line without its numbers, and without the width of its columns."""
    return " ".join(NUMBER.sub("#", line).split())


def excerpt(shown, printed):
    """The lines of `printed` that stand for those shown; (lines, the first shown line that nothing is like, or None)."""
    lines, at, lost = [], 0, None
    for old in (line for line in shown if line.strip() != LEFT_OUT):
        if not old.strip():
            continue
        wanted = words(old)
        rest = [(k, words(line)) for k, line in enumerate(printed) if k >= at and line.strip()]
        found = next((k for k, text in rest if text == wanted), None)
        if found is None and rest:
            ratio, k = max((difflib.SequenceMatcher(None, wanted.split(), text.split()).ratio(), -k) for k, text in rest)
            found = -k if ratio >= LIKE else None
        if found is None:
            lost = lost or old
            continue
        between = printed[at:found]
        if any(line.strip() for line in between):
            lines.append(LEFT_OUT)
        elif between:
            lines.append("")
        lines.append(printed[found].rstrip())
        at = found + 1
    if any(line.strip() for line in printed[at:]):
        lines.append(LEFT_OUT)
    return lines, lost


def is_close(old, new):
    """Whether a number is that of the page, within the tolerance and its last digit."""
    a, b = float(old), float(new)
    mantissa, _, power = old.partition("e")
    digit = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
    return abs(a - b) <= TOLERANCE * abs(a) + 1.01 * digit


def differences(shown, lines):
    """What of the page's lines is not so any more, in words."""
    found = []
    old, new = ([line for line in all_lines if line.strip() not in ("", LEFT_OUT)] for all_lines in (shown, lines))
    for before, after in zip(old, new):
        pairs = zip(NUMBER.findall(before), NUMBER.findall(after))
        if words(before) != words(after) or not all(is_close(a, b) for a, b in pairs):
            found.append(f"  page:  {before.strip()}\n  now:   {after.strip()}")
    return found


def blocks(text):
    """Marked blocks of a page: (commands, number of the first line of their output's block or None, lines of it)."""
    lines, found, k = text.split("\n"), [], 0
    while k < len(lines):
        if lines[k].strip() != MARK:
            k += 1
            continue
        if not re.fullmatch(r"```(bash|sh)", lines[k + 1].strip() if k + 1 < len(lines) else ""):
            sys.exit(f"error: line {k + 1}: {MARK} stands above no block of commands")
        end = lines.index("```", k + 2)
        after = next((n for n in range(end + 1, len(lines)) if lines[n].strip()), len(lines))
        if after < len(lines) and lines[after] == "```":
            close = lines.index("```", after + 1)
            found.append(("\n".join(lines[k + 2 : end]), after + 1, lines[after + 1 : close]))
            k = close + 1
        else:
            found.append(("\n".join(lines[k + 2 : end]), None, []))
            k = end + 1
    return found


def run(commands, folder):
    """What commands print; ends with what is wrong when one fails."""
    own = folder / "tmp"
    own.mkdir(exist_ok=True)
    environment = {**os.environ, "PATH": f"{folder / 'bin'}:{os.environ['PATH']}", "NO_COLOR": "1"}
    script = "set -euo pipefail\n" + re.sub(r"(?<![\w/])/tmp/", f"{own}/", commands)
    done = subprocess.run(["bash", "-c", script], cwd=folder, env=environment, capture_output=True, text=True, timeout=LONGEST_S, check=False)
    if done.returncode != 0:
        sys.exit(f"error: exit status {done.returncode} of\n{commands}\n{done.stderr}")
    return done.stdout.replace(f"{own}/", "/tmp/").split("\n")


def refreshed(page, folder, whorl):
    """A page with the outputs of its commands: (text, how many outputs differ, how many have a line that is lost)."""
    lines, differ, lost, moved = page.read_text().split("\n"), 0, 0, 0
    name = page.relative_to(ROOT) if page.is_relative_to(ROOT) else page
    shutil.copytree(ROOT / "params", folder / "params")
    shutil.copytree(EXAMPLE, folder, dirs_exist_ok=True)
    (folder / "bin").mkdir()
    (folder / "bin" / "whorl").symlink_to(whorl)
    for commands, at, shown in blocks(page.read_text()):
        print(f"{name}: {commands.strip().splitlines()[-1].strip()}", flush=True)
        printed = run(commands, folder)
        if at is None:
            continue
        taken, missing = excerpt(shown, printed)
        if missing is not None:
            lost += 1
            print(f"{name}:{at}: nothing that is printed is like `{missing.strip()}`; choose the lines anew from:", *printed, sep="\n", flush=True)
            continue
        found = differences(shown, taken)
        differ += bool(found)
        if found:
            print(f"{name}:{at}:", *found, sep="\n", flush=True)
        lines[at + moved : at + moved + len(shown)] = taken
        moved += len(taken) - len(shown)
    return "\n".join(lines), differ, lost


def main():
    parser = argparse.ArgumentParser(description=__doc__.format(PERCENT=round(100 * TOLERANCE)), formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="*", type=pathlib.Path, metavar="PAGE", help="pages (default: those of docs/ with a marked block)")
    parser.add_argument("--whorl", type=pathlib.Path, default=ROOT / "target/release/whorl", help="the program (default: target/release/whorl)")
    parser.add_argument("--check", action="store_true", help="write nothing, fail where a page differs")
    parser.add_argument("--keep", type=pathlib.Path, metavar="FOLDER", help="make the runs here and keep them")
    arguments = parser.parse_args()
    if not arguments.whorl.is_file():
        parser.error(f"--whorl {arguments.whorl}: there is no such file; build it: cargo build --release --locked --bin whorl")
    pages = [page.resolve() for page in arguments.pages] or [page for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))] if MARK in page.read_text().split("\n")]
    wrong = False
    for page in pages:
        with tempfile.TemporaryDirectory() as made:
            folder = pathlib.Path(made)
            if arguments.keep is not None:
                folder = (arguments.keep / page.stem).resolve()
                folder.mkdir(parents=True)
            text, differ, lost = refreshed(page, folder, arguments.whorl.resolve())
        wrong |= lost > 0 or (arguments.check and differ > 0)
        if not arguments.check and text != page.read_text():
            page.write_text(text)
            print(f"written: {page}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
