"""Recordings as arrays and data frames."""

from __future__ import annotations

import os
from typing import Any, Dict, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._native import Platform, WhorlError
from .catalogue import Channel, channels as table

PathLike = Union[str, "os.PathLike[str]"]
Model = Union[PathLike, Platform, None]


class Series(NamedTuple):
    """Samples of a channel."""

    time_s: NDArray[np.float64]
    """(n,), since the start of the run [s]."""
    values: NDArray[np.float64]
    """(n,) or (n, components), SI units."""
    unit: str
    """Unit of the values."""
    components: Tuple[str, ...]
    """Names of the columns of the values: axes, wheels."""


class Recording:
    """What was measured of one platform in one run: channels by name (`whorl.channels()` lists them).

    `recording["gyro"]` is a `Series`; several vector sensors are `vector_1`, `vector_2`, ... Arrays of axes and of single
    numbers are the recording's own memory, without a copy, and cannot be written to; those of wheels and attitudes are
    copies. A recording never changes.
    """

    def __init__(self, native: _native.Recording, platform: Optional[Platform] = None) -> None:
        self._native = native
        self.model = platform
        """The platform's model with which it was read, if any."""

    @classmethod
    def from_arrays(
        cls,
        channels: Mapping[str, Tuple[ArrayLike, ArrayLike]],
        *,
        model: Model = None,
        name: str = "recording",
        units: Optional[Mapping[str, str]] = None,
        reference_world: Optional[Mapping[str, Sequence[float]]] = None,
        jets: Optional[Sequence[Sequence[Tuple[float, float]]]] = None,
        clamped: bool = False,
        closed_loop: bool = False,
    ) -> "Recording":
        """A recording of arrays; no files are needed.

        channels: by key, times [s] of shape (n,) and values of shape (n, 3) for axes, (n, wheels) for wheels, (n,) for single
            numbers, (n, 4) for attitudes (w, x, y, z). Each channel has its own times; they need not agree. Of a gyro or
            accelerometer with one axis the values have shape (n,): of that axis (`gyro_z`), or as `gyro` with the model of a rig
            on a hinge along a body axis.
        model: the platform's parameter file, or a `Platform`; wheels and jets are checked against it.
        units: by key, where the unit is not the SI unit: `{"gyro": "deg/s"}`; `whorl.channels()[key].units` are allowed.
        reference_world: by key (`vector_1`), the direction that a vector sensor sees, east, north, up; default: the model's.
        jets: pulses of each jet, (switched on, switched off) [s].
        clamped: whether the platform was held and only its wheels moved.
        closed_loop: whether a controller was running.
        """
        platform = _platform(model)
        units, references = dict(units or {}), dict(reference_world or {})
        samples = []
        for key, given in channels.items():
            base, sensor = _key(key)
            try:
                time_s, values = given
            except (TypeError, ValueError):
                raise WhorlError(f"{key}: allowed: a pair of times and values") from None
            rows = _rows(key, values)
            axis = _axis(key)
            if axis is not None:
                base, rows = axis[0], _of_one_axis(key, rows, axis[1])
            elif rows.shape[1] == 1 and _has_axes(base):
                rows = _of_one_axis(key, rows, _hinge(key, platform))
            samples.append((base, sensor, _times(key, time_s), rows, units.pop(key, None), references.pop(key, None)))
        for left, what in ((units, "units"), (references, "reference_world")):
            if left:
                raise WhorlError(f"{what}: {next(iter(left))} is not among the channels: {', '.join(channels)}")
        pulses = None if jets is None else [[(float(on), float(off)) for on, off in of] for of in jets]
        return cls(_native.Recording.of(samples, name, platform, clamped, closed_loop, pulses), platform)

    @classmethod
    def from_frame(
        cls,
        frame: Any,
        channels: Optional[Mapping[str, Union[str, Sequence[str]]]] = None,
        *,
        time: str = "time_s",
        **given: Any,
    ) -> "Recording":
        """A recording of a data frame: Polars, pandas, or anything with `frame[column]` and `frame.columns`; or of an xarray
        Dataset with a variable to each channel.

        channels: by key, the column or columns; default: the columns that `whorl export csv` writes (`gyro_x_rad_s`, ...).
        time: the column of times [s]. Rows without a number (NaN, null) in any column of a channel are no sample of it.
        given: as for `from_arrays`: model, units, reference_world, ...
        """
        if hasattr(frame, "data_vars"):
            return cls.from_xarray(frame, **given)
        present = [str(column) for column in frame.columns]
        if time not in present:
            raise WhorlError(f"there is no column {time} for the time; there are: {', '.join(present)}")
        times = _column(frame, time)
        if channels is None:
            platform = given["model"] = _platform(given.get("model"))
            channels = _exported(present, platform)
            if not channels:
                raise WhorlError(
                    f"no column has the name of an export, such as gyro_x_rad_s; name them with channels; there are: "
                    f"{', '.join(present)}"
                )
        arrays = {}
        for key, columns in channels.items():
            columns = [columns] if isinstance(columns, str) else list(columns)
            for column in columns:
                if column not in present:
                    raise WhorlError(f"{key}: there is no column {column}; there are: {', '.join(present)}")
            values = np.column_stack([_column(frame, column) for column in columns])
            some = np.isfinite(values).any(axis=1)
            arrays[key] = (times[some], values[some])
        return cls.from_arrays(arrays, **given)

    @classmethod
    def from_xarray(cls, dataset: Any, **given: Any) -> "Recording":
        """A recording of an xarray Dataset: a variable to each channel, its first dimension with the times [s] as coordinate,
        as `to_xarray` gives. Attributes `units` and `reference_world` of a variable are used."""
        arrays, units = {}, dict(given.pop("units", None) or {})
        references = dict(given.pop("reference_world", None) or {})
        for key in dataset.data_vars:
            variable = dataset[key]
            arrays[str(key)] = (np.asarray(variable[variable.dims[0]]), np.asarray(variable))
            if "units" in variable.attrs:
                units.setdefault(str(key), variable.attrs["units"])
            if "reference_world" in variable.attrs:
                references.setdefault(str(key), list(variable.attrs["reference_world"]))
        units = {key: unit for key, unit in units.items() if unit != "1"}
        return cls.from_arrays(arrays, units=units, reference_world=references, **given)

    @property
    def name(self) -> str:
        """Name of the run."""
        return self._native.name

    @property
    def platform(self) -> str:
        """Name of the platform."""
        return self._native.platform

    @property
    def duration_s(self) -> float:
        """From the first to the last sample of any channel that tells of motion [s]."""
        return self._native.duration_s

    @property
    def source(self) -> Optional[str]:
        """The file or folder that it was read from."""
        return None if self._native.source is None else os.fspath(self._native.source)

    @property
    def clamped(self) -> bool:
        """Whether the platform was held."""
        return self._native.clamped

    @property
    def closed_loop(self) -> bool:
        """Whether a controller was running."""
        return self._native.closed_loop

    @property
    def remarks(self) -> List[str]:
        """What was noticed when it was read, one sentence each."""
        return self._native.remarks

    @property
    def jet_pulses(self) -> List[NDArray[np.float64]]:
        """Commanded pulses of each jet: (pulses, 2), switched on and off [s]."""
        return [np.array(of, dtype=float).reshape(-1, 2) for of in self._native.jet_pulses()]

    def keys(self) -> List[str]:
        """Channels that were sampled."""
        return [_name(key, sensor) for key, sensor, _ in self._native.sampled()]

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def __contains__(self, key: object) -> bool:
        return key in self.keys() or key == "vector" and "vector_1" in self.keys()

    def __getitem__(self, key: str) -> Series:
        base, sensor = _key(key)
        if key not in self:
            raise KeyError(f"{key} was not recorded; there are: {', '.join(self.keys())}")
        values = self._native.values(base, sensor)
        row = table()[base]
        components = row.components or self._wheels(values.shape[1])
        # Directions have length one; the table's unit is that of their errors.
        unit = row.unit if row.sensors == 1 else "1"
        return Series(self._native.time_s(base, sensor), values, unit, components)

    def _wheels(self, count: int) -> Tuple[str, ...]:
        names = self.model.wheels if self.model is not None else []
        return tuple(names) if len(names) == count else tuple(f"wheel_{j + 1}" for j in range(count))

    def reference_world(self, key: str = "vector_1") -> Optional[NDArray[np.float64]]:
        """The direction that a vector sensor sees: (3,), east, north, up."""
        found = self._native.reference_world(_key(key)[1])
        return None if found is None else np.array(found)

    def to_numpy(self) -> Dict[str, Tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Times [s] and values of every channel; `from_arrays` takes them."""
        return {key: self[key][:2] for key in self}

    def to_polars(self, key: str) -> Any:
        """A channel as a Polars data frame: `time_s` and a column to each component."""
        import polars

        time_s, values, unit, components = self[key]
        columns = {"time_s": time_s}
        if values.ndim == 1:
            columns[_name_with_unit(key, "", unit)] = values
        else:
            for k, component in enumerate(components):
                columns[_name_with_unit(key, component, unit)] = values[:, k]
        return polars.DataFrame(columns)

    def to_xarray(self) -> Any:
        """All channels as an xarray Dataset, each with its own times: dimensions `<key>_time` [s] and `<key>_component`."""
        import xarray

        variables = {}
        for key in self:
            time_s, values, unit, components = self[key]
            dims = [f"{key}_time"]
            coords: Dict[str, Any] = {f"{key}_time": time_s}
            if values.ndim == 2:
                dims.append(f"{key}_component")
                coords[f"{key}_component"] = list(components)
            attrs: Dict[str, Any] = {"units": unit, "long_name": table()[_key(key)[0]].holds}
            reference = self.reference_world(key) if key.startswith("vector") else None
            if reference is not None:
                attrs["reference_world"] = reference.tolist()
            variables[key] = xarray.DataArray(values, dims=dims, coords=coords, attrs=attrs)
        return xarray.Dataset(variables, attrs={"name": self.name, "platform": self.platform})

    def to_parquet(self, folder: PathLike) -> List[str]:
        """Writes a Parquet file to each channel, as `whorl export parquet`; returns their paths. Folders of many runs are read as
        one table: `polars.scan_parquet("folder/gyro", hive_partitioning=True)`."""
        return [os.fspath(path) for path in self._native.write_parquet(folder, self.model)]

    def figure(self, keys: Optional[Sequence[str]] = None) -> Any:
        """Channels over time as a Plotly figure, one below the other."""
        from . import figures

        return figures.recording(self, list(keys) if keys is not None else self.keys())

    def __repr__(self) -> str:
        return f"<whorl.Recording {self.name}: {self.platform}, {self.duration_s:.1f} s, {', '.join(self.keys())}>"

    def _repr_html_(self) -> str:
        from .html import table as html_table

        rows = []
        for key in self:
            time_s, values, unit, components = self[key]
            rate = (len(time_s) - 1) / (time_s[-1] - time_s[0]) if len(time_s) > 1 else float("nan")
            rows.append([key, str(len(time_s)), f"{rate:.4g}", unit, ", ".join(filter(None, components))])
        head = f"{self.name}: {self.platform}, {self.duration_s:.1f} s"
        return html_table(["channel", "samples", "rate [Hz]", "unit", "components"], rows, head, self.remarks)


def read(
    path: PathLike, *, model: Model = None, platform: Optional[str] = None, channels: Optional[PathLike] = None
) -> Recording:
    """Reads a run directory, a rosbag2 directory, an `.mcap` file, or a CSV file.

    model: the platform's parameter file or a `Platform`; default: the parameters saved in the run. CSV files need one.
    platform: name of the platform, where the run holds several.
    channels: map of columns (CSV) or topics (bags of other systems), a file; docs/recordings.md shows both.
    """
    known = _platform(model, platform)
    if known is None and channels is None and not str(path).lower().endswith((".csv", ".csv.gz")):
        try:
            known = Platform.of_runs([path], None, platform)
        except WhorlError:
            # A plain bag has no parameters; its channels can be read without, and errors of the run itself come now.
            known = None
    if known is None:
        return Recording(_native.Recording.read(path, None, platform, channels))
    return Recording(_native.Recording.read(path, known, platform, channels), known)


def _platform(model: Model, platform: Optional[str] = None) -> Optional[Platform]:
    if model is None or isinstance(model, Platform):
        return model
    return Platform.read(model, platform)


def _key(key: str) -> Tuple[str, int]:
    """Key of the table and number of the sensor, from 0: `vector_2` is the second vector sensor."""
    base, _, number = key.rpartition("_")
    row: Optional[Channel] = table().get(base)
    if row is not None and row.sensors > 1 and number.isdigit() and int(number) >= 1:
        return base, int(number) - 1
    return key, 0


def _has_axes(base: str) -> bool:
    """Whether it is a sensor of three axes of which some may be missing."""
    row: Optional[Channel] = table().get(base)
    return row is not None and row.sensors == 1 and row.components == tuple("xyz")


def _axis(key: str) -> Optional[Tuple[str, NDArray[np.float64]]]:
    """Of `gyro_z` the channel `gyro` and the axis z."""
    base, _, axis = key.rpartition("_")
    if axis in ("x", "y", "z") and _has_axes(base) and key not in table():
        return base, np.eye(3)["xyz".index(axis)]
    return None


def _hinge(key: str, platform: Optional[Platform]) -> NDArray[np.float64]:
    """The axis of a rig's hinge, if it is one of the body's."""
    axis = None if platform is None else platform.hinge_axis_b
    if axis is None or max(map(abs, axis)) < 1.0 - 1e-9:
        raise WhorlError(
            f"{key}: a sample has one number; allowed: (n, 3), or the name of the axis ({key}_x, {key}_y, {key}_z), or the model of a "
            "rig on a hinge along a body axis"
        )
    return np.array(axis)


def _of_one_axis(key: str, rows: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Samples of three axes; NaN on those that were not measured."""
    if rows.shape[1] != 1:
        raise WhorlError(f"{key}: values have shape {rows.shape}; allowed: (n,)")
    return np.where(np.abs(axis) > 0.5, rows * np.round(axis), np.nan)


def _name(key: str, sensor: int) -> str:
    return f"{key}_{sensor + 1}" if table()[key].sensors > 1 else key


def _name_with_unit(key: str, component: str, unit: str) -> str:
    unit = "" if unit == "1" else unit.replace("^", "").replace("/", "_").replace(" ", "_").lower()
    return "_".join(part for part in (key, component, unit) if part)


def _array(key: str, given: Any) -> NDArray[np.float64]:
    if hasattr(given, "to_numpy"):
        given = given.to_numpy()
    try:
        return np.ascontiguousarray(given, dtype=np.float64)
    except (TypeError, ValueError) as reason:
        raise WhorlError(f"{key}: allowed: numbers ({reason})") from None


def _times(key: str, given: Any) -> NDArray[np.float64]:
    array = _array(key, given)
    if array.ndim != 1:
        raise WhorlError(f"{key}: times have shape {array.shape}; allowed: (n,)")
    return array


def _rows(key: str, given: Any) -> NDArray[np.float64]:
    array = _array(key, given)
    if array.ndim == 1:
        return array.reshape(-1, 1)
    if array.ndim != 2:
        raise WhorlError(f"{key}: values have shape {array.shape}; allowed: (n,) or (n, components)")
    return array


def _column(frame: Any, column: str) -> NDArray[np.float64]:
    return _array(column, frame[column])


def _exported(present: Sequence[str], platform: Optional[Platform]) -> Dict[str, Sequence[str]]:
    """Channels whose exported columns are all there."""
    found: Dict[str, Sequence[str]] = {}
    for key, row in table().items():
        stem, end = row.column
        for sensor in range(row.sensors):
            if row.sensors > 1:
                names = [f"{stem}_{sensor + 1}_{c}{end}" for c in row.components or ()]
            elif row.components is None:
                wheels = platform.wheels if platform is not None and stem == "wheel" else []
                names = [f"{wheel}{end}" for wheel in wheels]
                if not set(names) <= set(present) or not names:
                    names = []
                    while key != "jets" and f"{stem}_{len(names) + 1}{end}" in present:
                        names.append(f"{stem}_{len(names) + 1}{end}")
            else:
                names = [f"{stem}_{c}{end}" if c else f"{stem}{end}" for c in row.components]
            if names and set(names) <= set(present):
                found[_name(key, sensor)] = names
    return found
