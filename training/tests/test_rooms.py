"""Tests of the room renderer with small images and no assets except those written by the tests; under a minute."""

import itertools
import json
import os

import numpy as np
import pytest

pytest.importorskip("bpy", reason="rooms need Blender: pip install 'bpy==4.5.*'")

from PIL import Image
from splatseg_training import dataset
from splatseg_training.rooms import views
from splatseg_training.rooms.__main__ import main
from splatseg_training.rooms.assets import Library, find_surfaces, largest_rectangle
from splatseg_training.rooms.cast import Camera
from splatseg_training.rooms.collada import read_collada
from splatseg_training.rooms.kinds import guess
from splatseg_training.rooms.materials import Paint
from splatseg_training.rooms.write import Settings, build_room, empty_scene, poses_of

SMALL = ["--width", "64", "--height", "48"]
CAMERA = Camera(160, 120)


def read(folder, number):
    """Depth (m), ids and pose of a written view."""
    depth = np.asarray(Image.open(folder / "depth" / f"{number}.png")).astype(float) / 1000
    ids = np.asarray(Image.open(folder / "instance-filt" / f"{number}.png")).astype(int)
    return depth, ids, np.loadtxt(folder / "pose" / f"{number}.txt")


def files(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def core(ids):
    """Pixels whose 3 × 3 neighbourhood has one id."""
    padded = np.pad(ids, 1, "edge")
    height, width = ids.shape
    around = [padded[y : y + height, x : x + width] for y, x in itertools.product(range(3), repeat=2)]
    return (np.stack(around) == ids).all(0)


def reproject(first, second, matrix):
    """Projects the first view's points into the second: depth errors (m) and agreement of ids at points visible in
    both."""
    (depth, ids, pose), (other_depth, other_ids, other_pose) = first, second
    height, width = depth.shape
    v, u = np.mgrid[0:height, 0:width]
    x, y = (u - matrix[0, 2]) / matrix[0, 0] * depth, (v - matrix[1, 2]) / matrix[1, 1] * depth
    inside = (depth > 0) & core(ids)
    points = np.stack([x, y, depth, np.ones_like(depth)], -1)[inside]
    points = points @ (np.linalg.inv(other_pose) @ pose).T
    front = points[:, 2] > 0.1
    points, ids = points[front], ids[inside][front]
    column = np.rint(matrix[0, 0] * points[:, 0] / points[:, 2] + matrix[0, 2]).astype(int)
    row = np.rint(matrix[1, 1] * points[:, 1] / points[:, 2] + matrix[1, 2]).astype(int)
    seen = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    row, column, points, ids = row[seen], column[seen], points[seen], ids[seen]
    error = points[:, 2] - other_depth[row, column]
    same_surface = (np.abs(error) < 0.05) & core(other_ids)[row, column]
    return np.abs(error[same_surface]), (ids == other_ids[row, column])[same_surface]


def test_depth_and_ids_of_a_walk_agree_between_views(tmp_path):
    main(
        [
            "--seed",
            "21",
            "--frames",
            "6",
            "--no-colour",
            "--width",
            "160",
            "--height",
            "120",
            "--out",
            str(tmp_path / "a"),
        ]
    )
    frames = [read(tmp_path / "a", number) for number in range(6)]
    pairs = [reproject(a, b, CAMERA.matrix) for a, b in itertools.pairwise(frames)]
    errors, same = (np.concatenate(parts) for parts in zip(*pairs))
    assert len(errors) > 20_000
    assert np.median(errors) < 0.01
    assert same.mean() > 0.995


def test_exact_surfaces_are_those_of_the_depth(tmp_path):
    main(["--seed", "71", "--frames", "3", "--no-colour", "--mesh", *SMALL, "--out", str(tmp_path / "a")])
    header, body = (tmp_path / "a" / "surfaces.ply").read_bytes().split(b"end_header\n", 1)
    count = int(header.split(b"element vertex ")[1].split(b"\n")[0])
    vertices = np.frombuffer(body, [("place", "<f4", 3), ("segment_id", "<i4")], count)
    camera = Camera(64, 48)
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    for number in range(3):
        depth, ids, pose = read(tmp_path / "a", number)
        x = (u - camera.matrix[0, 2]) / camera.matrix[0, 0] * depth
        y = (v - camera.matrix[1, 2]) / camera.matrix[1, 1] * depth
        points = np.stack([x, y, depth], -1) @ pose[:3, :3].T + pose[:3, 3]
        for id in np.unique(ids[depth > 0]):
            own = vertices["place"][vertices["segment_id"] == id]
            seen = points[(ids == id) & (depth > 0)]
            # Depth is in millimetres.
            assert (seen >= own.min(0) - 0.002).all(), id
            assert (seen <= own.max(0) + 0.002).all(), id


def test_the_same_seed_gives_the_same_bytes(tmp_path):
    command = ["--seed", "31", "--rooms", "2", "--views", "scattered", "--frames", "2", "--no-colour", *SMALL, "--out"]
    main([*command, str(tmp_path / "a")])
    main([*command[:3], "1", *command[4:], str(tmp_path / "b")])
    first = files(tmp_path / "a" / "31")
    assert first == files(tmp_path / "b" / "31")
    assert first != files(tmp_path / "a" / "32")
    assert sorted(os.listdir(tmp_path / "b")) == ["31"]


def test_rooms_that_exist_are_kept_and_leftovers_replaced(tmp_path, capsys):
    (tmp_path / "41").mkdir()
    (tmp_path / ".42.tmp" / "depth").mkdir(parents=True)
    (tmp_path / ".42.tmp" / "depth" / "99.png").write_bytes(b"half")
    command = ["--seed", "41", "--rooms", "2", "--views", "scattered", "--frames", "1", "--no-colour", *SMALL]
    main([*command, "--out", str(tmp_path)])
    assert "exists, kept" in capsys.readouterr().out
    assert not os.listdir(tmp_path / "41")
    assert sorted(os.listdir(tmp_path)) == ["41", "42"]
    [(number, view)] = dataset.read_folder(str(tmp_path / "42"))
    assert number == 0
    assert view.colour is None
    names = json.loads((tmp_path / "42" / "objects.json").read_text())["instances"]
    assert set(np.unique(view.ids)) - {0} <= {int(id) for id in names}
    assert [names[str(id)] for id in range(1, 7)] == ["wall"] * 4 + ["floor", "ceiling"]


def test_colours_show_the_same_room(tmp_path):
    main(
        [
            "--seed",
            "51",
            "--frames",
            "2",
            "--samples",
            "2",
            *SMALL,
            "--views",
            "scattered",
            "--out",
            str(tmp_path / "a"),
        ]
    )
    (_, view), _ = dataset.read_folder(str(tmp_path / "a"))
    assert view.colour.std() > 10
    image = np.asarray(Image.open(tmp_path / "a" / "color" / "0.jpg")).astype(float)
    _, ids, _ = read(tmp_path / "a", 0)
    edges = np.abs(np.diff(image, axis=1)).mean(-1)
    borders = np.diff(ids, axis=1) != 0
    assert edges[borders].mean() > 1.5 * edges[~borders].mean()


def test_a_walk_at_30_hz_moves_smoothly():
    room = build_room(61)
    poses = poses_of(room, Settings(frames=240, views="path", rate=30, camera=Camera(64, 48)))
    assert len(poses) == 240
    moved = [np.linalg.norm(b[:3, 3] - a[:3, 3]) for a, b in itertools.pairwise(poses)]
    cosines = [(np.trace(a[:3, :3].T @ b[:3, :3]) - 1) / 2 for a, b in itertools.pairwise(poses)]
    turned = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    assert 0.002 < np.mean(moved) < 0.01
    assert max(moved) < 0.015
    assert max(turned) < 1.2
    assert room.clearance(*np.array([pose[:2, 3] for pose in poses]).T).min() > 0


def test_interpolation_meets_its_keys_and_is_exact_on_lines():
    values = np.random.default_rng(0).normal(size=7)
    assert np.array_equal(views.interpolate(values, np.arange(7)), values)
    line = 3 * np.arange(5.0) + 1
    times = np.linspace(0, 4, 33)
    assert np.allclose(views.interpolate(line, times), 3 * times + 1)


def test_the_largest_rectangle_equals_a_naive_search():
    rng = np.random.default_rng(1)
    for _ in range(20):
        mask = rng.random((6, 7)) < 0.7
        best = 0
        for i0, j0 in itertools.product(range(6), range(7)):
            for i1, j1 in itertools.product(range(i0 + 1, 7), range(j0 + 1, 8)):
                if mask[i0:i1, j0:j1].all():
                    best = max(best, (i1 - i0) * (j1 - j0))
        i0, i1, j0, j1 = largest_rectangle(mask)
        assert mask[i0:i1, j0:j1].all()
        assert (i1 - i0) * (j1 - j0) == best


BOX_FACES = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]


