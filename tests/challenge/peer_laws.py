#!/usr/bin/env python3
"""Peers of `whorl discover` on the same files, blind: PySINDy 2.1 (weak form, FROLS) and gplearn (symbolic regression).

    cargo run --release -p whorl_challenge --bin whorl_challenge_laws -- --laws 10 --stride 2 --others 0 --write laws --only-build
    python3 -m venv venv && venv/bin/pip install "pysindy==2.1.0" gplearn
    venv/bin/python tests/challenge/peer_laws.py laws

Neither is told which law is hidden. Both get what an expert would give them: the torque that the nominal model leaves
(wheels' momentum, jets, gravity and gyroscopic torque taken off; inertia and gravity offset refitted as columns), and the
quantities on which a law may depend: rates, size of the rate, tilts, heading. PySINDy chooses from powers to the third,
signed squares, sines and cosines of up to three times the heading, about every axis of body and room, and along the rate;
the number of terms is the one that predicts the held-out run best. gplearn searches formulas of these quantities for the
torque about each axis, and the axis of which it explains the largest share answers. Neither has constants of the form of a
dead zone or of a limit: such laws count as found if the variable is right, and never as of the true form.

A variable is right if the term (for gplearn: the formula) that explains most holds it.
"""

import json
import sys
import warnings
from pathlib import Path

import numpy as np

from peer_pysindy import RATE_HZ, library, read, torque

VARIABLES = ["rate.x", "rate.y", "rate.z", "norm(rate)", "vertical.x", "vertical.y", "heading"]


def quantities(run):
    """Columns in the order of VARIABLES."""
    w, k = run["w"], run["k"]
    heading = np.unwrap(np.arctan2(-run["north"][:, 0], run["east"][:, 0]))
    return np.column_stack([w, np.linalg.norm(w, axis=1), k[:, :2], heading])


def terms(run):
    """Names, variables and columns of torque, (n, 3) each, of everything that PySINDy may choose."""
    x = quantities(run)
    factors = []
    for i, name in enumerate(VARIABLES[:6]):
        v = x[:, i]
        factors += [(name, name, v), (f"{name}^2", name, v**2), (f"{name}^3", name, v**3)]
        if name != "norm(rate)":
            factors.append((f"abs({name}) * {name}", name, np.abs(v) * v))
    for n in (1, 2, 3):
        of = "heading" if n == 1 else f"{n} * heading"
        factors += [(f"sin({of})", "heading", np.sin(n * x[:, 6])), (f"cos({of})", "heading", np.cos(n * x[:, 6]))]
    n = len(x)
    axes = [np.broadcast_to(np.eye(3)[i], (n, 3)) for i in range(3)] + [run["east"], run["north"], run["k"]]
    names = ["x", "y", "z", "east", "north", "vertical"]
    found = [(f, v, c[:, None] * a) for f, v, c in factors for a, _ in zip(axes, names)]
    size = np.maximum(x[:, [3]], 1e-4)
    for power in (0, 1, 2, 3):
        found.append((f"norm(rate)^{power + 0} along the rate", "norm(rate)", run["w"] / size * size**power))
    return found


def constants(run):
    """Columns of inertia and gravity offset."""
    columns = library(run)
    return columns["_inertia"] + columns["_mgr"]


