"""Results as Parquet. Truth: the same numbers as CSV or JSON, read by three other programs' readers."""

import csv
import json
import os
import signal
import socket
import subprocess
import sys

import duckdb
import numpy as np
import polars
import pyarrow.dataset
import pyarrow.parquet
import pytest
import whorl
from whorl.campaign import connected


def test_channels_of_many_runs_are_one_table(program, run, params, tmp_path):
    second = tmp_path / "second"
    hold = params / "experiments/hold.yaml"
    program("simulate", "--experiment", hold, "--out", second, "--no-report", "--longest", 8)
    out = tmp_path / "parquet"
    printed = program("export", "parquet", run, second, "--out", out).stdout
    assert printed.count(" rows: ") == 4
    folder = tmp_path / "csv"
    program("export", "csv", run, "--out", folder)
    of_csv = polars.read_csv(folder / "whorl_1.csv", infer_schema_length=None)

    # Polars, DuckDB and Arrow see the same table, with run and platform as columns.
    gyro = polars.read_parquet(out / "gyro", hive_partitioning=True)
    sql = f"SELECT run, platform, count(*), max(gyro_z_rad_s) FROM read_parquet('{out}/gyro/**/*.parquet') GROUP BY ALL ORDER BY ALL"
    rows = duckdb.sql(sql).fetchall()
    assert [row[:2] for row in rows] == [(r, p) for r in ("second", "swing") for p in ("whorl_1", "whorl_2")]
    assert sum(row[2] for row in rows) == len(gyro)
    assert pyarrow.dataset.dataset(out / "gyro", partitioning="hive").count_rows() == len(gyro)

    own = gyro.filter((polars.col("run") == "swing") & (polars.col("platform") == "whorl_1")).sort("time_s")
    names = ["time_s", "gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s"]
    np.testing.assert_array_equal(own.select(names).to_numpy(), of_csv.select(names).drop_nulls().to_numpy())
    wheels = polars.read_parquet(out / "wheel_speed/run=swing/platform=whorl_1/samples.parquet")
    assert wheels.columns[:2] == ["time_s", "wheel_x_rad_s"]
    notes = pyarrow.parquet.read_metadata(next((out / "vector_1").rglob("*.parquet"))).metadata
    assert notes[b"channel"] == b"vector_1" and len(json.loads(notes[b"reference_world"])) == 3

    # Writing a run again replaces it.
    program("export", "parquet", second, "--out", out)
    assert len(polars.read_parquet(out / "gyro")) == len(gyro)
    # From Python, the same files.
    paths = whorl.read(run, platform="whorl_1").to_parquet(tmp_path / "own")
    theirs = out / "wheel_speed/run=swing/platform=whorl_1/samples.parquet"
    (ours,) = [path for path in paths if "wheel_speed" in path]
    assert polars.read_parquet(ours).equals(polars.read_parquet(theirs))


def test_pulses_and_missing_axes(tmp_path):
    time_s = [0.0, 0.1, 0.2]
    rate = np.column_stack([[np.nan] * 3, [np.nan] * 3, [1.0, 2.0, 3.0]])
    recording = whorl.Recording.from_arrays({"gyro": (time_s, rate)}, jets=[[(0.05, 0.1)], [(0.0, 0.02), (0.1, 0.2)]], name="a/b")
    recording.to_parquet(tmp_path)
    gyro = polars.read_parquet(tmp_path / "gyro", hive_partitioning=True)
    # Not measured is null, not zero; a name with a slash is one folder.
    assert gyro["gyro_x_rad_s"].null_count() == 3 and gyro["gyro_z_rad_s"].to_list() == [1.0, 2.0, 3.0]
    assert gyro["run"].to_list() == ["a/b"] * 3
    pulses = polars.read_parquet(tmp_path / "jets").select("jet", "on_s", "off_s").rows()
    assert pulses == [("jet_1", 0.05, 0.1), ("jet_2", 0.0, 0.02), ("jet_2", 0.1, 0.2)]


def test_rows_of_a_campaign(program, params, tmp_path):
    campaign = tmp_path / "small.yaml"
    campaign.write_text(
        "/campaign:\n  ros__parameters:\n    name: small\n    experiments: [hold, leader_follower_short]\n    seeds: 2\n"
        "    longest_s: 6.0\n    sweep:\n"
        '      delay_s: {key: "/simulation:link.delay_s", values: [0.001, 0.05]}\n'
        "      link: {cases: {whole: [], lossy: ['/simulation:link.loss:=0.1']}}\n"
    )
    out = tmp_path / "out"
    program("campaign", campaign, "--params", params, "--out", out)
    with open(out / "summary.csv", newline="") as file:
        of_csv = {int(row["run"]): row for row in csv.DictReader(file)}
    table = duckdb.sql(f"SELECT * FROM read_parquet('{out}/table/**/*.parquet', hive_partitioning = true) ORDER BY run")
    rows = [dict(zip(table.columns, row)) for row in table.fetchall()]
    assert len(rows) == len(of_csv) == 16 and set(rows[0]) == set(of_csv[0])
    for row in rows:
        theirs = of_csv[row["run"]]
        for key, value in row.items():
            if isinstance(value, float):
                assert value == float(theirs[key]), key
            else:
                assert ("" if value is None else str(value)) == theirs[key], key
    assert {row["link"] for row in rows} == {"whole", "lossy"} and rows[0]["delay_s"] == 0.001


