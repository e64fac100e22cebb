"""History, trends and calibration. Truth: motions in closed form with known changes and errors, and the program on the same runs."""

import json

import numpy as np
import polars
import pytest
import whorl
from test_explain import TURNTABLE, turntable

FRICTION = "/whorl_1/driver:truth.effects.bearing_viscous_friction.c_n_m_s:="
DAY_S = 86400.0


def test_a_friction_that_grew_is_found_with_its_day(tmp_path):
    model = tmp_path / "turntable.yaml"
    friction = "      effects: {bearing_viscous_friction: {c_n_m_s: 0.05}}\n"
    model.write_text(TURNTABLE.replace("      sensors:", friction + "      sensors:"))
    frictions = [0.05, 0.05, 0.05, 0.053, 0.053, 0.053]
    runs = [
        whorl.Recording.from_arrays(turntable(c, seed), model=model, jets=[], name=f"day_{seed}") for seed, c in enumerate(frictions)
    ]
    found = whorl.trends(runs, began_unix_s=[DAY_S * k for k in range(6)], parquet=tmp_path / "out")
    (friction,) = [p for p in found.parameters if p["group"] == "bearing_viscous_friction"]
    for estimate in friction["estimates"]:
        assert abs(estimate["value"] - frictions[estimate["run"]]) < 4 * estimate["stddev"] < 1e-3
    change = friction["change"]
    assert change["from_run"] == 3 and change["chance"] < 1e-3
    assert abs(change["size"] - 0.003) < 4 * change["stddev"]
    assert "day_3" in found.answer[0] and "bearing_viscous_friction" in str(found)
    # The table has every estimate; so has the data frame.
    table = polars.read_parquet(tmp_path / "out", hive_partitioning=True).filter(polars.col("effect") == "bearing_viscous_friction")
    assert table["value"].to_list() == [e["value"] for e in friction["estimates"]]
    assert table["run"].to_list() == [f"day_{k}" for k in range(6)] and table["began_unix_s"].to_list() == [DAY_S * k for k in range(6)]
    assert set(table["change_from_run"]) == {"day_3"} and set(table["platform"]) == {"turntable"}
    assert found.to_polars().height == sum(len(p["estimates"]) for p in found.parameters)
    assert "<table" in found._repr_html_() and len(found.figure().data) >= 1
    assert found.save(tmp_path / "page.html").stat().st_size > 1000
    # Only what differs between before and since.
    since = whorl.trends(runs, since=runs[3], began_unix_s=range(6))
    (friction,) = [p for p in since.parameters if p["group"] == "bearing_viscous_friction"]
    assert friction["change"]["from_run"] == 3 and since.data["tests"] < found.data["tests"]

    with pytest.raises(whorl.WhorlError, match="is in memory: when it began is not known"):
        whorl.trends(runs)
    with pytest.raises(whorl.WhorlError, match="began_unix_s has 2 times; allowed: one to each of the 6 runs"):
        whorl.trends(runs, began_unix_s=[0, 1])
    with pytest.raises(whorl.WhorlError, match="two runs or more"):
        whorl.trends(runs[:1])
    with pytest.raises(whorl.WhorlError, match="none of the runs that were given"):
        whorl.trends(runs[:2], since=runs[3], began_unix_s=[0, 1])


def test_trends_and_history_are_those_of_the_program(program, run, params, tmp_path):
    other = tmp_path / "later"
    program("simulate", "--experiment", params / "experiments/swing.yaml", "--out", other, "--no-report", "-p", f"{FRICTION}0.1")
    given = ["--platform", "whorl_1", "--html", tmp_path / "page.html"]
    program("history", run, other, *given, "--json", tmp_path / "trends.json", "--parquet", tmp_path / "table")
    found = whorl.trends([run, other], platform="whorl_1")
    assert found.data == json.loads((tmp_path / "trends.json").read_text())
    estimates = polars.read_parquet(tmp_path / "table/platform=whorl_1/history.parquet")
    assert estimates.select("run", "value").rows() == found.to_polars().select("run", "value").rows()

    model = tmp_path / "whorl_1.yaml"
    model.write_text((params / "whorl_1.yaml").read_text())
    (tmp_path / "common.yaml").write_text((params / "common.yaml").read_text())
    assert "No adoption is noted" in str(whorl.history(model))
    whorl.adopt(run, "bearing_viscous_friction", out=model, model=model, platform="whorl_1")
    history = whorl.history(model, platform="whorl_1")
    assert [step["effects"] for step in history.steps] == [["bearing_viscous_friction"]]
    assert history.data == json.loads(program("history", model, "--platform", "whorl_1", "--json", "-").stdout)
    assert "bearing_viscous_friction" in str(history) and "<table" in history._repr_html_()


def six_faces(rate_hz=100.0):
    """A sensor that lies on each of its faces for 20 s and is turned about its own axes between: true rate and force, body axes."""
    up, omega, force = np.array([0.0, 0.0, 1.0]), [], []
    turns = [(0, 90), (0, 90), (0, 90), (0, 90), (1, 90), (1, 90), (1, 90), (1, 90)]
    for axis, degrees in [*turns, (None, 0)]:
        still = int(20 * rate_hz)
        omega.append(np.zeros((still, 3)))
        force.append(np.tile(9.81 * up, (still, 1)))
        if axis is None:
            break
        n = int(4 * rate_hz)
        s = (np.arange(n) + 0.5) / n
        angle = np.deg2rad(degrees) * (s - np.sin(2 * np.pi * s) / (2 * np.pi))
        rate = np.deg2rad(degrees) * (1 - np.cos(2 * np.pi * s)) * rate_hz / n
        omega.append(np.outer(rate, np.eye(3)[axis]))

        def seen(a, up=up, axis=axis):
            # The world's up in the body, which has turned by a about its own axis.
            return up * np.cos(a) + np.cross(up, np.eye(3)[axis]) * np.sin(a) + np.eye(3)[axis] * up[axis] * (1 - np.cos(a))

        force.append(np.array([9.81 * seen(a) for a in angle]))
        up = np.round(seen(np.deg2rad(degrees)))
    return np.vstack(omega), np.vstack(force)


