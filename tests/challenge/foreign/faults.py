"""What can be wrong with any drawn rig, whichever simulator moves it. Each changes the rig and returns the effect's id."""

import numpy as np

from case import SensorErrors, turned


def wheel_heavier(rig):
    rig.wheel_inertia[-1] *= 1.12
    return "wheel_inertia"


def wheel_tilted(rig):
    rig.wheel_axis[0] = turned(np.array([0.0, 0.03, 0.02])) @ rig.wheels[0].axis
    return "wheel_misalignment"


def gyro_scaled(rig):
    rig.errors = SensorErrors(gyro_scale=[0.0, 0.0, 0.03])
    return "gyro_scale"


def gyro_turned(rig):
    rig.errors = SensorErrors(gyro_turn=[0.03, -0.02, 0.0])
    return "gyro_misalignment"


def sensors_late(rig):
    rig.errors = SensorErrors(delay_s=0.04)
    return "imu_latency"


def jet_weak(rig):
    rig.thrust[1] *= 0.6
    return "thruster_strength"


def jet_turned(rig):
    jet = rig.jets[2]
    rig.push[2] = turned(0.2 * jet.position / np.linalg.norm(jet.position)) @ jet.direction
    return "thruster_misalignment"