def test_diagnoses_are_one_table(program, run, tmp_path):
    out = tmp_path / "diagnoses"
    given = ["--platform", "whorl_2", "--exclude", "wheel_friction", "--html", tmp_path / "page.html"]
    program("diagnose", run, *given, "--json", tmp_path / "answer.json", "--parquet", out)
    answer = json.loads((tmp_path / "answer.json").read_text())
    table = polars.read_parquet(out, hive_partitioning=True)
    assert table["effect"].to_list() == [c["effect"] for c in answer["candidates"]]
    assert table["delta_log_evidence"].to_list() == [c["delta_log_evidence"] for c in answer["candidates"]]
    assert set(table["run"]) == {"swing"} and set(table["platform"]) == {"whorl_2"}
    assert set(table["verdict"]) == {answer["verdict"]}
    assert table.filter("named")["effect"].sort().to_list() == sorted(set(answer["effects"]) & set(table["effect"]))
    assert json.loads(table["parameters_json"][0]) == answer["candidates"][0]["parameters"]


def small(tmp_path):
    path = tmp_path / "small.yaml"
    path.write_text(
        "/campaign:\n  ros__parameters:\n    name: small\n    experiments: [hold]\n    seeds: 4\n    longest_s: 4.0\n"
        '    sweep:\n      delay_s: {key: "/simulation:link.delay_s", values: [0.001, 0.05, 0.1]}\n'
    )
    return path


def test_dask_gives_the_table_of_the_program(program, params, tmp_path):
    """A scheduler and two workers as processes; one worker is killed while they work."""
    distributed = pytest.importorskip("dask.distributed")
    campaign = small(tmp_path)
    program("campaign", campaign, "--params", params, "--out", tmp_path / "threads")
    with distributed.LocalCluster(2, processes=True, threads_per_worker=1, dashboard_address=None) as cluster:
        with distributed.Client(cluster) as client:
            ours = whorl.Campaign(campaign, tmp_path / "dask", params=params)
            assert len(ours) == 12 and ours.missing == list(range(12))
            killed = []

            def kill_one(share, doing):
                if not killed:
                    pids = client.run(os.getpid)
                    killed.append(next(iter(pids.values())))
                    os.kill(killed[0], signal.SIGKILL)

            tables = ours.run_with(client, progress=kill_one)
    assert killed and tables.rows == 12 and ours.missing == []
    assert tables.csv.read_bytes() == (tmp_path / "threads/summary.csv").read_bytes()
    assert tables.sql("SELECT count(*), min(delay_s) FROM runs").fetchall() == [(12, 0.001)]
    assert tables.to_polars()["seed"].to_list() == [1, 2, 3, 4] * 3


def test_the_program_distributes_with_dask_and_says_when_the_scheduler_is_lost(program, params, tmp_path, monkeypatch):
    """A scheduler and two workers as processes of their own, given by address."""
    pytest.importorskip("dask.distributed")
    monkeypatch.setenv("WHORL_PYTHON", sys.executable)
    campaign = small(tmp_path)
    given = ["campaign", campaign, "--params", params]
    program(*given, "--out", tmp_path / "threads")
    out = [*given, "--out", tmp_path / "dask", "--engine", "dask"]
    assert "--scheduler" in program(*out, ok=False).stderr
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    said = program(*out, "--scheduler", address, ok=False).stderr
    assert f"no Dask scheduler answers at {address}" in said, said
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", address.rsplit(":", 1)[1]]
    started = [subprocess.Popen([*dask, "--dashboard-address", "127.0.0.1:0"], **quiet)]
    try:
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-dashboard"]
        started += [subprocess.Popen([*worker, "--local-directory", str(tmp_path)], **quiet) for _ in range(2)]
        said = program(*out, "--scheduler", address).stdout
        assert "12 runs on the cluster" in said and "12 of 12 runs are done" in said, said
        assert (tmp_path / "dask/summary.csv").read_bytes() == (tmp_path / "threads/summary.csv").read_bytes()

        # Killed while it works: what is done is kept, and the same call goes on.
        other = whorl.Campaign(campaign, tmp_path / "lost", params=params)
        with connected(address) as client:
            with pytest.raises(whorl.WhorlError, match="the Dask scheduler was lost.* of 12 runs are done and kept"):
                other.run_with(client, progress=lambda share, doing: started[0].kill())
        assert len(other.missing) < 12
        for index in other.missing:
            other.run(index)
        assert other.write_tables().csv.read_bytes() == (tmp_path / "threads/summary.csv").read_bytes()
    finally:
        for process in reversed(started):
            process.kill()
            process.wait()
    monkeypatch.setenv("WHORL_PYTHON", "/no/such/python")
    assert "cannot start `/no/such/python`" in program(*given, "--out", tmp_path / "x", "--engine", "dask", "--scheduler", address, ok=False).stderr


def test_parts_give_the_table_of_the_program_and_wrong_ones_are_refused(program, params, tmp_path):
    campaign = small(tmp_path)
    given = ["campaign", campaign, "--params", params, "--out"]
    program(*given, tmp_path / "whole")
    for part in ("2/3", "0/3"):
        program(*given, tmp_path / "parts", "--part", part)
    rest = whorl.Campaign(campaign, tmp_path / "parts", params=params)
    assert rest.missing == [1, 4, 7, 10]
    program(*given, tmp_path / "parts", "--part", "1/3")
    assert rest.write_tables().csv.read_bytes() == (tmp_path / "whole/summary.csv").read_bytes()
    said = program(*given, tmp_path / "parts", "--part", "3/3", ok=False).stderr
    assert "allowed: NUMBER/OF, NUMBER from 0 to OF - 1" in said
    with pytest.raises(whorl.WhorlError, match="run 12: allowed: 0 to 11"):
        rest.run(12)
    with pytest.raises(whorl.WhorlError, match="holds another campaign"):
        whorl.Campaign(campaign, tmp_path / "parts", params=params, seeds=5)
    with pytest.raises(whorl.WhorlError, match="does not exist"):
        whorl.Campaign(tmp_path / "none.yaml", tmp_path / "x", params=params)
