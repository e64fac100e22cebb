"""A case: what a laboratory would hand over (CSV files, channel map, platform file) and, apart from it, the truth.

Nothing here computes motion. It adds what sensors do to what a simulator says they should have read, states the
platform as its drawing would (each number off by its own standard deviation), and writes the files that
`whorl import csv` and `whorl diagnose` take.
"""

import csv
import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

GRAVITY_M_S2 = 9.81


@dataclass
class Wheel:
    """A reaction wheel as it is drawn: unit spin axis in body axes, inertia [kg m^2], limits [N m], [rad/s]."""

    axis: np.ndarray
    inertia: float
    max_torque: float
    max_speed: float = 600.0
    viscous: float = 0.0
    coulomb: float = 0.0


@dataclass
class Jet:
    """An on/off jet as it is drawn: position [m] and unit force direction in body axes, thrust [N]."""

    position: np.ndarray
    direction: np.ndarray
    thrust: float


@dataclass
class Sensors:
    """Noise of one sample (standard deviation) and rates. `None` for a sensor that the rig does not have."""

    rate_hz: float = 100.0
    gyro: float = 1e-3  # [rad/s]
    accelerometer: float | None = 0.02  # [m/s^2]
    lever_arm: np.ndarray = field(default_factory=lambda: np.zeros(3))  # [m], as stated
    vector: float | None = 2e-3  # [rad]
    vector_every: int = 10
    wheel_speed: float = 0.05  # [rad/s]


@dataclass
class Rig:
    """What is known of a platform. `inertia` [kg m^2] about the centre of rotation, wheels included; `mgr` [N m]."""

    name: str
    mass: float
    inertia: np.ndarray
    mgr: np.ndarray
    wheels: list
    jets: list
    sensors: Sensors
    freedom: str = "on_bearing"
    hinge_axis: np.ndarray | None = None


@dataclass
class Run:
    """Samples of ideal sensors at `time` [s]; commands hold from their own time until the next."""

    time: np.ndarray
    rate: np.ndarray  # (n, 3) body rate, body axes [rad/s]
    force: np.ndarray | None  # (n, 3) specific force where the accelerometer sits [m/s^2]
    rotation: np.ndarray  # (n, 3, 3) body to world
    wheel_speed: np.ndarray  # (n, wheels) [rad/s]
    command: np.ndarray  # (n, wheels) motor torque in force from this sample on [N m]
    pulses: list = field(default_factory=list)  # for each jet: list of (on, off) [s]
    closed_loop: bool = False


def correlated(rng, n, stddev, share=0.15, samples=3.0):
    """White noise with a small correlated part, of that total standard deviation."""
    white = rng.standard_normal((n, 3)) * np.sqrt(1.0 - share)
    slow, keep = np.zeros((n, 3)), np.exp(-1.0 / samples)
    drive = rng.standard_normal((n, 3)) * np.sqrt(share * (1.0 - keep**2))
    for k in range(1, n):
        slow[k] = keep * slow[k - 1] + drive[k]
    return stddev * (white + slow)


def turned(vector):
    """Rotation matrix of a rotation vector [rad]."""
    angle = np.linalg.norm(vector)
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


class SensorErrors:
    """Errors beyond noise and turn-on bias; each is one effect of the catalogue when it is not neutral."""

    def __init__(self, gyro_scale=None, gyro_turn=None, accel_scale=None, vector_turn=None, delay_s=0.0, clip=None):
        self.gyro_scale = np.zeros(3) if gyro_scale is None else np.asarray(gyro_scale)
        self.gyro_turn = np.zeros(3) if gyro_turn is None else np.asarray(gyro_turn)
        self.accel_scale = np.zeros(3) if accel_scale is None else np.asarray(accel_scale)
        self.vector_turn = np.zeros(3) if vector_turn is None else np.asarray(vector_turn)
        self.delay_s = delay_s
        self.clip = clip


REFERENCES = [np.array([1.0, 0.0, 0.0]), np.array([0.2, 0.9, -0.4])]


