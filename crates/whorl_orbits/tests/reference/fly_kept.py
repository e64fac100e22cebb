#!/usr/bin/env python3
"""Flies the corrections of `whorl orbit ... --json` by scipy's DOP853 and says how far its end is from Whorl's.

Independent of the crate: equations of motion in inertial axes at rtol 1e-12, the J2 potential's numerical gradient, thrust
along the deputy's own radius, track and orbit normal, mass by Tsiolkovsky.

    pip install scipy numpy && whorl orbit formation_keeping --json kept.json && python3 fly_kept.py kept.json 1.0 70.0

The two numbers are the thrust [N] and the specific impulse [s].
"""
import json
import sys

import numpy as np
from make_orbits import J2, acceleration, hill
from scipy.integrate import solve_ivp

G0 = 9.80665


def axes(x):
    r = x[:3] / np.linalg.norm(x[:3])
    h = np.cross(x[:3], x[3:6])
    h /= np.linalg.norm(h)
    return np.array([r, np.cross(h, r), h])


def fly(x, seconds, thrust=None):
    """`thrust`: direction in the deputy's axes, force [N], exhaust speed [m/s], mass [kg]."""

    def rate(t, x):
        a = acceleration(x[:3], J2)
        if thrust:
            direction, force, exhaust, mass = thrust
            a = a + axes(x).T @ direction * force / (mass - force / exhaust * t)
        return np.concatenate([x[3:], a])

    return solve_ivp(rate, (0, seconds), x, method="DOP853", rtol=1e-12, atol=1e-6).y[:, -1]


def main(path, force, impulse):
    kept = json.load(open(path))["passes"][0]["kept"][0]
    state = lambda s: np.array(s["position_m"] + s["velocity_m_s"])
    chief, deputy = [state(s) for s in kept["start"]]
    mass, exhaust, now = kept["mass_kg"], G0 * impulse, 0.0
    alone = deputy
    for c in kept["corrections"]:
        start = c["start_day"] * 86400.0
        deputy = fly(deputy, start - now)
        given = np.array(c["given_m_s"])
        deputy = fly(deputy, c["length_s"], (given / np.linalg.norm(given), force, exhaust, mass))
        mass -= force / exhaust * c["length_s"]
        now = start + c["length_s"]
    end = kept["days"] * 86400.0
    deputy, chief, alone = fly(deputy, end - now), fly(chief, end), fly(alone, end)
    ours = hill(*[state(s) for s in kept["end"]])
    print("relative to the chief, Whorl   [m]:", ours[:3].round(3))
    print("relative to the chief, DOP853  [m]:", hill(chief, deputy)[:3].round(3))
    print("without corrections, DOP853    [m]:", hill(chief, alone)[:3].round(3))
    print("apart [m]:", np.linalg.norm(hill(chief, deputy)[:3] - ours[:3]).round(3))
    print("gas [g]:", round((kept["mass_kg"] - mass) * 1e3, 3), "Whorl:", round(kept["gas_kg"] * 1e3, 3))


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), float(sys.argv[3]))
