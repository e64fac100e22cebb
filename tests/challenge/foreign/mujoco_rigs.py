"""Platforms whose truth is MuJoCo (Todorov, Erez and Tassa, IROS 2012; PyPI `mujoco`): rigid bodies, joints with
friction loss, damping, springs and limits, tendons, filters in actuators. The equations of motion, of contact
and of friction are MuJoCo's; this file only draws the rig, says what is wrong with it, and drives it.
"""

import mujoco
import numpy as np

from case import GRAVITY_M_S2, Jet, Rig, Run, SensorErrors, Sensors, Wheel, turned
from faults import gyro_scaled, gyro_turned, jet_turned, jet_weak, sensors_late, wheel_heavier, wheel_tilted

# Runge-Kutta of fourth order: with the semi-implicit Euler steps that MuJoCo takes by default, a platform that lacks
# nothing can be distinguished from a rigid body.
STEP_S = 2e-3


def unit(v):
    return np.asarray(v, float) / np.linalg.norm(v)


def text(v):
    return " ".join(f"{x:.9g}" for x in np.ravel(v))


class Laboratory:
    """A drawn rig and its MuJoCo model. `extra` holds what the drawing does not say: fragments of MJCF by place."""

    def __init__(self, rng, kind, jets=False, accelerometer=True):
        self.rng, self.kind = rng, kind
        # Inertia over five decades, mass with it: a ball of that size.
        scale = 10.0 ** rng.uniform(-3.0, 2.0) if kind == "ball" else 10.0 ** rng.uniform(-4.0, 1.0)
        self.scale = scale
        self.mass = 20.0 * scale**0.6
        radius = np.sqrt(scale / self.mass)
        self.radius = radius
        shape = scale * rng.uniform(0.8, 1.3, 3)
        turn = turned(rng.normal(0.0, 0.1, 3))
        self.hub_inertia = turn @ np.diag(shape) @ turn.T
        # A pendulum below its centre of rotation, slow: a period of 5 to 12 s.
        stiffness = scale * (2 * np.pi / rng.uniform(5.0, 12.0)) ** 2
        self.com = np.array([*rng.normal(0.0, 0.02, 2), -1.0]) * stiffness / (self.mass * GRAVITY_M_S2)
        if kind == "hinge":
            self.com = np.zeros(3)
        axes = [[0, 0, 1]] if kind == "hinge" else np.eye(3)
        self.wheels = []
        for axis in axes:
            spin = 2e-3 * scale * rng.uniform(0.7, 1.5)
            self.wheels.append(Wheel(unit(axis), spin, max_torque=0.05 * scale, max_speed=2000.0))
        arm = radius * 1.5
        self.jets = []
        if jets:
            for k in range(3):
                for sign in (1.0, -1.0):
                    position, push = np.eye(3)[(k + 1) % 3] * arm, np.eye(3)[(k + 2) % 3] * sign
                    self.jets.append(Jet(position, push, thrust=0.02 * scale / arm))
        self.acceleration = 0.02  # typical angular acceleration [rad/s^2]
        self.sensors = Sensors(
            gyro=10.0 ** rng.uniform(-3.7, -2.7),
            accelerometer=0.02 * rng.uniform(0.5, 2.0) if accelerometer and kind == "ball" else None,
            vector=2e-3 if kind == "ball" else None,
            lever_arm=rng.normal(0.0, 0.3 * radius, 3),
        )
        self.joint = {"damping": 0.0, "frictionloss": 0.0, "stiffness": 0.0}
        self.option, self.body, self.world, self.extra = "", "", "", ""
        self.wheel_joint = [{"damping": 0.0, "frictionloss": 0.0} for _ in self.wheels]
        self.wheel_axis = [w.axis for w in self.wheels]
        self.wheel_inertia = [w.inertia for w in self.wheels]
        self.thrust = [j.thrust for j in self.jets]
        self.push = [j.direction for j in self.jets]
        self.jet_filter_s, self.jet_delay_s = 0.0, 0.0
        self.lever_arm = self.sensors.lever_arm
        self.background = 0.0  # slow random torque, standard deviation as a share of inertia times acceleration
        self.extra_inertia, self.extra_moment, self.extra_mass = np.zeros((3, 3)), np.zeros(3), 0.0
        self.errors = SensorErrors()
        # Angle of a hinge from where its spring is relaxed, the largest of all runs.
        self.farthest_rad = 0.0

    def torque(self, share=1.0):
        """A torque [N m] that this rig notices: `share` of what its wheels usually make."""
        return share * self.scale * self.acceleration

    def rig(self):
        """The drawing: inertia about the centre of rotation with everything that was drawn."""
        c = self.com
        inertia = self.hub_inertia + self.mass * (c @ c * np.eye(3) - np.outer(c, c)) + self.extra_inertia
        for wheel in self.wheels:
            inertia = inertia + wheel.inertia * (0.55 * np.eye(3) + 0.45 * np.outer(wheel.axis, wheel.axis))
        mgr = GRAVITY_M_S2 * (self.mass * c + self.extra_moment)
        hinge = np.array([0.0, 0.0, 1.0]) if self.kind == "hinge" else None
        freedom = "hinge" if self.kind == "hinge" else "on_bearing"
        mass = self.mass + self.extra_mass
        return Rig(f"mujoco_{self.kind}", mass, inertia, mgr, self.wheels, self.jets, self.sensors, freedom, hinge)

    def model(self):
        joint = " ".join(f'{k}="{v:.9g}"' for k, v in self.joint.items())
        kind = 'type="ball"' if self.kind == "ball" else 'type="hinge" axis="0 0 1"'
        wheels, motors, sensors = "", "", ""
        for k, wheel in enumerate(self.wheels):
            spin, cross = self.wheel_inertia[k], 0.55 * self.wheel_inertia[k]
            frame = np.column_stack([*_across(self.wheel_axis[k]), self.wheel_axis[k]])
            quat = np.zeros(4)
            mujoco.mju_mat2Quat(quat, frame.ravel())
            own = " ".join(f'{n}="{v:.9g}"' for n, v in self.wheel_joint[k].items())
            wheels += (
                f'<body quat="{text(quat)}"><joint name="w{k}" type="hinge" axis="0 0 1" {own}/>'
                f'<inertial pos="0 0 0" mass="1e-6" diaginertia="{cross:.9g} {cross:.9g} {spin:.9g}"/></body>'
            )
            motors += f'<motor joint="w{k}" gear="1"/>'
            sensors += f'<jointvel joint="w{k}"/>'
        sites = ""
        for j, jet in enumerate(self.jets):
            sites += f'<site name="j{j}" pos="{text(jet.position)}"/>'
            dynamics = f'dyntype="filter" dynprm="{self.jet_filter_s:.9g}"' if self.jet_filter_s else ""
            force = self.push[j] * self.thrust[j]
            motors += f'<general site="j{j}" gear="{text(force)} 0 0 0" {dynamics}/>'
        i = self.hub_inertia
        full = [i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]
        return mujoco.MjModel.from_xml_string(
            f'<mujoco><option timestep="{STEP_S}" gravity="0 0 -{GRAVITY_M_S2}" integrator="RK4" {self.option}/>'
            f'<worldbody>{self.world}<body name="rig"><joint name="bearing" {kind} {joint}/>'
            f'<inertial pos="{text(self.com)}" mass="{self.mass:.9g}" fullinertia="{text(full)}"/>'
            f'<site name="imu" pos="{text(self.lever_arm)}"/>{sites}{wheels}{self.body}</body></worldbody>{self.extra}'
            f'<actuator>{motors}</actuator><sensor><gyro site="imu"/><accelerometer site="imu"/>'
            f'<framequat objtype="xbody" objname="rig"/>{sensors}</sensor></mujoco>'
        )

    def run(self, seed, seconds, how):
        """One run: `how` is "multisine", "swing", "spin", "closed" or "still"."""
        rng = np.random.default_rng([seed, 3])
        model = self.model()
        data = mujoco.MjData(model)
        wheels, three = len(self.wheels), self.kind == "ball"
        start = rng.normal(0.0, 0.1 if how in ("swing", "spin") else 0.03, 3)
        if three:
            mujoco.mju_axisAngle2Quat(data.qpos[:4], unit(start), np.linalg.norm(start))
            data.qvel[:3] = rng.normal(0.0, 0.05, 3)
            data.qvel[2] += {"spin": 0.6, "swing": 0.2}.get(how, 0.0) * rng.choice([-1.0, 1.0])
        else:
            data.qpos[0] = rng.normal(0.0, 1.0)
            data.qvel[0] = {"spin": 1.0, "swing": 0.5}.get(how, 0.1) * rng.choice([-1.0, 1.0])
        bias = rng.normal(0.0, 60.0, wheels)
        first = 3 if three else 1
        data.qvel[first : first + wheels] = bias
        steps, every = int(seconds / STEP_S), int(round(1.0 / (self.sensors.rate_hz * STEP_S)))
        sines = [(rng.uniform(0.03, 1.5, 5), rng.uniform(0, 2 * np.pi, 5)) for _ in range(wheels)]
        pulses = self.pulses(rng, seconds) if self.jets and how != "still" else [[] for _ in self.jets]
        torque, slow = np.zeros(3), np.exp(-STEP_S / 5.0)
        kick = self.background * self.torque() * np.sqrt(1 - slow**2)
        time, sensed, command = [], [], []
        u = np.zeros(wheels)
        target = rng.normal(0.0, 0.3)
        for k in range(steps):
            t = k * STEP_S
            if k % every == 0:
                u = self.wheel_torque(how, t, sines, data, target, rng)
                data.ctrl[:wheels] = u
                mujoco.mj_forward(model, data)
                time.append(t), sensed.append(data.sensordata.copy()), command.append(u)
            for j, list_of in enumerate(pulses):
                # On the grid of steps, where pulses begin and end.
                late = STEP_S * round((t - self.jet_delay_s) / STEP_S)
                data.ctrl[wheels + j] = any(on <= late < off for on, off in list_of)
            data.qfrc_applied[:] = 0.0
            if kick:
                torque = slow * torque + kick * rng.standard_normal(3)
                # A ball joint's generalised force is in body axes, as its velocity.
                data.qfrc_applied[:first] = torque if three else torque[2:]
            self.disturb(t, data)
            mujoco.mj_step(model, data)
            if not three:
                self.farthest_rad = max(self.farthest_rad, abs(data.qpos[0]))
            if not np.abs(data.qvel).max() < 1e4:
                raise RuntimeError(f"the simulation diverged at {data.time:.3f} s")
        sensed, command = np.array(sensed), np.array(command).reshape(len(time), wheels)
        rotation = np.zeros((len(time), 9))
        for row, q in zip(rotation, sensed[:, 6:10]):
            mujoco.mju_quat2Mat(row, q)
        return Run(
            time=np.array(time),
            rate=sensed[:, 0:3],
            force=sensed[:, 3:6],
            rotation=rotation.reshape(-1, 3, 3),
            wheel_speed=sensed[:, 10 : 10 + wheels],
            command=command,
            pulses=pulses,
            closed_loop=how == "closed",
        )

    def wheel_torque(self, how, t, sines, data, target, rng):
        if how in ("spin", "still"):
            return np.zeros(len(self.wheels))
        size = self.torque(0.5) * (0.3 if how == "swing" else 1.0)
        out = np.array([size * np.sum(np.sin(2 * np.pi * f * t + p)) / 2.0 for f, p in sines])
        if how == "closed":
            # Proportional-derivative law on noisy measurements, a turn and back.
            wanted = target if int(t / 20.0) % 2 else 0.0
            if self.kind == "ball":
                rotation = np.zeros(3)
                mujoco.mju_quat2Vel(rotation, data.qpos[:4], 1.0)
                error, rate = rotation - np.array([0.0, 0.0, wanted]), data.qvel[:3]
            else:
                error, rate = np.array([0, 0, data.qpos[0] - wanted]), np.array([0, 0, data.qvel[0]])
            rate = rate + rng.standard_normal(3) * self.sensors.gyro
            body = -self.scale * (0.4**2 * error + 2 * 0.8 * 0.4 * rate)
            out = np.array([-body @ w.axis for w in self.wheels])
        limit = np.array([w.max_torque for w in self.wheels])
        return np.clip(out, -limit, limit)

    def pulses(self, rng, seconds):
        """Pulses of 0.05 to 0.3 s, each jet now and then."""
        out = []
        for _ in self.jets:
            t, mine = rng.uniform(1.0, 6.0), []
            while t < seconds - 1.0:
                on, length = (STEP_S * round(x / STEP_S) for x in (t, rng.uniform(0.05, 0.3)))
                mine.append((on, STEP_S * round((on + length) / STEP_S)))
                t += rng.uniform(3.0, 9.0)
            out.append(mine)
        return out

    @property
    def about_z(self):
        """Which generalised force turns the body about its z axis."""
        return 2 if self.kind == "ball" else 0

    def yaw(self, data):
        """Heading [rad]."""
        if self.kind != "ball":
            return data.qpos[0]
        w, x, y, z = data.qpos[:4]
        return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    def disturb(self, t, data):
        """For what MuJoCo has no element: overridden by a case."""