def box_corners(low, high):
    return list(itertools.product(*zip(low, high)))


def write_table(path):
    """Writes an OBJ of a toy table, y up: a top of 4 × 2 and a leg, 3 high."""
    lines, boxes = [], [((-2, 2.8, -1), (2, 3, 1)), ((-0.3, 0, -0.3), (0.3, 2.8, 0.3))]
    for number, (low, high) in enumerate(boxes):
        lines += ["v {} {} {}".format(*corner) for corner in box_corners(low, high)]
        lines += ["f " + " ".join(str(int(k) + 8 * number) for k in face.split()) for face in BOX_FACES]
    path.write_text("\n".join(lines))


@pytest.fixture
def assets(tmp_path):
    folder = tmp_path / "assets" / "pack"
    folder.mkdir(parents=True)
    for name in ("Table_1", "Nightstand", "Armchair", "Chair_2", "Drawer", "Bookshelf"):
        write_table(folder / f"{name}.obj")
    (folder / "Couch.obj").write_text("nothing")
    (folder / "Bed.glb").write_bytes(b"broken")
    (folder / "notes.txt").write_text("not a mesh")
    return tmp_path / "assets"


def test_an_imported_table_stands_upright_at_its_size_and_carries_things(assets):
    empty_scene()
    table = Library(str(assets)).piece("table", Paint(np.random.default_rng(0)))
    assert table.imported
    assert table.name == "table"
    assert 0.7 <= table.height <= 0.8
    assert 1.2 < table.width / table.depth < 2.6
    assert abs(table.triangles[..., 2].min()) < 1e-6
    assert np.isclose(table.triangles[..., 2].max(), table.height)
    *_, z, clear = table.surfaces[-1]
    assert np.isclose(z, table.height, atol=1e-3)
    assert clear > 0.5


