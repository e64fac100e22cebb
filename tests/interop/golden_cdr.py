#!/usr/bin/env python3
"""Writes what other implementations make of every message: msgs/golden/cdr.json, the truth of msgs/src/conformity.rs.

usage: golden_cdr.py [FILE]

For every `.msg` and `.srv` file a message whose fields all differ, its CDR bytes by rosbags (PyPI), and the
constants that rosbags reads in the definition. Eclipse Cyclone DDS must give the same bytes, or nothing is written.
"""

from __future__ import annotations

import itertools
import json
import sys
from pathlib import Path

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ros_types import MSGS, message, structure

STORE = get_typestore(Stores.EMPTY)


def definitions():
    """(ROS type, text, class of Cyclone DDS) of every definition; a service has two."""
    for path in sorted(MSGS.glob("standard/*/*.msg")) + sorted(MSGS.glob("msg/*.msg")):
        package = "whorl_msgs" if path.parent.name == "msg" else path.parent.name
        name = f"{package}/msg/{path.stem}"
        yield name, path.read_text(), lambda name=name: message(name)
    for path in sorted(MSGS.glob("srv/*.srv")):
        for half, text in zip(("Request", "Response"), path.read_text().split("---")):
            name = f"{path.stem}{half}"
            dds = f"whorl_msgs::srv::dds_::{path.stem}_{half}_"
            yield (
                f"whorl_msgs/msg/{name}",
                text,
                lambda dds=dds, name=name, text=text: structure(dds, name, text, "whorl_msgs"),
            )


class Values:
    """Numbers and texts of which no two are alike, and that every type of number holds exactly."""

    def __init__(self, length: int):
        self.count = itertools.count(1)
        self.length = length

    def of(self, ros_type: str):
        fields = STORE.get_msgdef(ros_type).fields
        return {name: self.of_field(kind, description) for name, (kind, description) in fields}

    def of_field(self, kind, description):
        if kind == Nodetype.BASE:
            return self.of_base(description[0])
        if kind == Nodetype.NAME:
            return self.of(description)
        element, length = description
        length = self.length if kind == Nodetype.SEQUENCE else length
        return [self.of_field(*element) for _ in range(length)]

    def of_base(self, base: str):
        k = next(self.count)
        if base == "bool":
            return k % 3 == 0
        if base == "string":
            # Lengths that leave what follows at every alignment.
            return "abcdefgh"[: k % 5] + "\N{DEGREE SIGN}" * (k % 2)
        if base.startswith("float"):
            return (-1) ** k * (k + 0.25)
        if base in ("byte", "char", "octet"):
            return k
        bits = int(base.removeprefix("u").removeprefix("int"))
        return 2**bits - 1 - k if base.startswith("u") else k - 2 ** (bits - 1)


def as_rosbags(ros_type: str, value: dict):
    import numpy

    def convert(kind, description, value):
        if kind == Nodetype.NAME:
            return as_rosbags(description, value)
        if kind == Nodetype.BASE:
            return value
        (element_kind, element), _ = description
        if element_kind == Nodetype.BASE and element[0] != "string":
            base = {"octet": "uint8", "byte": "uint8", "char": "uint8", "bool": "bool"}.get(element[0], element[0])
            return numpy.array(value, dtype=base)
        return [convert(element_kind, element, item) for item in value]

    fields = STORE.get_msgdef(ros_type).fields
    return STORE.types[ros_type](**{name: convert(*shape, value[name]) for name, shape in fields})


def as_cyclone(kind, value: dict):
    import dataclasses
    import typing

    def convert(hint, value):
        if isinstance(value, dict):
            return as_cyclone(hint, value)
        if isinstance(value, list):
            element = next(extra.subtype for extra in hint.__metadata__ if hasattr(extra, "subtype"))
            return [convert(element, item) for item in value]
        return value

    hints = typing.get_type_hints(kind, include_extras=True)
    return kind(**{f.name: convert(hints[f.name], value[f.name]) for f in dataclasses.fields(kind)})


def main():
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else MSGS / "golden" / "cdr.json"
    everything = list(definitions())
    constants = {}
    for name, text, _ in everything:
        types = get_types_from_msg(text, name)
        STORE.register(types)
        if found := {constant: value for constant, _, value in types[name][0]}:
            constants[name] = found
    golden = []
    for name, _, cyclone in everything:
        for length in (3, 0):
            value = Values(length).of(name)
            cdr = bytes(STORE.serialize_cdr(as_rosbags(name, value), name))
            other = bytes(as_cyclone(cyclone(), value).serialize())
            # Cyclone DDS fills up to a multiple of four and counts in the header how much that is.
            if (cdr[:2], cdr[4:]) != (other[:2], other[4 : len(cdr)]):
                sys.exit(f"{name}: rosbags says\n{cdr.hex()}\nCyclone DDS says\n{other.hex()}")
            golden.append({"type": name, "value": value, "cdr": cdr.hex()})
    target.parent.mkdir(exist_ok=True)
    lines = ",\n".join(json.dumps(entry, ensure_ascii=False) for entry in golden)
    target.write_text(f'{{"constants": {json.dumps(constants, indent=1)},\n"messages": [\n{lines}\n]}}\n')
    print(f"{len(golden)} messages in {target}")


if __name__ == "__main__":
    main()
