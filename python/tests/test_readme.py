"""The README's Python, as it stands there."""

import re
import shutil
from pathlib import Path

import pytest

README = Path(__file__).resolve().parents[2] / "README.md"


@pytest.mark.slow
def test_the_readme(monkeypatch, tmp_path, program, params):
    (block,) = re.findall(r"^```python\n(.*?)^```", README.read_text(), re.MULTILINE | re.DOTALL)
    # What `whorl demo` keeps: two runs of one experiment, and the model that does not know the effect.
    demo = tmp_path / "my_demo"
    demo.mkdir()
    shutil.copy(params / "whorl_1.yaml", demo / "whorl_1_before.yaml")
    friction = "/whorl_1/driver:truth.effects.bearing_viscous_friction.c_n_m_s:=0.3"
    for seed, name in enumerate(("first", "second"), 1):
        given = ["--experiment", params / "experiments/swing.yaml", "--out", demo / name, "--seed", seed, "--no-report"]
        program("simulate", *given, "-p", friction)
    monkeypatch.chdir(tmp_path)
    given = {}
    exec(compile(block, str(README), "exec"), given)  # the README is ours
    assert given["answer"].effects == ["bearing_viscous_friction"]
    assert given["better"].versions[-1]["held_out_prediction_error"] < 1.1
