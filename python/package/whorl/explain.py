"""Explaining data: compare, locate, diagnose, discover, adopt, identify.

Each function takes runs and returns an `Answer`. A run is a path (run directory, bag, CSV file with `channels`) or a
`Recording`; several are a list. `held_out` runs test and are never fitted. `model` is the platform's parameter file or a
`Platform`; default: the parameters saved in the first run. Long calls release the interpreter's lock, end on Ctrl-C, and
report with `progress=True` or a function.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Tuple, Union

from . import _native, html
from ._native import Platform, WhorlError
from .progress import Progress, reporting
from .recording import Model, PathLike, Recording, read

Run = Union[PathLike, Recording]
Runs = Union[Run, Sequence[Run]]


class Answer:
    """What a question to the data gave."""

    def __init__(self, data: Dict[str, Any], answer: List[str], page: Optional[str], case: "_Case") -> None:
        self.data = data
        """Every number: what the command line writes with `--json`."""
        self.answer = answer
        """The answer in sentences, most important first."""
        self.page = page
        """A self-contained HTML page, as the command line writes it."""
        self.runs: List[Recording] = case.training
        """The training runs."""
        self.held_out: List[Recording] = case.held_out
        """The held-out runs."""
        self.model: Platform = case.platform
        """The model that was asked about."""

    def save(self, path: PathLike) -> Path:
        """Writes the page; returns its path."""
        if self.page is None:
            raise WhorlError("there is no page: nothing was computed that could be drawn")
        path = Path(path)
        path.write_text(self.page, encoding="utf-8")
        return path

    def figure(self) -> Any:
        """The main picture as a Plotly figure."""
        from . import figures

        return figures.of(self)

    def _table(self) -> Tuple[List[str], List[List[str]]]:
        return [], []

    def __str__(self) -> str:
        return "\n".join(self.answer)

    def __repr__(self) -> str:
        return f"<whorl.{type(self).__name__}: {self.answer[0] if self.answer else 'no answer'}>"

    def _repr_html_(self) -> str:
        headings, rows = self._table()
        return html.sentences(self.answer) + (html.table(headings, rows) if rows else "")


class Comparison(Answer):
    """How far off the model is."""

    @property
    def prediction_error(self) -> Optional[float]:
        """Over all training runs, relative to the noise: 1 is noise alone."""
        found: Optional[float] = self.data["prediction_error"]
        return found

    @property
    def held_out_prediction_error(self) -> Optional[float]:
        """The same over held-out runs."""
        found: Optional[float] = self.data["held_out_prediction_error"]
        return found

    def _table(self) -> Tuple[List[str], List[List[str]]]:
        rows = [
            [run["run"], channel["name"], channel["unit"], html.number(channel["noise_floor"])]
            + [html.number(horizon["ratio"]) for horizon in channel["horizons"]]
            for run in self.data["runs"]
            for channel in run["channels"]
        ]
        horizons: List[Dict[str, Any]] = next((channel["horizons"] for run in self.data["runs"] for channel in run["channels"]), [])
        return ["run", "channel", "unit", "noise"] + [f"{horizon_name(h)}: ratio" for h in horizons], rows


def horizon_name(horizon: Dict[str, Any]) -> str:
    """"10 s", or "run" for the whole run."""
    return "run" if horizon["horizon_s"] is None else f"{horizon['horizon_s']:g} s"


class Located(Answer):
    """Where the model fails."""

    @property
    def ranked(self) -> Dict[str, List[Dict[str, Any]]]:
        """The quantities on which something depends that is unexplained, by share: of `body`, and of the motor of each wheel by its name."""
        pooled = self.data["pooled"]
        of = {"body": pooled["dependences"], **{m["wheel"]: m["dependences"] for m in pooled["motors"]}}
        return {name: found["ranked"] for name, found in of.items() if found is not None}

    def _table(self) -> Tuple[List[str], List[List[str]]]:
        axes = {"body": "xyz", "world": ("east", "north", "up"), "wheel": ("axis",), "hinge": ("axis",)}
        rows = [
            [of, d["variable"], d["frame"], f"{100 * d['share']:.0f}", axes[d["frame"]][d["axis"]], d["parity"], d["growth"]]
            for of, ranked in self.ranked.items()
            for d in ranked[:12]
        ]
        return ["torque on", "quantity", "frame", "share of the excess [%]", "axis", "symmetry", "growth"], rows


class Diagnosis(Answer):
    """Which physical effect the model lacks."""

    @property
    def verdict(self) -> str:
        """`named`, `confounded`, `not_enough_information`, `unknown` or `nothing_missing`."""
        found: str = self.data["verdict"]
        return found

    @property
    def effects(self) -> List[str]:
        """The named effects, by their ids."""
        found: List[str] = self.data["effects"]
        return found

    @property
    def candidates(self) -> List[Dict[str, Any]]:
        """Every effect that was tested, with its evidence and its parameters."""
        found: List[Dict[str, Any]] = self.data["candidates"]
        return found

    def _table(self) -> Tuple[List[str], List[List[str]]]:
        def values(candidate: Dict[str, Any]) -> str:
            some = candidate["parameters"][:2]
            return ", ".join(f"{p['name']} {p['estimate']:.3g} +- {p['stddev']:.2g} {p['unit']}" for p in some)

        rows = [[c["effect"], f"{c['delta_log_evidence']:.1f}", values(c)] for c in self.candidates[:12]]
        return ["effect", "log evidence", "estimate"], rows


class Discovery(Answer):
    """The law of what no effect of the catalogue explains."""

    law: Optional[str] = None
    """The best law as an effect in YAML; None: no law is more probable than none."""

    @property
    def laws(self) -> List[Dict[str, Any]]:
        """Everything that was evaluated, most probable first; empty where nothing was searched for."""
        found: List[Dict[str, Any]] = (self.data["discovery"] or {}).get("laws", [])
        return found

    def write(self, path: PathLike) -> Path:
        """Writes the best law as an effect, `NAME.yaml`; `whorl.load_effect` and `whorl adopt` take it."""
        if self.law is None:
            raise WhorlError("nothing was written: there is no law to write")
        path = Path(path)
        path.write_text(self.law, encoding="utf-8")
        return path

    def _table(self) -> Tuple[List[str], List[List[str]]]:
        rows = [
            [law["kind"], f"{100 * law['probability']:.1f}", f"{law['log_evidence']:.1f}", law["equation"] or law["sentence"]]
            for law in self.laws
        ]
        return ["", "probability [%]", "log evidence", "equation"], rows


class Adoption(Answer):
    """The model with effects, before and after."""

    adopted: Optional[Platform] = None
    """The platform with the last version of the model: for further questions, without files."""
    written: Optional[str] = None
    """What was written into a parameter file."""

    @property
    def versions(self) -> List[Dict[str, Any]]:
        """As given, with its own parameters refitted, with each set of effects: errors and parameters."""
        found: List[Dict[str, Any]] = self.data["versions"]
        return found

    def _table(self) -> Tuple[List[str], List[List[str]]]:
        rows = [
            [v["name"], html.number(v["prediction_error"]), html.number(v["held_out_prediction_error"])]
            for v in self.versions
        ]
        return ["model", "prediction error / noise", "held out"], rows


class Identification(Answer):
    """Mass properties with their uncertainties."""

    identified: Optional[Platform] = None
    """The platform with them; None where they must not be used."""

    @property
    def parameters(self) -> List[Dict[str, Any]]:
        """Each with name, unit, before, estimate, stddev, prior_stddev, determined (`yes`, `hardly`, `no`)."""
        found: List[Dict[str, Any]] = self.data["parameters"]
        return found

    def _table(self) -> Tuple[List[str], List[List[str]]]:
        names = ("name", "before", "estimate", "stddev", "prior_stddev", "unit", "determined")
        return list(names), [[html.number(p[name]) for name in names] for p in self.parameters]


class _Case:
    """Runs and their model, read."""

    def __init__(
        self,
        runs: Runs,
        held_out: Runs,
        model: Model,
        platform: Optional[str],
        channels: Optional[PathLike],
    ) -> None:
        given, tested = _list(runs), _list(held_out)
        if not given:
            raise WhorlError("no run was given")
        self.platform = self._model(given[0], model, platform)
        self.training = [self._run(run, channels) for run in given]
        self.held_out = [self._run(run, channels) for run in tested]

    @staticmethod
    def _model(first: Run, model: Model, platform: Optional[str]) -> Platform:
        if isinstance(model, Platform):
            return model
        if model is not None:
            return Platform.read(model, platform)
        if isinstance(first, Recording):
            if first.model is None:
                raise WhorlError(
                    f"{first.name}: a recording in memory holds no parameters: name the platform's file, e.g. "
                    'model="params/whorl_1.yaml"'
                )
            return first.model
        return Platform.of_runs([first], None, platform)

    def _run(self, run: Run, channels: Optional[PathLike]) -> Recording:
        if isinstance(run, Recording):
            run._native.check(self.platform)
            return run
        return read(run, model=self.platform, channels=channels)

    @property
    def native(self) -> Tuple[List[_native.Recording], List[_native.Recording], Platform]:
        return [r._native for r in self.training], [r._native for r in self.held_out], self.platform


def _list(runs: Runs) -> List[Run]:
    return [runs] if isinstance(runs, (str, os.PathLike, Recording)) else list(runs)


def compare(
    runs: Runs,
    *,
    held_out: Runs = (),
    model: Model = None,
    platform: Optional[str] = None,
    channels: Optional[PathLike] = None,
    refit: bool = False,
    progress: Progress = None,
) -> Comparison:
    """How far off the model is: prediction errors by channel and horizon, relative to the noise; as `whorl compare`.

    refit: refits the platform's own parameters within their priors first, to all runs but held-out ones.
    """
    case = _Case(runs, held_out, model, platform, channels)
    with reporting(progress, "compare") as show:
        text, page = _native.compare(*case.native, refit, show)
    data = json.loads(text)
    return Comparison(data, [run["answer"] for run in data["runs"]], page, case)


def locate(
    runs: Runs,
    *,
    held_out: Runs = (),
    model: Model = None,
    platform: Optional[str] = None,
    channels: Optional[PathLike] = None,
    progress: Progress = None,
) -> Located:
    """Where the model fails: the quantities that the unexplained torque depends on; as `whorl where`."""
    case = _Case(runs, held_out, model, platform, channels)
    with reporting(progress, "locate") as show:
        text, page = _native.locate(*case.native, show)
    data = json.loads(text)
    return Located(data, data["pooled"]["answer"], page, case)


def diagnose(
    runs: Runs,
    *,
    held_out: Runs = (),
    model: Model = None,
    platform: Optional[str] = None,
    channels: Optional[PathLike] = None,
    exclude: Sequence[str] = (),
    progress: Progress = None,
) -> Diagnosis:
    """Which physical effect the model lacks: a verdict in words, then every effect tested; as `whorl diagnose`.

    exclude: ids of effects that are not to be considered.
    """
    case = _Case(runs, held_out, model, platform, channels)
    with reporting(progress, "diagnose") as show:
        text, answer, page = _native.diagnose(*case.native, list(exclude), show)
    return Diagnosis(json.loads(text), answer, page, case)


def discover(
    runs: Runs,
    *,
    held_out: Runs = (),
    model: Model = None,
    platform: Optional[str] = None,
    channels: Optional[PathLike] = None,
    name: str = "discovered_law",
    exclude: Sequence[str] = (),
    anyway: bool = False,
    progress: Progress = None,
) -> Discovery:
    """Which law is missing where no effect of the catalogue explains the data; as `whorl discover`.

    name: id of the law as an effect: small letters, digits and _.
    anyway: searches even if a named effect explains the data, or nothing is missing.
    """
    if not (name[:1].isalpha() and name.islower() and name.isascii() and name.replace("_", "a").isalnum()):
        raise WhorlError(f"{name}: the name is the effect's id; allowed: small letters, digits and _")
    case = _Case(runs, held_out, model, platform, channels)
    with reporting(progress, "discover") as show:
        text, page, law = _native.discover(*case.native, name, list(exclude), anyway, show)
    data = json.loads(text)
    found = Discovery(data, data["answer"], page, case)
    found.law = law
    return found


def adopt(
    runs: Runs,
    effects: Union[str, Sequence[str]],
    *,
    candidates: Sequence[Union[str, Sequence[str]]] = (),
    out: Optional[PathLike] = None,
    anyway: bool = False,
    held_out: Runs = (),
    model: Model = None,
    platform: Optional[str] = None,
    channels: Optional[PathLike] = None,
    progress: Progress = None,
) -> Adoption:
    """Adds effects to the model, refits it, and shows the errors before and after; as `whorl adopt`.

    effects: ids of effects to adopt together.
    candidates: further sets of effects, compared side by side beside `effects`, not with `out`.
    out: parameter file to write; made as a copy of the model's where it does not exist. Without it nothing is written, and
        `.adopted` is the platform with the new model.
    anyway: writes even if held-out runs are predicted worse, or a mass property moves implausibly far.
    """
    sets = [[effects] if isinstance(effects, str) else list(effects)]
    if not sets[0]:
        raise WhorlError("name the effect to adopt after the runs; `whorl effects` lists them, `whorl diagnose` finds them")
    sets += [[one] if isinstance(one, str) else list(one) for one in candidates]
    if out is not None and len(sets) > 1:
        raise WhorlError("out goes with one set of effects: candidates are only compared")
    case = _Case(runs, held_out, model, platform, channels)
    with reporting(progress, "adopt") as show:
        text, page, adopted, written = _native.adopt(*case.native, sets, out, anyway, show)
    data = json.loads(text)
    found = Adoption(data, data["answer"], page, case)
    found.adopted, found.written = (adopted if len(sets) == 1 else None), written
    return found


def identify(
    runs: Runs,
    *,
    model: Model = None,
    platform: Optional[str] = None,
    channels: Optional[PathLike] = None,
    prior_scale: float = 1.0,
    progress: Progress = None,
) -> Identification:
    """Mass properties from runs, with uncertainties; as `whorl identify`.

    prior_scale: widens the prior of the mass properties: 1 uses the model's uncertainties, 100 makes it negligible.
    """
    case = _Case(runs, (), model, platform, channels)
    training, _, known = case.native
    with reporting(progress, "identify") as show:
        text, identified = _native.identify(training, known, prior_scale, show)
    data = json.loads(text)
    runs_s = f"{len(training)} run" + ("s" if len(training) > 1 else "")
    errors = data["prediction_error"]
    before, after = ("-" if e is None else f"{e:.2f}" for e in (errors["before"], errors["after"]))
    answer = [
        f"{data['platform']} from {data['duration_s']:.1f} s of {runs_s}: prediction error {after} times the noise, "
        f"{before} with the model as given"
    ]
    answer += [("DO NOT USE: " if f["fatal"] else "note: ") + f["text"] for f in data["findings"]]
    found = Identification(data, answer, None, case)
    found.identified = identified
    return found
