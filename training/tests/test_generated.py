"""Tests of generated training samples: exact and brute-force ray casting, layout, inputs, sensors, batches, runs."""

import cv2
import numpy as np
import pytest
import torch
from splatseg_training import augment, inputs, solids
from splatseg_training.export import export
from splatseg_training.generated import batches, cast, fields, layout, piles, scenes, sensors, show, train
from splatseg_training.generated import inputs as generated_inputs
from splatseg_training.generated.draws import Draws
from splatseg_training.generated.parts import BALL, BOX, CYLINDER, Parts, tilted, yawed
from splatseg_training.network import load
from splatseg_training.sensors import cameras
from splatseg_training.sensors import scene as numpy_scene

torch.set_num_threads(1)
WIDTHS = (4, 4, 8, 8, 8)
SHAPES = {"box": BOX, "cylinder": CYLINDER, "ball": BALL}
SETTINGS = augment.Settings(height=64, width=96, no_colour=0.5, turn=0.5)


def one(*solids_of_scene):
    """Parts [1, P] of solids (shape, centre, half, id) with axes of the world."""
    shape, centre, half, id = zip(*solids_of_scene)
    axes = torch.eye(3).expand(1, len(shape), 3, 3)
    values = (torch.tensor([shape]), torch.tensor([centre]).float(), torch.tensor([half]).float(), axes)
    return Parts(*values, torch.tensor([id]))


def camera(rotation=None, position=(0, 0, 0)):
    """A camera with 100 px focal length in the middle of an image of 101 × 81, looking along +z."""
    rotation = torch.eye(3) if rotation is None else rotation
    return cast.Cameras(rotation[None], torch.tensor([position]).float(), torch.tensor([[100.0, 100, 50, 40]]))


def hit(parts, view=None, room=None):
    """Depth and ids, [81, 101]."""
    hits = cast.cast(parts, view or camera(), 81, 101, room)
    return hits.z[0], hits.id[0]


def test_a_box_seen_head_on():
    z, ids = hit(one((BOX, (0, 0, 3), (0.5, 0.3, 1), 7)))
    assert z[40, 50] == 2 and ids[40, 50] == 7
    seen = torch.zeros(81, 101, dtype=torch.bool)
    seen[25:56, 25:76] = True  # 0.3 m and 0.5 m at 2 m, where the face's borders are on pixels
    inner = seen[1:-1, 1:-1]
    assert (z[26:55, 26:75] == 2).all() and (ids[26:55, 26:75] == 7).all() and inner.any()
    assert not z[~seen].any() and not ids[~seen].any()


def test_a_ball_and_a_cylinder_seen_head_on():
    z, _ = hit(one((BALL, (0, 0, 3), (1, 1, 1), 1)))
    x = (torch.arange(101) - 50) / 100
    square = 9 - (1 + x**2) * 8  # |t d - c|² = 1 along the middle row
    expected = torch.where(square > 0, (3 - square.clamp(min=0).sqrt()) / (1 + x**2), 0)
    torch.testing.assert_close(z[40], expected)
    z, _ = hit(one((CYLINDER, (0, 0, 3), (1, 1, 1), 1)))  # along its axis: a disc at 2 m
    radius = torch.hypot((torch.arange(101) - 50)[None] / 50, (torch.arange(81) - 40)[:, None] / 50)
    assert (z[radius < 0.99] == 2).all() and not z[radius > 1.01].any()


def test_a_slanted_plane():
    """A board turned by 30° about the vertical axis: z = 2 / (1 - x tan 30°)."""
    rotation = torch.tensor(
        [[np.cos(np.pi / 6), 0, -np.sin(np.pi / 6)], [0, 1, 0], [np.sin(np.pi / 6), 0, np.cos(np.pi / 6)]]
    )
    rotation = rotation.float()
    centre = torch.tensor([0, 0, 2.0]) + rotation[:, 2] * 0.01
    parts = one((BOX, centre.tolist(), (5, 5, 0.01), 1))._replace(axes=rotation[None, None])
    z, _ = hit(parts)
    x = (torch.arange(101) - 50) / 100
    expected = 2 / (1 - x * np.tan(np.pi / 6))
    torch.testing.assert_close(z, expected.expand(81, 101), rtol=1e-5, atol=1e-5)


