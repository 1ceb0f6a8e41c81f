"""Saved maps: floor plan, mesh, names and files."""

import json
from pathlib import Path

import numpy as np
import pytest
import splatseg as ss

ROOM = "synthetic:frames=30,width=96,height=72,objects=6"


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The map of a room that shows its floor."""
    folder = tmp_path_factory.mktemp("saved_map")
    ss.run(ROOM, folder / "out", save_memory=folder / "map.ply", page=False, online=True)
    return folder / "map.ply"


def test_the_plan_is_that_of_the_exported_files(saved: Path, tmp_path: Path) -> None:
    home = ss.SavedMap(saved)
    plan = home.floor_plan()
    home.export(tmp_path / "home", "occupancy")
    with pytest.raises(ValueError, match="exists"):
        home.export(tmp_path / "home", "occupancy")
    data = json.loads((tmp_path / "home.json").read_text())
    height, width = plan.grid.shape
    assert (data["grid"]["width"], data["grid"]["height"]) == (width, height)
    assert plan.origin.tolist() == data["grid"]["origin"] and plan.resolution == data["grid"]["resolution"]
    pixels = np.frombuffer((tmp_path / "home.pgm").read_bytes()[-width * height :], np.uint8).reshape(height, width)
    values = np.select([pixels == 254, pixels == 0], [0, 100], -1)
    assert np.array_equal(plan.grid, values[::-1]) and {-1, 0, 100} == set(np.unique(plan.grid).tolist())
    assert [(room.id, room.name) for room in plan.rooms] == [(room["id"], None) for room in data["rooms"]]
    assert set(np.unique(plan.room_ids)) == {0, *(room.id for room in plan.rooms)}
    exported = {one["id"]: one for one in data["objects"]}
    for id, one in exported.items():
        footprint = plan.footprints[id]
        assert footprint.outlines[0].tolist() == one["footprint"][0] and footprint.room == one["room"]
        if one["approach"]:
            assert list(plan.approach(id)[0].place) == one["approach"][0]["place"]
    assert plan.picture(2).shape == (2 * height, 2 * width, 3)
    for scale in (0, 33):
        with pytest.raises(ValueError, match=f"scale is {scale}, expected 1 to 32"):
            plan.picture(scale)


def test_routes_stay_on_free_cells(saved: Path) -> None:
    plan = ss.SavedMap(saved).floor_plan()
    rows, columns = np.nonzero((plan.grid == 0) & (plan.room_ids == plan.rooms[-1].id))
    places = plan.origin + plan.resolution * (np.stack([columns, rows], axis=1) + 0.5)
    routes = []
    for end in places[:: len(places) // 12 + 1]:
        try:
            routes.append(plan.route(plan.rooms[-1].middle, end, robot_radius=0.15))
        except ValueError as error:
            assert "free" in str(error) or "way" in str(error)
    assert len(routes) > 3
    for route in routes:
        for start, end in zip(route.points, route.points[1:], strict=False):
            steps = start + np.linspace(0, 1, 50)[:, None] * (end - start)
            cells = np.floor((steps - plan.origin) / plan.resolution).astype(int)
            assert (plan.grid[cells[:, 1], cells[:, 0]] == 0).all()
        lengths = np.linalg.norm(np.diff(route.points, axis=0), axis=1)
        assert route.length_m == pytest.approx(lengths.sum()) and route.clearance_m >= 0.15 and route.yaw is None
    with pytest.raises(ValueError, match="no footprint|object 9999"):
        plan.route(plan.rooms[-1].middle, 9999)
    with pytest.raises(ValueError, match="shape"):
        plan.route((0, 0, 0), (1, 1))
    place = np.array(plan.rooms[0].middle)
    assert plan.to_plan(plan.to_world(place)) == pytest.approx(place)


def test_unused_settings_are_refused(saved: Path, tmp_path: Path) -> None:
    home = ss.SavedMap(saved)
    with pytest.raises(ValueError, match="resolution"):
        home.floor_plan(resolution=0.0)
    with pytest.raises(ValueError, match="voxel"):
        home.mesh(voxel=9.0)
    with pytest.raises(ValueError, match="missing.ply"):
        ss.SavedMap(tmp_path / "missing.ply")
    wider = home.floor_plan(free_path=0.3)
    assert (wider.grid == 0).sum() >= (home.floor_plan().grid == 0).sum()


def test_the_mesh_is_that_of_the_exported_file(saved: Path, tmp_path: Path) -> None:
    home = ss.SavedMap(saved)
    mesh = home.mesh(voxel=0.05)
    home.export(tmp_path / "mesh.ply", "mesh", voxel=0.05)
    for form, options, message in [
        ("mesh", {}, r"mesh\.ply: exists: pass overwrite=True to replace it"),
        ("points", {"voxel": 0.05}, "voxel: is for form mesh"),
        ("points", {"colour": "id"}, "unexpected argument 'colour' found tip: a similar argument exists: 'color'"),
        ("pointz", {}, "invalid value 'pointz' for 'form'"),
    ]:
        with pytest.raises(ValueError, match=f"{message}") as told:
            home.export(tmp_path / "mesh.ply", form, overwrite=bool(options), **options)
        assert "--" not in str(told.value) and "\n" not in str(told.value)
    header = (tmp_path / "mesh.ply").read_bytes().split(b"end_header")[0].decode()
    assert f"element vertex {len(mesh.vertices)}\n" in header and f"element face {len(mesh.triangles)}\n" in header
    assert mesh.vertices.dtype == np.float64 and mesh.colors.dtype == np.uint8 and mesh.ids.dtype == np.uint32
    assert mesh.triangles.max() == len(mesh.vertices) - 1 and len(mesh.ids) == len(mesh.colors) == len(mesh.vertices)
    # The room has 5 x 4 x 2.5 m.
    assert (np.ptp(mesh.vertices, axis=0) < 8).all() and (np.ptp(mesh.vertices, axis=0) > 1).all()
    ids = {one.id for one in home.objects()}
    assert len(ids & set(mesh.triangle_ids().tolist())) > 3


def test_names_stay_in_the_file(saved: Path, tmp_path: Path) -> None:
    home = ss.SavedMap(saved)
    plan = home.floor_plan()
    room = plan.rooms[0]
    with pytest.raises(ValueError, match="room 77: found no such room"):
        home.name_room(plan, 77, "hall")
    home.name_room(plan, room.id, "hall")
    assert (plan.rooms[0].name, plan.rooms[0].name_source) == ("hall", "by_hand")
    id = next(id for id, one in plan.footprints.items() if one.room == room.id)
    home.name_object(id, "bed")
    (tmp_path / "named.ply").write_text("precious")
    with pytest.raises(FileExistsError, match="overwrite=True"):
        home.save(tmp_path / "named.ply")
    assert (tmp_path / "named.ply").read_text() == "precious"
    home.save(tmp_path / "named.ply", overwrite=True)
    again = ss.SavedMap(tmp_path / "named.ply")
    graph = again.scene_graph()
    assert (graph.rooms[0].name, graph.rooms[0].name_source) == ("hall", "by_hand")
    assert again.floor_plan().footprints[id].label == "bed"
    again.save()
    again.save(tmp_path / "named.ply")
    again.name_room(plan := again.floor_plan(), room.id, None)
    assert (plan.rooms[0].name, plan.rooms[0].name_source) == ("bedroom", "derived")
