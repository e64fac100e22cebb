#!/usr/bin/env python3
"""Reference points of the Earth for tests/validation.rs: writes targets.csv beside this file.

Independent of the crate: pymap3d's WGS 84 (geodetic to ECEF, azimuth-elevation-range).

    pip install pymap3d && python3 make_targets.py
"""
import csv
import pathlib

import numpy as np
import pymap3d


def main():
    path = pathlib.Path(__file__).with_name("targets.csv")
    with path.open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow("geodetic_deg geocentric_deg longitude_deg x_m y_m z_m sat_x_m sat_y_m sat_z_m "
                     "below_x_m below_y_m below_z_m elevation_deg".split())
        for lat, lon, sat in [
            (37.2296, -80.4139, (35.0, -75.0, 500e3)),
            (-45.0, 120.0, (-47.0, 118.0, 800e3)),
            (89.0, 10.0, (86.0, -60.0, 700e3)),
            (0.0, 0.0, (3.0, 2.0, 400e3)),
            (78.2232, 15.6267, (0.0, 15.0, 35786e3)),
        ]:
            point = np.array(pymap3d.geodetic2ecef(lat, lon, 0.0))
            spacecraft = np.array(pymap3d.geodetic2ecef(*sat))
            central = np.degrees(np.arctan2(point[2], np.hypot(point[0], point[1])))
            # Not by ecef2geodetic, which is 0.3 mm off at 500 km: the spacecraft was placed above this point.
            below = np.array(pymap3d.geodetic2ecef(sat[0], sat[1], 0.0))
            _, elevation, _ = pymap3d.ecef2aer(*spacecraft, lat, lon, 0.0)
            row = [lat, central, lon, *point, *spacecraft, *below, elevation]
            out.writerow([repr(float(x)) for x in row])


main()
