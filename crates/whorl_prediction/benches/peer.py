"""A pass of Whorl's filter beside a compiled Kalman filter of the same size, in one run: statsmodels' (Cython over BLAS), with likelihoods that agree.

    pip install numpy scipy statsmodels
    python3 crates/whorl_prediction/benches/peer.py

First the likelihood of tests/dense/turntable.json, which Whorl's filter has within 1e-9 (tests/dense.rs), by statsmodels. Then processor time of an
instant: Whorl's by `cargo bench`, statsmodels' of 36,000 instants with 21 states and nine numbers, and matrices that change from
instant to instant, as a rotating platform's do. Whorl's pass has the plant in it: it integrates the motion, derives the matrices and finds
exp(A h); statsmodels' is given all of them.
"""

import json
import os
import pathlib
import subprocess
import sys
import time

# Processor time is that of all threads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.linalg import expm
from statsmodels.tsa.statespace.kalman_filter import FILTER_CONVENTIONAL, FILTER_UNIVARIATE, KalmanFilter

HERE = pathlib.Path(__file__).resolve().parent
STATES, NUMBERS, INSTANTS = 21, 9, 36_000


def turntable():
    """log p of the reference by statsmodels, and by the dense normal."""
    sys.path.insert(0, str(HERE.parent / "tests" / "dense"))
    import make

    reference = json.loads((HERE.parent / "tests" / "dense" / "turntable.json").read_text())
    rows = {"gyro": [0, 1, 0, 0, 1], "vector": [1, 0, 0, 0, 0], "wheel": [0, 0, 1, 0, 0]}
    noise = {"gyro": make.GYRO, "vector": make.VECTOR, "wheel": make.TACHOMETER}
    readings = sorted((t - make.LATE[name], name, y) for name in rows for t, y in zip(*reference[name]))
    n = len(readings)
    model = KalmanFilter(k_endog=1, k_states=5, k_posdef=5, nobs=n)
    model.bind(np.array([[y] for _, _, y in readings]))
    model["design"] = np.array([rows[name] for _, name, _ in readings], dtype=float).T[None]
    model["obs_cov"] = np.array([noise[name] ** 2 for _, name, _ in readings])[None, None]
    model["selection"] = np.eye(5)
    transition, cov, intercept = np.zeros((5, 5, n)), np.zeros((5, 5, n)), np.zeros((5, n))
    commands = reference["commands"]
    for k in range(n):
        if k + 1 == n:
            transition[:, :, k] = np.eye(5)
            continue
        begin, end = readings[k][0], readings[k + 1][0]
        edges = [begin, *[t for t, _ in commands if begin < t < end], end]
        moved = np.zeros(5)
        for a, b in zip(edges, edges[1:]):
            u = next((u for t, u in reversed(commands) if t <= a), 0.0)
            both = np.zeros((6, 6))
            both[:5, :5], both[:5, 5] = make.A, make.INPUT * u
            moved = (expm(both * (b - a)) @ np.append(moved, 1.0))[:5]
        h = end - begin
        # Van Loan's exponential of both at once.
        loan = expm(np.block([[-make.A, make.W], [np.zeros((5, 5)), make.A.T]]) * h)
        transition[:, :, k] = loan[5:, 5:].T
        cov[:, :, k] = loan[5:, 5:].T @ loan[:5, 5:]
        intercept[:, k] = moved
    model["transition"], model["state_cov"], model["state_intercept"] = transition, cov, intercept
    model.initialize_known(make.MEAN0, make.P0)
    out_of_plane = len(reference["vector"][0]) * -0.5 * np.log(2 * np.pi * make.VECTOR**2)
    return model.loglike() + out_of_plane, reference["log_likelihood"]


def peer(method):
    """Processor time of an instant [us], the best of five."""
    rng = np.random.default_rng(1)
    model = KalmanFilter(k_endog=NUMBERS, k_states=STATES, k_posdef=STATES, nobs=INSTANTS)
    model.bind(rng.normal(size=(INSTANTS, NUMBERS)))
    model.filter_method = method
    model.memory_no_forecast = model.memory_no_predicted = model.memory_no_filtered = model.memory_no_gain = True
    transition = 0.99 * np.eye(STATES) + 0.01 * rng.normal(size=(STATES, STATES)) / np.sqrt(STATES)
    model["transition"] = np.repeat(transition[:, :, None], INSTANTS, axis=2)
    model["design"] = np.repeat(rng.normal(size=(NUMBERS, STATES))[:, :, None], INSTANTS, axis=2)
    model["obs_cov"], model["state_cov"] = np.eye(NUMBERS), 0.01 * np.eye(STATES)
    model["selection"] = np.eye(STATES)
    model.initialize_known(np.zeros(STATES), np.eye(STATES))
    model.loglike()
    times = []
    for _ in range(5):
        begun = time.process_time()
        model.loglike()
        times.append(time.process_time() - begun)
    return min(times) / INSTANTS * 1e6


def main():
    found, dense = turntable()
    print(f"log likelihood of the turntable: statsmodels {found:.9f}, dense normal {dense:.9f}, {abs(found / dense - 1):.1e} apart")
    assert abs(found / dense - 1) < 1e-9
    command = ["cargo", "bench", "-p", "whorl_prediction", "--locked", "--", "gains and mean"]
    print(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout.strip())
    print(f"statsmodels, {STATES} states, {NUMBERS} numbers: {peer(FILTER_CONVENTIONAL):.1f} us an instant, number by number {peer(FILTER_UNIVARIATE):.1f} us")


if __name__ == "__main__":
    main()
