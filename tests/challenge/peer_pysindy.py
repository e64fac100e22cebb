#!/usr/bin/env python3
"""The peer on the same files: PySINDy 2.1, weak form, FROLS, with expert columns.

    cargo run --release -p whorl_challenge -- --only-build --cells single/ control --write cases
    python3 -m venv venv && venv/bin/pip install "pysindy==2.1.0"
    venv/bin/python tests/challenge/peer_pysindy.py cases

PySINDy is used as an expert would: the state is the momentum that the nominal model does not explain, each
physical effect is one input column stacked over the three axes (so that it has one coefficient), columns are
scaled to unit RMS, constants of the platform (inertia, gravity offset) are columns too, and the number of
terms is the one that predicts the held-out run best. Effects of sensors and valves have no column: PySINDy
cannot express them, and such cases are left out of its row.
"""

import csv
import json
import sys
import warnings
from pathlib import Path

import numpy as np

RATE_HZ = 20.0
INERTIA = np.array([[6.2, -0.9, -0.2], [-0.9, 7.5, 0.1], [-0.2, 0.1, 12.1]])
MGR = np.array([-0.02, -0.07, -2.0])
WHEEL_INERTIA = 0.02
THRUST_N, ARM = 0.4, 0.45
# Jets 1..12 of params/whorl_1.yaml: position, force.
POSITION = ARM * np.array([[1, 0, 0]] * 3 + [[0, 1, 0]] * 3 + [[-1, 0, 0]] * 3 + [[0, -1, 0]] * 3, float)
POSITION[:, 2] = 0.05
FORCE = np.array(
    [[0, 0, 1], [0, 0, -1], [0, 1, 0], [0, 0, 1], [0, 0, -1], [1, 0, 0],
     [0, 0, 1], [0, 0, -1], [0, -1, 0], [0, 0, 1], [0, 0, -1], [-1, 0, 0]], float)
FIELD = np.array([-3e-6, 21e-6, -47e-6])


def column(rows, name):
    """Times and values of a column that is blank where nothing was measured."""
    pairs = [(float(r["t"]), float(r[name])) for r in rows if r.get(name)]
    return np.array(pairs).T if pairs else np.zeros((2, 0))


def smooth(time, value, grid):
    """Mean over one grid interval, by integrating: aliasing stays out."""
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (value[1:] + value[:-1]) * np.diff(time))])
    half = 0.5 / RATE_HZ
    return (np.interp(grid + half, time, integral) - np.interp(grid - half, time, integral)) / (2 * half)


def read(path):
    """Smoothed channels of a run on a uniform grid, or None for a clamped run."""
    with open(path) as file:
        rows = list(csv.DictReader(file))
    if "gx" not in rows[0]:
        return None
    end = column(rows, "gx")[0, -1]
    grid = np.arange(0.5, end - 0.5, 1.0 / RATE_HZ)
    three = lambda names: np.stack([smooth(*column(rows, n), grid) for n in names], 1)
    run = {"t": grid, "w": three(["gx", "gy", "gz"]), "f": three(["ax", "ay", "az"])}
    run["wheel"] = three(["speed_1", "speed_2", "speed_3"])
    vector = three(["vx", "vy", "vz"])
    # Still at the start: that is the gyro's bias.
    run["w"] = run["w"] - run["w"][grid < 4.0].mean(0)
    jets = np.zeros((len(grid), 12))
    for j in range(12):
        times, open_ = column(rows, f"jet_{j + 1}")
        for t, now, after in zip(times, open_, np.append(times[1:], end)):
            if now > 0:
                overlap = np.minimum(grid + 0.5 / RATE_HZ, after) - np.maximum(grid - 0.5 / RATE_HZ, t)
                jets[:, j] += np.clip(overlap, 0, None) * RATE_HZ
    run["jets"] = jets
    # Vertical in body axes: the accelerometer corrected slowly, carried on by the gyro; then the lamp.
    k = run["f"][:20].mean(0)
    k /= np.linalg.norm(k)
    vertical = []
    for w, f in zip(run["w"], run["f"]):
        k = k - np.cross(w, k) / RATE_HZ
        k = k + 0.01 * (f / np.linalg.norm(f) - k)
        k /= np.linalg.norm(k)
        vertical.append(k)
    run["k"] = np.array(vertical)
    east = vector - (vector * run["k"]).sum(1, keepdims=True) * run["k"]
    run["east"] = east / np.linalg.norm(east, axis=1, keepdims=True)
    run["north"] = np.cross(run["k"], run["east"])
    return run


def torque(run):
    """What the nominal model says acts on the platform, wheels' momentum taken along."""
    jets = run["jets"] @ np.cross(POSITION, FORCE * THRUST_N)
    momentum = run["w"] @ INERTIA + WHEEL_INERTIA * run["wheel"]
    return jets - np.cross(MGR, run["k"]) - np.cross(run["w"], momentum), momentum