def test_the_nearest_part_hides_others():
    z, ids = hit(
        one((BOX, (0, 0, 4), (2, 2, 1), 3), (BALL, (0, 0, 2), (0.5, 0.5, 0.5), 5), (BOX, (0, 0, 1), (9, 9, 0.1), 0))
    )
    assert z[40, 50] == 1.5 and ids[40, 50] == 5  # the last one does not exist
    assert z[0, 0] == 3 and ids[0, 0] == 3


def test_a_room_is_seen_from_inside():
    forward = torch.tensor([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # looks along +y, z is up
    room = (torch.tensor([[-1.0, -4, 0]]), torch.tensor([[1.0, 3, 2]]))
    z, ids = hit(one((BOX, (0, 0, 0), (1, 1, 1), 0)), camera(forward, (0, 0, 1)), room)
    assert z[40, 50] == 3 and ids[40, 50] == 4
    assert ids[40, 0] == 1 and ids[40, 100] == 2 and ids[80, 50] == 5 and ids[0, 50] == 6
    assert z[40, 0] == 2 and z[80, 50] == 2.5


def random_solids(rng, count):
    """Solids for both ray casters; some cross the camera's plane and some surround it."""
    out = []
    for number in range(count):
        shape = rng.choice(list(SHAPES))
        yaw, tilt = rng.uniform(0, 7), rng.uniform(-1, 1)
        axes = (yawed(torch.tensor(yaw)) @ tilted(torch.tensor(tilt))).numpy().astype(float)
        out.append(solids.Solid(shape, rng.uniform(-2, 2, 3) + (0, 0, 2), axes, rng.uniform(0.05, 0.8, 3), number + 1))
    return out


@pytest.mark.parametrize("seed", range(3))
def test_casting_equals_a_loop_over_all_solids(seed):
    """With tiles, `cast` intersects each ray with a few parts; `solids.cast` is the other implementation."""
    rng = np.random.default_rng(seed)
    made = [random_solids(rng, 30) for _ in range(3)]
    poses = [np.eye(4) for _ in made]
    poses[1][:3, :3] = yawed(torch.tensor(0.4)).numpy() @ tilted(torch.tensor(0.3)).numpy()
    intrinsics = np.array([90.0, 95, 47, 30])
    parts = Parts(
        torch.tensor([[SHAPES[solid.shape] for solid in scene] for scene in made]),
        *(
            torch.tensor(np.array([[getattr(s, name) for s in scene] for scene in made])).float()
            for name in ("centre", "half", "axes")
        ),
        torch.tensor([[solid.id for solid in scene] for scene in made]),
    )
    pose = torch.tensor(np.array(poses)).float()
    views = cast.Cameras(pose[:, :3, :3], pose[:, :3, 3], torch.tensor(intrinsics).float().expand(3, 4))
    hits = cast.cast(parts, views, 70, 100)
    for scene, at, z, ids in zip(made, poses, hits.z.numpy(), hits.id.numpy()):
        expected_z, expected_ids = brute_force(scene, at, intrinsics, 70, 100)
        assert (ids != expected_ids).mean() < 0.002  # rays along a silhouette
        same = (ids == expected_ids) & (ids > 0)
        assert same.mean() > 0.2
        assert np.quantile(np.abs(z - expected_z)[same] / z[same], 0.999) < 1e-3


def brute_force(scene, pose, intrinsics, height, width):
    """Depth and ids from every ray and every solid, in double precision."""
    fx, fy, cx, cy = intrinsics
    v, u = np.mgrid[:height, :width]
    rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(u.shape)], -1) @ pose[:3, :3].T
    best, ids = np.full(u.shape, np.inf), np.zeros(u.shape, int)
    for solid in scene:
        into = (solid.axes / solid.half).T
        depth = solids._entry(solid.shape, into @ (pose[:3, 3] - solid.centre), rays @ into.T)
        ids = np.where(depth < best, solid.id, ids)
        best = np.minimum(depth, best)
    return np.where(np.isfinite(best), best, 0), ids


