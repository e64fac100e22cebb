#!/usr/bin/env python3
"""Talks to the nodes with Eclipse Cyclone DDS, which shares no code with ours.

usage: cyclone.py read    TOPIC TYPE [--count N] [--seconds S]
       cyclone.py command PLATFORM [--torque T T T] [--seconds S] [--rate HZ]
       cyclone.py nodes   [--seconds S]
       cyclone.py get     NODE PARAMETER [--seconds S]
       cyclone.py set     NODE PARAMETER NUMBER [--seconds S]

Prints JSON lines; exits with 1 when nothing came within S seconds. The domain is ROS_DOMAIN_ID;
everything stays on the loopback interface unless CYCLONEDDS_URI says otherwise. `get` and `set` call
the parameter services in the way of rmw_cyclonedds.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time

os.environ.setdefault(
    "CYCLONEDDS_URI",
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface address='127.0.0.1' multicast='true'/>"
    "</Interfaces><AllowMulticast>true</AllowMulticast></General><Discovery>"
    "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>30</MaxAutoParticipantIndex>"
    "<Peers><Peer address='127.0.0.1'/></Peers></Discovery></Domain></CycloneDDS>",
)

from cyclonedds.core import Policy, Qos  # noqa: E402
from cyclonedds.domain import DomainParticipant  # noqa: E402
from cyclonedds.pub import DataWriter  # noqa: E402
from cyclonedds.sub import DataReader  # noqa: E402
from cyclonedds.topic import Topic  # noqa: E402
from cyclonedds.util import duration  # noqa: E402

from ros_types import message, structure, zero  # noqa: E402

STREAM = Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(10))
RELIABLE = Qos(
    Policy.Reliability.Reliable(duration(milliseconds=100)),
    Policy.Durability.Volatile,
    Policy.History.KeepLast(10),
)
LATCHED = Qos(
    Policy.Reliability.Reliable(duration(milliseconds=100)),
    Policy.Durability.TransientLocal,
    Policy.History.KeepAll,  # without keys all nodes share one history
)

# rcl_interfaces and rmw_dds_common, as far as they are needed here.
PARAMETER_VALUE = """uint8 type
bool bool_value
int64 integer_value
float64 double_value
string string_value
uint8[] byte_array_value
bool[] bool_array_value
int64[] integer_array_value
float64[] double_array_value
string[] string_array_value"""
# What rmw_cyclonedds puts in front of a request and of its response.
HEADER = "uint64 client\nint64 count"


def plain(value):
    """A message as dicts and lists."""
    if hasattr(value, "__dataclass_fields__"):
        return {name: plain(getattr(value, name)) for name in value.__dataclass_fields__}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value


def samples(reader, seconds):
    """Samples as they come, for some seconds."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        yield from (sample for sample in reader.take(N=64) if sample.sample_info.valid_data)
        time.sleep(0.002)


def read(participant, arguments):
    kind = message(arguments.type)
    topic = Topic(participant, "rt" + arguments.topic, kind)
    left = arguments.count
    for sample in samples(DataReader(participant, topic, qos=STREAM), arguments.seconds):
        print(json.dumps(plain(sample)), flush=True)
        left -= 1
        if left == 0:
            return True
    return False


def command(participant, arguments):
    kind = message("whorl_msgs/msg/ActuatorCommand")
    topic = Topic(participant, f"rt/{arguments.platform}/actuators/command", kind)
    writer = DataWriter(participant, topic, qos=STREAM)
    sent = 0
    end = time.monotonic() + arguments.seconds
    while time.monotonic() < end:
        sent += 1
        now = time.time_ns()
        out = zero(kind)
        out.sequence = sent
        out.header.stamp.sec, out.header.stamp.nanosec = divmod(now, 10**9)
        out.valid_until.sec, out.valid_until.nanosec = divmod(now + 100_000_000, 10**9)
        out.wheel_torque_n_m = arguments.torque
        out.jet_slot_length_s = 0.02
        writer.write(out)
        time.sleep(1.0 / arguments.rate)
    print(json.dumps({"sent": sent}))
    return True


