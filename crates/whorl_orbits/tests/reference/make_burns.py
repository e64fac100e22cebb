#!/usr/bin/env python3
"""Reference burns for tests/validation.rs: writes burns.csv beside this file.

Independent of the crate: scipy's DOP853 at rtol 1e-13 on the equations of motion of chief and deputy in inertial axes,
thrust included. The direction of the thrust is not found by building an attitude: in the plane of line of sight s and wanted
velocity change u, at angle mission from each other, a body whose thruster is at angle config from its boresight, and which
gives the boresight the share w of the mismatch, thrusts at config + w (mission - config) from s towards u.

    pip install scipy numpy && python3 make_burns.py
"""
import csv
import pathlib

import numpy as np
from make_orbits import J2, MU, RE, acceleration, hill  # noqa: F401
from scipy.integrate import solve_ivp

EARTH_RATE, POLAR = 7.292115e-5, 6378137.0 * (1 - 1 / 298.257223563)
G0 = 9.80665
LATITUDE, LONGITUDE = np.radians(10.0), np.radians(9.0)  # geocentric
THRUST, MASS, ISP = 5.0, 80.0, 70.0


def target(t):
    c, s = np.cos(LATITUDE), np.sin(LATITUDE)
    r = 1 / np.sqrt((c / RE) ** 2 + (s / POLAR) ** 2)
    east = LONGITUDE + EARTH_RATE * t
    return r * np.array([c * np.cos(east), c * np.sin(east), s])


def hill_axes(x):
    r, h = x[:3] / np.linalg.norm(x[:3]), np.cross(x[:3], x[3:])
    h /= np.linalg.norm(h)
    return np.array([r, np.cross(h, r), h])


def direction(t, chief, deputy, wanted_hill, config, weight):
    s = target(t) - deputy[:3]
    s /= np.linalg.norm(s)
    u = hill_axes(chief).T @ wanted_hill
    u /= np.linalg.norm(u)
    mission = np.arccos(s @ u)
    across = u - (u @ s) * s
    across /= np.linalg.norm(across)
    angle = config + weight * (mission - config)
    return np.cos(angle) * s + np.sin(angle) * across


def fly(j2, wanted, config, weight, error, start, end):
    chief = np.array([6878137.0, 0, 0, 0, 7612.608 * np.cos(0.3), 7612.608 * np.sin(0.3)])
    deputy = chief.copy()
    deputy[3:] += hill_axes(chief).T @ error
    rate = THRUST / (G0 * ISP)
    size = np.linalg.norm(wanted)
    length = MASS / rate * (1 - np.exp(-size / (G0 * ISP)))

    def f(t, x, thrusts):
        c, d = x[:6], x[6:12]
        push = np.zeros(3)
        if thrusts:
            push = THRUST / (MASS - rate * (t - start)) * direction(t, c, d, wanted, config, weight)
        return np.concatenate(
            [c[3:], acceleration(c[:3], j2), d[3:], acceleration(d[:3], j2) + push, hill_axes(c) @ push]
        )

    x = np.concatenate([chief, deputy, np.zeros(3)])
    for begin, stop, thrusts in [(0, start, False), (start, start + length, True), (start + length, end, False)]:
        x = solve_ivp(f, (begin, stop), x, method="DOP853", rtol=1e-13, atol=1e-10, args=(thrusts,)).y[:, -1]
    return x[6:12], x[12:], rate * length


def main():
    path = pathlib.Path(__file__).with_name("burns.csv")
    with path.open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow("j2,config_deg,weight,wx,wy,wz,ex,ey,ez,start_s,time_s,rx,ry,rz,vx,vy,vz,gx,gy,gz,gas_kg".split(","))
        for j2 in (0.0, J2):
            for config, weight, wanted, start in (
                (90.0, 0.0, (0.02, 0.5, -0.3), 40.0),
                (90.0, 0.6, (0.02, 0.5, -0.3), 40.0),
                (60.0, 1.0, (-0.4, 0.1, 1.2), 0.0),
            ):
                error, end = np.array([0.3, -0.2, 0.5]), 260.0
                state, given, gas = fly(j2, np.array(wanted), np.radians(config), weight, error, start, end)
                row = [config, weight, *wanted, *error, start, end, *state, *given, gas]
                out.writerow([int(j2 > 0)] + [repr(float(x)) for x in row])


if __name__ == "__main__":
    main()
