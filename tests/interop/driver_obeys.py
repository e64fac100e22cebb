#!/usr/bin/env python3
"""Commands a driver through Eclipse Cyclone DDS and falls silent: it must obey, then switch everything off.

usage: driver_obeys.py PLATFORM [--wheels N] [--jets N]

Sends `actuators/command` at 50 Hz for two seconds: a torque on the first wheel and one long pulse of the
third jet. `wheels/state` and `thrusters/state` must show both; from 100 ms after the last command on
neither. The domain is ROS_DOMAIN_ID. No other node may command the platform.
"""

from __future__ import annotations

import argparse
import os
import sys
import time

import cyclone  # sets CYCLONEDDS_URI
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from ros_types import message, zero

TORQUE = 0.1  # [N m]
JET = 2
WITHIN = 100_000_000  # [ns]


def stamp(sample) -> int:
    return sample.header.stamp.sec * 10**9 + sample.header.stamp.nanosec


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("platform")
    parser.add_argument("--wheels", type=int, default=3)
    parser.add_argument("--jets", type=int, default=12)
    arguments = parser.parse_args()

    participant = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0")))

    def topic(name, kind):
        return Topic(participant, f"rt/{arguments.platform}/{name}", message(kind))

    command = message("whorl_msgs/msg/ActuatorCommand")
    writer = DataWriter(participant, topic("actuators/command", "whorl_msgs/msg/ActuatorCommand"), qos=cyclone.STREAM)
    wheels = DataReader(participant, topic("wheels/state", "sensor_msgs/msg/JointState"), qos=cyclone.STREAM)
    thrusters = DataReader(participant, topic("thrusters/state", "whorl_msgs/msg/ThrusterState"), qos=cyclone.STREAM)

    end = time.monotonic() + 20
    while not (writer.get_matched_subscriptions() and wheels.get_matched_publications()):
        if time.monotonic() > end:
            print("no driver", file=sys.stderr)
            return 1
        time.sleep(0.05)
    time.sleep(0.2)

    states, valves, last = [], [], 0
    for sequence in range(200):
        if sequence < 100:
            last = time.time_ns()
            out = zero(command)
            out.sequence = sequence
            out.header.stamp.sec, out.header.stamp.nanosec = divmod(last, 10**9)
            # It claims to be valid for a minute, which the driver must not accept.
            out.valid_until.sec, out.valid_until.nanosec = divmod(last + 60 * 10**9, 10**9)
            out.wheel_torque_n_m = [TORQUE] + [0.0] * (arguments.wheels - 1)
            out.jet_slot_length_s = 60.0
            out.jet_on_time_s = [60.0 if jet == JET else 0.0 for jet in range(arguments.jets)]
            writer.write(out)
        time.sleep(0.02)
        states += [s for s in wheels.take(N=64) if s.sample_info.valid_data]
        valves += [s for s in thrusters.take(N=64) if s.sample_info.valid_data]

    problems = []
    obeyed = [s for s in states if stamp(s) <= last and abs(s.effort[0] - TORQUE) < 1e-9]
    opened = [s for s in valves if stamp(s) <= last and s.valve_open[JET]]
    if len(obeyed) < 100:
        problems.append(f"the wheel obeyed in {len(obeyed)} states of {len(states)}")
    if len(opened) < 100:
        problems.append(f"the valve was open in {len(opened)} states of {len(valves)}")
    after_wheels = [s for s in states if stamp(s) > last + WITHIN]
    after_valves = [s for s in valves if stamp(s) > last + WITHIN]
    if len(after_wheels) < 100 or len(after_valves) < 100:
        problems.append(f"only {len(after_wheels)} and {len(after_valves)} states after the silence")
    if any(effort != 0.0 for s in after_wheels for effort in s.effort):
        problems.append("a wheel has torque 100 ms after the last command")
    if any(opened for s in after_valves for opened in s.valve_open):
        problems.append("a valve is open 100 ms after the last command")
    print(f"obeyed in {len(obeyed)} wheel and {len(opened)} valve states, off in {len(after_wheels)} and {len(after_valves)}")
    for problem in problems:
        print(f"PROBLEM {problem}", file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
