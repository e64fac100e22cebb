#!/usr/bin/env python3
"""Reads a recording with two independent implementations and compares everything.

usage: read_bag.py RUN_OR_BAG [--expect-topics NAME...]

`rosbags` and `mcap` + `mcap-ros2-support` (PyPI) each read every message of every topic and decode every
field with the schema in the bag. Checked: both see the same messages, times and values; their counts equal
those of metadata.yaml and, for a run directory, of manifest.yaml; log times do not go back; hashes of the
parameter files are right. Exits with 1 and one line per problem when something differs.
"""

from __future__ import annotations

import argparse
import hashlib
import math
import struct
import sys
from collections import Counter
from pathlib import Path

import numpy
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from ruamel.yaml import YAML

problems: list[str] = []


def check(condition: bool, text: str) -> None:
    if not condition:
        problems.append(text)


def leaves(value: object, path: str = ""):
    """Every field of a message of either library, as (path, comparable value)."""
    if isinstance(value, (bool, numpy.bool_)):
        yield path, int(value)
    elif isinstance(value, (int, numpy.integer)):
        yield path, int(value)
    elif isinstance(value, (float, numpy.floating)):
        # As bits: NaN equals NaN, and 0.0 differs from -0.0.
        yield path, struct.pack("<d", float("nan") if math.isnan(value) else float(value))
    elif isinstance(value, str):
        yield path, value
    elif isinstance(value, (list, tuple, numpy.ndarray, bytes, bytearray)):
        yield f"{path}.length", len(value)
        for index, item in enumerate(value):
            yield from leaves(item, f"{path}[{index}]")
    else:
        names = getattr(value, "__slots__", None) or list(value.__dataclass_fields__)
        for name in sorted(name for name in names if not name.startswith("_")):
            if name.isupper():  # constants of the definition
                continue
            yield from leaves(getattr(value, name), f"{path}.{name}")


def with_rosbags(bag: Path):
    typestore = get_typestore(Stores.EMPTY)
    messages = []
    counts: Counter[str] = Counter()
    with Reader(bag) as reader:
        for connection in reader.connections:
            counts[connection.topic] = 0
            check(bool(connection.ext.offered_qos_profiles), f"{connection.topic}: no quality of service")
            text = connection.msgdef.data
            check(bool(text), f"{connection.topic}: no definition of {connection.msgtype} in the bag")
            if text:
                new = get_types_from_msg(text, connection.msgtype)
                typestore.register({k: v for k, v in new.items() if k not in typestore.types})
        for connection, time, data in reader.messages():
            counts[connection.topic] += 1
            message = typestore.deserialize_cdr(data, connection.msgtype)
            messages.append((connection.topic, time, list(leaves(message))))
        for connection in reader.connections:
            check(
                counts[connection.topic] == connection.msgcount,
                f"{connection.topic}: metadata.yaml counts {connection.msgcount}, rosbags reads {counts[connection.topic]}",
            )
        check(reader.message_count == len(messages), "message_count of metadata.yaml is wrong")
    return messages, counts


def with_mcap(bag: Path):
    messages = []
    for path in sorted(bag.glob("*.mcap")):
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
            check(reader.get_header().profile == "ros2", f"{path.name}: profile is not ros2")
            of_file = []
            for _, channel, record, message in reader.iter_decoded_messages(log_time_order=True):
                of_file.append((channel.topic, record.log_time, list(leaves(message))))
            times = [message[1] for message in of_file]
            check(times == sorted(times), f"{path.name}: log times go back")
            messages += of_file
    return messages


def compare(first: list, second: list) -> None:
    check(len(first) == len(second), f"rosbags reads {len(first)} messages, mcap reads {len(second)}")
    # The libraries order messages of equal time differently.
    key = lambda message: (message[1], message[0])  # noqa: E731
    differing = 0
    for ours, theirs in zip(sorted(first, key=key), sorted(second, key=key), strict=False):
        if ours != theirs and differing < 5:
            differing += 1
            fields = [(a, b) for a, b in zip(ours[2], theirs[2], strict=False) if a != b][:3]
            problems.append(f"{ours[0]} at {ours[1]}: rosbags and mcap differ: {fields or (ours[:2], theirs[:2])}")


def check_manifest(run: Path, counts: Counter[str]) -> None:
    manifest = YAML(typ="safe").load((run / "manifest.yaml").read_text())
    check(manifest["state"] != "recording", "manifest.yaml: state is recording")
    check(manifest["messages"] == sum(counts.values()), f"manifest.yaml: messages {manifest['messages']}")
    recorded = {topic["name"]: topic for topic in manifest["topics"]}
    check(recorded.keys() == counts.keys(), f"manifest.yaml: topics differ: {recorded.keys() ^ counts.keys()}")
    for name, count in counts.items():
        topic = recorded.get(name, {"count": count})
        check(topic["count"] == count, f"{name}: manifest.yaml counts {topic['count']}, rosbags reads {count}")
    for file in manifest["parameters"]:
        digest = hashlib.sha256((run / file["file"]).read_bytes()).hexdigest()
        check(digest == file["sha256"], f"{file['file']}: hash differs from manifest.yaml")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("path", type=Path)
    parser.add_argument("--expect-topics", nargs="*", default=[], help="topics that must have messages")
    arguments = parser.parse_args()
    run = arguments.path
    bag = run / "bag" if (run / "bag").is_dir() else run

    by_rosbags, counts = with_rosbags(bag)
    by_mcap = with_mcap(bag)
    compare(by_rosbags, by_mcap)
    for name in arguments.expect_topics:
        check(counts[name] > 0, f"{name}: no messages")
    if bag != run:
        check_manifest(run, counts)

    fields = sum(len(message[2]) for message in by_rosbags)
    print(f"{bag}: {len(counts)} topics, {len(by_rosbags)} messages, {fields} fields")
    for name, count in sorted(counts.items()):
        print(f"  {count:8} {name}")
    for problem in problems:
        print(f"PROBLEM {problem}", file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
