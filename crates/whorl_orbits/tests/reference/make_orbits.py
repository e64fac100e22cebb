#!/usr/bin/env python3
"""Reference orbits for tests/validation.rs: writes orbits.csv beside this file.

Independent of the crate: scipy's DOP853 at rtol 1e-13 on the equations of motion of both spacecraft in inertial
axes, with the gradient of the J2 potential taken numerically by complex steps instead of written out.

    pip install scipy numpy && python3 make_orbits.py
"""
import csv
import pathlib

import numpy as np
from scipy.integrate import solve_ivp

MU, RE, J2 = 3.986004418e14, 6378137.0, 1.08262668e-3


def potential(r, j2):
    d = np.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    return MU / d * (1 - j2 * (RE / d) ** 2 * (1.5 * (r[2] / d) ** 2 - 0.5))


def acceleration(r, j2):
    a = np.empty(3)
    for i in range(3):
        z = r.astype(complex)
        z[i] += 1e-30j
        a[i] = potential(z, j2).imag / 1e-30
    return a


def propagate(state, t, j2):
    def f(_, x):
        return np.concatenate([x[3:], acceleration(x[:3], j2)])

    return solve_ivp(f, (0, t), state, method="DOP853", rtol=1e-13, atol=1e-9).y[:, -1]


def hill(chief, deputy):
    r, v = chief[:3], chief[3:]
    h = np.cross(r, v)
    o = np.array([r / np.linalg.norm(r), np.cross(h, r) / np.linalg.norm(np.cross(h, r)), h / np.linalg.norm(h)])
    rho = o @ (deputy[:3] - r)
    w = np.array([0, 0, np.linalg.norm(h) / (r @ r)])
    return np.concatenate([rho, o @ (deputy[3:] - v) - np.cross(w, rho)])


CASES = [  # name, chief state [m, m/s], deputy minus chief [m, m/s]
    ("low_circular", [6878137, 0, 0, 0, 7612.608 * np.cos(0.9), 7612.608 * np.sin(0.9)], [200, 500, 0, 0, -0.4428, 0.6]),
    ("elliptic", [7000000, 0, 0, 0, 8000, 3000], [0, 400, -100, 0.2, 0, 0.1]),
    ("polar", [0, 0, 7200000, 7440, 0, 100], [30, -100, 50, 0.02, 0.01, -0.05]),
]


def main():
    path = pathlib.Path(__file__).with_name("orbits.csv")
    with path.open("w", newline="") as file:
        out = csv.writer(file)
        names = "rx ry rz vx vy vz dx dy dz dvx dvy dvz".split()
        out.writerow(
            ["case", "j2", "time_s"]
            + [f"start_{n}" for n in names]
            + [f"end_{n}" for n in names]
            + [f"start_hill_{n}" for n in names[:6]]
            + [f"end_hill_{n}" for n in names[:6]]
        )
        for name, chief, offset in CASES:
            chief = np.array(chief, float)
            deputy = chief + np.array(offset, float)
            for j2 in (0.0, J2):
                for t in (600.0, 3000.0, 6000.0, 20000.0):
                    c, d = propagate(chief, t, j2), propagate(deputy, t, j2)
                    row = [chief, deputy, c, d, hill(chief, deputy), hill(c, d)]
                    out.writerow([name, int(j2 > 0), t] + [repr(float(x)) for part in row for x in part])


if __name__ == "__main__":
    main()
