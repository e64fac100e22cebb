"""Native part. Use the functions of `whorl`, which return objects instead of JSON texts."""

from os import PathLike
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import NDArray

Path = Union[str, "PathLike[str]"]
Progress = Optional[Callable[[float, str], object]]
Floats = NDArray[np.float64]
Elements = Sequence[float]

__version__: str

class WhorlError(ValueError):
    """What is wrong, where, and what is allowed: the words of the `whorl` command."""

class Platform:
    """A platform's model and how well it is known."""

    @staticmethod
    def read(source: Path, platform: Optional[str] = None) -> "Platform": ...
    @staticmethod
    def of_runs(
        runs: Sequence[Path], model: Optional[Path] = None, platform: Optional[str] = None
    ) -> "Platform": ...
    @property
    def name(self) -> str: ...
    @property
    def files(self) -> List[PathLike[str]]: ...
    @property
    def wheels(self) -> List[str]: ...
    @property
    def jets(self) -> List[str]: ...
    @property
    def hinge_axis_b(self) -> Optional[List[float]]: ...
    @property
    def mass_kg(self) -> float: ...
    @property
    def inertia_b_kg_m2(self) -> List[List[float]]: ...
    @property
    def gravity_offset_b_n_m(self) -> List[float]: ...
    @property
    def effects(self) -> Dict[str, Dict[str, float]]: ...

class Recording:
    @staticmethod
    def read(
        path: Path,
        platform: Optional[Platform] = None,
        name: Optional[str] = None,
        channels: Optional[Path] = None,
    ) -> "Recording": ...
    @staticmethod
    def of(
        samples: Sequence[Tuple[str, int, Floats, Floats, Optional[str], Optional[Sequence[float]]]],
        name: str,
        platform: Optional[Platform] = None,
        clamped: bool = False,
        closed_loop: bool = False,
        jets: Optional[Sequence[Sequence[Tuple[float, float]]]] = None,
    ) -> "Recording": ...
    def check(self, platform: Platform) -> None: ...
    @property
    def name(self) -> str: ...
    @property
    def platform(self) -> str: ...
    @property
    def source(self) -> Optional[PathLike[str]]: ...
    @property
    def duration_s(self) -> float: ...
    @property
    def clamped(self) -> bool: ...
    @property
    def closed_loop(self) -> bool: ...
    @property
    def remarks(self) -> List[str]: ...
    def sampled(self) -> List[Tuple[str, int, int]]: ...
    def jet_pulses(self) -> List[List[Tuple[float, float]]]: ...
    def reference_world(self, sensor: int) -> Optional[List[float]]: ...
    def write_parquet(self, folder: Path, platform: Optional[Platform]) -> List[PathLike[str]]: ...
    def time_s(self, key: str, sensor: int) -> Floats: ...
    def values(self, key: str, sensor: int) -> Floats: ...

class Allocator:
    def __init__(
        self,
        jet_torque_b_n_m: Floats,
        jet_gas_rate_kg_s: Sequence[float],
        motor_torque_b: Floats,
        motor_limit: Sequence[float],
    ) -> None: ...
    def allocate(
        self, torque_b_n_m: Sequence[float], mode: str = "both", failed_jets: Sequence[int] = ()
    ) -> Dict[str, Any]: ...

class Campaign:
    def __init__(
        self,
        file: Path,
        out: Path,
        params: Optional[Path] = None,
        seeds: Optional[int] = None,
        grow: bool = True,
    ) -> None: ...
    def __len__(self) -> int: ...
    def missing(self) -> List[int]: ...
    def hold(self) -> Held: ...
    def run(self, index: int) -> None: ...
    def noun(self) -> str: ...
    def write_tables(self) -> Tuple[str, str, List[str], Optional[str], int, List[str]]: ...

class Held:
    def release(self) -> None: ...

def channels() -> str: ...
def effects(platform: Optional[Platform] = None) -> str: ...
def describe_effect(id: str, platform: Optional[Platform] = None) -> str: ...
def load_effect(path: Path) -> str: ...
def compare(
    training: Sequence[Recording],
    held_out: Sequence[Recording],
    platform: Platform,
    refit: bool = False,
    progress: Progress = None,
) -> Tuple[str, str]: ...
def locate(
    training: Sequence[Recording], held_out: Sequence[Recording], platform: Platform, progress: Progress = None
) -> Tuple[str, str]: ...
def diagnose(
    training: Sequence[Recording],
    held_out: Sequence[Recording],
    platform: Platform,
    exclude: Sequence[str] = (),
    progress: Progress = None,
) -> Tuple[str, List[str], str]: ...
def discover(
    training: Sequence[Recording],
    held_out: Sequence[Recording],
    platform: Platform,
    id: str,
    exclude: Sequence[str] = (),
    anyway: bool = False,
    progress: Progress = None,
) -> Tuple[str, Optional[str], Optional[str]]: ...
def adopt(
    training: Sequence[Recording],
    held_out: Sequence[Recording],
    platform: Platform,
    sets: Sequence[Sequence[str]],
    out: Optional[Path] = None,
    anyway: bool = False,
    progress: Progress = None,
) -> Tuple[str, str, Optional[Platform], Optional[str]]: ...
def identify(
    training: Sequence[Recording], platform: Platform, prior_scale: float = 1.0, progress: Progress = None
) -> Tuple[str, Optional[Platform]]: ...
def simulate(
    experiment: Path,
    out: Optional[Path] = None,
    seed: int = 1,
    params: Optional[Path] = None,
    overrides: Sequence[str] = (),
    longest_s: float = 3600.0,
    progress: Progress = None,
) -> Tuple[PathLike[str], str]: ...
def estimate(
    time_s: Floats,
    gyro_rad_s: Floats,
    force_m_s2: Optional[Floats],
    vectors: Sequence[Floats],
    references: Sequence[Optional[Sequence[float]]],
    filter: Optional[str],
    smooth: bool,
    gyro_noise: float,
    gyro_bias_walk: float,
    gyro_bias_sigma: float,
    vector_noise_deg: Sequence[float],
) -> Tuple[Floats, Floats, Floats, str, bool, List[str]]: ...
def orbit(of: Elements, time_s: Sequence[float]) -> Tuple[Floats, float]: ...
def relative_motion(chief: Elements, deputy: Sequence[float], time_s: Sequence[float]) -> Floats: ...
def trends(
    training: Sequence[Recording],
    platform: Platform,
    began: Optional[Sequence[float]] = None,
    since: Optional[int] = None,
    parquet: Optional[Path] = None,
    progress: Progress = None,
) -> Tuple[str, List[str], List[str], List[List[str]], str, Optional[PathLike[str]]]: ...
def history(platform: Platform) -> str: ...
def calibrate_sensors(
    training: Sequence[Recording],
    platform: Platform,
    known_turn_deg: Optional[float] = None,
    turn_error_deg: float = 0.3,
    level_error_deg: float = 0.5,
    gravity_m_s2: Optional[float] = None,
    out: Optional[Path] = None,
) -> Tuple[str, Optional[int]]: ...
