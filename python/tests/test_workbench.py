"""What `whorl open` says to its page. Truth: its schema, made from the program's own types, and the answers of this package."""

import json
import os
import socket
import struct
import subprocess
import time
import urllib.request
from pathlib import Path

import pytest
import whorl

jsonschema = pytest.importorskip("jsonschema")
ROOT = Path(__file__).resolve().parents[2]
SCHEMA = json.loads((ROOT / "crates/whorl_workbench/api.schema.json").read_text())
DATA = ROOT / "tests/workbench/data"
FILES = ["band.csv.gz", "band.yaml", "band.channels.yaml"]
TOKEN = "00112233445566778899aabbccddeeff"
# For a comparison, on a computer that does other things as well.
LONG_S = 300.0


def check(part, value):
    """Holds a value to what the schema says of this part of the interface; returns it."""
    jsonschema.Draft202012Validator({"$defs": SCHEMA["$defs"], **SCHEMA["properties"][part]}).validate(value)
    return value


class Workbench:
    """A folder that is open."""

    def __init__(self, program, folder):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.site = f"http://127.0.0.1:{free.getsockname()[1]}"
        port = self.site.rsplit(":", 1)[1]
        environment = {**os.environ, "WHORL_OPEN_TOKEN": TOKEN}
        self.process = subprocess.Popen([program, "open", str(folder), "--port", port], env=environment, stdout=subprocess.PIPE, text=True)
        assert self.site in self.process.stdout.readline()

    def call(self, path, value=None):
        """The bytes of an answer."""
        body = json.dumps(value).encode()
        asked = urllib.request.Request(f"{self.site}/api/{path}", body, {"Authorization": f"Bearer {TOKEN}"})
        with urllib.request.urlopen(asked, timeout=LONG_S) as answer:
            return answer.read()

    def until(self, holds):
        """The state in which something holds."""
        begun = time.monotonic()
        while time.monotonic() - begun < LONG_S:
            state = check("state", json.loads(self.call("state")))
            if holds(state):
                return state
            time.sleep(0.2)
        raise AssertionError(f"not within {LONG_S:.0f} s: {state}")


@pytest.fixture
def bench(tmp_path, program):
    for name in FILES:
        (tmp_path / name).write_bytes((DATA / name).read_bytes())
    workbench = Workbench(program.path, tmp_path)
    yield workbench
    workbench.process.kill()
    workbench.process.wait()


def test_answers_are_of_the_schema_and_those_of_the_package(bench, tmp_path):
    bench.call("ask", check("ask", {"what": "compare"}))
    state = bench.until(lambda state: any(row["what"] == "compare" for row in state["answers"]) and state["job"] is None)
    assert state["problem"] is None
    answer = check("answer", json.loads(bench.call("answer", check("ask_answer", {"of": "compare", "number": None}))))
    run, model, channels = (tmp_path / name for name in FILES)
    own = whorl.compare(run, model=model, channels=channels)
    assert answer["json"]["prediction_error"] == pytest.approx(own.data["prediction_error"], rel=1e-12)
    assert answer["sentences"][0] == own.answer[0]

    # Samples come as a head of JSON and numbers behind it.
    samples = bench.call("series", check("ask_series", {"file": FILES[0], "from_s": None, "to_s": None, "most": 400_000}))
    (length,) = struct.unpack_from("<I", samples)
    head = check("series", json.loads(samples[4 : 4 + length]))
    wheel = next(row for row in head["signals"] if row["group"].startswith("wheel") and not row["holds"])
    times = struct.unpack_from(f"<{wheel['count']}d", samples, 4 + length + wheel["times_at"])
    assert list(times) == sorted(times) and head["span_s"][0] <= times[0] <= times[-1] <= head["span_s"][1]

    platform = check("platform", json.loads(bench.call("platform")))
    assert platform["platform"] == own.model.name
    check("map", json.loads(bench.call("map")))
    effects = check("effects", json.loads(bench.call("effects")))
    assert {row["id"] for row in effects} == {effect.id for effect in whorl.effects()}


def test_what_is_not_of_the_schema_is_refused(bench):
    with pytest.raises(jsonschema.ValidationError):
        check("ask", {"what": "format_disk"})
    with pytest.raises(urllib.error.HTTPError, match="400"):
        bench.call("ask", {"what": "format_disk"})
