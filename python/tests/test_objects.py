"""Recordings and campaigns in object storage. Truth: the same on the file system. The server is moto's, on this machine."""

import os
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

import pytest
import whorl

boto3 = pytest.importorskip("boto3")


@pytest.fixture(scope="module")
def bucket():
    """A bucket of an S3 server on this machine, which the environment names meanwhile."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"http://127.0.0.1:{port}"
    server = subprocess.Popen(
        [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    given = {
        "AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "secret", "AWS_REGION": "us-east-1", "AWS_ENDPOINT_URL": address,
    }
    before = {name: os.environ.get(name) for name in given}
    os.environ.update(given)
    try:
        until = time.monotonic() + 60
        while True:
            try:
                urllib.request.urlopen(address, timeout=1)
                break
            except (urllib.error.URLError, OSError):
                assert server.poll() is None and time.monotonic() < until, "the server does not start"
                time.sleep(0.1)
        client = boto3.client("s3", endpoint_url=address, region_name="us-east-1")
        client.create_bucket(Bucket="laboratory")
        yield client
    finally:
        server.terminate()
        server.wait()
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


def uploaded(client, folder, prefix):
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            client.upload_file(str(path), "laboratory", f"{prefix}/{path.relative_to(folder)}")


def keys(client, prefix):
    listed = client.get_paginator("list_objects_v2").paginate(Bucket="laboratory", Prefix=prefix)
    return [entry["Key"] for page in listed for entry in page.get("Contents", [])]


def content(client, key):
    return client.get_object(Bucket="laboratory", Key=key)["Body"].read()


def small(tmp_path):
    path = tmp_path / "small.yaml"
    path.write_text(
        "/campaign:\n  ros__parameters:\n    name: small\n    experiments: [hold]\n    seeds: 3\n    longest_s: 4.0\n    keep_every: 3\n"
        '    sweep:\n      delay_s: {key: "/simulation:link.delay_s", values: [0.001, 0.05]}\n'
    )
    return path


def test_a_campaign_gives_the_same_objects_as_files(program, params, bucket, tmp_path):
    file = small(tmp_path)
    given = ["campaign", file, "--params", params, "--out"]
    program(*given, tmp_path / "here")
    # Begun by a part, as an engine's task would; the rest by a second machine, which shares nothing but the bucket.
    there = "s3://laboratory/campaigns/small"
    program(*given, there, "--part", "1/3")
    assert len(keys(bucket, "campaigns/small/rows/")) == 2
    said = program(*given, there).stdout
    assert "4 runs here" in said and "2 were already done" in said and f"table: {there}/summary.csv" in said
    mine = {str(path.relative_to(tmp_path / "here")) for path in (tmp_path / "here").rglob("*") if path.is_file()} - {"lock"}
    theirs = {key.removeprefix("campaigns/small/") for key in keys(bucket, "campaigns/small/")}
    assert theirs == mine and any(name.startswith("runs/") for name in mine)
    for name in sorted(mine):
        if not name.startswith("runs/"):
            assert content(bucket, f"campaigns/small/{name}") == (tmp_path / "here" / name).read_bytes(), name
    assert "0 runs here" in program(*given, there).stdout
    # Another campaign in the same place.
    other = program("campaign", file, "--params", params, "--seeds", 2, "--out", there, ok=False).stderr
    assert "s3://laboratory/campaigns/small" in other and "holds another campaign" in other


def test_workers_of_dask_share_nothing_but_the_bucket(program, params, bucket, tmp_path):
    distributed = pytest.importorskip("dask.distributed")
    file = small(tmp_path)
    program("campaign", file, "--params", params, "--out", tmp_path / "here")
    with distributed.LocalCluster(2, processes=True, threads_per_worker=1, dashboard_address=None) as cluster:
        with distributed.Client(cluster) as client:
            campaign = whorl.Campaign(file, "s3://laboratory/dask", params=params)
            assert campaign.folder == "s3://laboratory/dask" and len(campaign.missing) == 6
            tables = campaign.run_with(client)
    assert campaign.missing == [] and tables.csv == "s3://laboratory/dask/summary.csv"
    assert content(bucket, "dask/summary.csv") == (tmp_path / "here/summary.csv").read_bytes()
    with pytest.raises(whorl.WhorlError, match="is in object storage"):
        tables.sql("SELECT count(*) FROM runs")


def test_recordings_are_asked_where_they_are(program, run, bucket, tmp_path):
    uploaded(bucket, run, "runs/swing")
    bucket.put_object(Bucket="laboratory", Key="runs/torn/manifest.yaml", Body=b"state: recording\n")
    bucket.put_object(Bucket="laboratory", Key="elsewhere/x/manifest.yaml", Body=b"")
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs/swing").symlink_to(run)
    (tmp_path / "runs/torn").mkdir()
    (tmp_path / "runs/torn/manifest.yaml").write_text("state: recording\n")
    rows = {}
    for name, pattern in (("here", "runs/*"), ("there", "s3://laboratory/runs/*")):
        file = tmp_path / f"{name}.yaml"
        file.write_text(f"/campaign:\n  ros__parameters:\n    name: asked\n    recordings: ['{pattern}']\n    task: compare\n")
        program("campaign", file, "--out", tmp_path / f"out_{name}")
        rows[name] = (tmp_path / f"out_{name}/summary.csv").read_text()
    assert rows["here"].count("\n") == 4 and "torn" in rows["here"]
    assert rows["there"].replace("s3://laboratory/runs/", "runs/") == rows["here"].replace(f"{tmp_path}/", "")

    given = ["--platform", "whorl_1", "--html", tmp_path / "page.html", "--json", "-"]
    alone = program("compare", run, *given).stdout
    assert program("compare", "s3://laboratory/runs/swing", *given).stdout.replace("s3://laboratory/runs/swing", str(run)) == alone
    local, stored = whorl.read(run, platform="whorl_1"), whorl.read("s3://laboratory/runs/swing", platform="whorl_1")
    assert (stored["gyro"].values == local["gyro"].values).all()


def test_what_is_not_there_is_said(program, bucket, tmp_path, monkeypatch):
    said = program("compare", "s3://laboratory/none", "--platform", "whorl_1", ok=False).stderr
    assert "s3://laboratory/none: there is nothing with this name or below it" in said
    said = program("compare", "s3://no-such-bucket/a", "--platform", "whorl_1", ok=False).stderr
    assert "s3://no-such-bucket/a" in said and "NoSuchBucket" in said
    assert "allowed: s3://BUCKET" in program("compare", "s3:///a", "--platform", "whorl_1", ok=False).stderr
    file = tmp_path / "none.yaml"
    file.write_text("/campaign:\n  ros__parameters:\n    recordings: ['s3://laboratory/nothing/*']\n    task: compare\n")
    said = program("campaign", file, "--out", tmp_path / "out", ok=False).stderr
    assert "no recording matches s3://laboratory/nothing/*" in said
    # A server that does not answer: told within a minute or so, and nothing is lost.
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    begun = time.monotonic()
    said = program("compare", "s3://laboratory/none", "--platform", "whorl_1", ok=False).stderr
    assert "cannot list s3://laboratory/none" in said and time.monotonic() - begun < 90
