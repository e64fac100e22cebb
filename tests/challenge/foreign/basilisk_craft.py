"""Free-floating spacecraft whose truth is Basilisk (Kenneally, Piggott and Schaub, JAIS 17(9), 2020; PyPI `bsk`): hub with
wheels (imbalance, Stribeck friction), sloshing particles, hinged panels and thrusters with ramps, by its back-substitution
method. The drawing and the motion's commands are made here; every equation of motion is Basilisk's.
"""

import numpy as np
from Basilisk.architecture import messaging
from Basilisk.simulation import (
    hingedRigidBodyStateEffector,
    linearSpringMassDamper,
    reactionWheelStateEffector,
    spacecraft,
    thrusterDynamicEffector,
    thrusterStateEffector,
)
from Basilisk.utilities import RigidBodyKinematics as rbk
from Basilisk.utilities import SimulationBaseClass, macros, simIncludeRW, simIncludeThruster

from case import Jet, Rig, Run, SensorErrors, Sensors, Wheel, turned
from faults import gyro_scaled, gyro_turned, jet_turned, jet_weak, sensors_late, wheel_heavier, wheel_tilted

STEP_S = 2e-3
# The last stage of a Runge-Kutta step, a sixth of it, finds a jet still open at the very time at which it closes: a pulse of
# N steps has the impulse of N + 1/6 (measured with a jet alone).
LAST_STAGE_S = STEP_S / 6
# Static [kg m] and dynamic [kg m^2] imbalance of a wheel.
IMBALANCES = ("U_s", "U_d")