@pytest.fixture(scope="module")
def faces():
    rng = np.random.default_rng(3)
    omega, force = six_faces()
    gyro = omega * 1.01 + [0.004, -0.003, 0.002] + 5e-4 * rng.standard_normal(omega.shape)
    felt = force + [0.05, -0.04, 0.03] + 0.01 * rng.standard_normal(force.shape)
    return np.arange(len(gyro)) / 100.0, gyro, felt


def test_known_errors_of_sensors_are_found(faces, params, tmp_path):
    t, gyro, felt = faces
    model = params / "whorl_1.yaml"
    run = whorl.Recording.from_arrays({"gyro": (t, gyro), "accelerometer": (t, felt)}, model=model, jets=[], name="faces")
    found = whorl.calibrate(run, model=model)
    assert found.usable and found.written is None, found.findings
    for sensor, truth in (("gyro", [0.004, -0.003, 0.002]), ("accelerometer", [0.05, -0.04, 0.03])):
        of = found.data[sensor]["bias"]
        for value, stddev, true in zip(of["value"], of["stddev"], truth):
            assert abs(value - true) < 4 * stddev, (sensor, of)
    np.testing.assert_allclose(found.data["gyro"]["noise_stddev"]["value"], 5e-4, rtol=0.05)
    # Turns that begin and end on level faces show the gyro's scale about x and y; about the vertical, nothing does.
    scale = found.data["gyro"]["scale"]
    assert all(abs(abs(scale["value"][axis]) - 0.01) < 4 * scale["stddev"][axis] for axis in (0, 1)), scale
    assert "not determined" in str(found) and "<table" in found._repr_html_()

    # Written, and read back by who reads models.
    out = tmp_path / "whorl_1.yaml"
    out.write_text(model.read_text())
    (tmp_path / "common.yaml").write_text((params / "common.yaml").read_text())
    written = whorl.calibrate(run, model=out, out=out)
    assert written.written > 5 and written.data["gyro"]["bias"] == found.data["gyro"]["bias"]
    assert len(whorl.history(out, platform="whorl_1").steps) == 1

    with pytest.raises(whorl.WhorlError, match="^turn_error_deg is 0; allowed: a positive number"):
        whorl.calibrate(run, model=model, turn_error_deg=0)
    # Never at rest for two seconds: turned from face to face without a pause.
    turning = np.linalg.norm(gyro, axis=1) > 0.02
    t_turning = np.arange(turning.sum()) / 100.0
    moving = {"gyro": (t_turning, gyro[turning]), "accelerometer": (t_turning, felt[turning])}
    moving = whorl.Recording.from_arrays(moving, model=model, jets=[])
    assert not whorl.calibrate(moving, model=model).usable
    before = out.read_text()
    with pytest.raises(whorl.WhorlError, match="nothing was written: No still stretch"):
        whorl.calibrate(moving, model=out, out=out)
    assert out.read_text() == before


def test_a_calibration_is_that_of_the_program(faces, program, params, tmp_path):
    t, gyro, felt = faces
    table = np.column_stack([t, gyro, felt])
    header = "t,gx,gy,gz,ax,ay,az"
    np.savetxt(tmp_path / "faces.csv", table, fmt="%.17g", delimiter=",", header=header, comments="")
    columns = tmp_path / "map.yaml"
    columns.write_text(
        "csv:\n  ros__parameters:\n    time: {column: t, unit: s}\n    gyro: {columns: [gx, gy, gz], unit: rad/s}\n"
        "    accelerometer: {columns: [ax, ay, az], unit: m/s^2}\n"
    )
    given = [tmp_path / "faces.csv", "--channels", columns, "--model", params / "whorl_1.yaml"]
    program("calibrate", "imu", *given, "--dry-run", "--json", tmp_path / "found.json")
    found = whorl.calibrate(tmp_path / "faces.csv", channels=columns, model=params / "whorl_1.yaml")
    assert found.data == json.loads((tmp_path / "found.json").read_text())


def test_runs_are_one_table_for_sql(program, run, params, tmp_path):
    program("simulate", "--experiment", params / "experiments/leader_follower_short.yaml", "--out", tmp_path / "runs/pair")
    (tmp_path / "runs/swing").symlink_to(run)
    listed = json.loads(program("runs", tmp_path / "runs", "--json", "-", "--parquet", tmp_path / "runs.parquet").stdout)
    found = whorl.sql("SELECT experiment, verdict, duration_s FROM runs ORDER BY experiment", runs=tmp_path / "runs.parquet").fetchall()
    assert found == sorted((row["experiment"], row["verdict"], row["duration_s"]) for row in listed) and len(found) == 2
    with pytest.raises(whorl.WhorlError, match="runs: there is no table"):
        whorl.sql("SELECT 1 FROM runs", runs=tmp_path / "none.parquet")
    with pytest.raises(whorl.WhorlError, match="colour"):
        whorl.sql("SELECT colour FROM runs", runs=tmp_path / "runs.parquet").fetchall()