def _across(axis):
    helper = np.array([1.0, 0, 0]) if abs(axis[0]) < 0.7 else np.array([0, 1.0, 0])
    first = unit(np.cross(helper, axis))
    return first, np.cross(axis, first)


# --- What is wrong: each function changes a drawn laboratory and returns the answer's id (None: nothing is).


def nothing(lab):
    return None


def random_torque(lab):
    lab.background = 0.02
    return None


def damping(lab):
    lab.joint["damping"] = lab.scale * 0.02
    return "bearing_viscous_friction"


def friction_loss(lab):
    lab.joint["frictionloss"] = lab.torque(0.15)
    return "bearing_coulomb_friction"


def cable(lab):
    """A hinge's own spring; on a ball two cords from the rim to the base, which twist and stretch."""
    if lab.kind == "hinge":
        # So stiff that few runs turn by half a turn: beyond, a cable winds up, which is another effect (`make`).
        lab.joint["stiffness"] = lab.scale * 0.5
        return "harness_spring"
    r = lab.radius
    lab.world = "".join(f'<site name="base{k}" pos="{s * 2 * r:.9g} 0 0"/>' for k, s in enumerate((1, -1)))
    lab.body += "".join(f'<site name="rim{k}" pos="{s * r:.9g} 0 0"/>' for k, s in enumerate((1, -1)))
    k_n_m = lab.scale * 0.05 / (4 * r * r)
    lab.extra = "<tendon>" + "".join(
        f'<spatial stiffness="{k_n_m:.9g}" springlength="{0.5 * r:.9g}"><site site="rim{k}"/><site site="base{k}"/></spatial>'
        for k in range(2)
    ) + "</tendon>"
    return "harness_spring"