class Craft:
    """A drawn spacecraft, and what the drawing does not say."""

    def __init__(self, rng, jets=False):
        self.rng = rng
        self.scale = 10.0 ** rng.uniform(-2.0, 3.0)
        self.mass = 30.0 * self.scale**0.6
        self.radius = np.sqrt(self.scale / self.mass)
        turn = turned(rng.normal(0.0, 0.1, 3))
        self.hub_inertia = turn @ np.diag(self.scale * rng.uniform(0.8, 1.3, 3)) @ turn.T
        self.wheels = [
            Wheel(axis, 2e-3 * self.scale * rng.uniform(0.7, 1.5), 0.05 * self.scale, 600.0) for axis in np.eye(3)
        ]
        self.jets = []
        arm = 1.5 * self.radius
        if jets:
            for k in range(3):
                for sign in (1.0, -1.0):
                    position, push = np.eye(3)[(k + 1) % 3] * arm, np.eye(3)[(k + 2) % 3] * sign
                    self.jets.append(Jet(position, push, thrust=0.02 * self.scale / arm))
        self.sensors = Sensors(gyro=10.0 ** rng.uniform(-4.3, -3.0), accelerometer=None, vector=1e-3, vector_every=20)
        self.wheel_axis = [w.axis for w in self.wheels]
        self.wheel_inertia = [w.inertia for w in self.wheels]
        self.wheel_extra = [{} for _ in self.wheels]
        self.wheel_model = messaging.BalancedWheels
        self.thrust = [j.thrust for j in self.jets]
        self.push = [j.direction for j in self.jets]
        self.rise_s = 0.0
        self.effectors = []  # functions that build a state effector
        self.extra_inertia, self.extra_mass = np.zeros((3, 3)), 0.0
        self.errors = SensorErrors()

    def torque(self, share=1.0):
        return share * self.scale * 0.02

    def rig(self):
        """The drawing. Balanced wheels are part of the hub's inertia in Basilisk; imbalanced ones come on top."""
        inertia = self.hub_inertia + self.extra_inertia
        rig = Rig("basilisk_craft", self.mass + self.extra_mass, inertia, np.zeros(3), self.wheels, self.jets, self.sensors)
        rig.freedom = "free"
        return rig

    def run(self, seed, seconds, how):
        rng = np.random.default_rng([seed, 5])
        sim = SimulationBaseClass.SimBaseClass()
        process = sim.CreateNewProcess("dynamics")
        process.addTask(sim.CreateNewTask("step", macros.sec2nano(STEP_S)))
        keep = []
        body = spacecraft.Spacecraft()
        body.ModelTag = "craft"
        body.hub.mHub = self.mass
        body.hub.r_BcB_B = [[0.0], [0.0], [0.0]]
        body.hub.IHubPntBc_B = self.hub_inertia.tolist()
        body.hub.sigma_BNInit = [[x] for x in rng.normal(0.0, 0.05, 3)]
        fast = {"spin": 0.15, "swing": 0.05}.get(how, 0.02)
        body.hub.omega_BN_BInit = [[x] for x in rng.normal(0.0, fast, 3)]
        wheels = reactionWheelStateEffector.ReactionWheelStateEffector()
        factory = simIncludeRW.rwFactory()
        bias = rng.normal(0.0, 60.0, 3)
        for k, wheel in enumerate(self.wheels):
            made = factory.create(
                "custom",
                list(self.wheel_axis[k]),
                Omega=bias[k] * 60 / (2 * np.pi),
                Omega_max=wheel.max_speed * 60 / (2 * np.pi),
                Js=self.wheel_inertia[k],
                u_max=wheel.max_torque,
                RWModel=self.wheel_model,
                **{name: value for name, value in self.wheel_extra[k].items() if name not in IMBALANCES},
            )
            # `create` does not know these, and passes over what it does not know.
            for name in IMBALANCES:
                setattr(made, name, self.wheel_extra[k].get(name, 0.0))
        factory.addToSpacecraft("wheels", wheels, body)
        command_msg = messaging.ArrayMotorTorqueMsg()
        wheels.rwMotorCmdInMsg.subscribeTo(command_msg)
        for build in self.effectors:
            effector = build(rng)
            body.addStateEffector(effector)
            sim.AddModelToTask("step", effector, 1)
            keep.append(effector)
        jets_msg = messaging.THRArrayOnTimeCmdMsg()
        pulses = [[] for _ in self.jets]
        if self.jets:
            pulses = self.pulses(rng, seconds) if how != "still" else pulses
            thrusters = (
                thrusterStateEffector.ThrusterStateEffector()
                if self.rise_s
                else thrusterDynamicEffector.ThrusterDynamicEffector()
            )
            jet_factory = simIncludeThruster.thrusterFactory()
            for j, jet in enumerate(self.jets):
                extra = {"cutoffFrequency": 1.0 / self.rise_s} if self.rise_s else {}
                jet_factory.create(
                    "TEST_Thruster", list(jet.position), list(self.push[j]), MaxThrust=self.thrust[j], MinOnTime=0.0, **extra
                )
            jet_factory.addToSpacecraft("jets", thrusters, body)
            thrusters.cmdsInMsg.subscribeTo(jets_msg)
            sim.AddModelToTask("step", thrusters, 3)
            keep.append(thrusters)
        sim.AddModelToTask("step", wheels, 2)
        sim.AddModelToTask("step", body, 0)
        every = 1.0 / self.sensors.rate_hz
        state_every, speeds_every = (x.recorder(macros.sec2nano(every)) for x in (body.scStateOutMsg, wheels.rwSpeedOutMsg))
        sim.AddModelToTask("step", state_every, -1)
        sim.AddModelToTask("step", speeds_every, -1)
        payload = messaging.ArrayMotorTorqueMsgPayload()
        command_msg.write(payload)
        jets_msg.write(messaging.THRArrayOnTimeCmdMsgPayload())
        sim.InitializeSimulation()
        sim.ConfigureStopTime(0)
        sim.ExecuteSimulation()
        sines = [(rng.uniform(0.03, 1.5, 5), rng.uniform(0, 2 * np.pi, 5)) for _ in range(3)]
        target = rng.normal(0.0, 0.3)
        due = sorted((round(on, 2), off - on - LAST_STAGE_S, j) for j, mine in enumerate(pulses) for on, off in mine)
        time, command = [], []
        for k in range(int(seconds / every)):
            t = k * every
            u = self.wheel_torque(how, t, sines, body, target, rng)
            payload.motorTorque = list(u)
            now = macros.sec2nano(t)
            command_msg.write(payload, now)
            started = [d for d in due if d[0] < t + every / 2 and d[0] >= t - every / 2]
            if started:
                requests = messaging.THRArrayOnTimeCmdMsgPayload()
                # A request without a jet would end the pulse that this jet has begun.
                left = [[d[0] + d[1] - t for d in due if d[2] == j and d[0] < t + every / 2 < d[0] + d[1]] for j in range(len(self.jets))]
                requests.OnTimeRequest = [max(mine, default=0.0) for mine in left]
                jets_msg.write(requests, now)
            time.append(t), command.append(u)
            # Executed up to and including t; commands given now act from here on.
            sim.ConfigureStopTime(macros.sec2nano(t + every))
            sim.ExecuteSimulation()
        n = min(len(time), len(state_every.omega_BN_B))
        rotation = np.array([rbk.MRP2C(s).T for s in state_every.sigma_BN[:n]])
        speed = np.array(speeds_every.wheelSpeeds)[:n, :3]
        return Run(
            time=np.array(time)[:n],
            rate=np.array(state_every.omega_BN_B)[:n],
            force=None,
            rotation=rotation,
            wheel_speed=speed,
            command=np.array(command)[:n],
            pulses=pulses,
            closed_loop=how == "closed",
        )

    def wheel_torque(self, how, t, sines, body, target, rng):
        if how in ("spin", "still"):
            return np.zeros(3)
        size = self.torque(0.5) * (0.3 if how == "swing" else 1.0)
        out = np.array([size * np.sum(np.sin(2 * np.pi * f * t + p)) / 2.0 for f, p in sines])
        if how == "closed":
            now = body.scStateOutMsg.read()
            wanted = np.array([0.0, 0.0, target if int(t / 20.0) % 2 else 0.0])
            rate = np.array(now.omega_BN_B) + rng.standard_normal(3) * self.sensors.gyro
            error = 4.0 * np.array(now.sigma_BN) - wanted
            out = self.scale * (0.4**2 * error + 2 * 0.8 * 0.4 * rate)
        limit = np.array([w.max_torque for w in self.wheels])
        return np.clip(out, -limit, limit)

    def pulses(self, rng, seconds):
        out = []
        for _ in self.jets:
            t, mine = rng.uniform(1.0, 6.0), []
            while t < seconds - 1.0:
                on, length = round(t, 2), STEP_S * round(rng.uniform(0.05, 0.3) / STEP_S)
                mine.append((on, on + length + LAST_STAGE_S))
                t += rng.uniform(3.0, 9.0)
            out.append(mine)
        return out