def test_surface_normals_are_those_of_the_depth():
    made = scenes.random_scenes(Draws(4, 0), [(96, 128)] * 4)
    hits = cast.cast(made.parts, made.cameras, 96, 128, made.room)
    _, normal = cast.surfaces(hits, made.parts, made.cameras)
    from_depth = generated_inputs.normals(hits.z, made.cameras.intrinsics).permute(0, 2, 3, 1)
    cosine = (normal * from_depth).sum(-1).abs()
    assert cosine.median() > 0.9999 and (cosine > 0.99).float().mean() > 0.65  # all but edges
    assert normal.norm(dim=-1).sub(1).abs().max() < 1e-3


def test_scenes_are_rooms_with_things_at_sensible_distances():
    made = scenes.random_scenes(Draws(1, 0), [(96, 128)] * 24)
    hits = cast.cast(made.parts, made.cameras, 96, 128, made.room)
    counts = np.array([len(ids.unique()) for ids in hits.id])
    assert (hits.id > 0).all() and hits.id.max() < scenes.IDS
    assert 8 <= np.median(counts) <= 30 and counts.max() < 70
    assert 0.3 < hits.z.median() < 4 and hits.z.max() < 12
    low, high = made.room
    position = made.cameras.position
    assert (position > low).all() and (position < high).all() and (position[:, 2] > 0.25).all()


def test_pieces_do_not_overlap_and_things_rest_on_something():
    draws = Draws(2, 0)
    pieces = scenes._together([scenes._pieces(kinds, slots, draws, 8) for kinds, slots in scenes._GROUPS])
    room, _ = scenes._rooms(draws, 8)
    placed = layout.arranged(pieces, torch.ones_like(pieces.low).bool(), room, draws)
    assert placed.exists.float().mean() > 0.3
    apart = (placed.low[:, :, None] > placed.high[:, None] - 2e-3) | (
        placed.high[:, :, None] < placed.low[:, None] + 2e-3
    )
    both = placed.exists[:, :, None] & placed.exists[:, None] & ~torch.eye(apart.shape[1], dtype=torch.bool)
    assert (apart.any(-1) | ~both).all()
    flat = torch.tensor([[[0.0, 0, 0.7]]])
    table = piles.Surfaces(
        flat, torch.zeros(1, 1), torch.tensor([[[0.5, 0.3]]]), torch.full((1, 1), 3.0), torch.ones(1, 1).bool()
    )
    things = scenes.random_things(draws, 30).view(1, 30)
    on = torch.zeros(1, 30, dtype=torch.long)
    places = piles.placed(things, on, table, torch.ones(1, 30).bool(), draws)
    base, top = places.offset[0, :, 2], places.offset[0, :, 2] + things.high[0]
    assert places.exists[0, 0] and (base > 0.7).any()
    for number in torch.nonzero(places.exists[0])[:, 0].tolist():
        supports = torch.cat((torch.tensor([0.7]), top[:number][places.exists[0, :number]]))
        assert (supports - base[number]).abs().min() < 1e-6


def test_inputs_equal_those_of_numpy():
    rng = np.random.default_rng(0)
    z = np.stack([cv2.GaussianBlur(rng.random((48, 64)).astype(np.float32) * 3 + 0.4, (0, 0), 4) for _ in range(5)])
    z[rng.random(z.shape) < 0.6] = 0
    z[1, :, :20], z[2], z[3] = 0, 0, 0
    z[3, 10, 20], z[3, 30, 50], z[4] = 1, 2, z[4] * 60
    rgb = rng.integers(0, 256, (5, 48, 64, 3)).astype(np.uint8)
    matrix = augment.matrix((60, 62, 30.0, 25.0))
    expected = [inputs.inputs(c, np.rint(d * 1000).clip(0, 65535).astype(np.uint16), matrix) for c, d in zip(rgb, z)]
    intrinsics = torch.tensor([60, 62, 30.0, 25.0]).expand(5, 4)
    colours = torch.from_numpy(rgb).permute(0, 3, 1, 2).float()
    actual = generated_inputs.inputs(colours, torch.from_numpy(z), intrinsics)
    np.testing.assert_allclose(actual.numpy(), np.stack(expected), atol=1e-4)
    assert (generated_inputs.filled(torch.from_numpy(z))[3].numpy() == inputs.filled(z[3])).all()


