#!/usr/bin/env python3
"""Measures how well `whorl identify` finds the mass properties of the simulated Whorl-I: the table of docs/identification.md.

usage: identify.py WORK [--seeds N] [--whorl PROGRAM]        (a built program; WORK: an empty folder for the runs)
"""

import argparse
import json
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MOMENTS, PRODUCTS, OFFSET = ["I_xx", "I_yy", "I_zz"], ["I_xy", "I_xz", "I_yz"], ["mgr_x", "mgr_y", "mgr_z"]


def truth() -> dict[str, float]:
    """The nine parameters of the simulated platform."""
    text = (ROOT / "params/truth/whorl_1.yaml").read_text()
    true = {f"I_{axes}": float(value) for axes, value in re.findall(r"^ +([xyz]{2}): ([-+.\d]+)", text, re.M)}
    offset = re.search(r"gravity_offset_n_m: \[(.*?)\]", text).group(1)
    return true | dict(zip(OFFSET, map(float, offset.split(","))))


def without_vector(whorl: str, run: Path) -> list[str]:
    """The same run without what the vector sensor read, as words of a command."""
    exported = run.with_name(f"{run.name}_exported")
    subprocess.run([whorl, "export", "csv", run, "--out", exported], check=True, stdout=subprocess.DEVNULL)
    channels = exported / "whorl_1.channels.yaml"
    lines = channels.read_text().splitlines()
    kept = [line for line in lines if not line.strip().startswith("vectors.")]
    if len(kept) == len(lines):
        raise SystemExit(f"{channels} has no vector sensor")
    channels.write_text("\n".join(kept) + "\n")
    return [str(exported / "whorl_1.csv"), "--channels", str(channels), "--model", str(ROOT / "params/whorl_1.yaml")]


def identified(whorl: str, words: list[str], answer: Path) -> dict:
    command = [whorl, "identify", *words, "--platform", "whorl_1", "--prior-scale", "100", "--json", str(answer)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return json.loads(answer.read_text())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", type=Path)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--whorl", default="whorl")
    arguments = parser.parse_args()
    whorl, true = arguments.whorl, truth()
    size = sum(true[name] ** 2 for name in OFFSET) ** 0.5
    worst: dict[str, list[float]] = {}
    for seed in range(1, arguments.seeds + 1):
        run = arguments.work / f"identify_{seed}"
        experiment = ROOT / "params/experiments/identify_whorl_1.yaml"
        simulate = [whorl, "simulate", "--experiment", experiment, "--seed", str(seed), "--out", run, "--no-report"]
        subprocess.run(simulate, check=True, stdout=subprocess.DEVNULL)
        sensors = {"two vectors": [str(run)], "accelerometer alone": without_vector(whorl, run)}
        for name, words in sensors.items():
            answer = identified(whorl, words, run.with_name(f"{run.name}_{len(words)}.json"))
            off = {p["name"]: (p["estimate"] - true[p["name"]], p["stddev"]) for p in answer["parameters"]}
            errors = [
                max(100 * abs(off[name][0] / true[name]) for name in MOMENTS),
                max(abs(off[name][0]) for name in PRODUCTS),
                100 * sum(off[name][0] ** 2 for name in OFFSET) ** 0.5 / size,
                max(abs(error) / stddev for error, stddev in off.values()),
            ]
            said = "moments {:.2f} %, products {:.4f} kg m^2, offset {:.2f} %, at most {:.1f} deviations".format(*errors)
            print(f"seed {seed}, {name}: {said}, prediction error {answer['prediction_error']}", flush=True)
            worst[name] = [max(pair) for pair in zip(worst.get(name, errors), errors)]
    for name, errors in worst.items():
        print("worst, {}: moments {:.2f} %, products {:.4f} kg m^2, offset {:.2f} %, {:.1f} deviations".format(name, *errors))


if __name__ == "__main__":
    main()