def table(rig, run, rng, errors, true_noise):
    """Column names and rows (blank where nothing was measured) of one run."""
    n, sensors = len(run.time), rig.sensors
    lag = int(round(errors.delay_s * sensors.rate_hz))
    late = lambda x: np.concatenate([np.repeat(x[:1], lag, 0), x[: n - lag]]) if lag else x
    gyro = late(run.rate) @ turned(errors.gyro_turn) * (1.0 + errors.gyro_scale)
    gyro = gyro + rng.normal(0.0, 2e-3, 3) + correlated(rng, n, sensors.gyro * true_noise)
    if errors.clip is not None:
        gyro = np.clip(gyro, -errors.clip, errors.clip)
    hinge = rig.hinge_axis
    columns = {f"g{a}": gyro[:, i] for i, a in enumerate("xyz") if hinge is None or abs(hinge[i]) > 0.5}
    if sensors.accelerometer is not None:
        force = late(run.force) * (1.0 + errors.accel_scale) + rng.normal(0.0, 2e-3, 3)
        force = force + correlated(rng, n, sensors.accelerometer * true_noise)
        columns |= {f"a{a}": force[:, i] for i, a in enumerate("xyz")}
    if sensors.vector is not None:
        for k, reference in enumerate(REFERENCES[: 2 if sensors.accelerometer is None else 1]):
            seen = np.einsum("nji,j->ni", run.rotation, reference / np.linalg.norm(reference))
            seen = seen @ turned(errors.vector_turn) + rng.standard_normal((n, 3)) * sensors.vector * true_noise
            seen[np.arange(n) % sensors.vector_every != 0] = np.nan
            columns |= {f"v{k}{a}": seen[:, i] for i, a in enumerate("xyz")}
    speed = run.wheel_speed + rng.standard_normal(run.wheel_speed.shape) * sensors.wheel_speed * true_noise
    columns |= {f"speed_{w + 1}": speed[:, w] for w in range(len(rig.wheels))}
    columns |= {f"command_{w + 1}": run.command[:, w] for w in range(len(rig.wheels))}
    rows = {round(t * 1e9): [values[k] for values in columns.values()] for k, t in enumerate(run.time)}
    names = list(columns) + [f"jet_{j + 1}" for j in range(len(rig.jets))]
    blank = [np.nan] * len(names)
    for key in rows:
        rows[key] = rows[key] + [np.nan] * len(rig.jets)
    for j, pulses in enumerate(run.pulses):
        edges = [(0.0, 0.0)] + [edge for on, off in pulses for edge in ((on, 1.0), (off, 0.0))]
        for t, value in edges:
            rows.setdefault(round(t * 1e9), list(blank))[len(columns) + j] = value
    return names, sorted(rows.items())


def channel_map(rig, closed_loop):
    """The map that names every column."""
    sensors, wheels = rig.sensors, range(1, len(rig.wheels) + 1)
    listed = lambda prefix, numbers: ", ".join(f"{prefix}_{k}" for k in numbers)
    if rig.hinge_axis is None:
        gyro = "gx, gy, gz"
    else:
        gyro = ", ".join(f"g{a}" if abs(rig.hinge_axis[i]) > 0.5 else "~" for i, a in enumerate("xyz"))
    lines = ["time: {column: t, unit: s}", f"gyro: {{columns: [{gyro}], unit: rad/s}}"]
    if sensors.accelerometer is not None:
        lines.append("accelerometer: {columns: [ax, ay, az], unit: m/s^2}")
    if sensors.vector is not None:
        lines.append("vectors:")
        for k, reference in enumerate(REFERENCES[: 2 if sensors.accelerometer is None else 1]):
            direction = ", ".join(f"{x:.6f}" for x in reference / np.linalg.norm(reference))
            lines.append(f"  sensor_{k + 1}: {{columns: [v{k}x, v{k}y, v{k}z], reference_world: [{direction}]}}")
    if rig.wheels:
        lines.append(f"wheel_speed: {{columns: [{listed('speed', wheels)}], unit: rad/s}}")
        lines.append(f"wheel_torque_command: {{columns: [{listed('command', wheels)}], unit: N m}}")
    if rig.jets:
        lines.append(f"jets: {{columns: [{listed('jet', range(1, len(rig.jets) + 1))}], quantity: open}}")
    if closed_loop:
        lines.append("closed_loop: true")
    return "csv:\n  ros__parameters:\n" + "".join(f"    {line}\n" for line in lines)


def drawing(rig, rng):
    """The platform as its drawing has it: every number off by one standard deviation of what a builder knows."""
    principal = np.diag(rig.inertia)
    spread = 0.05 * 0.5 * (principal[:, None] + principal[None, :])
    change = rng.standard_normal((3, 3)) * spread
    inertia = rig.inertia + (np.tril(change) + np.tril(change, -1).T) * 0.5
    arm = 0.2 * np.abs(rig.mgr) + 2e-3 * np.linalg.norm(rig.mgr)
    free = rig.freedom == "free"
    mgr = rig.mgr + (0.0 if free else 1.0) * rng.standard_normal(3) * arm
    return inertia, spread, mgr, np.zeros(3) if free else np.maximum(arm, 1e-9)


