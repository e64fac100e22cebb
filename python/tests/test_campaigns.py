"""Campaigns over recordings. Truth: the answers of the single commands on the same recordings, and interrupted commands."""

import csv
import json
import os
import signal
import subprocess
import sys
import textwrap
import time

import numpy as np
import polars
import pytest
import whorl

FRICTION = "/whorl_1/driver:truth.effects.bearing_viscous_friction.c_n_m_s:="


@pytest.fixture(scope="module")
def archive(tmp_path_factory, program, params):
    """Two runs, one with a friction that the model lacks, a file that is none, and a campaign file beside them."""
    folder = tmp_path_factory.mktemp("archive")
    swing = params / "experiments/swing.yaml"
    for name, friction in (("first", 0.3), ("second", 0.0)):
        program("simulate", "--experiment", swing, "--out", folder / "runs" / name, "--no-report", "-p", f"{FRICTION}{friction}")
    (folder / "runs/torn").mkdir()
    (folder / "runs/torn/manifest.yaml").write_text("state: recording\n")
    return folder


def campaign_file(archive, name, text, recordings="runs/*"):
    path = archive / f"{name}.yaml"
    path.write_text(f"/campaign:\n  ros__parameters:\n    recordings: ['{recordings}']\n    {text}\n")
    return path


def rows_of(folder):
    with open(folder / "summary.csv", newline="") as file:
        return list(csv.DictReader(file))


def test_every_run_compared_as_the_single_command_compares(program, archive, tmp_path):
    file = campaign_file(archive, "again", "task: compare")
    assert program("campaign", file, "--dry-run").stdout.splitlines()[-1] == "5 recordings"
    said = program("campaign", file, "--out", tmp_path / "out").stdout
    assert "5 of 5 recordings are done" in said and "runs/torn" in said
    rows = rows_of(tmp_path / "out")
    assert [(row["recording"], row["platform"], row["outcome"]) for row in rows] == [
        ("runs/first", "whorl_1", "done"),
        ("runs/first", "whorl_2", "done"),
        ("runs/second", "whorl_1", "done"),
        ("runs/second", "whorl_2", "done"),
        ("runs/torn", "", "failed"),
    ]
    assert rows[4]["reason"] and rows[4]["prediction_error"] == ""
    for row in rows[:4]:
        given = [archive / row["recording"], "--platform", row["platform"], "--html", tmp_path / "page.html"]
        program("compare", *given, "--json", tmp_path / "one.json")
        alone = json.loads((tmp_path / "one.json").read_text())
        assert float(row["prediction_error"]) == alone["prediction_error"]
        channels = polars.read_parquet(tmp_path / "out/channels").filter(polars.col("number") == int(row["number"]))
        theirs = [(c["name"], h["rms"]) for c in alone["runs"][0]["channels"] for h in c["horizons"]]
        assert channels.select("channel", "rms").rows() == theirs

    # A year later: only what is new is computed; numbers stay. The second time, nothing is.
    before = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "out/rows").iterdir()}
    os.rename(archive / "runs/torn", archive / "torn")
    (archive / "runs/0_new").symlink_to(archive / "runs/first")
    said = program("campaign", file, "--out", tmp_path / "out").stdout
    assert "2 recordings here" in said and "7 of 7 recordings are done" in said
    later = rows_of(tmp_path / "out")
    assert later[:5] == rows and [row["recording"] for row in later[5:]] == ["runs/0_new"] * 2
    assert [row["prediction_error"] for row in later[5:]] == [row["prediction_error"] for row in rows[:2]]
    assert all(path.stat().st_mtime_ns == before[path.name] for path in (tmp_path / "out/rows").iterdir() if path.name in before)
    os.unlink(archive / "runs/0_new")
    os.rename(archive / "torn", archive / "runs/torn")


@pytest.mark.slow
def test_diagnoses_are_those_of_the_single_command_whoever_computes_them(program, archive, tmp_path):
    file = campaign_file(archive, "diagnosed", "task: diagnose\n    platforms: [whorl_1]")
    program("campaign", file, "--out", tmp_path / "threads")
    # As parts in other processes, in another order, the last of them in Python.
    for part in ("2/3", "0/3"):
        program("campaign", file, "--out", tmp_path / "parts", "--part", part)
    rest = whorl.Campaign(file, tmp_path / "parts")
    assert rest.missing == [1] and rest.run(1) == 1
    tables = rest.write_tables()
    for table in ("summary.csv", "table/rows.parquet", "candidates/rows.parquet"):
        assert (tmp_path / "threads" / table).read_bytes() == (tmp_path / "parts" / table).read_bytes(), table
    rows = rows_of(tmp_path / "threads")
    # The friction that was put in, beside that of the wheels, which the truth of every run has.
    assert rows[0]["verdict"] == "named" and "bearing_viscous_friction" in rows[0]["effects"].split(", ")
    assert "bearing_viscous_friction" not in rows[1]["effects"].split(", ")
    assert rows[2]["outcome"] == "failed"
    assert any("x named: bearing_viscous_friction" in sentence for sentence in tables.said)
    answer = whorl.diagnose(archive / "runs/first", platform="whorl_1")
    named = tables.sql("SELECT effect, delta_log_evidence FROM candidates WHERE named AND recording = 'runs/first'").fetchall()
    theirs = {c["effect"]: c["delta_log_evidence"] for c in answer.candidates if c["effect"] in answer.effects}
    assert dict(named) == pytest.approx(theirs, rel=1e-9) and "bearing_viscous_friction" in theirs
    assert tables.sql("SELECT count(*) FROM recordings WHERE outcome = 'done'").fetchall() == [(2,)]
    assert tables.to_polars("candidates").height > 10
    with pytest.raises(whorl.WhorlError, match="there is no table none; allowed: candidates"):
        tables.to_polars("none")


