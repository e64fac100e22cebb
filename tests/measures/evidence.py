#!/usr/bin/env python3
"""How often a diagnosis is right: rows of the worlds in, tables and the reliability diagram out.

    tests/measures/evidence.py add ROWS.csv challenge cases.jsonl       # of whorl_challenge --json
    tests/measures/evidence.py add ROWS.csv foreign rows.jsonl          # of tests/challenge/foreign/score.py --json
    tests/measures/evidence.py table ROWS.csv [--svg FILE]              # Markdown for docs/challenge.md

A row is one case: its world, seed, key and family, the truth, the verdict, what was named (alternatives after |), the most probable explanation and its
probability, whether the answer is right (of a control: silent; of a pair: its first effect is one of the two), exact, a wrong name, and whether that
explanation is the truth. Effects outside the catalogue are `?`.
"""

import argparse
import csv
import json
import math
import statistics
from pathlib import Path

FIELDS = "world seed case family truth verdict named explanation probability right exact wrong stated_right processor_s".split()
FAMILIES = {
    "control": "nothing missing",
    "one": "one effect of the catalogue",
    "pair": "two effects",
    "either": "one that the runs do not separate from another",
    "outside": "outside the catalogue",
}
SILENT = ("nothing_missing", "not_enough_information")
BINS = [0.5, 0.75, 0.9, 0.95, 0.99, 1.0000001]


def joined(sets):
    return "|".join("+".join(sorted(one)) for one in sets)


def row(world, seed, case, family, truth, verdict, named, explanation, right, exact, wrong, seconds, stated_right=None):
    """A row, all of it text as in the file; the explanation as `whorl diagnose --json` writes it."""
    effects = sorted((explanation or {}).get("effects", [])) + ["?"] * bool((explanation or {}).get("with_unknown"))
    if stated_right is None:
        stated_right = sorted(truth) == effects
    return {
        "world": world,
        "seed": str(seed),
        "case": case,
        "family": family,
        "truth": "+".join(sorted(truth)),
        "verdict": verdict,
        "named": joined(named),
        "explanation": "+".join(effects),
        "probability": f"{(explanation or {}).get('probability', 0.0):.4f}",
        "right": str(int(right)),
        "exact": str(int(exact)),
        "wrong": str(int(wrong)),
        "stated_right": str(int(stated_right)) if explanation else "",
        "processor_s": f"{seconds:.0f}",
    }


def of_challenge(line):
    spec, truth = line["spec"], [e for e in line["truth"]]
    outside = spec["cell"] == "outside"
    family = {"outside": "outside", "pair": "pair", "confounded": "either"}.get(spec["cell"], "one" if truth else "control")
    verdict = line["verdict"] or "refused"
    states = verdict in ("named", "confounded")
    named = [line["answer"], *line["confounded_with"]] if states else []
    first = bool(named) and bool(named[0]) and (named[0][0] in truth if family == "pair" else sorted(named[0]) == sorted(truth))
    right = {"control": verdict in SILENT, "outside": not states}.get(family, first)
    exact = {"control": right, "outside": bool(line["unknown_right"])}.get(family, line["exact"])
    if family == "either":
        right = line["truth_in_set"]
    seed = spec["seed"] // 1000 if spec["seed"] >= 1000 else spec["seed"]
    return row(
        "challenge", seed, line["key"], family, ["?"] if outside else truth, verdict, named, line.get("explanation"), right, exact,
        line["wrong_name"], line["seconds"],
    )


def of_foreign(line):
    truth, verdict = line["truth"], line["kind"]
    family = "outside" if truth == ["unknown"] else "control" if not truth else "one" if len(truth) == 1 else "pair"
    states = verdict in ("named", "confounded")
    right = line["right"] or (family == "outside" and not states)
    exact = line["right"] if family in ("control", "outside") else line.get("exact", False)
    named = line["named"] if states else []
    # A name beside "unknown" is not the answer of a case outside the catalogue, and no wrong one where it is the truth.
    wrong = bool(named) and not any(set(one) == set(truth) for one in named)
    return row(
        "foreign", int(line["case"].rsplit("_", 1)[1]), line["case"], family, ["?"] if family == "outside" else truth, verdict, named,
        line.get("explanation"), right, exact, wrong, line.get("processor_s", 0.0),
    )


