#!/usr/bin/env python3
"""How much each setting of `whorl diagnose` changes the score on cases with known truth when it is halved and doubled.

usage: settings.py CASES RESULTS [--settings NAME ...] [--cases N] [--seed N] [--jobs N] [--whorl PROGRAM]

CASES: a folder that `whorl_challenge --write CASES` made (`--only-build` makes no diagnosis): in each folder train_*.csv,
held_out.csv, MAP.yaml, whorl_1.yaml and answer.json. RESULTS: a file with one line of JSON for each diagnosis; what is in it is not
run again, so that a call may be interrupted, or repeated with more cases.

A setting between 0 and 1 is changed by halving and doubling its odds, a list number by number. Two scores are printed, of each setting
and factor over the cases that have both:
- right: cases whose verdict and set of effects are those of the answer;
- log probability: mean natural logarithm of the posterior probability of the answer, not below 1e-6. It moves where no verdict does.
"""

import argparse
import json
import math
import random
import re
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

FACTORS = {"half": 0.5, "double": 2.0}
FLOOR = 1e-6
FILES = ["answer.json", "MAP.yaml", "whorl_1.yaml", "train_1.csv"]


def defaults(whorl: str) -> dict[str, tuple[list[float], bool]]:
    """Of each setting its numbers, and whether it is a share."""
    text = subprocess.run([whorl, "diagnose", "--settings"], check=True, capture_output=True, text=True).stdout
    found, comment = {}, ""
    for line in filter(str.strip, text.splitlines()[1:]):
        if line.lstrip().startswith("#"):
            comment += line.lstrip(" #") + " "
            continue
        name, value = line.strip().split(": ", 1)
        numbers = [float(number) for number in re.findall(r"[-+.\deE]+", value)]
        found[name] = (numbers, "between 0 and 1" in comment)
        comment = ""
    return found


def changed(numbers: list[float], is_share: bool, factor: float) -> list[float]:
    if not is_share:
        return [factor * number for number in numbers]
    odds = [factor * number / (1.0 - number) for number in numbers]
    return [number / (1.0 + number) for number in odds]


def score(case: Path, found: dict) -> dict:
    """Whether an answer is right, and the logarithm of the probability that it gives to the truth."""
    answer = json.loads((case / "answer.json").read_text())
    is_outside = answer.get("foreign") is not None
    truth = sorted(answer["effects"])
    if is_outside:
        right = found["verdict"] == "unknown"
    elif truth:
        right = found["verdict"] in ("named", "confounded") and sorted(found["effects"]) == truth
    else:
        right = found["verdict"] == "nothing_missing"
    holds = lambda one: one["with_unknown"] if is_outside else not one["with_unknown"] and sorted(one["effects"]) == truth
    probability = sum(one["probability"] for one in found["explanations"] if holds(one))
    return {"right": right, "log_probability": math.log(max(min(probability, 1.0), FLOOR))}


def diagnosed(whorl: str, case: Path, settings: str) -> dict:
    with tempfile.TemporaryDirectory() as folder:
        answer, file = Path(folder) / "answer.json", Path(folder) / "settings.yaml"
        file.write_text(settings)
        command = [whorl, "diagnose", *sorted(map(str, case.glob("train_*.csv")))]
        for held in sorted(case.glob("held_out*.csv")):
            command += ["--held-out", str(held)]
        command += ["--channels", str(case / "MAP.yaml"), "--model", str(case / "whorl_1.yaml"), "--settings-file", str(file)]
        command += ["--json", str(answer), "--html", str(Path(folder) / "page.html")]
        ran = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        if ran.returncode != 0:
            # No answer is a wrong one; the reason is kept.
            return {"right": False, "log_probability": math.log(FLOOR), "error": ran.stderr.strip()[-300:]}
        return score(case, json.loads(answer.read_text()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("results", type=Path)
    parser.add_argument("--settings", nargs="+", metavar="NAME", help="only these (all)")
    parser.add_argument("--cases", dest="count", type=int, default=10, metavar="N", help="cases drawn at random (10)")
    parser.add_argument("--seed", type=int, default=1, help="of that draw (1)")
    parser.add_argument("--jobs", type=int, default=1, help="diagnoses at a time (1)")
    parser.add_argument("--whorl", default="whorl")
    arguments = parser.parse_args()

    known = defaults(arguments.whorl)
    wanted = arguments.settings or list(known)
    if unknown := [name for name in wanted if name not in known]:
        parser.error(f"there is no setting {', '.join(unknown)}; allowed: {', '.join(known)}")
    cases = sorted(folder for folder in arguments.cases.iterdir() if all((folder / name).is_file() for name in FILES))
    if not cases:
        parser.error(f"{arguments.cases}: no folder in it has {', '.join(FILES)}")
    random.Random(arguments.seed).shuffle(cases)
    cases = cases[: arguments.count]

    tries = {("default", ""): "diagnosis:\n  sure: {}\n".format(known["sure"][0][0])}
    for name in wanted:
        for word, factor in FACTORS.items():
            numbers = changed(*known[name], factor)
            value = repr(numbers[0]) if len(numbers) == 1 else repr(numbers)
            tries[(name, word)] = f"diagnosis:\n  {name}: {value}\n"

    done: dict[tuple[str, str, str], dict] = {}
    if arguments.results.is_file():
        for line in arguments.results.read_text().splitlines():
            try:
                row = json.loads(line)
            except json.JSONDecodeError:
                continue  # Interrupted while it was written.
            done[(row["setting"], row["factor"], row["case"])] = row

    def run(key: tuple[str, str, Path]) -> dict:
        name, word, case = key
        return {"setting": name, "factor": word, "case": case.name, **diagnosed(arguments.whorl, case, tries[(name, word)])}

    # Case by case, so that what an interrupted call has measured can be compared.
    missing = [(*way, case) for case in cases for way in tries if (*way, case.name) not in done]
    with ThreadPoolExecutor(arguments.jobs) as pool, arguments.results.open("a") as file:
        for row in pool.map(run, missing):
            file.write(json.dumps(row) + "\n")
            file.flush()
            done[(row["setting"], row["factor"], row["case"])] = row
            print(f"{len(done)}: {row['setting']} {row['factor']} {row['case']}: {'right' if row['right'] else 'wrong'}", flush=True)

    base = {case.name: done[("default", "", case.name)] for case in cases}
    right = sum(row["right"] for row in base.values())
    print(f"\n{len(base)} cases with the defaults: {right} right, log probability of the truth {mean(base.values()):.3f}\n")
    print("| setting | default | right, half | right, double | log probability, half | log probability, double |")
    print("|---|---|---|---|---|---|")
    for name in wanted:
        rows = [[done[(name, word, case)] for case in base] for word in FACTORS]
        gains = [sum(row["right"] for row in of) - right for of in rows]
        logs = [mean(of) - mean(base.values()) for of in rows]
        value = ", ".join(f"{number:g}" for number in known[name][0])
        print(f"| `{name}` | {value} | {gains[0]:+d} | {gains[1]:+d} | {logs[0]:+.3f} | {logs[1]:+.3f} |")


def mean(rows) -> float:
    rows = list(rows)
    return sum(row["log_probability"] for row in rows) / len(rows)


if __name__ == "__main__":
    main()