def test_fields_have_their_deviation_and_correlation():
    draws = Draws(0, 0)
    noise = fields.correlated_noise(draws, (60, 96, 128), [0.0, 2.0, 5.0] * 20).view(20, 3, 96, 128)
    assert (noise.std((0, 2, 3)) - 1).abs().max() < 0.12
    for number, length in ((1, 4), (2, 10)):  # the correlation falls to 1/e at twice the length
        field = noise[:, number]
        assert (field[..., length:] * field[..., :-length]).mean() / field.square().mean() == pytest.approx(
            np.exp(-1), abs=0.1
        )
    share = fields.below_share(noise[:, 1], [0.25] * 20).float().mean()
    assert share == pytest.approx(0.25, abs=0.03)


def exact_views():
    """Views of four rooms, and their scenes for the sensors in NumPy."""
    made = scenes.random_scenes(Draws(6, 0), [(96, 128)] * 4)
    hits = cast.cast(made.parts, made.cameras, 96, 128, made.room)
    grey = torch.randint(60, 255, hits.z.shape, generator=torch.Generator().manual_seed(0)).float()
    intrinsics = made.cameras.intrinsics
    views = sensors.Views(hits.z, grey, torch.ones(4).bool(), hits.id, intrinsics, scenes.IDS)
    colour = grey[..., None].expand(-1, -1, -1, 3).numpy().astype(np.uint8)
    values = zip(hits.z.numpy(), colour, hits.id.numpy(), intrinsics.numpy().astype(float))
    return views, [numpy_scene.Scene(*value) for value in values]


@pytest.mark.parametrize("kind", cameras.SHARES)
def test_sensors_err_as_much_as_those_of_numpy(kind):
    views, numpy_views = exact_views()
    for strength in (0.3, 0.9):
        draws = Draws(3, 0)
        drawn = [[cameras.draw_camera(kind, strength, draws.rng) for _ in range(4)] for _ in range(4)]
        actual = torch.cat([sensors.measure_with(each, views, draws) for each in drawn]).numpy()
        expected = [cameras.measure_with(c, v, draws.rng) for each in drawn for c, v in zip(each, numpy_views)]
        truth = views.z.repeat(4, 1, 1).numpy()
        ours, theirs = sizes(actual, truth), sizes(np.stack(expected), truth)
        assert ours[0] == pytest.approx(theirs[0], abs=0.05)  # share of the pixels without depth
        assert ours[1:] == pytest.approx(theirs[1:], rel=0.35)


def sizes(measured, truth):
    """The share of missing pixels, and the median and 90 % quantile of the relative error of the others."""
    known = measured > 0
    errors = (np.abs(measured - truth) / truth)[known]
    return [1 - known.mean(), *np.quantile(errors, [0.5, 0.9])]


def test_a_late_frame_moves_as_that_of_numpy():
    views, numpy_views = exact_views()
    draws = Draws(0, 0)
    registration = cameras.registration.NONE._replace(rotation=(0.01, -0.012, 0.005), translation=(0.015, 0.0, -0.01))
    actual = sensors.registration.late(views, [registration] * 4, draws).numpy()
    for z, view in zip(actual, numpy_views):
        expected = cameras.registration.late(view.z, view.camera, registration.rotation, registration.translation)
        assert (np.abs(z - expected) < 1e-3).mean() > 0.99
        assert (np.abs(z - view.z) > 1e-3).mean() > 0.5


def test_a_batch_depends_on_seed_and_step_alone():
    x, ids = batches.batch(3, 7, 6, SETTINGS)
    assert (
        x.shape == (6, 8, 64, 96) and x.dtype == torch.float16 and ids.shape == (6, 32, 48) and ids.dtype == torch.int32
    )
    assert x.isfinite().all() and (ids > 0).all()
    again = batches.batch(3, 7, 6, SETTINGS)
    assert torch.equal(x, again[0]) and torch.equal(ids, again[1])
    assert not torch.equal(x, batches.batch(3, 8, 6, SETTINGS)[0])
    colourless = (x[:, :3] == 0).flatten(1).all(1)
    assert colourless.any() and not colourless.all()