READERS = {"challenge": of_challenge, "foreign": of_foreign}


def read(path):
    if not path.exists():
        return []
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def write(path, rows):
    rows.sort(key=lambda r: (r["world"], int(r["seed"]), r["case"]))
    with open(path, "w", newline="") as file:
        out = csv.DictWriter(file, FIELDS, lineterminator="\n")
        out.writeheader()
        out.writerows(rows)


def add(path, world, source):
    """Adds the cases of a file that are not in the rows yet: every case counts once, as it came out first."""
    rows = read(path)
    known = {(r["world"], r["case"]) for r in rows}
    for line in map(json.loads, source.read_text().splitlines()):
        if line.get("not_built") is None:
            new = READERS[world](line)
            if (new["world"], new["case"]) not in known:
                known.add((new["world"], new["case"]))
                rows.append(new)
    write(path, rows)
    print(f"{len(rows)} rows in {path}")


def wilson(hits, count, z=1.96):
    """95 % interval of a share."""
    if count == 0:
        return 0.0, 1.0
    p, d = hits / count, 1 + z * z / count
    half = z * math.sqrt(p * (1 - p) / count + z * z / (4 * count * count)) / d
    middle = (p + z * z / (2 * count)) / d
    return middle - half, middle + half


def share(hits, target=None, at_most=False):
    count, n = sum(hits), len(hits)
    if n == 0:
        return "- | - | 0 |"
    low, high = wilson(count, n)
    reached = count / n <= target if at_most else target is None or count / n >= target
    mark = "" if target is None else " ok" if reached else " **short**"
    return f"{100 * count / n:.1f} % | {100 * low:.0f}-{100 * high:.0f} % | {n} |{mark}"


def tables(rows):
    flag = lambda some, key: [r[key] == "1" for r in some]
    for world in sorted({r["world"] for r in rows}):
        mine = [r for r in rows if r["world"] == world]
        family = lambda *names: [r for r in mine if r["family"] in names]
        seeds = ", ".join(sorted({r["seed"] for r in mine}, key=int))
        print(f"\n**{world}**, seeds {seeds}:\n\n| question | target | share | 95 % interval | cases | |\n|---|---|---|---|---|---|")
        print(f"| nothing missing: silent | 97 % | {share(flag(family('control'), 'right'), 0.97)} |")
        print(f"| one effect: right first | 90 % | {share(flag(family('one'), 'right'), 0.90)} |")
        print(f"| one effect: exact | 80 % | {share(flag(family('one'), 'exact'), 0.80)} |")
        print(f"| two effects: first is one of them | | {share(flag(family('pair'), 'right'))} |")
        print(f"| two effects: exact | | {share(flag(family('pair'), 'exact'))} |")
        print(f"| not to be separated: truth in the set | | {share(flag(family('either'), 'right'))} |")
        print(f"| outside the catalogue: not named | 90 % | {share(flag(family('outside'), 'right'), 0.90)} |")
        print(f"| a wrong name, all cases | 3 % | {share(flag(mine, 'wrong'), 0.03, at_most=True)} |")
        refused = [r["verdict"] == "refused" for r in mine]
        print(f"| ended with an error | | {share(refused)} |")
        stated = [r for r in mine if r["stated_right"] and float(r["probability"]) >= 0.95]
        print(f"| stated at 95 % and more: right | 93 % | {share(flag(stated, 'stated_right'), 0.93)} |")
        seconds = sorted(float(r["processor_s"]) for r in mine if float(r["processor_s"]) > 0)
        if seconds:
            print(f"\nProcessor time: median {statistics.median(seconds):.0f} s, most {seconds[-1]:.0f} s.")


