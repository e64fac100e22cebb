"""What several tests use: the `whorl` program, whose answers the package must give, and a recorded run."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def params():
    """The parameter folder of the repository."""
    return ROOT / "params"


@pytest.fixture(scope="session")
def program():
    """Runs the `whorl` program, which is at its `path`; returns the finished process."""
    folder = os.environ.get("WHORL_BIN")
    path = shutil.which("whorl", path=folder) if folder else shutil.which("whorl")
    if path is None:
        pytest.fail("no `whorl` program: set WHORL_BIN to the folder that it was built into")

    def run(*arguments, ok=True):
        done = subprocess.run([path, *map(str, arguments)], capture_output=True, text=True, check=False)
        assert (done.returncode == 0) == ok, done.stdout + done.stderr
        return done

    run.path = path
    return run


@pytest.fixture(scope="session")
def run(tmp_path_factory, program, params):
    """A minute of two platforms that the program simulated: Whorl-I swings, and has friction that its model lacks."""
    path = tmp_path_factory.mktemp("runs") / "swing"
    friction = "/whorl_1/driver:truth.effects.bearing_viscous_friction.c_n_m_s:=0.3"
    program("simulate", "--experiment", params / "experiments/swing.yaml", "--out", path, "--no-report", "-p", friction)
    return path
