#!/usr/bin/env python3
"""Reference mean elements for tests/validation.rs: writes mean.csv and secular.csv beside this file.

mean.csv: Basilisk's own map between mean and osculating elements (orbitalMotion.clMeanOscMap), both ways.
secular.csv: independent of any theory: scipy's DOP853 over forty revolutions with the J2 potential's numerical gradient;
the slopes of node and mean argument of latitude (perigee plus mean anomaly) are least squares over means of revolutions.

    pip install bsk scipy numpy && python3 make_mean.py
"""
import csv
import pathlib

import numpy as np
from make_orbits import J2, MU, RE, acceleration
from scipy.integrate import solve_ivp

CASES = [  # a [m], e, i, node, perigee, mean anomaly [deg]
    (6878137.0, 0.001, 51.6, 20.0, 40.0, 70.0),
    (7153000.0, 0.05, 48.0, 0.0, 30.0, 0.0),
    (7500000.0, 0.08, 98.2, 110.0, -60.0, 200.0),
    (26600000.0, 0.6, 30.0, -70.0, 200.0, 10.0),
    (7000000.0, 0.0, 70.0, 45.0, 0.0, 120.0),
    (7200000.0, 0.01, 5.0, 300.0, 100.0, -30.0),
]


def from_basilisk():
    from Basilisk.utilities import orbitalMotion as om

    here = pathlib.Path(__file__)
    with here.with_name("mean.csv").open("w", newline="") as file:
        out = csv.writer(file)
        names = "a e i node perigee anomaly".split()
        out.writerow(["sign"] + names + [f"{n}_mapped" for n in names])
        for case in CASES:
            for sign in (1, -1):
                a, e, *angles = case
                i, node, perigee, anomaly = np.radians(angles)
                oe, mapped = om.ClassicElements(), om.ClassicElements()
                oe.a, oe.e, oe.i, oe.Omega, oe.omega = a, e, i, node, perigee
                wrapped = (anomaly + np.pi) % (2 * np.pi) - np.pi
                oe.f = om.E2f(om.M2E(wrapped, e), e)
                om.clMeanOscMap(RE, J2, oe, mapped, sign)
                back = om.E2M(om.f2E(mapped.f, mapped.e), mapped.e)
                numbers = [a, e, i, node, perigee, anomaly]
                numbers += [mapped.a, mapped.e, mapped.i, mapped.Omega, mapped.omega, back]
                out.writerow([sign] + [repr(float(x)) for x in numbers])


def state(a, e, i, node, perigee, anomaly):
    m = anomaly
    big = m
    for _ in range(100):
        big -= (big - e * np.sin(big) - m) / (1 - e * np.cos(big))
    f = 2 * np.arctan2(np.sqrt(1 + e) * np.sin(big / 2), np.sqrt(1 - e) * np.cos(big / 2))
    p = a * (1 - e * e)
    z = lambda x: np.array([[np.cos(x), -np.sin(x), 0], [np.sin(x), np.cos(x), 0], [0, 0, 1]])
    x = np.array([[1, 0, 0], [0, np.cos(i), -np.sin(i)], [0, np.sin(i), np.cos(i)]])
    q = z(node) @ x @ z(perigee)
    r = q @ np.array([np.cos(f), np.sin(f), 0]) * p / (1 + e * np.cos(f))
    v = q @ np.array([-np.sin(f), e + np.cos(f), 0]) * np.sqrt(MU / p)
    return np.concatenate([r, v])


def secular():
    here = pathlib.Path(__file__)
    with here.with_name("secular.csv").open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow("rx,ry,rz,vx,vy,vz,node_rad_s,latitude_rad_s".split(","))
        for a, e, *angles in CASES[:3] + CASES[5:]:
            start = state(a, e, *np.radians(angles))
            period = 2 * np.pi * np.sqrt(a**3 / MU)
            times = np.linspace(0, 40 * period, 40 * 90 + 1)
            f = lambda _, x: np.concatenate([x[3:], acceleration(x[:3], J2)])
            y = solve_ivp(f, (0, times[-1]), start, method="DOP853", rtol=1e-12, atol=1e-6, t_eval=times).y.T
            h = np.cross(y[:, :3], y[:, 3:])
            node = np.unwrap(np.arctan2(h[:, 0], -h[:, 1]))
            n = np.stack([np.cos(node), np.sin(node), 0 * node], axis=1)
            m = np.cross(h / np.linalg.norm(h, axis=1)[:, None], n)
            r, v = y[:, :3], y[:, 3:]
            distance = np.linalg.norm(r, axis=1)
            vector = np.cross(v, h) / MU - r / distance[:, None]
            eccentricity = np.linalg.norm(vector, axis=1)
            perigee = np.arctan2(np.sum(vector * m, axis=1), np.sum(vector * n, axis=1))
            axis = 1 / (2 / distance - np.sum(v * v, axis=1) / MU)
            f = np.arctan2(np.sum(r * m, axis=1), np.sum(r * n, axis=1)) - perigee
            big = 2 * np.arctan2(np.sqrt(1 - eccentricity) * np.sin(f / 2), np.sqrt(1 + eccentricity) * np.cos(f / 2))
            mean_latitude = np.unwrap(perigee + big - eccentricity * np.sin(big))
            # Means of whole revolutions, so that waves within one cancel.
            revolution = lambda series: series[:-1].reshape(40, 90).mean(axis=1)
            slope = lambda series: np.polyfit(revolution(times), revolution(series), 1)[0]
            node_rate, latitude_rate = slope(node), slope(mean_latitude)
            out.writerow([repr(float(x)) for x in [*start, node_rate, latitude_rate]])


if __name__ == "__main__":
    from_basilisk()
    secular()
