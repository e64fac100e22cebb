"""A linear rig as a dense multivariate normal: its log likelihood, and its states given all readings. The reference of `dense.rs`;
writes turntable.json beside it.

A turntable turns about the vertical under a wheel's reaction and a torque that nobody knows (first-order Markov); its gyro has
a bias that walks. Three sensors at three rates, two of them late, readings missing. Nothing here is filtered: the mean of each
reading is the solution of the linear equations, and the covariance of any two follows from that of the state,

    cov(x(s), x(t)) = P(s) exp(A (t - s))^T,  P(t) = exp(A t) P0 exp(A t)^T + integral of exp(A s) W exp(A s)^T ds,

the integral by adaptive quadrature. Needs numpy and scipy.
"""

import json
import pathlib

import numpy as np
from scipy.integrate import quad_vec
from scipy.linalg import expm
from scipy.stats import multivariate_normal

I, J, B = 2.0, 0.05, 0.004  # table with wheel [kg m^2], wheel [kg m^2], its viscous friction [N m s]
TORQUE, TAU = 0.02, 0.7  # disturbance: standard deviation [N m], correlation time [s]
BIAS, WALK = 0.01, 0.002  # gyro's bias at the start [rad/s], its walk [rad/s/sqrt(s)]
GYRO, VECTOR, TACHOMETER = 0.003, 0.01, 0.2  # noise of one reading [rad/s], [rad], [rad/s]
LATE = {"gyro": 0.013, "vector": 0.021, "wheel": 0.0}
# State: angle, rate, wheel speed, disturbance, bias.
A = np.zeros((5, 5))
A[0, 1] = 1.0
R = I - J
A[1, 2], A[1, 3] = B / R, 1.0 / R
A[2, 2], A[2, 3] = -B / J - B / R, -1.0 / R
A[3, 3] = -1.0 / TAU
INPUT = np.array([0.0, -1.0 / R, 1.0 / J + 1.0 / R, 0.0, 0.0])
W = np.diag([0.0, 0.0, 0.0, 2.0 * TORQUE**2 / TAU, WALK**2])
P0 = np.diag([0.05, 0.02, 2.0, TORQUE, BIAS]) ** 2
MEAN0 = np.array([0.3, 0.1, 20.0, 0.0, 0.0])


def main():
    rng = np.random.default_rng(5)
    first = 0.0  # the instant of the first reading, where the start is
    stamps = {
        "gyro": np.arange(60) * 0.01 + LATE["gyro"],
        "vector": np.arange(9) * 0.07 + LATE["vector"] + 0.004,
        "wheel": np.arange(25) * 0.024 + 0.002,
    }
    keep = {name: rng.random(len(t)) > 0.2 for name, t in stamps.items()}
    keep["gyro"][0] = True
    stamps = {name: np.round(t[keep[name]], 9) for name, t in stamps.items()}
    commands = [(round(k * 0.05 + 0.001, 9), float(u)) for k, u in enumerate(rng.normal(0, 0.3, 13))]

    def move(x, frm, to):
        """The mean from one time to another, commands held."""
        edges = [frm, *[t for t, _ in commands if frm < t < to], to]
        for a, b in zip(edges, edges[1:]):
            u = next((u for t, u in reversed(commands) if t <= a), 0.0)
            both = np.zeros((6, 6))
            both[:5, :5], both[:5, 5] = A, INPUT * u
            x = (expm(both * (b - a)) @ np.append(x, 1.0))[:5]
        return x

    def covariance(t):
        grown, _ = quad_vec(lambda s: expm(A * s) @ W @ expm(A * s).T, 0.0, t, epsabs=1e-18, epsrel=1e-13)
        f = expm(A * t)
        return f @ P0 @ f.T + grown

    rows = {"gyro": [0, 1, 0, 0, 1], "vector": [1, 0, 0, 0, 0], "wheel": [0, 0, 1, 0, 0]}
    noise = {"gyro": GYRO, "vector": VECTOR, "wheel": TACHOMETER}
    readings = sorted((t - LATE[name] - first, name, t) for name in stamps for t in stamps[name])
    times = [t for t, _, _ in readings]
    h = np.array([rows[name] for _, name, _ in readings], dtype=float)
    at = [covariance(t) for t in times]
    means = np.array([h[i] @ move(MEAN0, 0.0, t) for i, t in enumerate(times)])
    n = len(readings)
    s = np.zeros((n, n))
    for i in range(n):
        for j in range(i, n):
            s[i, j] = s[j, i] = h[i] @ at[i] @ expm(A * (times[j] - times[i])).T @ h[j]
        s[i, i] += noise[readings[i][1]] ** 2
    y = means + np.linalg.cholesky(s) @ rng.normal(size=n)
    found = multivariate_normal(means, s).logpdf(y)
    # What a direction says out of the plane is noise alone, and drawn as zero: on the sphere it would bend the rest.
    found += len(stamps["vector"]) * float(-0.5 * np.log(2 * np.pi * VECTOR**2))

    def given_all(t):
        """Mean and standard deviation of the state at a time, all readings known: those of a conditional normal."""
        now = covariance(t)
        both = np.array(
            [
                now @ expm(A * (times[j] - t)).T @ h[j] if times[j] >= t else expm(A * (t - times[j])) @ at[j] @ h[j]
                for j in range(n)
            ]
        ).T
        mean = move(MEAN0, 0.0, t) + both @ np.linalg.solve(s, y - means)
        left = now - both @ np.linalg.solve(s, both.T)
        return {"time_s": t, "mean": list(map(float, mean)), "stddev": list(map(float, np.sqrt(np.diag(left))))}

    values = {name: [float(v) for v, (_, of, _) in zip(y, readings) if of == name] for name in stamps}
    out = {
        "log_likelihood": float(found),
        "numbers": n + len(stamps["vector"]),
        "commands": commands,
        "gyro": [list(map(float, stamps["gyro"])), values["gyro"]],
        "wheel": [list(map(float, stamps["wheel"])), values["wheel"]],
        "vector": [list(map(float, stamps["vector"])), values["vector"]],
        "smoothed": [given_all(float(t)) for t in times[::9]],
    }
    pathlib.Path(__file__).with_name("turntable.json").write_text(json.dumps(out) + "\n")
    print(found, n)


if __name__ == "__main__":
    main()
