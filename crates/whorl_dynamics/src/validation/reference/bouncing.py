#!/usr/bin/env python3
"""Reference for `a_platform_that_bounces_between_its_stops` in ../motion_at_stops.rs: prints tilt and rate.

A platform that tilts about one axis between its stops: I x'' = the one-sided spring and damper
at +-limit. Independent of the crate: scipy's DOP853 at rtol 1e-12 from one contact event to the next.

    pip install scipy && python3 bouncing.py
"""
import numpy as np
from scipy.integrate import solve_ivp

I, LIMIT = 6.0, 0.09
MEAN = (6.0 + 7.0 + 12.0) / 3.0
K, C = 2000.0 / 8.6 * MEAN, 100.0 / 8.6 * MEAN


def force(x, v):
    s = np.sign(x)
    return K * (s * x - LIMIT) + C * s * v


def main():
    t, y, touching, out, bounces = 0.0, np.array([0.01, 0.5]), False, {}, 0
    for end in (1.0, 10.0, 30.0):
        while t < end:
            def f(_, y, touching=touching):
                s = np.sign(y[0])
                return [y[1], -(s * force(y[0], y[1]) if touching else 0.0) / I]

            def event(_, y, touching=touching):
                return force(y[0], y[1]) if touching else abs(y[0]) - LIMIT

            event.terminal, event.direction = True, -1.0 if touching else 1.0
            sol = solve_ivp(f, (t, end), y, method="DOP853", rtol=1e-12, atol=1e-14, events=event, max_step=0.05)
            t, y = sol.t[-1], sol.y[:, -1]
            if sol.status == 1:
                touching, bounces = not touching, bounces + 1
        print(end, repr(float(y[0])), repr(float(y[1])), "events", bounces)


main()
