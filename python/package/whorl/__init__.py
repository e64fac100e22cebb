"""Whorl: why a rotating rig does not do what its model says.

The functions of the `whorl` command line, on run directories, bags, CSV files, or arrays and data frames in memory:

>>> import whorl
>>> run = whorl.read("runs/2026-11-21T06-32-49Z_swing")
>>> print(whorl.diagnose(run))                                                    # doctest: +SKIP

Vectors are in body axes unless a name says otherwise (`_b_`: body, `_world_`: east, north, up); units stand in names and
are SI. Quaternions are w, x, y, z and rotate body vectors into the world. What is wrong raises `WhorlError` with the words
of the command line.
"""

from ._native import Platform, WhorlError, __version__
from .campaign import Campaign, sql
from .catalogue import Channel, Effect, channels, describe_effect, effects, load_effect
from .attitude import Attitudes, estimate
from .explain import (
    Adoption,
    Answer,
    Comparison,
    Diagnosis,
    Discovery,
    Identification,
    Located,
    adopt,
    compare,
    diagnose,
    discover,
    identify,
    locate,
)
from .pieces import Allocator, Orbit
from .recording import Recording, Series, read
from .simulation import Simulated, simulate
from .trends import Calibration, History, Trends, calibrate, history, trends

__all__ = [
    "Adoption",
    "Allocator",
    "Answer",
    "Attitudes",
    "Calibration",
    "Campaign",
    "Channel",
    "Comparison",
    "Diagnosis",
    "Discovery",
    "Effect",
    "History",
    "Identification",
    "Located",
    "Orbit",
    "Platform",
    "Recording",
    "Series",
    "Simulated",
    "Trends",
    "WhorlError",
    "__version__",
    "adopt",
    "calibrate",
    "channels",
    "compare",
    "describe_effect",
    "diagnose",
    "discover",
    "effects",
    "estimate",
    "history",
    "identify",
    "load_effect",
    "locate",
    "read",
    "simulate",
    "sql",
    "trends",
]
