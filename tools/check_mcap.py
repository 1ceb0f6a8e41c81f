"""Checks a file of `splatseg run --save-mcap` with Rerun and with the Python readers for MCAP and ROS 2.

Exits with 1 if one of them misses a topic, reads it as another type, or cannot read a message.

pip install rerun-sdk mcap mcap-ros2-support
python tools/check_mcap.py run.mcap [--without-floor] [--without-memory]
"""

import argparse
import json
import sys
import tempfile
from collections import Counter, defaultdict
from pathlib import Path

import rerun
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rerun.chunk import RrdReader

# Rerun's component for each topic.
FRAMES = {
    "/tf": "Transform3D:translation",
    "/splatseg/camera_info": "Pinhole:image_from_camera",
    "/splatseg/overlay": "EncodedImage:blob",
    "/splatseg/segments": "DepthImage:buffer",
}
OBJECTS = {
    "/splatseg/points": "Points3D:positions",
    "/splatseg/boxes": "McapMessage:data",
    "/splatseg/markers": "visualization_msgs.msg.MarkerArray:message",
}
# Only if the keyframes show a floor.
MAP = {"/splatseg/map": "nav_msgs.msg.OccupancyGrid:message"}


def read_with_mcap(path: Path) -> tuple[Counter[str], list[str]]:
    """Decodes all messages; returns the number of messages per topic, and the problems."""
    counts: Counter[str] = Counter()
    wrong = []
    decoders = DecoderFactory()
    boxes: dict[int, int] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            counts[channel.topic] += 1
            if channel.message_encoding == "json":
                boxes[message.log_time] = len(json.loads(message.data)["entities"])
                continue
            decoder = decoders.decoder_for(channel.message_encoding, schema)
            if decoder is None:
                wrong.append(f"{channel.topic}: no decoder for {schema.name}")
                continue
            content = decoder(message.data)
            if channel.topic == "/splatseg/segments" and len(content.data) != 2 * content.width * content.height:
                wrong.append(f"{channel.topic}: {len(content.data)} bytes")
            if channel.topic == "/splatseg/map" and len(content.data) != content.info.width * content.info.height:
                wrong.append(f"{channel.topic}: {len(content.data)} cells")
            if channel.topic == "/splatseg/points" and len(content.data) != content.point_step * content.width:
                wrong.append(f"{channel.topic}: {len(content.data)} bytes")
            # Each object has a box and an id.
            if channel.topic == "/splatseg/markers" and len(content.markers) != 2 * boxes[message.log_time]:
                wrong.append(f"{channel.topic}: {len(content.markers)} markers")
    return counts, wrong


def read_with_rerun(path: Path) -> dict[str, Counter[str]]:
    """Loads the file as the viewer does; returns the number of values of each component of each topic."""
    found: dict[str, Counter[str]] = defaultdict(Counter)
    with tempfile.TemporaryDirectory() as folder:
        loaded = Path(folder) / "loaded.rrd"
        with rerun.RecordingStream("check_mcap") as recording:
            recording.save(loaded)
            recording.log_file_from_path(path)
            recording.flush()
        recording.disconnect()
        for chunk in RrdReader(loaded).stream():
            batch = chunk.to_record_batch()
            for name, column in zip(batch.schema.names, batch.columns, strict=True):
                if ":" in name:
                    found[str(chunk.entity_path)][name] += len(column) - column.null_count
    return found


def check(path: Path, expected: dict[str, str]) -> list[str]:
    """Reads the file with both; returns the problems."""
    counts, wrong = read_with_mcap(path)
    found = read_with_rerun(path)
    for topic, component in expected.items():
        in_rerun = found[topic][component]
        print(f"{topic}: {counts[topic]} messages; Rerun: {in_rerun} of {component}")
        if counts[topic] == 0 or in_rerun != counts[topic]:
            wrong.append(f"{topic}: {counts[topic]} messages, but Rerun has {in_rerun} of {component}")
    wrong += [f"{topic}: is not expected" for topic in counts if topic not in expected and topic != "/tf_static"]
    if "/splatseg/points" in expected and found["/splatseg/points"]["Points3D:colors"] != 1:
        wrong.append("/splatseg/points: Rerun finds no colours")
    if len({counts[topic] for topic in FRAMES}) != 1:
        wrong.append("topics of frames differ in length")
    return wrong


def main() -> int:
    """Prints the results of the check."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--without-floor", action="store_true", help="the keyframes show no floor: no free space")
    parser.add_argument("--without-memory", action="store_true", help="the method had no memory: no points, no boxes")
    arguments = parser.parse_args()
    objects = OBJECTS if arguments.without_floor else OBJECTS | MAP
    wrong = check(arguments.file, FRAMES if arguments.without_memory else FRAMES | objects)
    for line in wrong:
        print(line, file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
