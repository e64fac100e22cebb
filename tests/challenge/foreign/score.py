#!/usr/bin/env python3
"""Gives every case to `whorl import csv` and `whorl diagnose`, as a user would, and keeps the score.

    venv/bin/python score.py cases --whorl target/release/whorl [--json rows.jsonl]

`answer.json` is opened only after the diagnosis of that case has been written. Rows that are in `--json` are not run again.
"""

import argparse
import json
import resource
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "measures"))
import evidence


def diagnose(whorl, folder, timeout):
    """The verdict of a case as `whorl diagnose --json` states it, or the error it ended with."""
    runs = {}
    for table in sorted(folder.glob("*.csv")):
        run = folder / f"run_{table.stem}"
        if not run.exists():
            command = [whorl, "import", "csv", table, "--channels", folder / "MAP.yaml"]
            done = subprocess.run(
                [*command, "--platform", folder / "rig.yaml", "--out", run], capture_output=True, text=True, timeout=timeout
            )
            if done.returncode:
                return {"refused": done.stderr.strip()}
        runs[table.stem] = run
    train = [run for name, run in runs.items() if name.startswith("train")]
    out = folder / "diagnosis.json"
    done = subprocess.run(
        [whorl, "diagnose", *train, "--held-out", runs["held_out"], "--json", out, "--html", folder / "diagnosis.html"],
        capture_output=True,
        text=True,
        timeout=timeout,
    )
    return json.loads(out.read_text()) if done.returncode == 0 else {"refused": done.stderr.strip()}


def judged(report, answer):
    """What the verdict is worth: right first, exact, wrong name, alarm."""
    kind = report.get("verdict", "refused")
    named = [report["effects"]] if report.get("effects") else []
    named += report.get("confounded_with", [])
    truth = answer["answer"]
    row = {"kind": kind, "named": named, "truth": truth, "error": report.get("refused")}
    # The most probable explanation, with its probability.
    row["explanation"] = (report.get("explanations") or [None])[0]
    if truth == []:
        row["right"] = kind in ("nothing_missing", "not_enough_information")
    elif truth == ["unknown"]:
        row["right"] = kind == "unknown"
    else:
        row["right"] = bool(named) and set(named[0]) == set(truth)
        row["exact"] = row["right"] and kind == "named"
    row["wrong_name"] = bool(named) and not any(set(s) == set(truth) for s in named)
    return row


def processor_seconds():
    """What the programs that were run have taken so far."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--whorl", required=True)
    parser.add_argument("--json", type=Path, default=None, help="rows, one a line, written as they are done")
    parser.add_argument("--only", nargs="+", default=None, metavar="CASE")
    parser.add_argument("--timeout", type=float, default=600.0, help="of one command [s]")
    arguments = parser.parse_args()
    rows = {}
    if arguments.json and arguments.json.exists():
        rows = {row["case"]: row for row in map(json.loads, arguments.json.read_text().splitlines())}
    cases = sorted(path.parent for path in arguments.folder.glob("*/answer.json"))
    if not cases:
        parser.error(f"no case in {arguments.folder}: make.py writes them")
    for folder in cases:
        if folder.name in rows or (arguments.only and not any(o in folder.name for o in arguments.only)):
            continue
        begun = processor_seconds()
        try:
            report = diagnose(arguments.whorl, folder, arguments.timeout)
        except subprocess.TimeoutExpired:
            report = {"refused": f"more than {arguments.timeout:.0f} s"}
        row = {"case": folder.name, **judged(report, json.loads((folder / "answer.json").read_text()))}
        row["processor_s"] = round(processor_seconds() - begun, 1)
        rows[folder.name] = row
        print(f"{'right' if row['right'] else 'WRONG'} {folder.name}: {row['kind']} {row['named'] or row['error']}", file=sys.stderr)
        if arguments.json:
            with open(arguments.json, "a") as file:
                file.write(json.dumps(row) + "\n")
    evidence.tables([evidence.of_foreign(row) for row in rows.values()])


if __name__ == "__main__":
    main()