def bins(rows):
    """Of answers by their stated probability: mean of what was stated, hits, count."""
    for low, high in zip(BINS, BINS[1:]):
        some = [r for r in rows if r["stated_right"] and low <= float(r["probability"]) < high]
        if some:
            yield low, high, statistics.mean(float(r["probability"]) for r in some), sum(r["stated_right"] == "1" for r in some), len(some)


def reliability(rows):
    print("\n| stated probability of the first explanation | mean stated | right | 95 % interval | answers |\n|---|---|---|---|---|")
    for low, high, stated, hits, count in bins(rows):
        least, most = wilson(hits, count)
        print(f"| {100 * low:.0f}-{100 * min(high, 1):.0f} % | {100 * stated:.1f} % | {100 * hits / count:.1f} % | {100 * least:.0f}-{100 * most:.0f} % | {count} |")


def diagram(rows, path):
    """Right over stated, with 95 % intervals; on the diagonal a probability means what it says."""
    x = lambda p: 60 + 400 * (p - 0.5) / 0.5
    y = lambda p: 420 - 400 * p
    parts = [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 500 470" font-family="sans-serif" font-size="13">',
        '<rect width="500" height="470" fill="white"/>',
        f'<path d="M{x(0.5)} {y(0.5)} L{x(1)} {y(1)}" stroke="#888" stroke-dasharray="5 4"/>',
        f'<path d="M{x(0.5)} {y(1)} V{y(0)} H{x(1)}" stroke="black" fill="none"/>',
    ]
    for p in (0.5, 0.6, 0.7, 0.8, 0.9, 1.0):
        parts.append(f'<text x="{x(p)}" y="{y(0) + 18}" text-anchor="middle">{100 * p:.0f} %</text>')
    for p in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0):
        parts.append(f'<text x="{x(0.5) - 8}" y="{y(p) + 4}" text-anchor="end">{100 * p:.0f} %</text>')
    parts.append(f'<text x="{x(0.75)}" y="{y(0) + 40}" text-anchor="middle">stated probability</text>')
    parts.append(f'<text transform="translate(14 {y(0.5)}) rotate(-90)" text-anchor="middle">right</text>')
    for _, _, stated, hits, count in bins(rows):
        low, high = wilson(hits, count)
        parts.append(f'<path d="M{x(stated):.1f} {y(low):.1f} V{y(high):.1f}" stroke="#1f5fa8" stroke-width="2"/>')
        parts.append(f'<circle cx="{x(stated):.1f}" cy="{y(hits / count):.1f}" r="5" fill="#1f5fa8"/>')
        parts.append(f'<text x="{x(stated) - 9:.1f}" y="{y(hits / count) + 18:.1f}" text-anchor="end" fill="#1f5fa8">{hits} of {count}</text>')
    path.write_text("\n".join([*parts, "</svg>", ""]))


def misses(rows):
    for r in rows:
        if r["right"] != "1" or r["wrong"] == "1":
            said = r["named"] or r["verdict"].replace("_", " ")
            print(f"| `{r['case']}` | {r['truth'] or 'nothing'} | {said} | {100 * float(r['probability']):.0f} % |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    adding = commands.add_parser("add", help="adds cases to the rows")
    adding.add_argument("rows", type=Path)
    adding.add_argument("world", choices=sorted(READERS))
    adding.add_argument("source", type=Path)
    showing = commands.add_parser("table", help="prints tables of the rows")
    showing.add_argument("rows", type=Path)
    showing.add_argument("--svg", type=Path, help="writes the reliability diagram")
    showing.add_argument("--misses", action="store_true", help="lists what was not right")
    arguments = parser.parse_args()
    if arguments.command == "add":
        return add(arguments.rows, arguments.world, arguments.source)
    rows = read(arguments.rows)
    tables(rows)
    reliability(rows)
    if arguments.svg:
        diagram(rows, arguments.svg)
    if arguments.misses:
        misses(rows)


if __name__ == "__main__":
    main()
