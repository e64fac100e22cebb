"""Catalogue, simulation, allocation, orbits, stubs. Truth: the program, closed forms, and the module itself."""

import ast
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import whorl
from whorl import _native

MU = 3.986004415e14  # [m^3/s^2], Earth


def test_the_catalogue_is_that_of_the_program(program):
    printed = program("effects").stdout
    ids = [effect.id for effect in whorl.effects()]
    assert len(ids) > 40 and all(f"{id} " in printed for id in ids)
    assert whorl.describe_effect("harness_spring") == program("effects", "harness_spring").stdout
    with pytest.raises(whorl.WhorlError, match="there is no effect spring"):
        whorl.describe_effect("spring")


def test_a_written_effect_joins_the_catalogue(tmp_path, params):
    (written,) = sorted((params / "demo/effects").glob("*.yaml"))[:1]
    id = whorl.load_effect(written)
    assert id == written.stem and id in [effect.id for effect in whorl.effects()]
    broken = tmp_path / "broken.yaml"
    broken.write_text(written.read_text().replace("equation", "equatoin"))
    with pytest.raises(whorl.WhorlError, match="broken.yaml"):
        whorl.load_effect(broken)


def test_a_simulation_is_that_of_the_program(tmp_path, program, params):
    experiment = params / "experiments/hold.yaml"
    steps = []
    ours = whorl.simulate(
        experiment,
        tmp_path / "ours",
        seed=3,
        longest_s=12.0,
        overrides={"/whorl_1/driver:truth.effects.harness_spring.k_n_m_rad": np.float64(0.25)},
        progress=lambda share, doing: steps.append(doing),
    )
    spring = "/whorl_1/driver:truth.effects.harness_spring.k_n_m_rad:=0.25"
    given = ["--experiment", experiment, "--seed", 3, "--longest", 12, "-p", spring, "--no-report"]
    program("simulate", *given, "--out", tmp_path / "theirs")
    for platform in ("whorl_1", "whorl_2"):
        a, b = ours.recording(platform), whorl.read(tmp_path / "theirs", platform=platform)
        assert a.keys() == b.keys()
        for key in a:
            np.testing.assert_array_equal(a[key].values, b[key].values)
    assert "verdict" in ours.data and ours.verdict in repr(ours) and (ours.path / "report.html").exists()
    assert any(step.startswith("simulated ") for step in steps)
    with pytest.raises(whorl.WhorlError, match="does not exist"):
        whorl.simulate(tmp_path / "none.yaml")


def test_wheels_share_a_torque():
    wheels = whorl.Allocator(motor_torque_b=-np.eye(3), motor_limit=[0.5, 0.5, 0.5])
    found = wheels.allocate([0.2, 0.0, 1.0])
    # More than the z wheel can give: the direction is kept, half of the size is met.
    assert found["alpha"] == pytest.approx(0.5)
    np.testing.assert_allclose(found["motor_command"], [-0.1, 0.0, -0.5], atol=1e-9)
    np.testing.assert_allclose(found["achieved_torque_b_n_m"], [0.1, 0.0, 0.5], atol=1e-9)
    for wrong in ([1.0], [np.nan, 0, 0]):
        with pytest.raises(whorl.WhorlError):
            wheels.allocate(wrong)
    with pytest.raises(whorl.WhorlError, match=r"shape \(2, 3\); allowed: \(3, n\)"):
        whorl.Allocator(motor_torque_b=np.ones((2, 3)), motor_limit=[1, 1, 1])


def test_a_circular_orbit():
    a = 7e6
    orbit = whorl.Orbit(a, inclination_rad=0.9)
    n = math.sqrt(MU / a**3)
    assert orbit.period_s == pytest.approx(2 * math.pi / n, rel=1e-6)
    time_s = np.linspace(0.0, 6000.0, 7)
    position, velocity = orbit.state(time_s)
    expected = np.stack([np.cos(n * time_s), np.sin(n * time_s) * np.cos(0.9), np.sin(n * time_s) * np.sin(0.9)], axis=1)
    np.testing.assert_allclose(position, a * expected, atol=2.0)
    np.testing.assert_allclose(np.linalg.norm(velocity, axis=1), n * a, rtol=1e-6)
    with pytest.raises(whorl.WhorlError, match="above the ground"):
        whorl.Orbit(6e6).period_s


def test_a_deputy_seen_from_its_chief_is_the_difference_of_two_orbits():
    chief = whorl.Orbit(7.2e6, 0.02, 0.4, 0.3, 0.2, 0.1)
    deputy = whorl.Orbit(7.2e6, 0.0201, 0.4001, 0.3002, 0.2, 0.1001)
    time_s = np.linspace(0.0, chief.period_s, 9)

    def hill(k):
        (r, v), (rd, vd) = [tuple(x[k] for x in orbit.state(time_s)) for orbit in (chief, deputy)]
        h = np.cross(r, v)
        x, z = r / np.linalg.norm(r), h / np.linalg.norm(h)
        to_hill = np.stack([x, np.cross(z, x), z])
        turning = h / (r @ r)
        return to_hill @ (rd - r), to_hill @ (vd - v - np.cross(turning, rd - r))

    truth = [hill(k) for k in range(len(time_s))]
    position, velocity = chief.seen_from(*truth[0], time_s)
    np.testing.assert_allclose(position, [p for p, _ in truth], atol=0.05)
    np.testing.assert_allclose(velocity, [v for _, v in truth], atol=1e-4)


def test_stubs_name_what_there_is():
    tree = ast.parse(Path(_native.__file__).with_name("_native.pyi").read_text())
    public = {name for name in dir(_native) if not name.startswith("_")}
    stubbed = {node.name: node for node in tree.body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
    assert public == set(stubbed)
    for name, node in stubbed.items():
        if isinstance(node, ast.ClassDef):
            own = {n for n in vars(getattr(_native, name)) if not n.startswith("_")}
            assert own == {n.name for n in node.body if isinstance(n, ast.FunctionDef) and not n.name.startswith("_")}
    assert Path(_native.__file__).with_name("py.typed").exists()
    assert all(hasattr(whorl, name) and getattr(whorl, name).__doc__ for name in whorl.__all__ if name != "__version__")


def test_types_are_complete():
    command = [sys.executable, "-m", "mypy", "--strict", "--ignore-missing-imports", "--cache-dir", os.devnull, "-p", "whorl"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