def test_all_new_tensors_name_their_device():
    """Where one does not, it is on the device `meta` here, as it would be on the CPU beside a GPU's tensors."""
    run = train.Run.__new__(train.Run)
    run.options = train.parse(["--out", "unused"])
    expected = batches.batch(3, 7, 6, SETTINGS)
    with torch.device("meta"):
        actual = batches.batch(3, 7, 6, SETTINGS)
        targets, _ = train.train.affinities.targets(actual[1])
        logits = targets * 2 - 1
        depth = actual[0][:, 3, ::2, ::2].float() + 0.5
        assert train.train.affinities.loss(logits, actual[1].long(), depth) < 0.4
    assert torch.equal(expected[0], actual[0])


def test_turned_samples_fit_their_cameras():
    """Turned, depth and camera give the same points, with turned coordinates."""
    settings = SETTINGS._replace(turn=1.0, sensor=0.0)
    for group, turns in batches.groups(1, 0, 16, settings):
        _, z, ids, intrinsics = batches.turned(group, turns)
        for number, turn in enumerate(turns):
            images = (group.z[number].numpy(), group.ids[number].numpy())
            expected, camera_after = augment.turned(images, group.intrinsics[number].numpy(), int(turn))[:2], None
            *expected, camera_after = augment.turned(images, group.intrinsics[number].numpy(), int(turn))
            assert (z[number].numpy() == expected[0]).all() and (ids[number].numpy() == expected[1]).all()
            np.testing.assert_allclose(intrinsics[number].numpy(), camera_after, rtol=1e-5, atol=1e-4)


def command(out, *more):
    size = ["--batch", "4", "--height", "64", "--width", "96", "--widths", *map(str, WIDTHS)]
    return ["--out", str(out), *size, "--workers", "0", "--threads", "1", "--device", "cpu", *more]


def test_a_run_learns_resumes_and_exports(tmp_path, capsys):
    train.main(command(tmp_path / "whole", "--steps", "60", "--rate", "0.01"))
    assert "% generating" in capsys.readouterr().out
    whole = losses(tmp_path / "whole")
    assert np.mean(whole[-10:]) < 0.93 * np.mean(whole[:10])
    parts = train.Run(train.parse(command(tmp_path / "parts", "--steps", "60", "--rate", "0.01")))
    parts.progress = lambda: parts.step / 60 if parts.step < 25 else 1
    parts.train()
    assert len(losses(tmp_path / "parts")) == 25
    train.main(command(tmp_path / "parts", "--steps", "60", "--rate", "0.01"))
    assert losses(tmp_path / "parts") == whole
    export(str(tmp_path / "whole" / "weights.pt"), str(tmp_path / "out.safetensors"), -1.0)
    assert load(str(tmp_path / "out.safetensors"))(torch.zeros(1, 8, 64, 96)).isfinite().all()


def losses(run):
    return [float(line.split(",")[1]) for line in (run / "losses.csv").read_text().splitlines()[1:]]


def test_folders_can_be_mixed_in(tmp_path):
    from splatseg_training import clutter

    clutter.write(str(tmp_path / "data"), 2, seed=3)
    options = train.parse(
        command(tmp_path / "run", "--steps", "1", "--data", str(tmp_path / "data"), "--data-share", "0.5")
    )
    run = train.Run(options, train.read_groups(options.data))
    x, ids = next(run.batches())
    assert len(x) == 4 and ids.shape == (4, 32, 48)
    assert torch.equal(x[:2], batches.batch(0, 0, 2, train.train.settings(options))[0])
    assert run.update(x, ids, 1e-3) > 0


def test_pictures_are_drawn(tmp_path):
    show.main(["--out", str(tmp_path), "--count", "2"])
    assert cv2.imread(str(tmp_path / "generated-0.png")).shape == (4 * 192, 2 * 256, 3)
