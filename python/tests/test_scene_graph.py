"""The scene graph's file, read by the package and checked against its schema."""

import json
from pathlib import Path

import pytest
import splatseg

GRAPH = {
    "format": "splatseg-scene-graph",
    "version": 1,
    "up": [0, 0, 1],
    "frames": 50,
    "rooms": [{"id": 1, "name": "kitchen", "objects": [18, 19]}],
    "objects": [
        {
            "id": id,
            "label": label,
            "room": 1,
            "color": [200, 180, 90],
            "box": {"center": [0, 0, 0.7], "size": [1, 1, 0.1], "rotation": [0, 0, 0, 1]},
            "last_seen": {"frame": 49, "time_s": None, "position": [0.1, 0.2, 0.7]},
        }
        for id, label in ((18, "table"), (19, None))
    ],
    "relations": [{"subject": 19, "relation": "on", "object": 18}],
}


def write(folder: Path, **changes: object) -> Path:
    path = folder / "home.json"
    path.write_text(json.dumps({**GRAPH, **changes}))
    return path


def test_a_graph_is_read(tmp_path: Path) -> None:
    graph = splatseg.load_scene_graph(write(tmp_path))
    assert repr(graph) == "<splatseg.SceneGraph: 1 rooms, 2 objects, 1 relations>"
    assert graph.of(18) == [splatseg.Relation(19, "on", 18)] and graph.of(7) == []
    assert repr(graph.objects[18]) == "<splatseg.SceneObject 18 'table'>"
    assert graph.objects[19].last_seen.position == (0.1, 0.2, 0.7)
    assert graph.rooms[0].objects == (18, 19) and graph.up == (0, 0, 1)


def test_other_files_are_refused(tmp_path: Path) -> None:
    for changes, message in (
        ({"format": "other"}, "not a scene graph"),
        ({"version": 2}, "version 2 of the scene graph, expected 1"),
        ({"up": [1, 2]}, "found 2 numbers"),
        ({"objects": [{"id": 1}]}, "no 'last_seen'"),
        ({"rooms": 3}, "not iterable"),
    ):
        with pytest.raises(ValueError, match=message):
            splatseg.load_scene_graph(write(tmp_path, **changes))


def test_the_example_fits_the_schema() -> None:
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads((Path(__file__).parents[2] / "docs/scene_graph.schema.json").read_text())
    jsonschema.validate(GRAPH, schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**GRAPH, "relations": [{"subject": 19, "relation": "near", "object": 18}]}, schema)
