"""Writes zstd.mcap with the PyPI packages mcap and mcap-ros2-support: 300 points in zstd chunks of 2000 bytes."""

from mcap.writer import CompressionType
from mcap_ros2.writer import Writer

with open("zstd.mcap", "wb") as file:
    writer = Writer(file, chunk_size=2000, compression=CompressionType.ZSTD)
    schema = writer.register_msgdef(
        "geometry_msgs/msg/Vector3Stamped",
        "\n".join(
            [
                "std_msgs/Header header",
                "geometry_msgs/Vector3 vector",
                "=" * 80,
                "MSG: std_msgs/Header",
                "builtin_interfaces/Time stamp",
                "string frame_id",
                "=" * 80,
                "MSG: builtin_interfaces/Time",
                "int32 sec",
                "uint32 nanosec",
                "=" * 80,
                "MSG: geometry_msgs/Vector3",
                "float64 x",
                "float64 y",
                "float64 z",
            ]
        ),
    )
    for i in range(300):
        message = {
            "header": {"stamp": {"sec": i, "nanosec": 5}, "frame_id": "world"},
            "vector": {"x": i * 0.5, "y": -1.0, "z": 1e-9},
        }
        writer.write_message("/point", schema, message, log_time=i * 1000, publish_time=i * 1000, sequence=i)
    writer.finish()
