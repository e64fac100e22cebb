"""Attitudes. Truth: a motion in closed form, and the program on the same numbers."""

import numpy as np
import pytest
import whorl

FIELD_UT = np.array([0.0, 22.0, -42.0])  # east, north, up


def motion(n=6000, noise=1.0):
    """A sensor at 100 Hz that stands tilted by 0.2 rad on a table, which turns to and fro: yaw(t) about the vertical."""
    t = np.arange(n) / 100.0
    yaw, yaw_rate = 1.2 * np.sin(0.5 * t), 0.6 * np.cos(0.5 * t)
    tilt = 0.2
    # q = yaw about up, then the tilt about the sensor's x; its inverse takes the world's up, north and east into the sensor.
    q = np.stack(
        [
            np.cos(yaw / 2) * np.cos(tilt / 2),
            np.cos(yaw / 2) * np.sin(tilt / 2),
            np.sin(yaw / 2) * np.sin(tilt / 2),
            np.sin(yaw / 2) * np.cos(tilt / 2),
        ],
        axis=1,
    )
    up = np.array([0.0, np.sin(tilt), np.cos(tilt)])
    c, s = np.cos(yaw), np.sin(yaw)
    flat = np.stack([c * FIELD_UT[0] + s * FIELD_UT[1], -s * FIELD_UT[0] + c * FIELD_UT[1]], axis=1)
    field = np.stack(
        [
            flat[:, 0],
            flat[:, 1] * np.cos(tilt) + FIELD_UT[2] * np.sin(tilt),
            -flat[:, 1] * np.sin(tilt) + FIELD_UT[2] * np.cos(tilt),
        ],
        axis=1,
    )
    rng = np.random.default_rng(5)
    gyro = np.outer(yaw_rate, up) + 0.01 + noise * 2e-3 * rng.standard_normal((n, 3))
    force = np.tile(9.81 * up, (n, 1)) + noise * 0.05 * rng.standard_normal((n, 3))
    return t, gyro, force, field + noise * 0.3 * rng.standard_normal((n, 3)), q


def error_deg(a, b):
    return np.rad2deg(2 * np.arccos(np.clip(np.abs(np.sum(a * b, axis=1)), 0, 1)))


@pytest.mark.parametrize(("smooth", "most_deg"), [(False, 3.0), (True, 1.0)])
def test_a_known_motion_is_found_and_as_the_program_finds_it(program, tmp_path, smooth, most_deg):
    t, gyro, force, field, q = motion()
    found = whorl.estimate(t, gyro, force, [field], smooth=smooth)
    error = error_deg(found.q_world_body[1000:], q[1000:])
    assert found.filter == "free_motion" and np.sqrt(np.mean(error**2)) < most_deg
    # The biases that the motion shows, within what the filter says of them.
    sigma = np.sqrt(np.diagonal(found.covariance[-1]))[3:]
    assert np.all(np.abs(found.gyro_bias_rad_s[-1] - 0.01) < 4 * sigma) and sigma.min() < 3e-3
    sigma = np.rad2deg(np.sqrt(np.trace(found.covariance[-1, :3, :3])))
    assert error[-1] < 3 * sigma < 30

    table = np.column_stack([t, gyro, force, field])
    header = "t," + ",".join(f"{of}{axis}" for of in "gam" for axis in "xyz")
    np.savetxt(tmp_path / "table.csv", table, fmt="%.17g", delimiter=",", header=header, comments="")
    (tmp_path / "map.yaml").write_text(
        "time: {column: t, unit: s}\ngyro: {columns: [gx, gy, gz], unit: rad/s}\n"
        "accelerometer: {columns: [ax, ay, az], unit: m/s^2}\nvector: {columns: [mx, my, mz]}\n"
    )
    out = tmp_path / "attitudes.csv"
    given = ["--channels", tmp_path / "map.yaml", "--out", out, *(["--smooth"] if smooth else [])]
    program("estimate", tmp_path / "table.csv", *given)
    theirs = np.loadtxt(out, delimiter=",", skiprows=1)
    ours = found.q_world_body[np.isfinite(found.q_world_body[:, 0])]
    assert theirs.shape[0] == ours.shape[0]
    assert np.max(np.abs(theirs[:, 1:5] - ours)) < 1e-6


def test_directions_without_an_accelerometer():
    t, gyro, _, field, q = motion(3000)
    up = np.tile([0.0, np.sin(0.2), np.cos(0.2)], (len(t), 1))
    up[np.arange(len(t)) % 10 != 0] = np.nan
    found = whorl.estimate(t, gyro, vectors=[field, up], reference_world=[FIELD_UT, [0, 0, 1]], vector_noise_deg=[0.5, 0.2])
    assert found.filter == "directions"
    assert np.sqrt(np.mean(error_deg(found.q_world_body[500:], q[500:]) ** 2)) < 1.0


def test_wrong_arrays_are_refused():
    t, gyro, force, field, _ = motion(300)
    for words, call in [
        (r"accelerometer_m_s2 has shape \(299, 3\); allowed: \(300, 3\)", lambda: whorl.estimate(t, gyro, force[1:])),
        (r"gyro_rad_s has shape \(300,\)", lambda: whorl.estimate(t, gyro[:, 0])),
        ("needs directions", lambda: whorl.estimate(t, gyro)),
        (r"vector sensor 1 .* has no direction in the world", lambda: whorl.estimate(t, gyro, vectors=[field])),
        ("allowed: free_motion, directions", lambda: whorl.estimate(t, gyro, force, filter="kalman")),
        ("no axis y: x and z alone do not tell the vertical, and are left out", lambda: whorl.estimate(t, gyro, force * [1, np.nan, 1])),
        ("gyro of three axes", lambda: whorl.estimate(t, gyro * [1, 1, np.nan], force)),
        ("time 1 is not after", lambda: whorl.estimate(t * 0, gyro, force)),
        ("are too few for a first attitude", lambda: whorl.estimate(t[:1], gyro[:1], force[:1], [field[:1]])),
        ("reference_world has 2 entries; allowed: one for each of 1", lambda: whorl.estimate(t, gyro, vectors=[field], reference_world=[None, None])),
    ]:
        with pytest.raises(whorl.WhorlError, match=words):
            call()