def test_dask_asks_the_recordings(archive, tmp_path):
    distributed = pytest.importorskip("dask.distributed")
    file = campaign_file(archive, "dask", "task: compare")
    alone = whorl.Campaign(file, tmp_path / "alone")
    for number in alone.missing:
        alone.run(number)
    with distributed.LocalCluster(2, processes=True, threads_per_worker=1, dashboard_address=None) as cluster:
        with distributed.Client(cluster) as client:
            tables = whorl.Campaign(file, tmp_path / "dask").run_with(client)
    assert tables.rows == 5 and tables.page is None
    assert tables.csv.read_bytes() == alone.write_tables().csv.read_bytes()


def test_attitudes_of_many_recordings(program, archive, tmp_path):
    file = campaign_file(archive, "estimated", "task: estimate\n    platforms: [whorl_2]\n    smooth: true")
    said = program("campaign", file, "--out", tmp_path / "out").stdout
    assert "attitudes" in said
    rows = rows_of(tmp_path / "out")
    assert [row["filter"] for row in rows[:2]] == ["free_motion"] * 2
    # The simulation's truth is in its recording. North is where the platform's file says, not where its vector sensor looks (east).
    assert all(0.0 < float(row["error_rms_deg"]) < 6.0 for row in rows[:2]), rows
    assert all(0.0 < float(row["inclination_error_rms_deg"]) < 1.0 for row in rows[:2]), rows
    attitudes = polars.read_parquet(tmp_path / "out/attitudes", hive_partitioning=True)
    first = attitudes.filter(polars.col("recording") == "runs/first").sort("time_s")
    assert len(first) == int(float(rows[0]["attitudes"])) and set(attitudes["platform"]) == {"whorl_2"}
    norm = first.select(["qw", "qx", "qy", "qz"]).to_numpy()
    np.testing.assert_allclose(np.linalg.norm(norm, axis=1), 1.0, atol=1e-12)