def pendulum(lab):
    """A mass on a rod that swings in a damped cardan joint inside the platform."""
    # Of 0.7 Hz, and no longer than what fits into a small rig.
    mass, rod = 0.05 * lab.mass, min(GRAVITY_M_S2 / (2 * np.pi * 0.7) ** 2, 0.5 * lab.radius)
    at = np.array([0.0, 0.0, -0.2 * lab.radius])
    lab.body += (
        f'<body pos="{text(at)}"><joint type="hinge" axis="1 0 0" damping="{0.02 * mass * rod * rod:.9g}"/>'
        f'<joint type="hinge" axis="0 1 0" damping="{0.02 * mass * rod * rod:.9g}"/>'
        f'<inertial pos="0 0 {-rod:.9g}" mass="{mass:.9g}" diaginertia="1e-9 1e-9 1e-9"/></body>'
    )
    c = at + np.array([0, 0, -rod])
    lab.extra_mass, lab.extra_moment = mass, mass * c
    lab.extra_inertia = mass * (c @ c * np.eye(3) - np.outer(c, c))
    return "slosh"


def panel(lab):
    """A panel on a sprung hinge along body x at the rim."""
    mass, half = 0.03 * lab.mass, 1.2 * lab.radius
    inertia = mass * half**2 / 3.0
    about = inertia + mass * half**2
    omega = 2 * np.pi * lab.rng.uniform(1.2, 3.0)
    at = np.array([0.0, lab.radius, 0.0])
    lab.body += (
        f'<body pos="{text(at)}"><joint type="hinge" axis="1 0 0" stiffness="{about * omega**2:.9g}" '
        f'damping="{2 * 0.01 * about * omega:.9g}"/>'
        f'<inertial pos="0 {half:.9g} 0" mass="{mass:.9g}" diaginertia="{inertia:.9g} {inertia / 9:.9g} {inertia:.9g}"/></body>'
    )
    c = at + np.array([0, half, 0])
    # Who mounts a panel balances the platform again: the hub's centre of mass moves the other way.
    lab.com = lab.com - [0.0, mass * c[1] / lab.mass, 0.0]
    lab.extra_mass, lab.extra_moment = mass, mass * c
    lab.extra_inertia = np.diag([inertia, inertia / 9, inertia]) + mass * (c @ c * np.eye(3) - np.outer(c, c))
    return "flexible_mode"


