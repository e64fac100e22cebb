"""Explaining. Truth: the numbers of the program on the same files, and a rig whose motion is known in closed form."""

import json
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time

import numpy as np
import pytest
import whorl


@pytest.fixture(scope="module")
def recording(run):
    return whorl.read(run, platform="whorl_1")


@pytest.fixture(scope="module")
def diagnosis(recording):
    steps = []
    found = whorl.diagnose(recording, progress=lambda share, doing: steps.append((share, doing)))
    return found, steps


def of_program(program, tmp_path, *arguments):
    path = tmp_path / "answer.json"
    done = program(*arguments, "--json", path, "--html", tmp_path / "page.html")
    return json.loads(path.read_text()), done.stdout


@pytest.mark.parametrize(("command", "function"), [("compare", whorl.compare), ("where", whorl.locate)])
def test_answers_are_those_of_the_program(program, tmp_path, run, recording, command, function):
    data, printed = of_program(program, tmp_path, command, run, "--platform", "whorl_1")
    for given in ({"runs": recording}, {"runs": [run], "platform": "whorl_1"}):
        answer = function(**given)
        assert answer.data == data
        assert all(sentence in printed for sentence in answer.answer) and answer.answer
    assert answer.save(tmp_path / "own.html").read_text().startswith("<!")


def test_a_diagnosis_is_that_of_the_program_and_names_what_was_put_in(program, tmp_path, run, diagnosis):
    found, steps = diagnosis
    data, printed = of_program(program, tmp_path, "diagnose", run, "--platform", "whorl_1")
    assert found.data == data and found.answer[0] in printed
    # The fixture's friction; the wheels' own was in the truth of the parameter folder.
    assert found.verdict == "named" and "bearing_viscous_friction" in found.effects
    (friction,) = [c for c in found.candidates if c["effect"] == "bearing_viscous_friction"]
    (c,) = friction["parameters"]
    assert abs(c["estimate"] - 0.3) < 4 * c["stddev"] < 0.02
    shares = [share for share, _ in steps]
    assert len(set(shares)) > 4 and min(shares) >= 0 and max(shares) <= 1 and shares == sorted(shares)


def test_an_adopted_model_is_written_and_goes_on_in_memory(program, tmp_path, recording, diagnosis, params):
    effects = diagnosis[0].effects
    out = tmp_path / "whorl_1.yaml"
    out.write_bytes((params / "whorl_1.yaml").read_bytes())
    (tmp_path / "common.yaml").write_bytes((params / "common.yaml").read_bytes())
    found = whorl.adopt(recording, effects, out=out)
    errors = [version["prediction_error"] for version in found.versions]
    # The simulated sensors are off their model by a little, too.
    assert errors[0] > 1.2 and errors[-1] < 1.05
    assert whorl.compare(recording, model=found.adopted).prediction_error == pytest.approx(errors[-1], abs=1e-9)
    # The file rounds to the uncertainty.
    assert whorl.compare(recording, model=out).prediction_error == pytest.approx(errors[-1], abs=1e-3)
    assert "adopted bearing_viscous_friction" in program("history", out).stdout
    assert "sha256" in found.data["provenance"]


TURNTABLE = """
/turntable/**:
  ros__parameters:
    model:
      mass_kg: 20.0
      inertia_kg_m2: {xx: 1.0, xy: 0.0, xz: 0.0, yy: 1.0, yz: 0.0, zz: 2.0}
      gravity_offset_n_m: [0.0, 0.0, 0.0]
      freedom: {kind: hinge, axis: [0.0, 0.0, 1.0]}
      wheel_defaults: {spin_inertia_kg_m2: 0.02, max_torque_n_m: 0.5, max_speed_rad_s: 300.0,
                       viscous_friction_n_m_s: 0.0, coulomb_friction_n_m: 0.0}
      wheels: {wheel: {spin_axis: [0.0, 0.0, 1.0]}}
      sensors:
        rate_hz: 100.0
        gyro: {axes: [z], noise_stddev_rad_s: 0.0005, bias_turn_on_stddev_rad_s: 0.002}
"""


def turntable(friction_n_m_s, seed):
    """A turntable (2 kg m^2 with its wheel) that a wheel (0.02 kg m^2) swings, held back by viscous friction: in each of the
    steps in which the motor's torque is constant, (J - J_w) w' = -torque - c w has an exponential for its solution."""
    step, n, body, wheel = 0.01, 9000, 2.0 - 0.02, 0.02
    rng = np.random.default_rng(seed)
    time_s = step * np.arange(n)
    torque = 0.1 * np.sin(2 * np.pi * time_s / 9.0) + 0.1 * np.sign(np.sin(2 * np.pi * time_s / 21.0))
    rate, speed = np.zeros(n), np.zeros(n)
    keep = np.exp(-friction_n_m_s * step / body)
    for k in range(n - 1):
        limit = -torque[k] / friction_n_m_s
        rate[k + 1] = limit + (rate[k] - limit) * keep
        speed[k + 1] = speed[k] + torque[k] * step / wheel - (rate[k + 1] - rate[k])
    return {
        "gyro": (time_s, np.column_stack([np.full(n, np.nan)] * 2 + [rate + 5e-4 * rng.standard_normal(n)])),
        "wheel_speed": (time_s, speed + 0.05 * rng.standard_normal(n)),
        "wheel_torque_command": (time_s, torque),
    }