def platform(rig, rng, stated_noise):
    """Text of the platform's parameter file."""
    inertia, spread, mgr, mgr_spread = drawing(rig, rng)
    names = ["xx", "xy", "xz", "yy", "yz", "zz"]
    at = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
    group = lambda m: "{" + ", ".join(f"{n}: {m[i, j]:.6e}" for n, (i, j) in zip(names, at)) + "}"
    listed = lambda v: "[" + ", ".join(f"{x:.6e}" for x in v) + "]"
    s, model = rig.sensors, []
    model.append(f"mass_kg: {rig.mass:.6e}")
    model.append(f"inertia_kg_m2: {group(inertia)}")
    model.append(f"gravity_offset_n_m: {listed(mgr)}")
    model.append("tilt_limit: {kind: cone, max_rad: 3.0}")
    if rig.freedom == "hinge":
        model.append(f"freedom: {{kind: hinge, axis: {listed(rig.hinge_axis)}}}")
    elif rig.freedom == "free":
        model.append("freedom: {kind: free}")
    if rig.wheels:
        model.append("wheels:")
        for k, wheel in enumerate(rig.wheels):
            model.append(
                f"  wheel_{k + 1}: {{spin_axis: {listed(wheel.axis)}, "
                f"spin_inertia_kg_m2: {wheel.inertia * (1 + 0.01 * rng.standard_normal()):.6e}, "
                f"max_torque_n_m: {wheel.max_torque:.6e}, max_speed_rad_s: {wheel.max_speed:.6e}, "
                f"viscous_friction_n_m_s: {wheel.viscous:.6e}, coulomb_friction_n_m: {wheel.coulomb:.6e}}}"
            )
    if rig.jets:
        model.append("jets:")
        for k, jet in enumerate(rig.jets):
            model.append(
                f"  jet_{k + 1}: {{position_m: {listed(jet.position)}, force_direction: {listed(jet.direction)}, "
                f"thrust_n: {jet.thrust * (1 + 0.05 * rng.standard_normal()):.6e}, min_on_time_s: 0.005}}"
            )
    model.append("sensors:")
    model.append(f"  rate_hz: {s.rate_hz:.6e}")
    model.append(f"  gyro: {{noise_stddev_rad_s: {s.gyro * stated_noise:.6e}, bias_turn_on_stddev_rad_s: 2.0e-3}}")
    if s.accelerometer is not None:
        model.append(
            f"  accelerometer: {{noise_stddev_m_s2: {s.accelerometer * stated_noise:.6e}, "
            f"bias_turn_on_stddev_m_s2: 2.0e-3, lever_arm_m: {listed(s.lever_arm)}}}"
        )
    model.append(f"  wheel_speed: {{noise_stddev_rad_s: {s.wheel_speed * stated_noise:.6e}}}")
    if s.vector is not None:
        model.append(
            f"  vector: {{reference_direction: [1.0, 0.0, 0.0], noise_stddev_rad: {s.vector * stated_noise:.6e}, "
            f"rate_hz: {s.rate_hz / s.vector_every:.6e}}}"
        )
    prior = [f"inertia_kg_m2: {group(spread)}", f"gravity_offset_n_m: {listed(mgr_spread)}"]
    lines = ["model:"] + [f"  {line}" for line in model] + ["model_prior:"] + [f"  {line}" for line in prior]
    return "/rig/**:\n  ros__parameters:\n" + "".join(f"    {line}\n" for line in lines)


def write(folder: Path, rig: Rig, runs, answer, seed, errors=None):
    """Writes `train_*.csv`, `held_out.csv` (the last run), `MAP.yaml`, `rig.yaml`, and `answer.json` for the judge."""
    rng = np.random.default_rng([seed, 7])
    errors = errors or SensorErrors()
    folder.mkdir(parents=True, exist_ok=True)
    stated_noise = np.exp(rng.normal(0.0, 0.2))  # data sheets are not exact
    for k, run in enumerate(runs):
        name = "held_out.csv" if k == len(runs) - 1 else f"train_{k + 1}.csv"
        names, rows = table(rig, run, rng, errors, 1.0)
        with open(folder / name, "w", newline="") as file:
            out = csv.writer(file)
            out.writerow(["t", *names])
            for time_ns, row in rows:
                cells = ["" if np.isnan(x) else f"{x:.9g}" for x in row]
                out.writerow([f"{time_ns * 1e-9:.9f}", *cells])
    (folder / "MAP.yaml").write_text(channel_map(rig, any(run.closed_loop for run in runs)))
    (folder / "rig.yaml").write_text(platform(rig, rng, stated_noise))
    (folder / "answer.json").write_text(json.dumps({"rig": rig.name, "freedom": rig.freedom, **answer}, indent=2) + "\n")