def wheel_damping(lab):
    lab.wheel_joint[-1]["damping"] = lab.torque(0.15) / 60.0
    return "wheel_friction"


def wheel_friction_loss(lab):
    lab.wheel_joint[0]["frictionloss"] = lab.torque(0.2)
    return "wheel_friction"


def lamp_turned(lab):
    lab.errors = SensorErrors(vector_turn=[0.0, 0.0, 0.04])
    return "vector_sensor_misalignment"


def accelerometer_elsewhere(lab):
    lab.lever_arm = lab.sensors.lever_arm + np.array([2.0, -1.5, 1.0]) * 0.3 * lab.radius * 10
    return "accel_lever_arm"


def jets_slow(lab):
    lab.jet_filter_s = 0.05
    return "thruster_rise"


def jets_late(lab):
    lab.jet_delay_s = 0.04
    return "thruster_delay"


def vane(lab):
    """Outside every catalogue: a vane in a steady draught, whose torque follows the angle to the draught."""
    size = lab.torque(0.6)

    def disturb(t, data):
        data.qfrc_applied[lab.about_z] += size * np.sin(2 * lab.yaw(data))

    lab.disturb = disturb
    return "unknown", "yaw"


def detent(lab):
    """Outside every catalogue: the bearing catches at every sixth of a turn."""
    size = lab.torque(0.5)

    def disturb(t, data):
        data.qfrc_applied[lab.about_z] -= size * np.sin(6 * lab.yaw(data))

    lab.disturb = disturb
    return "unknown", "yaw"


