"""Lists of objects: as tables, and how results are printed."""

import csv
import sys

import numpy as np
import pytest
import splatseg as ss
from conftest import step


@pytest.fixture
def results(room):
    pipeline = ss.FastSamSplat(segmenter="graph")
    return pipeline, [step(pipeline, frame) for frame in room]


def test_objects_become_a_table(results, tmp_path):
    pandas = pytest.importorskip("pandas")
    objects = results[0].objects()
    table = objects.to_df()
    assert isinstance(table, pandas.DataFrame) and table.id.tolist() == [entry.id for entry in objects]
    placed = next(entry for entry in objects if entry.shape is not None)
    row = table[table.id == placed.id].iloc[0]
    assert (row.centroid_x, row.min_z) == (placed.centroid[0], placed.box[0][2])
    assert (row.best_width, row.last_frame) == (placed.best_view.bounding_box[2], placed.last_seen.number)
    shown = results[1][-1]
    table = shown.to_df()
    assert table.id.tolist() == [sighting.id for sighting in shown.objects]
    assert table.width.tolist() == [sighting.bounding_box[2] for sighting in shown.objects]
    empty = step(ss.FastSamSplat(segmenter=lambda rgb, depth: np.zeros(depth.shape, np.uint8)), scene_frame())
    assert len(empty.to_df()) == 0
    assert empty.to_df().columns.tolist() == shown.to_df().columns.tolist()
    few = objects[:2]
    assert type(few) is ss.Objects and few.to_df().id.tolist() == [entry.id for entry in objects][:2]
    assert type(shown.objects[1:]) is ss.Sightings and shown.objects[-1] is list(shown.objects)[-1]
    assert objects[:0].to_df().columns.tolist() == objects.to_df().columns.tolist()


def scene_frame():
    return ss.open_scene("synthetic:frames=1,width=96,height=72")[0]


def test_columns_have_the_names_of_the_file(tmp_path):
    pytest.importorskip("pandas")
    run = ss.run("synthetic:frames=2,width=96,height=72", tmp_path / "out", segmenter="graph")
    with open(tmp_path / "out/objects.csv") as file:
        rows = list(csv.DictReader(file))
    table = run.objects().to_df()
    assert set(table.columns) <= set(rows[0]) and len(table.columns) > 30
    assert table.id.tolist() == [int(row["id"]) for row in rows]
    for name in ("frames", "first_frame", "points", "best_x"):
        assert [str(value) for value in table[name].astype("Int64")] == [row[name] or "<NA>" for row in rows], name


def test_a_missing_package_is_named(results, monkeypatch):
    shown = results[1][-1]
    for module, package, function in [
        ("pandas", "pandas", shown.to_df),
        ("pandas", "pandas", results[0].objects().to_df),
        ("supervision", "supervision", shown.to_supervision),
        ("PIL", "pillow", shown.show),
    ]:
        with monkeypatch.context() as patched:
            patched.setitem(sys.modules, module, None)
            patched.delitem(sys.modules, f"{module}.Image", raising=False)
            with pytest.raises(ImportError, match=rf"{function.__name__} needs {module}: pip install {package}$"):
                function()


def test_results_are_printed_in_a_line(results, room):
    pipeline, shown = results[0], results[1][-1]
    objects = pipeline.objects()
    first = objects[0]
    at = ", ".join(f"{value:.2f}" for value in first.centroid)
    assert repr(first) == f"<splatseg.Object {first.id}: {first.state}, in {first.frames} frames, at ({at}) m>"
    pose = f"{len(shown.objects)} objects, 96x72, pose given"
    assert repr(shown) == f"<splatseg.StepResult '{room[-1].name}': {pose}>"
    assert repr(room[0]) == f"<splatseg.Frame '{room[0].name}': 96x72, with a pose>"
    assert repr(objects).startswith(f"<splatseg.Objects: {len(objects)} objects, ids {first.id}, ")
    assert repr(ss.Sightings()) == "<splatseg.Sightings: 0 objects>"
    for value in (first, shown, shown.objects, shown.objects[0], objects, room[0], pipeline, pipeline.memory):
        assert len(repr(value)) < 130 and "\n" not in repr(value)
    assert objects._repr_html_().count("<tr>") == len(objects) + 1
