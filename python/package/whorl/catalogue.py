"""Tables: what can be measured, and the physical effects that Whorl knows."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Dict, List, Optional, Tuple, Union

from . import _native


@dataclass(frozen=True)
class Channel:
    """A quantity that is measured of a platform, or known to act on it."""

    key: str
    """Its name in `Recording` and in maps of columns."""
    holds: str
    """What it is."""
    unit: str
    """SI unit of its numbers."""
    units: Tuple[str, ...]
    """Units that given data may have."""
    components: Optional[Tuple[str, ...]]
    """Names of a sample's numbers; None: one for each wheel or jet of the platform."""
    column: Tuple[str, str]
    """Stem and end of the columns of an export."""
    is_held: bool
    """Whether a sample holds until the next, as commands do."""
    is_motion: bool
    """Whether it measures motion: a recording needs at least one such channel."""
    sensors: int
    """How many sensors of it there may be."""


@lru_cache(maxsize=None)
def channels() -> Dict[str, Channel]:
    """The table of channels, by key, in the order of exported columns."""
    rows = json.loads(_native.channels())
    for row in rows:
        for name in ("units", "components", "column"):
            row[name] = tuple(row[name]) if row[name] is not None else None
    return {row["key"]: Channel(**row) for row in rows}


@dataclass(frozen=True)
class Effect:
    """A physical effect of the catalogue."""

    id: str
    title: str
    kind: str
    """`torque`, `actuator`, `sensor` or `hidden_state`."""
    explanation: str
    equation: str
    source: str
    confusable_with: Tuple[str, ...]
    separated_by: str
    parameters: Tuple[Dict[str, Any], ...]
    """Each with name, unit, min, max, neutral, prior_stddev, known, doc."""


def effects(platform: Optional[_native.Platform] = None) -> List[Effect]:
    """The catalogue, as `whorl effects` lists it; the platform names wheels and jets (default: Whorl-I as published)."""
    rows = json.loads(_native.effects(platform))
    for row in rows:
        for name in ("confusable_with", "parameters"):
            row[name] = tuple(row[name])
    return [Effect(**row) for row in rows]


def describe_effect(id: str, platform: Optional[_native.Platform] = None) -> str:
    """An effect in words: equation, source, parameters, what it is confused with; as `whorl effects ID`."""
    return _native.describe_effect(id, platform)


def load_effect(path: Union[str, "os.PathLike[str]"]) -> str:
    """Adds an effect written in YAML to the catalogue of this process; returns its id."""
    return _native.load_effect(path)