def test_attitudes_of_csv_files_are_those_of_the_single_command(program, params, tmp_path):
    t = np.arange(3000) / 100.0
    rng = np.random.default_rng(2)
    for name in ("a", "b"):
        still = np.column_stack([t, 1e-3 * rng.standard_normal((3000, 3)), [0, 0, 9.81] + 0.02 * rng.standard_normal((3000, 3))])
        table = np.column_stack([still, [0.0, 22.0, -42.0] + 0.1 * rng.standard_normal((3000, 3))])
        header = "t,gx,gy,gz,ax,ay,az,mx,my,mz"
        np.savetxt(tmp_path / f"{name}.csv", table, fmt="%.17g", delimiter=",", header=header, comments="")
    map_ = tmp_path / "map.yaml"
    map_.write_text(
        "csv:\n  ros__parameters:\n    time: {column: t, unit: s}\n    gyro: {columns: [gx, gy, gz], unit: rad/s}\n"
        "    accelerometer: {columns: [ax, ay, az], unit: m/s^2}\n    vector: {columns: [mx, my, mz]}\n    imu_latency_s: 0.003\n"
    )
    file = tmp_path / "many.yaml"
    file.write_text("/campaign:\n  ros__parameters:\n    recordings: ['*.csv']\n    task: estimate\n    channels: map.yaml\n")
    program("campaign", file, "--out", tmp_path / "out")
    rows = rows_of(tmp_path / "out")
    assert [(row["recording"], row["filter"], row["samples"]) for row in rows] == [
        (name, "free_motion", "3000.0") for name in ("a.csv", "b.csv")
    ]
    program("estimate", tmp_path / "b.csv", "--channels", map_, "--out", tmp_path / "one.csv")
    alone = polars.read_csv(tmp_path / "one.csv")
    ours = polars.read_parquet(tmp_path / "out/attitudes/recording=b.csv/platform=/attitudes.parquet").sort("time_s")
    np.testing.assert_allclose(ours.select(alone.columns).to_numpy(), alone.to_numpy(), rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(ours["qw"].to_numpy(), alone["qw"].to_numpy(), atol=1e-9)


def test_what_is_wrong_is_refused_before_anything_is_computed(program, archive, params, tmp_path):
    out = tmp_path / "out"

    def refused(text, *given):
        return program("campaign", campaign_file(archive, "wrong", text), "--out", out, *given, ok=False).stderr

    assert "there is no effect no_such" in refused("task: diagnose\n    exclude: [no_such]")
    assert "no file" in refused("task: compare\n    model_file: none.yaml")
    assert "--seeds is for campaigns over experiments" in refused("task: compare", "--seeds", 3)
    assert "it does not go with `recordings`" in refused("task: compare\n    experiments: [hold]")
    empty = archive / "wrong.yaml"
    empty.write_text("/campaign:\n  ros__parameters:\n    recordings: ['nothing/*']\n    task: compare\n")
    assert "no recording matches nothing/*" in program("campaign", empty, "--out", out / "2", ok=False).stderr
    # Another question in the same folder.
    program("campaign", campaign_file(archive, "one", "task: compare\n    platforms: [whorl_2]"), "--out", out / "3")
    other = campaign_file(archive, "one", "task: compare\n    platforms: [whorl_1]")
    assert "holds another campaign" in program("campaign", other, "--out", out / "3", ok=False).stderr


def test_a_new_effect_is_a_candidate_for_old_runs(program, archive, params, tmp_path):
    (written,) = sorted((params / "demo/effects").glob("*.yaml"))[:1]
    (archive / written.name).write_text(written.read_text())
    one = "task: diagnose\n    platforms: [whorl_1]"
    file = campaign_file(archive, "with_new", f"{one}\n    effects: [{written.name}]", "runs/second")
    program("campaign", file, "--out", tmp_path / "new")
    candidates = polars.read_parquet(tmp_path / "new/candidates")
    assert written.stem in set(candidates["effect"])

    # Where a process has added the effect for something else, a campaign that does not name it does without, as workers do. In a
    # process of its own: an effect that is loaded stays.
    without = campaign_file(archive, "without", one, "runs/second")
    script = textwrap.dedent(
        """
        import sys, whorl
        written, campaign, out = sys.argv[1:]
        print(whorl.load_effect(written))
        campaign = whorl.Campaign(campaign, out)
        campaign.run(0)
        campaign.write_tables()
        """
    )
    given = [sys.executable, "-c", script, str(written), str(without), str(tmp_path / "old")]
    done = subprocess.run(given, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stdout.split() == [written.stem], done.stdout + done.stderr
    old = polars.read_parquet(tmp_path / "old/candidates")
    assert written.stem not in set(old["effect"]) and set(old["recording"]) == {"runs/second"}


def test_a_killed_command_goes_on_and_a_second_one_is_refused(params, program, tmp_path):
    file = tmp_path / "many.yaml"
    file.write_text("/campaign:\n  ros__parameters:\n    name: many\n    experiments: [hold]\n    seeds: 24\n    longest_s: 30.0\n")
    given = ["campaign", str(file), "--params", str(params), "--out"]
    program(*given, tmp_path / "whole")
    binary = program("--version").args[0]
    rows = tmp_path / "broken/rows"
    killed = subprocess.Popen([binary, *given, str(tmp_path / "broken"), "-j", "2"], stdout=subprocess.DEVNULL)
    until = time.monotonic() + 120
    while len(list(rows.glob("*.csv")) if rows.exists() else []) < 2:
        assert killed.poll() is None and time.monotonic() < until
        time.sleep(0.002)
    # While it works: a second command, and Dask, are told who works there.
    os.kill(killed.pid, signal.SIGSTOP)
    refused = program(*given, tmp_path / "broken", ok=False).stderr
    assert f"process {killed.pid} on" in refused and "works on this campaign already" in refused
    with pytest.raises(whorl.WhorlError, match=f"process {killed.pid} on"):
        whorl.Campaign(file, tmp_path / "broken", params=params).run_with(None)
    killed.kill()
    killed.wait()
    before = {path.name: path.stat().st_mtime_ns for path in rows.glob("*.csv")}
    assert 2 <= len(before) < 24
    said = program(*given, tmp_path / "broken").stdout
    assert f"{24 - len(before)} runs here" in said and f"{len(before)} were already done" in said
    assert all((rows / name).stat().st_mtime_ns == written for name, written in before.items()), "a row was computed twice"
    assert (tmp_path / "broken/summary.csv").read_bytes() == (tmp_path / "whole/summary.csv").read_bytes()

    # A cluster's job is at work on it.
    (tmp_path / "broken/slurm").mkdir()
    (tmp_path / "broken/slurm/job").write_text("4711\n")
    refused = program(*given, tmp_path / "broken", ok=False).stderr
    assert "job 4711 on Slurm works on" in refused and "scancel 4711" in refused