#: name: (kind of rig, with jets, what is wrong, how the runs go)
OPEN = ["multisine", "spin", "swing", "multisine"]
CLOSED = ["closed", "closed", "closed", "closed"]
CASES = {
    "control_ball": ("ball", False, nothing, OPEN),
    "control_ball_jets": ("ball", True, nothing, OPEN),
    "control_ball_closed": ("ball", False, nothing, CLOSED),
    "control_ball_random_torque": ("ball", False, random_torque, OPEN),
    "control_ball_random_torque_closed": ("ball", False, random_torque, CLOSED),
    "control_hinge": ("hinge", False, nothing, OPEN),
    "control_hinge_closed": ("hinge", False, nothing, CLOSED),
    "ball_damping": ("ball", False, damping, OPEN),
    "ball_damping_closed": ("ball", False, damping, CLOSED),
    "hinge_damping": ("hinge", False, damping, OPEN),
    "hinge_friction_loss": ("hinge", False, friction_loss, OPEN),
    "ball_friction_loss": ("ball", False, friction_loss, OPEN),
    "hinge_spring": ("hinge", False, cable, OPEN),
    "ball_cords": ("ball", False, cable, OPEN),
    "ball_pendulum": ("ball", False, pendulum, OPEN),
    "ball_panel": ("ball", False, panel, OPEN),
    "ball_panel_closed": ("ball", False, panel, CLOSED),
    "ball_wheel_damping": ("ball", False, wheel_damping, OPEN),
    "ball_wheel_friction_loss": ("ball", False, wheel_friction_loss, OPEN),
    "hinge_wheel_friction_loss": ("hinge", False, wheel_friction_loss, OPEN),
    "ball_wheel_heavier": ("ball", False, wheel_heavier, OPEN),
    "hinge_wheel_heavier": ("hinge", False, wheel_heavier, OPEN),
    "ball_wheel_tilted": ("ball", False, wheel_tilted, OPEN),
    "ball_gyro_scaled": ("ball", False, gyro_scaled, OPEN),
    "ball_gyro_turned": ("ball", False, gyro_turned, OPEN),
    "ball_sensors_late": ("ball", False, sensors_late, OPEN),
    "ball_lamp_turned": ("ball", False, lamp_turned, OPEN),
    "ball_accelerometer_elsewhere": ("ball", False, accelerometer_elsewhere, OPEN),
    "ball_jet_weak": ("ball", True, jet_weak, OPEN),
    "ball_jet_turned": ("ball", True, jet_turned, OPEN),
    "ball_jets_slow": ("ball", True, jets_slow, OPEN),
    "ball_jets_late": ("ball", True, jets_late, OPEN),
    "ball_vane": ("ball", False, vane, OPEN),
    "hinge_vane": ("hinge", False, vane, OPEN),
    "ball_detent": ("ball", False, detent, OPEN),
}


def make(name, seed, seconds):
    """The rig, its runs (the last one is held out), the answer and the sensors' errors of a case."""
    kind, jets, wrong, how = CASES[name]
    rng = np.random.default_rng([seed, sorted(CASES).index(name)])
    lab = Laboratory(rng, kind, jets)
    answer = wrong(lab)
    variable = None
    if isinstance(answer, tuple):
        answer, variable = answer
    runs = [lab.run(1000 * seed + 10 * k + 1, seconds, h) for k, h in enumerate(how)]
    if answer == "harness_spring" and lab.farthest_rad > np.pi:
        answer = "winding_cable"
    return lab.rig(), runs, {"answer": [answer] if answer else [], "variable": variable}, lab.errors