def library(run):
    """Effect -> columns of torque over time, (n, 3) each; base columns begin with '_'."""
    w, k, east, north = run["w"], run["k"], run["east"], run["north"]
    size = np.linalg.norm(w, axis=1, keepdims=True)
    yaw = np.unwrap(np.arctan2(-north[:, 0], east[:, 0]))[:, None]
    acceleration = np.gradient(w, 1.0 / RATE_HZ, axis=0)
    field = FIELD[0] * east + FIELD[1] * north + FIELD[2] * k
    unit = np.eye(3)
    columns = {
        "bearing_viscous_friction": [-w],
        "bearing_coulomb_friction": [-w / np.hypot(size, 1e-3)],
        "air_drag_quadratic": [-size * w * unit[i] for i in range(3)],
        "air_current": [east, north, k],
        "bearing_turbine": [np.broadcast_to(unit[2], w.shape)],
        "magnetic_torque": [np.cross(unit[i], field) for i in range(3)],
        "harness_spring": [-yaw * k, k],
        "thruster_strength": [run["jets"][:, [j]] * np.cross(POSITION[j], FORCE[j] * THRUST_N) for j in range(12)],
        "wheel_inertia": [
            -np.gradient(run["wheel"][:, i] * WHEEL_INERTIA, 1.0 / RATE_HZ)[:, None] * unit[i]
            - np.cross(w, (run["wheel"][:, [i]] * WHEEL_INERTIA) * unit[i]) for i in range(3)
        ],
        "_mgr": [-np.cross(unit[i], k) for i in range(3)],
    }
    inertia = []
    for i, j in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]:
        e = np.zeros((3, 3))
        e[i, j] = e[j, i] = 1.0
        inertia.append(-acceleration @ e - np.cross(w, w @ e))
    columns["_inertia"] = inertia
    return columns


def stacked(run):
    """One trajectory per axis: unexplained momentum, and the columns as inputs."""
    known, momentum = torque(run)
    rest = momentum - np.cumsum(known, axis=0) / RATE_HZ
    columns = library(run)
    names = [name for name, list_ in columns.items() for _ in list_]
    inputs = np.stack([c for list_ in columns.values() for c in list_], 2)
    return [rest[:, [a]] - rest[0, a] for a in range(3)], [inputs[:, a, :] for a in range(3)], names


def diagnose(training, held_out):
    import pysindy as ps

    x, u, names = [], [], []
    for run in training:
        states, inputs, names = stacked(run)
        x += states
        u += inputs
    scale = np.sqrt(np.mean(np.concatenate(u) ** 2, axis=0)) + 1e-12
    u = [v / scale for v in u]
    length = min(len(v) for v in x)
    x, u = [v[:length] for v in x], [v[:length] for v in u]
    test_x, test_u, _ = stacked(held_out)
    best = None
    for terms in range(1, 25, 2):
        np.random.seed(1)
        inner = ps.CustomLibrary([lambda v: v], [lambda name: name], interaction_only=True)
        grid = np.arange(length) / RATE_HZ
        weak = ps.WeakPDELibrary(function_library=inner, spatiotemporal_grid=grid, K=300, p=4)
        model = ps.SINDy(optimizer=ps.FROLS(max_iter=terms), feature_library=weak)
        model.fit(x, t=1.0 / RATE_HZ, u=u)
        coefficients = np.ravel(model.coefficients())[1:]
        if len(coefficients) != len(names):
            raise RuntimeError(f"{len(coefficients)} coefficients for {len(names)} columns")
        error = 0.0
        for state, inputs in zip(test_x, test_u):
            predicted = np.cumsum((inputs / scale) @ coefficients) / RATE_HZ
            left = state[:, 0] - predicted
            # Over windows of 3 s, each with its own start.
            n = int(3 * RATE_HZ)
            left = left[: len(left) // n * n].reshape(-1, n)
            error += np.sum((left - left.mean(1, keepdims=True)) ** 2)
        if best is None or error < best[0]:
            best = (error, coefficients)
    weight = {}
    for name, value in zip(names, best[1]):
        if not name.startswith("_") and value != 0.0:
            weight[name] = max(weight.get(name, 0.0), abs(value))
    return sorted(weight, key=weight.get, reverse=True)


def main():
    warnings.filterwarnings("ignore")
    can_say = {n for n in library_names() if not n.startswith("_")}
    first = exact = cases = alarms = controls = 0
    for folder in sorted(p for p in Path(sys.argv[1]).iterdir() if (p / "answer.json").is_file()):
        truth = json.loads((folder / "answer.json").read_text())["effects"]
        if not set(truth) <= can_say:
            continue
        runs = [read(p) for p in sorted(folder.glob("train_*.csv"))]
        held_out = read(folder / "held_out.csv")
        if held_out is None or any(r is None for r in runs):
            continue
        found = diagnose(runs, held_out)
        print(f"{folder.name}: {found}", flush=True)
        if truth:
            cases += 1
            first += bool(found) and found[0] in truth
            exact += set(found) == set(truth)
        else:
            controls += 1
            alarms += bool(found)
    print("\n| PySINDy 2.1 weak FROLS, expert columns | right first | exact set | false alarm on controls |\n|---|---|---|---|")
    print(f"| effects that it has columns for | {first}/{cases} | {exact}/{cases} | {alarms}/{controls} |")


def library_names():
    n = 30
    zero = np.zeros((n, 3))
    unit = lambda i: np.broadcast_to(np.eye(3)[i], (n, 3))
    run = {"w": zero, "k": unit(2), "east": unit(0), "north": unit(1), "wheel": zero, "jets": np.zeros((n, 12))}
    return library(run)


if __name__ == "__main__":
    main()
