"""What is saved with a map besides its Gaussians, as arrays."""

import io
import itertools
import json
import textwrap
from types import SimpleNamespace

import numpy as np
import PIL.Image
import pytest
import splatseg as ss
from conftest import command, step
from PIL import Image

MOVING = "synthetic:frames=12,width=96,height=72,speed=0.1"


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A map with keyframes."""
    folder = tmp_path_factory.mktemp("state")
    options = ["--save-memory", str(folder / "map.ply"), "--set=poses=track", "--no-page"]
    ended = command("run", MOVING, "--out", str(folder / "out"), *options)
    assert ended.returncode == 0, ended.stderr
    return folder / "map.ply"


def test_a_map_has_keyframes_with_small_images(saved):
    state = ss.read_state(saved)
    assert state["writer"] == f"splatseg {ss.__version__}"
    count = len(state["keyframes.id"])
    assert count >= 2 and state["keyframes.world_from_camera"].shape == (count, 4, 4)
    np.testing.assert_allclose(state["keyframes.world_from_camera"][:, 3], [[0, 0, 0, 1]] * count)
    offsets = state["keyframes.color_offsets"]
    for start, end in itertools.pairwise(offsets):
        with Image.open(io.BytesIO(state["keyframes.color"][start:end])) as image:
            assert image.size == (96, 72)
    assert state["keyframes.size"].tolist() == [[96, 72]] * count
    assert state["keyframes.state.json"]["next"] == count
    assert int(state["memory.anchors"][:, 1].sum()) == len(ss.FastSamSplat.load(saved).memory)
    assert state["memory.given_ids"].shape == ()


def test_the_camera_of_a_keyframe_is_scaled_to_its_image(tmp_path):
    """As the docstring of read_state does it."""
    scene, out = "synthetic:frames=2,width=320,height=240,speed=0.1", tmp_path / "map.ply"
    ended = command("run", scene, "--out", str(tmp_path / "out"), "--save-memory", str(out), "--set=poses=track", "--no-page")
    assert ended.returncode == 0, ended.stderr
    code = ss.read_state.__doc__.partition("::\n")[2].partition("\n    All arrays")[0]
    values = {"splatseg": SimpleNamespace(read_state=lambda _: ss.read_state(out)), "PIL": PIL, "io": io}
    exec(textwrap.dedent(code), values)  # noqa: S102
    assert values["image"].size == (320, 240)
    np.testing.assert_allclose(values["K"], ss.open_scene(scene)[0].K, atol=0.01)


def test_two_maps_become_one(saved, tmp_path):
    report = ss.merge(saved, saved, tmp_path / "home.ply")
    np.testing.assert_allclose(report["transform"], np.eye(4), atol=0.01)
    objects = report["objects"]
    assert objects and all(o["id"] in o["earlier"] and o["earlier"] == o["later"] for o in objects)
    assert {o["id"] for o in objects} <= set(ss.FastSamSplat.load(tmp_path / "home.ply").memory.segment_ids.tolist())
    with pytest.raises(FileExistsError, match=r"home\.ply: exists: pass overwrite=True"):
        ss.merge(saved, saved, tmp_path / "home.ply", transform=np.eye(4))
    given = ss.merge(saved, saved, tmp_path / "home.ply", transform=np.eye(4), overwrite=True)
    assert given["keyframes"]["later_recognised"] == 0 and len(given["objects"]) == len(objects)
    with pytest.raises(ValueError, match=r"transform has the shape \(3, 4\)"):
        ss.merge(saved, saved, tmp_path / "no.ply", transform=np.eye(4)[:3])
    with pytest.raises(ValueError, match="missing.ply"):
        ss.merge(saved, tmp_path / "missing.ply", tmp_path / "no.ply")
    assert not (tmp_path / "no.ply").exists()


def test_names_are_arrays(tmp_path, room):
    pipeline = ss.FastSamSplat(keep_views=True)
    for frame in room:
        step(pipeline, frame)
    pipeline.name_objects(lambda *_: ("thing", [1.0, 2.0, 3.0]))
    pipeline.save(tmp_path / "map.ply")
    state = ss.read_state(tmp_path / "map.ply")
    assert len(state["names.id"]) > 0 and set(state["names.labels.json"]) == {"thing"}
    assert state["names.embedding"].tolist() == [[1.0, 2.0, 3.0]] * len(state["names.id"])


def test_other_files_are_refused(saved, tmp_path):
    data = saved.read_bytes()
    changed = tmp_path / "changed"

    def refused(content):
        changed.write_bytes(content)
        with pytest.raises(ValueError, match="changed: ") as error:
            ss.read_state(changed)
        return str(error.value)

    assert "checksum" in refused(data[:-9] + b"x" + data[-8:])
    assert "not a splatseg memory" in refused(data.replace(b"comment splatseg", b"comment blender", 1))
    assert "version 4" in refused(data.replace(b"memory 5", b"memory 4", 1))
    assert "not a saved state" in refused(b"x" * 100)
    header = json.dumps({"__metadata__": {"splatseg_state": "2"}}).encode()
    assert "version 2" in refused(len(header).to_bytes(8, "little") + header)
    with pytest.raises(OSError, match="missing"):
        ss.read_state(tmp_path / "missing.ply")