def test_rooms_hold_imported_pieces_and_skip_broken_files(assets, tmp_path, capsys):
    command = ["--rooms", "3", "--views", "scattered", "--frames", "2", "--no-colour", *SMALL, "--assets", str(assets)]
    main(["--seed", "71", *command, "--out", str(tmp_path / "a")])
    printed = capsys.readouterr()
    counts = [int(line.split(" of them imported")[0].split()[-1]) for line in printed.out.splitlines()]
    assert len(counts) == 3
    assert sum(counts) >= 5
    warnings = [line for line in printed.err.splitlines() if line.startswith("warning")]
    assert len(warnings) == len(set(warnings)) <= 2
    main(["--seed", "71", *command, "--out", str(tmp_path / "b")])
    assert files(tmp_path / "a" / "72") == files(tmp_path / "b" / "72")


def test_surfaces_are_found_inside_shelves():
    boards = [((-0.5, -0.2, z), (0.5, 0.2, z + 0.02)) for z in (0.1, 0.5, 0.9)]
    triangles = []
    for low, high in boards:
        corners = np.array(box_corners(low, high))
        for face in BOX_FACES:
            a, b, c, d = corners[[int(k) - 1 for k in face.split()]]
            triangles += [(a, b, c), (a, c, d)]
    surfaces = find_surfaces(np.array(triangles))
    assert np.allclose([surface[4] for surface in surfaces], [0.12, 0.52, 0.92])
    assert np.allclose([surface[5] for surface in surfaces], [0.365, 0.365, 0.785], atol=0.02)
    assert np.allclose(surfaces[0][:4], [-0.485, 0.485, -0.185, 0.185])


