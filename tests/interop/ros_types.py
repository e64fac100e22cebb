"""DDS types of ROS 2 messages, made from the `.msg` files themselves.

`message("whorl_msgs/msg/AttitudeEstimate")` gives a class for Eclipse Cyclone DDS (PyPI `cyclonedds`)
with the name, field order and field types that ROS 2 uses on the wire.
"""

from __future__ import annotations

import functools
import re
from collections import OrderedDict
from pathlib import Path

from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.types import array, float32, float64, int8, int16, int32, int64
from cyclonedds.idl.types import sequence, uint8, uint16, uint32, uint64

MSGS = Path(__file__).resolve().parents[2] / "msgs"

PRIMITIVES = {
    "bool": bool, "byte": uint8, "char": uint8, "string": str,
    "float32": float32, "float64": float64,
    "int8": int8, "int16": int16, "int32": int32, "int64": int64,
    "uint8": uint8, "uint16": uint16, "uint32": uint32, "uint64": uint64,
}
FIELD = re.compile(r"^(?P<type>[\w/]+)(?P<array>\[(?P<size>\d*)\])?\s+(?P<name>\w+)(\s+\S+)?\s*$")  # with a default


def definition(package: str, name: str) -> str:
    """Text of a `.msg` file, ours or one of the standard ones that come with `whorl_msgs`."""
    own = MSGS / "msg" / f"{name}.msg"
    standard = MSGS / "standard" / package / f"{name}.msg"
    return (own if package == "whorl_msgs" else standard).read_text()


@functools.cache
def message(ros_type: str):
    """The class of a message type, `package/msg/Type` or `package/Type`."""
    package, name = ros_type.split("/")[0], ros_type.split("/")[-1]
    return structure(f"{package}::msg::dds_::{name}_", name, definition(package, name), package)


def structure(dds_name: str, class_name: str, text: str, package: str):
    """A class from the lines of a `.msg` file (or of one half of a `.srv` file)."""
    fields = OrderedDict()
    for line in text.splitlines():
        line = line.split("#")[0].strip()
        if not line or "=" in line:  # a constant
            continue
        match = FIELD.match(line)
        if match is None:
            raise ValueError(f"{dds_name}: cannot read `{line}`")
        base = match["type"]
        if base in PRIMITIVES:
            kind = PRIMITIVES[base]
        else:
            kind = message(base if "/" in base else f"{package}/{base}")
        if match["array"]:
            kind = array[kind, int(match["size"])] if match["size"] else sequence[kind]
        fields[match["name"]] = kind
    return make_idl_struct(class_name, dds_name, fields)


def zero(kind):
    """A message with every field zero or empty."""
    import dataclasses
    import typing

    values = {}
    for field, hint in typing.get_type_hints(kind, include_extras=True).items():
        values[field] = zero_value(hint)
    assert dataclasses.is_dataclass(kind)
    return kind(**values)


def zero_value(hint):
    import typing

    if hasattr(hint, "__idl_typename__") or hasattr(hint, "__idl__"):
        return zero(hint)
    origin = typing.get_origin(hint)
    extras = getattr(hint, "__metadata__", ())
    for extra in extras:
        if isinstance(extra, sequence):
            return []
        if isinstance(extra, array):
            return [zero_value(extra.subtype) for _ in range(extra.length)]
    base = typing.get_args(hint)[0] if origin is typing.Annotated or extras else hint
    return base()