def nodes(participant, arguments):
    gid = structure("rmw_dds_common::msg::dds_::Gid_", "Gid", "uint8[16] data", "rmw_dds_common")
    from collections import OrderedDict

    from cyclonedds.idl import make_idl_struct
    from cyclonedds.idl.types import sequence

    entity = make_idl_struct(
        "NodeEntitiesInfo",
        "rmw_dds_common::msg::dds_::NodeEntitiesInfo_",
        OrderedDict(
            node_namespace=str, node_name=str, reader_gid_seq=sequence[gid], writer_gid_seq=sequence[gid]
        ),
    )
    info = make_idl_struct(
        "ParticipantEntitiesInfo",
        "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_",
        OrderedDict(gid=gid, node_entities_info_seq=sequence[entity]),
    )
    topic = Topic(participant, "ros_discovery_info", info)
    found = {}
    for sample in samples(DataReader(participant, topic, qos=LATCHED), arguments.seconds):
        for node in sample.node_entities_info_seq:
            name = f"{node.node_namespace.rstrip('/')}/{node.node_name}"
            found[name] = {"readers": len(node.reader_gid_seq), "writers": len(node.writer_gid_seq)}
    print(json.dumps(found))
    return bool(found)


def call(participant, node, service, request_fields, response_fields, values, seconds):
    """Calls `NODE/SERVICE` of rcl_interfaces as rmw_cyclonedds does."""
    snake = "".join("_" + c.lower() if c.isupper() else c for c in service).strip("_")
    name = f"{node.strip('/')}/{snake}"
    package = "rcl_interfaces"
    request = wrapped(f"{package}::srv::dds_::{service}_Request_", service + "Request", request_fields)
    response = wrapped(f"{package}::srv::dds_::{service}_Response_", service + "Response", response_fields)
    writer = DataWriter(participant, Topic(participant, f"rq/{name}Request", request), qos=RELIABLE)
    reader = DataReader(participant, Topic(participant, f"rr/{name}Reply", response), qos=RELIABLE)
    client, end = 0x1122334455667788, time.monotonic() + seconds
    while not (writer.get_matched_subscriptions() and reader.get_matched_publications()):
        if time.monotonic() > end:
            return None
        time.sleep(0.01)
    time.sleep(0.1)
    writer.write(request(client=client, count=1, **values))
    for sample in samples(reader, seconds):
        if (sample.client, sample.count) == (client, 1):
            return sample
    return None


def wrapped(dds_name, class_name, fields):
    from collections import OrderedDict

    from cyclonedds.idl import make_idl_struct
    from cyclonedds.idl.types import int64, uint64

    return make_idl_struct(class_name, dds_name, OrderedDict(client=uint64, count=int64, **fields))


def parameter_types():
    from cyclonedds.idl import make_idl_struct
    from collections import OrderedDict

    dds = "rcl_interfaces::msg::dds_::"
    value = structure(dds + "ParameterValue_", "ParameterValue", PARAMETER_VALUE, "rcl_interfaces")
    parameter = make_idl_struct("Parameter", dds + "Parameter_", OrderedDict(name=str, value=value))
    result = structure(
        dds + "SetParametersResult_", "SetParametersResult", "bool successful\nstring reason", "rcl_interfaces"
    )
    return value, parameter, result


def get(participant, arguments):
    from cyclonedds.idl.types import sequence

    value, _, _ = parameter_types()
    answer = call(
        participant, arguments.node, "GetParameters", {"names": sequence[str]}, {"values": sequence[value]},
        {"names": [arguments.parameter]}, arguments.seconds,
    )
    if answer is not None:
        print(json.dumps(plain(answer.values[0])))
    return answer is not None


def set_(participant, arguments):
    from cyclonedds.idl.types import sequence

    value, parameter, result = parameter_types()
    new = zero(value)
    new.type, new.double_value = 3, arguments.number
    answer = call(
        participant, arguments.node, "SetParameters",
        {"parameters": sequence[parameter]}, {"results": sequence[result]},
        {"parameters": [parameter(name=arguments.parameter, value=new)]}, arguments.seconds,
    )
    if answer is not None:
        print(json.dumps(plain(answer.results[0])))
    return answer is not None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    commands = parser.add_subparsers(required=True)

    def add(name, action, *positional):
        sub = commands.add_parser(name)
        for argument in positional:
            sub.add_argument(argument, type=float if argument == "number" else str)
        sub.add_argument("--seconds", type=float, default=10.0)
        sub.set_defaults(action=action)
        return sub

    add("read", read, "topic", "type").add_argument("--count", type=int, default=1)
    sub = add("command", command, "platform")
    sub.add_argument("--torque", type=float, nargs=3, default=[0.0, 0.0, 0.0])
    sub.add_argument("--rate", type=float, default=100.0)
    add("nodes", nodes)
    add("get", get, "node", "parameter")
    add("set", set_, "node", "parameter", "number")
    arguments = parser.parse_args()
    participant = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0")))
    sys.exit(0 if arguments.action(participant, arguments) else 1)


if __name__ == "__main__":
    main()
