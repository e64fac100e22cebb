"""Attitude of a gyro with an accelerometer, a magnetometer, or other direction sensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Sequence, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._native import WhorlError
from .recording import _array


@dataclass(frozen=True)
class Attitudes:
    """Attitudes over time; NaN before the first, and at samples that were left out."""

    time_s: NDArray[np.float64]
    """(n,) [s]."""
    q_world_body: NDArray[np.float64]
    """(n, 4): w, x, y, z; rotates sensor axes into the world's (east, north, up, for filters that know the vertical)."""
    gyro_bias_rad_s: NDArray[np.float64]
    """(n, 3), sensor axes [rad/s]."""
    covariance: NDArray[np.float64]
    """(n, 6, 6): attitude error (rotation vector, sensor axes [rad]) and bias error [rad/s]."""
    filter: str
    """The filter."""
    is_magnetised: bool
    """Whether iron or a magnet was found on the sensor; its field is estimated and removed."""
    notes: Sequence[str] = ()
    """What was not used, and what is odd about the sensors: axes that turn against the gyro, the end of its range."""


def estimate(
    time_s: ArrayLike,
    gyro_rad_s: ArrayLike,
    accelerometer_m_s2: Optional[ArrayLike] = None,
    vectors: Sequence[ArrayLike] = (),
    *,
    reference_world: Sequence[Optional[Sequence[float]]] = (),
    filter: Optional[str] = None,
    smooth: bool = False,
    gyro_noise: float = 3e-4,
    gyro_bias_walk: float = 3e-5,
    gyro_bias_sigma: float = 0.02,
    vector_noise_deg: Union[float, Sequence[float]] = 1.0,
) -> Attitudes:
    """Estimates attitudes, as `whorl estimate`.

    time_s: (n,), in order [s].
    gyro_rad_s: (n, 3), sensor axes [rad/s].
    accelerometer_m_s2: (n, 3), specific force, +9.81 along the vertical at rest [m/s^2].
    vectors: an (n, 3) array to each vector sensor, of any unit; the magnetometer first; NaN where there is no new sample.
        Sensors may have rows of their own; the attitudes are those of rows with a gyro sample.
    reference_world: what each of them sees in the world; None: not known, which a magnetometer need not be.
    filter: `free_motion` (default with an accelerometer): a sensor in a hand, on a limb, on a trolley; `directions` (default
        without): any vehicle with directions whose references are known; or a filter of the estimator node.
    smooth: each sample from the whole recording, not from its past alone (free_motion, directions).
    gyro_noise, gyro_bias_walk, gyro_bias_sigma, vector_noise_deg: for `directions` [rad/s/sqrt(Hz)], [rad/s/sqrt(s)], [rad/s],
        [deg] of each vector sensor.
    """
    seen = [_array(f"vectors[{k}]", of) for k, of in enumerate(vectors)]
    references = list(reference_world) or [None] * len(seen)
    if len(references) != len(seen):
        raise WhorlError(f"reference_world has {len(references)} entries; allowed: one for each of {len(seen)} vector sensors")
    given = {"gyro_rad_s": _array("gyro_rad_s", gyro_rad_s)}
    if accelerometer_m_s2 is not None:
        given["accelerometer_m_s2"] = _array("accelerometer_m_s2", accelerometer_m_s2)
    for name, array in [*given.items(), *((f"vectors[{k}]", of) for k, of in enumerate(seen))]:
        if array.ndim != 2:
            raise WhorlError(f"{name} has shape {array.shape}; allowed: (n, 3)")
    times = _array("time_s", time_s)
    if times.ndim != 1:
        raise WhorlError(f"time_s has shape {times.shape}; allowed: (n,)")
    noise = [vector_noise_deg] if isinstance(vector_noise_deg, (int, float)) else list(vector_noise_deg)
    q, bias, covariance, name, magnetised, notes = _native.estimate(
        times,
        given["gyro_rad_s"],
        given.get("accelerometer_m_s2"),
        seen,
        [None if of is None else [float(x) for x in of] for of in references],
        filter,
        smooth,
        gyro_noise,
        gyro_bias_walk,
        gyro_bias_sigma,
        [float(x) for x in noise],
    )
    return Attitudes(times, q, bias, covariance.reshape(-1, 6, 6), name, magnetised, notes)
