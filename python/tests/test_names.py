"""Names from a network for images and words: the tiny one of the Rust tests, which knows shapes and colours."""

import json
import struct

import numpy as np
import pytest
import splatseg as ss
from conftest import ROOT, step

TOKENS = 49408


@pytest.fixture
def network(tmp_path):
    """The network with all rows of its token embedding, of which the file has those that are used."""
    data = (ROOT / "crates/splatseg/tests/data/tiny_clip.safetensors").read_bytes()
    (length,) = struct.unpack("<Q", data[:8])
    header, numbers = json.loads(data[8 : 8 + length]), data[8 + length :]
    metadata = header.pop("__metadata__")
    tensors = {}
    for name, entry in header.items():
        start, end = entry["data_offsets"]
        kind = {"F16": np.float16, "I32": np.int32}[entry["dtype"]]
        tensors[name] = np.frombuffer(numbers[start:end], kind).reshape(entry["shape"])
    rows, used = tensors.pop("token_embedding.rows"), tensors.pop("token_rows")
    tensors["token_embedding.weight"] = np.zeros((TOKENS, rows.shape[1]), np.float16)
    tensors["token_embedding.weight"][used] = rows
    header, offset = {"__metadata__": metadata}, 0
    for name, tensor in tensors.items():
        header[name] = {"dtype": "F16", "shape": tensor.shape, "data_offsets": [offset, offset + tensor.nbytes]}
        offset += tensor.nbytes
    text = json.dumps(header).encode()
    path = tmp_path / "tiny.safetensors"
    path.write_bytes(struct.pack("<Q", len(text)) + text + b"".join(tensor.tobytes() for tensor in tensors.values()))
    return path


def test_a_network_names_objects_and_finds_them(network, room, tmp_path):
    labels = [f"{color} {shape}" for shape in ("ball", "box", "cone") for color in ("red", "green", "blue", "white")]
    names = ss.names(network, vocabulary=[*labels, "black box, dark crate"], min_score=0.0)
    assert names.labels == [*labels, "black box"]
    assert np.linalg.norm(names.embed_text("red ball")) == pytest.approx(1, abs=1e-4)
    pipeline = ss.FastSamSplat(keep_views=True)
    for frame in room:
        result = step(pipeline, frame)
    assert pipeline.name_objects(names) > 3
    assert pipeline.name_objects(names) == 0
    objects = pipeline.objects()
    mug = next(entry.id for entry in objects if entry.state == "remembered")
    pipeline.name_by_hand(mug, "mug")
    found = pipeline.find("coffee cup", top=1)
    assert [(entry.object.id, entry.score) for entry in found] == [(mug, 1.0)]
    assert pipeline.find(names.embed_text("red ball"))[0].similarity > -1
    assert all(entry.label is None or entry.label in names.labels for entry in objects)
    supervision = pytest.importorskip("supervision")
    detections = result.to_supervision(pipeline.objects())
    assert isinstance(detections, supervision.Detections)
    known = {entry.id: entry.label for entry in pipeline.objects()}
    expected = [known.get(sighting.id) or "object" for sighting in result.objects]
    assert detections.data["class_name"].tolist() == expected
    numbers = {name: number for name, number in zip(expected, detections.class_id, strict=True)}
    assert numbers.get("object", 0) == 0 and len(set(numbers.values())) == len(numbers)


def test_files_that_cannot_be_used_are_value_errors(network, tmp_path):
    with pytest.raises(ValueError, match="nowhere.safetensors"):
        ss.names(tmp_path / "nowhere.safetensors")
    with pytest.raises(ValueError, match="0 labels"):
        ss.names(network, vocabulary=[])
    with pytest.raises(ValueError, match="min_score is 2"):
        ss.names(network, min_score=2)