def pysindy(training, held_out):
    import pysindy as ps

    def stacked(run):
        known, momentum = torque(run)
        rest = momentum - np.cumsum(known, axis=0) / RATE_HZ
        inputs = np.stack([c for _, _, c in terms(run)] + constants(run), 2)
        return [rest[:, [a]] - rest[0, a] for a in range(3)], [inputs[:, a, :] for a in range(3)]

    x, u = [], []
    for run in training:
        states, inputs = stacked(run)
        x += states
        u += inputs
    scale = np.sqrt(np.mean(np.concatenate(u) ** 2, axis=0)) + 1e-12
    length = min(len(v) for v in x)
    x, u = [v[:length] for v in x], [v[:length] / scale for v in u]
    test_x, test_u = stacked(held_out)
    best = None
    for count in range(1, 16):
        np.random.seed(1)
        inner = ps.CustomLibrary([lambda v: v], [lambda name: name], interaction_only=True)
        grid = np.arange(length) / RATE_HZ
        weak = ps.WeakPDELibrary(function_library=inner, spatiotemporal_grid=grid, K=300, p=4)
        model = ps.SINDy(optimizer=ps.FROLS(max_iter=count), feature_library=weak)
        model.fit(x, t=1.0 / RATE_HZ, u=u)
        coefficients = np.ravel(model.coefficients())[1:]
        error = 0.0
        for state, inputs in zip(test_x, test_u):
            left = state[:, 0] - np.cumsum((inputs / scale) @ coefficients) / RATE_HZ
            n = int(3 * RATE_HZ)
            left = left[: len(left) // n * n].reshape(-1, n)
            error += np.sum((left - left.mean(1, keepdims=True)) ** 2)
        if best is None or error < best[0]:
            best = (error, coefficients)
    list_ = terms(training[0])
    weight = np.abs(best[1][: len(list_)])
    if not weight.any():
        return None
    name, variable, _ = list_[int(np.argmax(weight))]
    return name, {variable}


def gplearn(training, held_out):
    from gplearn.genetic import SymbolicRegressor

    def rest(run):
        """Torque that is left when inertia and gravity offset are refitted, smoothed over a second."""
        known, momentum = torque(run)
        kernel = np.hanning(int(RATE_HZ) + 2)[1:-1]
        kernel /= kernel.sum()
        smooth = lambda v: np.apply_along_axis(lambda c: np.convolve(c, kernel, "same"), 0, v)
        left = smooth(np.gradient(momentum, 1.0 / RATE_HZ, axis=0) - known)
        columns = np.stack([smooth(c) for c in constants(run)], 2)
        inner = slice(int(RATE_HZ), -int(RATE_HZ))
        return left[inner], columns[inner], quantities(run)[inner]

    parts = [rest(run) for run in training]
    left, columns, x = (np.concatenate([p[i] for p in parts]) for i in range(3))
    flat = columns.reshape(-1, columns.shape[2])
    solved, *_ = np.linalg.lstsq(flat, left.reshape(-1), rcond=None)
    left = left - columns @ solved
    scale_x = np.maximum(np.abs(x).max(0), 1e-9)
    best = None
    for axis in range(3):
        y = left[:, axis] / left[:, axis].std()
        step = max(1, len(y) // 1500)
        machine = SymbolicRegressor(
            population_size=1000, generations=15, parsimony_coefficient=0.003, random_state=1,
            function_set=("add", "sub", "mul", "abs", "sin"), feature_names=[f"v{i}" for i in range(7)])
        machine.fit(x[::step] / scale_x, y[::step])
        share = machine.score(x[::step] / scale_x, y[::step])
        if best is None or share > best[0]:
            best = (share, str(machine._program))
    text = best[1]
    used = {name for i, name in enumerate(VARIABLES) if f"v{i}" in text}
    for i, name in enumerate(VARIABLES):
        text = text.replace(f"v{i}", name)
    return (text, used) if best[0] > 0.05 else None


def is_form(name, form):
    """Whether PySINDy's term is of the true form."""
    wanted = {"(heading)": "sin(heading)"}.get(form, form)
    return wanted in name and not (wanted.endswith("^2") and name.startswith("abs"))


def main():
    warnings.filterwarnings("ignore")
    score = {name: [0, 0, 0] for name in ("PySINDy 2.1", "gplearn 0.4")}
    for folder in sorted(p for p in Path(sys.argv[1]).iterdir() if (p / "answer.json").is_file()):
        law = json.loads((folder / "answer.json").read_text()).get("law")
        if not law:
            continue
        variable, form, words = law
        runs = [read(p) for p in sorted(folder.glob("train_*.csv"))]
        held_out = read(folder / "held_out.csv")
        if held_out is None or any(r is None for r in runs):
            continue
        for name, ask in (("PySINDy 2.1", pysindy), ("gplearn 0.4", gplearn)):
            found = ask(runs, held_out)
            right = bool(found) and variable in found[1] and (name != "gplearn 0.4" or len(found[1]) <= 2)
            of_form = bool(found) and right and is_form(found[0], form)
            score[name][0] += 1
            score[name][1] += right
            score[name][2] += of_form
            print(f"{folder.name}: {form}: {name}: {found[0] if found else 'nothing'} "
                  f"(variable {'right' if right else 'WRONG'})", flush=True)
    print("\n| | laws | right variable | true form |\n|---|---|---|---|")
    for name, (count, right, of_form) in score.items():
        print(f"| {name} | {count} | {right} | {of_form} |")


if __name__ == "__main__":
    main()
