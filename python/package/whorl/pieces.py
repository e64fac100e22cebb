"""Pieces that need no recording: allocation of torques, orbits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Dict, Sequence, Tuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native


class Allocator:
    """Shares a torque among jets and motors with the quadratic program of the local control node.

    jet_torque_b_n_m: (3, jets), torque of each jet at full thrust about the centre of rotation, body axes [N m].
    jet_gas_rate_kg_s: (jets,), gas that each open jet draws [kg/s].
    motor_torque_b: (3, motors), torque on the body per unit of each motor's command; of a wheel its spin axis with a minus.
    motor_limit: (motors,), largest command of each motor, in its unit.
    """

    def __init__(
        self,
        jet_torque_b_n_m: ArrayLike = (),
        jet_gas_rate_kg_s: Sequence[float] = (),
        motor_torque_b: ArrayLike = (),
        motor_limit: Sequence[float] = (),
    ) -> None:
        self._native = _native.Allocator(
            _columns(jet_torque_b_n_m), list(jet_gas_rate_kg_s), _columns(motor_torque_b), list(motor_limit)
        )

    def allocate(
        self, torque_b_n_m: ArrayLike, mode: str = "both", failed_jets: Sequence[int] = ()
    ) -> Dict[str, Any]:
        """On-time fractions (0 to 1) and motor commands for a torque on the body, body axes [N m].

        mode: `motors`, `jets` or `both`. Returns a dictionary: `jet_on_fraction`, `motor_command`, `alpha` (share of the
        torque that is met, 0 to 1: its direction is kept), `achieved_torque_b_n_m`, `unallocated_torque_b_n_m`,
        `gas_rate_kg_s`, `status`.
        """
        torque = np.asarray(torque_b_n_m, dtype=float)
        if torque.shape != (3,):
            raise _native.WhorlError(f"torque_b_n_m has shape {torque.shape}; allowed: (3,)")
        found = self._native.allocate(torque.tolist(), mode, list(failed_jets))
        return {key: np.asarray(value) if isinstance(value, list) else value for key, value in found.items()}


def _columns(given: ArrayLike) -> NDArray[np.float64]:
    array = np.asarray(given, dtype=float)
    if array.size == 0:
        return np.zeros((3, 0))
    if array.ndim != 2:
        raise _native.WhorlError(f"torques have shape {array.shape}; allowed: (3, n), a column to each jet or motor")
    return np.ascontiguousarray(array)


@dataclass(frozen=True)
class Orbit:
    """Classical elements of an ellipse about the Earth."""

    semi_major_axis_m: float
    eccentricity: float = 0.0
    inclination_rad: float = 0.0
    node_rad: float = 0.0
    perigee_rad: float = 0.0
    mean_anomaly_rad: float = 0.0

    def _elements(self) -> Tuple[float, ...]:
        return (
            self.semi_major_axis_m,
            self.eccentricity,
            self.inclination_rad,
            self.node_rad,
            self.perigee_rad,
            self.mean_anomaly_rad,
        )

    @property
    def period_s(self) -> float:
        """Time of one revolution [s]."""
        return _native.orbit(self._elements(), [])[1]

    def state(self, time_s: ArrayLike) -> Tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Position [m] and velocity [m/s] in inertial axes, (n, 3) each, two-body, at times since the elements' own [s]."""
        rows = _native.orbit(self._elements(), np.atleast_1d(np.asarray(time_s, dtype=float)).tolist())[0]
        return rows[:, :3], rows[:, 3:]

    def seen_from(
        self, position_m: ArrayLike, velocity_m_s: ArrayLike, time_s: ArrayLike
    ) -> Tuple[NDArray[np.float64], NDArray[np.float64]]:
        """A deputy's motion seen from this chief: position [m] and velocity [m/s] in its Hill frame (radial, near-velocity,
        orbit-normal), (n, 3) each, at times since the start [s]; full two-body motion, not linearised."""
        deputy = [*np.asarray(position_m, dtype=float).tolist(), *np.asarray(velocity_m_s, dtype=float).tolist()]
        if len(deputy) != 6:
            raise _native.WhorlError(f"position and velocity have {len(deputy)} numbers; allowed: 3 each")
        times = np.atleast_1d(np.asarray(time_s, dtype=float)).tolist()
        rows = _native.relative_motion(self._elements(), deputy, times)
        return rows[:, :3], rows[:, 3:]