def nothing(craft):
    return None


def stribeck(craft):
    """Static, Coulomb and viscous friction of a wheel's bearing that is not on the drawing."""
    t = craft.torque(0.2)
    craft.wheel_extra[0] = dict(useRWfriction=True, fCoulomb=t, fStatic=1.5 * t, betaStatic=0.2, cViscous=0.2 * t / 60.0)
    return "wheel_friction"


def imbalance(craft):
    craft.wheel_model = messaging.JitterSimple
    craft.wheel_extra[1] = dict(U_d=craft.torque(0.3) / 60.0**2)
    return "wheel_imbalance"


def sloshing(craft):
    """Three particles on springs with dampers, one along each body axis, in a tank off the centre."""
    mass = 0.04 * craft.mass
    omega = 2 * np.pi * craft.rng.uniform(0.4, 1.0)
    at = np.array([0.0, 0.0, 0.8]) * craft.radius

    def build(axis):
        def particle(_):
            effector = linearSpringMassDamper.LinearSpringMassDamper()
            effector.k, effector.c = mass / 3 * omega**2, 2 * 0.03 * mass / 3 * omega
            effector.r_PB_B = [[x] for x in at]
            effector.pHat_B = [[float(i == axis)] for i in range(3)]
            effector.rhoInit, effector.rhoDotInit, effector.massInit = 0.0, 0.0, mass / 3
            return effector

        return particle

    craft.effectors += [build(axis) for axis in range(2)]
    craft.extra_mass = mass * 2 / 3
    craft.extra_inertia = craft.extra_mass * (at @ at * np.eye(3) - np.outer(at, at))
    return "slosh"


