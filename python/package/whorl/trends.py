"""What changed from run to run, how a model came to be, and errors of its sensors: history, trends, calibrate."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Tuple

from . import _native, html
from ._native import Platform, WhorlError
from .explain import Answer, Run, Runs, _Case, _list
from .progress import Progress, reporting
from .recording import Model, PathLike, Recording


class Trends(Answer):
    """Every parameter, fitted run by run."""

    table: Optional[Path] = None
    """The Parquet file that was written."""
    _headings: List[str] = []
    _rows: List[List[str]] = []

    @property
    def parameters(self) -> List[Dict[str, Any]]:
        """Each with group, name, unit, model, scatter, estimates (run, value, stddev) and change (kind, from_run, size, stddev,
        chance) or None."""
        found: List[Dict[str, Any]] = self.data["parameters"]
        return found

    @property
    def run_names(self) -> List[str]:
        """The runs in order of time."""
        return [run["name"] for run in self.data["runs"]]

    def to_polars(self) -> Any:
        """A row to each estimate: run, began_unix_s, effect, parameter, unit, value, stddev."""
        import polars

        rows = [
            {
                "run": self.data["runs"][e["run"]]["name"],
                "began_unix_s": self.data["runs"][e["run"]]["began_unix_s"],
                "effect": p["group"],
                "parameter": p["name"],
                "unit": p["unit"],
                "value": e["value"],
                "stddev": e["stddev"],
            }
            for p in self.parameters
            for e in p["estimates"]
        ]
        return polars.DataFrame(rows)

    def figure(self, most: int = 6) -> Any:
        """The parameters that changed most surely, run by run with standard deviations (Plotly)."""
        from . import figures

        return figures.trends(self, most)

    def _table(self) -> Tuple[List[str], List[List[str]]]:
        return self._headings, self._rows


class History:
    """How a platform's model came to be."""

    def __init__(self, data: Dict[str, Any]) -> None:
        self.data = data
        """What `whorl history MODEL --json` writes."""

    @property
    def steps(self) -> List[Dict[str, Any]]:
        """What was adopted, oldest first: number, date, effects, prediction errors before and after, source."""
        found: List[Dict[str, Any]] = self.data["steps"]
        return found

    def __str__(self) -> str:
        if not self.steps:
            return f"No adoption is noted in the model of {self.data['platform']}."
        return "\n".join(
            f"{s['number']}  {s['date'] or '(no date)'}  {' and '.join(s['effects']) or 'own parameters estimated'}" for s in self.steps
        )

    def _repr_html_(self) -> str:
        rows = [[str(s["number"]), s["date"] or "", ", ".join(s["effects"]), s["source"] or ""] for s in self.steps]
        return html.sentences([] if rows else [str(self)]) + (html.table(["step", "date", "adopted", "source"], rows) if rows else "")


class Calibration:
    """Errors of gyro and accelerometer."""

    def __init__(self, data: Dict[str, Any], written: Optional[int]) -> None:
        self.data = data
        """What `whorl calibrate imu --json` writes; what was not determined is None."""
        self.written = written
        """How many entries were written into the parameter file."""

    @property
    def usable(self) -> bool:
        """Whether the data are good for a calibration at all."""
        found: bool = self.data["usable"]
        return found

    @property
    def findings(self) -> List[str]:
        """What the data could not determine, and other remarks."""
        return [finding["text"] for finding in self.data["findings"]]

    def _table(self) -> Tuple[List[str], List[List[str]]]:
        rows = []
        for sensor in ("gyro", "accelerometer"):
            for what in ("bias", "scale", "misalignment"):
                of = self.data[sensor][what]
                cells = [
                    "not determined" if value is None else f"{value:.3g} +- {stddev:.2g}"
                    for value, stddev in zip(of["value"], of["stddev"])
                ]
                rows.append([f"{sensor} {what.replace('_', ' ')}", *cells, of["unit"]])
        return ["", "x", "y", "z", "unit"], rows

    def __str__(self) -> str:
        return "\n".join(["  ".join(row) for row in self._table()[1]] + self.findings)

    def _repr_html_(self) -> str:
        return html.table(*self._table()) + html.sentences(self.findings)


def trends(
    runs: Runs,
    *,
    since: Optional[Run] = None,
    began_unix_s: Optional[Sequence[float]] = None,
    parquet: Optional[PathLike] = None,
    model: Model = None,
    platform: Optional[str] = None,
    channels: Optional[PathLike] = None,
    progress: Progress = None,
) -> Trends:
    """What stays or changed from run to run, every parameter fitted run by run; as `whorl history RUN RUN...`.

    since: one of the runs: tests only what differs between those before it and those from it on.
    began_unix_s: when each run began [s since 1970], for recordings in memory; default: as their manifests say.
    parquet: folder for the estimates as a table, `platform=NAME/history.parquet`.
    """
    given = _list(runs)
    if len(given) < 2:
        raise WhorlError("trends need two runs or more; whorl.history(MODEL) says how a model came to be")
    place = None
    if since is not None:
        same = [k for k, run in enumerate(given) if run is since or (not isinstance(run, Recording) and run == since)]
        if not same:
            raise WhorlError(f"since={since}: it is none of the runs that were given")
        place = same[0]
    case = _Case(given, (), model, platform, channels)
    training, _, known = case.native
    times = None if began_unix_s is None else [float(time) for time in began_unix_s]
    with reporting(progress, "trends") as show:
        text, answer, headings, rows, page, table = _native.trends(training, known, times, place, parquet, show)
    found = Trends(json.loads(text), answer, page, case)
    found._headings, found._rows = headings, rows
    found.table = None if table is None else Path(table)
    return found


def history(model: Model, *, platform: Optional[str] = None) -> History:
    """How a platform's model came to be; as `whorl history MODEL`.

    model: a parameter file, a run directory, or a `Platform`.
    """
    if model is None:
        raise WhorlError("no model was given: a parameter file, a run directory, or a Platform")
    known = model if isinstance(model, Platform) else Platform.read(model, platform)
    return History(json.loads(_native.history(known)))


def calibrate(
    runs: Runs,
    *,
    known_turn_deg: Optional[float] = None,
    turn_error_deg: float = 0.3,
    level_error_deg: float = 0.5,
    gravity_m_s2: Optional[float] = None,
    out: Optional[PathLike] = None,
    model: Model = None,
    platform: Optional[str] = None,
    channels: Optional[PathLike] = None,
) -> Calibration:
    """Bias, scale, misalignment and noise of gyro and accelerometer; as `whorl calibrate imu`.

    runs: the sensor lies still for 20 s on each of its six faces, and is turned from one to the next.
    known_turn_deg: turns about the vertical were multiples of this angle [deg].
    turn_error_deg, level_error_deg: standard deviation of these turns, and of the levelling of each face [deg].
    gravity_m_s2: gravity where it was recorded [m/s^2]; without it, it is estimated within its range over the Earth.
    out: parameter file to write into, created as a copy of the model's if it does not exist; without it nothing is written.
    """
    case = _Case(runs, (), model, platform, channels)
    training, _, known = case.native
    text, written = _native.calibrate_sensors(
        training, known, known_turn_deg, turn_error_deg, level_error_deg, gravity_m_s2, out
    )
    return Calibration(json.loads(text), written)
