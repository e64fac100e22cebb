"""Simulated experiments."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, Dict, Mapping, Optional, Sequence, Union

from . import _native
from .progress import Progress, reporting
from .recording import Recording, read


class Simulated:
    """A simulated run."""

    def __init__(self, path: Path, data: Dict[str, Any]) -> None:
        self.path = path
        """The run directory: everything that reads runs reads it."""
        self.data = data
        """What `summary.json` has: errors, torques, gas, the verdict."""

    @property
    def verdict(self) -> str:
        """What the run came to, in one line."""
        return str(self.data["verdict"]["line"])

    def recording(self, platform: str) -> Recording:
        """What was measured of one platform."""
        return read(self.path, platform=platform)

    def __repr__(self) -> str:
        return f"<whorl.Simulated {self.path}: {self.verdict}>"


def simulate(
    experiment: Union[str, "os.PathLike[str]"],
    out: Union[str, "os.PathLike[str]", None] = None,
    *,
    seed: int = 1,
    params: Union[str, "os.PathLike[str]", None] = None,
    overrides: Union[Mapping[str, Any], Sequence[str]] = (),
    longest_s: float = 3600.0,
    progress: Progress = None,
) -> Simulated:
    """Simulates an experiment in this process: same seed, same parameters, same run to the bit; as `whorl simulate`.

    experiment: an experiment file, e.g. `params/experiments/swing.yaml`.
    out: the run directory to write, which must not hold a run yet; default: a new one in `runs/`.
    params: the parameter folder; default: the experiment file's `../`.
    overrides: parameters in place of the files', as texts `"/whorl_1/driver:truth.effects.harness_spring.k_n_m_rad:=0.3"`, or
        a mapping of `node:key` to values.
    longest_s: longest simulated time [s]; an experiment normally ends by itself.
    """
    if isinstance(overrides, Mapping):
        overrides = [f"{key}:={_yaml(value)}" for key, value in overrides.items()]
    with reporting(progress, "simulate") as show:
        path, text = _native.simulate(experiment, out, seed, params, list(overrides), longest_s, show)
    return Simulated(Path(path), json.loads(text))


def _yaml(value: Any) -> str:
    if isinstance(value, str):
        return value
    # JSON is YAML; numbers of other libraries become Python's.
    return json.dumps(value, default=lambda x: x.tolist())