def panel(craft):
    mass, half = 0.04 * craft.mass, 1.2 * craft.radius
    inertia = mass * half**2 / 3
    omega = 2 * np.pi * craft.rng.uniform(0.8, 2.5)
    at = np.array([0.0, craft.radius, 0.0])

    def build(_):
        effector = hingedRigidBodyStateEffector.HingedRigidBodyStateEffector()
        about = inertia + mass * half**2
        effector.mass, effector.d = mass, half
        effector.k, effector.c = about * omega**2, 2 * 0.01 * about * omega
        effector.IPntS_S = np.diag([inertia / 9, inertia, inertia]).tolist()
        # The panel's s1 axis points back to its hinge; s2 is the hinge's axis, body x here.
        effector.dcm_HB = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
        effector.r_HB_B = [[x] for x in at]
        effector.thetaInit, effector.thetaDotInit = 0.0, 0.0
        return effector

    craft.effectors.append(build)
    c = at + np.array([0, half, 0])
    craft.extra_mass = mass
    craft.extra_inertia = np.diag([inertia, inertia / 9, inertia]) + mass * (c @ c * np.eye(3) - np.outer(c, c))
    return "flexible_mode"


def jets_slow(craft):
    craft.rise_s = 0.06
    return "thruster_rise"


OPEN = ["multisine", "spin", "swing", "multisine"]
CLOSED = ["closed", "closed", "closed", "closed"]
CASES = {
    "craft_control": (False, nothing, OPEN),
    "craft_control_jets": (True, nothing, OPEN),
    "craft_control_closed": (False, nothing, CLOSED),
    "craft_stribeck": (False, stribeck, OPEN),
    "craft_stribeck_closed": (False, stribeck, CLOSED),
    "craft_imbalance": (False, imbalance, OPEN),
    "craft_slosh": (False, sloshing, OPEN),
    "craft_slosh_jets": (True, sloshing, OPEN),
    "craft_panel": (False, panel, OPEN),
    "craft_panel_closed": (False, panel, CLOSED),
    "craft_wheel_heavier": (False, wheel_heavier, OPEN),
    "craft_wheel_tilted": (False, wheel_tilted, OPEN),
    "craft_gyro_scaled": (False, gyro_scaled, OPEN),
    "craft_gyro_turned": (False, gyro_turned, OPEN),
    "craft_sensors_late": (False, sensors_late, OPEN),
    "craft_jet_weak": (True, jet_weak, OPEN),
    "craft_jet_turned": (True, jet_turned, OPEN),
    "craft_jets_slow": (True, jets_slow, OPEN),
}


def make(name, seed, seconds):
    """The rig, its runs (the last one is held out), the answer and the sensors' errors of a case."""
    jets, wrong, how = CASES[name]
    rng = np.random.default_rng([seed, 1000 + sorted(CASES).index(name)])
    craft = Craft(rng, jets)
    answer = wrong(craft)
    runs = [craft.run(1000 * seed + 10 * k + 1, seconds, h) for k, h in enumerate(how)]
    return craft.rig(), runs, {"answer": [answer] if answer else [], "variable": None}, craft.errors