def test_arrays_of_ones_own_to_a_named_effect(tmp_path):
    model = tmp_path / "turntable.yaml"
    model.write_text(TURNTABLE)
    run = whorl.Recording.from_arrays(turntable(0.05, 1), model=model, jets=[], name="bench")
    found = whorl.diagnose(run)
    assert found.effects == ["bearing_viscous_friction"], str(found)
    (c,) = next(c for c in found.candidates if c["effect"] == found.effects[0])["parameters"]
    assert abs(c["estimate"] - 0.05) < 4 * c["stddev"] < 0.01
    # Asked for nevertheless, the search finds the same law with the same number.
    found = whorl.discover(run, name="drag", anyway=True)
    law = next(law for law in found.laws if law["kind"] == "law")
    (k,) = law["parameters"]
    assert k["unit"] == "N m s" and abs(k["value"]) == pytest.approx(0.05, rel=0.01), law
    if found.laws[0]["kind"] == "law":
        assert whorl.load_effect(found.write(tmp_path / "drag.yaml")) == "drag"
    else:
        with pytest.raises(whorl.WhorlError, match="there is no law to write"):
            found.write(tmp_path / "drag.yaml")
    with pytest.raises(whorl.WhorlError, match="the name is the effect's id; allowed: small letters"):
        whorl.discover(run, name="My law")


def test_mass_properties(recording):
    found = whorl.identify(recording)
    (i_zz,) = [p for p in found.parameters if p["name"] == "I_zz"]
    assert i_zz["determined"] == "yes" and found.identified is not None
    assert found.identified.inertia_b_kg_m2[2][2] == pytest.approx(i_zz["estimate"], rel=1e-3)
    with pytest.raises(whorl.WhorlError, match="prior_scale is 0"):
        whorl.identify(recording, prior_scale=0)


def test_errors_have_the_words_of_the_program(program, run, recording, tmp_path):
    csv = tmp_path / "table.csv"
    csv.write_text("t,x\n0,1\n")
    for call, arguments in [
        (lambda: whorl.compare("nowhere"), ["compare", "nowhere"]),
        (lambda: whorl.compare(run), ["compare", run]),
        (lambda: whorl.compare(run, platform="whorl_3"), ["compare", run, "--platform", "whorl_3"]),
        (lambda: whorl.compare(csv), ["compare", csv]),
        (lambda: whorl.adopt(recording, "friction"), ["adopt", run, "--try", "friction", "--platform", "whorl_1"]),
    ]:
        with pytest.raises(whorl.WhorlError) as raised:
            call()
        said = program(*arguments, ok=False).stderr
        assert said == f"error: {raised.value}\n"


def test_what_progress_raises_ends_the_computation(recording):
    class Enough(Exception):
        pass

    def stop(share, doing):
        raise Enough

    begun = time.monotonic()
    with pytest.raises(Enough):
        whorl.diagnose(recording, progress=stop)
    assert time.monotonic() - begun < 5


def test_other_threads_run_meanwhile(recording):
    """Without the interpreter's lock released, the other thread would not get a turn during a comparison."""
    ticks, over = [], threading.Event()

    def tick():
        while not over.wait(0.005):
            ticks.append(time.monotonic())

    other = threading.Thread(target=tick)
    other.start()
    begun = time.monotonic()
    whorl.compare(recording)
    ended = time.monotonic()
    over.set()
    other.join()
    gaps = np.diff([begun, *[t for t in ticks if begun < t < ended], ended])
    assert gaps.max() < 0.5 * (ended - begun), "the lock was held"


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_ctrl_c_ends_a_long_call(run):
    program = f"""
        import time, whorl
        recording = whorl.read({str(run)!r}, platform="whorl_1")
        try:
            whorl.diagnose(recording, progress=lambda share, doing: print(doing, flush=True))
        except KeyboardInterrupt:
            print("interrupted", flush=True)
    """
    process = subprocess.Popen([sys.executable, "-c", textwrap.dedent(program)], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline()
    time.sleep(0.5)
    asked = time.monotonic()
    process.send_signal(signal.SIGINT)
    rest, _ = process.communicate(timeout=60)
    assert rest.endswith("interrupted\n") and process.returncode == 0
    assert time.monotonic() - asked < 5


def test_figures_draw_the_numbers(recording, diagnosis):
    found = diagnosis[0]
    bars = found.figure().data[0]
    assert bars.y[-1] == found.candidates[0]["effect"] and bars.x[-1] == found.candidates[0]["delta_log_evidence"]
    compared = whorl.compare(recording)
    channels = compared.data["runs"][0]["channels"]
    drawn = compared.figure().data
    assert len(drawn) == len(channels[0]["horizons"]) and list(drawn[0].x) == [c["name"] for c in channels]
    np.testing.assert_array_equal(recording.figure(["gyro"]).data[1].y, recording["gyro"].values[:, 1])
    for answer in (found, compared):
        assert "<table>" in answer._repr_html_() and answer.answer[0].split(" (")[0] in answer._repr_html_()