COLLADA = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema">
<asset><unit meter="0.01"/><up_axis>Z_UP</up_axis></asset>
<library_effects><effect id="red"><profile_COMMON><technique><phong><diffuse><color>1 0 0 1</color></diffuse></phong>
</technique></profile_COMMON></effect></library_effects>
<library_materials><material id="paint"><instance_effect url="#red"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array count="15">0 0 0 1 0 0 1 1 0 0 1 0 0 0 2</float_array>
<technique_common><accessor count="5" stride="3"/></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist count="2" material="m"><input semantic="VERTEX" offset="0" source="#v"/><vcount>4 3</vcount>
<p>0 1 2 3 0 1 4</p></polylist></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene><node><matrix>10 0 0 5 0 10 0 0 0 0 10 0 0 0 0 1</matrix><instance_geometry url="#g">
<bind_material><technique_common><instance_material symbol="m" target="#paint"/></technique_common></bind_material>
</instance_geometry></node></visual_scene></library_visual_scenes></COLLADA>"""


def test_collada_polygons_units_and_colours(tmp_path):
    (tmp_path / "a.dae").write_text(COLLADA)
    mesh = read_collada(str(tmp_path / "a.dae"))
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 1, 4], [0, 2, 3]]
    assert np.allclose(mesh.vertices[4], [0.05, 0, 0.2])
    assert np.allclose(mesh.vertices[2], [0.15, 0.1, 0])
    assert np.allclose(mesh.finishes[0].colour, [1, 0, 0])


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("aws_TVCabinet_01_visual", "cabinet"),
        ("aws_ChairA_01_visual", "chair"),
        ("Kitchen_Fridge", "fridge"),
        ("NightStand_1", "nightstand"),
        ("table_low", "low table"),
        ("Trashcan_Small1", "bin"),
        ("armchair_pillows", "armchair"),
        ("Teapot", "other"),
    ],
)
def test_kinds_are_guessed_from_names(name, kind):
    assert guess(name).name == kind


@pytest.mark.parametrize("name", ["aws_Sofa_01_collision", "Door_Double", "Window_Small1", "Light_Ceiling1"])
def test_parts_of_buildings_are_not_used(name):
    assert guess(name) is None


def test_quick_colours_are_those_of_the_same_surfaces(tmp_path):
    pytest.importorskip("embreex", reason="--quick needs: pip install embreex")
    common = ["--seed", "5002", "--frames", "2", "--views", "scattered", "--width", "160", "--height", "120"]
    main([*common, "--quick", "--out", str(tmp_path / "quick")])
    main([*common, "--samples", "8", "--out", str(tmp_path / "slow")])
    for number in range(2):
        quick, slow = (read(tmp_path / name, number) for name in ("quick", "slow"))
        assert (quick[2] == slow[2]).all()
        assert (np.abs(quick[0] - slow[0]) <= 0.0011).mean() > 0.995 and (quick[1] == slow[1]).mean() > 0.995
        images = [
            np.asarray(Image.open(tmp_path / name / "color" / f"{number}.jpg"), float) for name in ("quick", "slow")
        ]
        # The mean colours of things agree: both renderers have the same materials and lights.
        things = [thing for thing in np.unique(slow[1]) if (slow[1] == thing).sum() > 100]
        means = [[image[slow[1] == thing].mean(0) for thing in things] for image in images]
        assert len(things) > 3 and np.median(np.abs(np.subtract(*means)).max(1)) < 40
        assert np.corrcoef(np.ravel(means[0]), np.ravel(means[1]))[0, 1] > 0.9
