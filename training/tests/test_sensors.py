"""Tests of the depth sensors' models: each error has the size that its parameters say."""

import cv2
import numpy as np
import pytest
from splatseg_training import augment, clutter, dataset, sensors
from splatseg_training.inputs import normals
from splatseg_training.sensors import (
    __main__,
    cameras,
    lidar,
    losses,
    noise,
    registration,
    stereo,
    structured_light,
    time_of_flight,
)
from splatseg_training.sensors.fields import correlated_noise
from splatseg_training.sensors.scene import Scene

SHAPE = (192, 256)
CAMERA = np.array([250.0, 250, 127.5, 95.5])


def rng(seed=0):
    return np.random.default_rng(seed)


def flat(z=2.0, shape=SHAPE):
    return np.full(shape, z, np.float32)


def scene(z, colour=None):
    return Scene(z, colour, np.ones(z.shape, int), CAMERA)


def box(background=2.0, foreground=1.0):
    """A square of 40 pixels before a wall."""
    z = flat(background)
    z[70:110, 100:140] = foreground
    return z


def corner():
    """Two walls that meet at 3 m in the middle column."""
    across = np.abs(np.arange(SHAPE[1], dtype=np.float32) - 127.5) / 250
    return np.broadcast_to(3 / (1 + across), SHAPE).astype(np.float32)


def room(colour=False):
    """Walls, a floor, boxes and a window without depth."""
    z = np.minimum(corner(), 1.2 / np.maximum((np.arange(SHAPE[0], dtype=np.float32)[:, None] - 95.5) / 250, 0.01))
    ids = 1 + (np.arange(SHAPE[1])[None] > 127) + np.zeros(SHAPE, int)
    for number, (y, x, depth) in enumerate([(60, 40, 1.5), (100, 120, 1.2), (90, 200, 2.0)]):
        z[y : y + 40, x : x + 30], ids[y : y + 40, x : x + 30] = depth, number + 3
    z[10:30, 60:90] = 0
    image = cv2.blur(rng(5).integers(0, 255, (*SHAPE, 3)).astype(np.uint8), (3, 3)) if colour else None
    return z, image, ids, CAMERA


def correlation(field, distance):
    """The correlation of pixels at this distance, across."""
    return (field[:, :-distance] * field[:, distance:]).mean() / (field**2).mean()


@pytest.mark.parametrize("length", [1.5, 2, 4, 7, 10])
def test_noise_has_its_deviation_and_correlation_length(length):
    errors = np.stack([noise.apply(flat(), noise.Noise(0.02, length, 0), rng(i)) - 2 for i in range(40)])
    assert errors.std() == pytest.approx(0.02, rel=0.1)
    at = np.mean([correlation(error, round(2 * length)) for error in errors])
    assert at == pytest.approx(np.exp(-1), abs=0.08)
    assert np.abs(errors.std((0, 1)) / 0.02 - 1).max() < 0.35  # alike in all columns


def test_noise_grows_with_the_square_of_the_distance():
    white = noise.Noise(0.01, 3.0, 1.0)
    near, far = noise.apply(flat(1), white, rng()) - 1, noise.apply(flat(4), white, rng()) - 4
    assert near.std() == pytest.approx(0.0025, rel=0.05) and far.std() == pytest.approx(0.04, rel=0.05)
    assert abs(correlation(near, 1)) < 0.02
    half = noise.apply(flat(), noise.Noise(0.01, 5.0, 0.5), rng()) - 2
    assert half.std() == pytest.approx(0.01, rel=0.15) and 0.3 < correlation(half, 1) < 0.6
    assert (noise.apply(np.zeros(SHAPE, np.float32), white, rng()) == 0).all()


def test_fields_have_all_sizes():
    for shape in ((192, 256), (256, 192), (5, 7), (240, 320)):
        for length in (0, 0.5, 1.5, 3.3, 17):
            assert correlated_noise(rng(), shape, length).shape == shape


@pytest.mark.parametrize("sides", [(2, 2, 2, 2), (4, 1, 0, 3), (0, 3, 1, 0)])
def test_foreground_grows_by_the_given_pixels(sides):
    z = stereo.fattened(box(), sides, 0, rng())
    left, right, top, bottom = sides
    assert (z[70 - top : 110 + bottom, 100 - left : 140 + right] == 1).all()
    assert (z == 1).sum() == (40 + top + bottom) * (40 + left + right)
    ragged = stereo.fattened(box(), sides, 0.5, rng())
    assert (box() == 1).sum() < (ragged == 1).sum() < (z == 1).sum()
    assert (stereo.fattened(corner(), sides, 0, rng()) == corner()).all()  # a slope is no edge


def test_disparities_have_steps_and_prefer_whole_pixels():
    z = np.linspace(0.8, 4, SHAPE[0] * SHAPE[1], dtype=np.float32).reshape(SHAPE)
    camera = stereo.draw(rng(), 0.5)._replace(focal_baseline=20.0, step=0.125, locking=0.0)
    steps = 20 / stereo.stepped(z, camera) / 0.125
    assert np.abs(steps - np.rint(steps)).max() < 1e-3
    assert np.abs(20 / stereo.stepped(z, camera) - 20 / z).max() < 0.126 / 2
    locked = stereo.stepped(z, camera._replace(step=1e-4, locking=0.9))
    off = [np.abs(20 / depth - np.rint(20 / depth)) for depth in (z, locked)]
    assert (off[1] < 0.1).mean() > 1.5 * (off[0] < 0.1).mean()


def test_a_stereo_camera_has_a_band_and_loses_calm_surfaces():
    plain = stereo.draw(rng(), 0.5)._replace(
        fatten=(0, 0, 0, 0), shadow=0, band=0, textureless=0, dark=0, shiny=0, wrong=0, grazing=-1, farthest=9.0
    )
    plain = plain._replace(noise=noise.Noise(0.001, 2.0, 0.0))
    assert (stereo.measure(scene(flat()), plain, rng()) > 0).all()
    for side, columns in ((0.1, slice(0, 26)), (-0.1, slice(-26, None))):
        lost = stereo.measure(scene(flat()), plain._replace(band=side), rng()) == 0
        assert lost[:, columns].all() and lost.mean() == pytest.approx(26 / 256)
    colour = rng().integers(0, 255, (*SHAPE, 3)).astype(np.uint8)
    colour[:, :128] = 120
    lost = stereo.measure(scene(flat(), colour), plain._replace(textureless=0.3), rng()) == 0
    assert lost.mean() == pytest.approx(0.3, abs=0.02) and lost[:, :120].sum() > 50 * lost[:, 140:].sum()
    lost = stereo.measure(scene(flat()), plain._replace(textureless=0.2), rng()) == 0
    assert lost.mean() == pytest.approx(0.2, abs=0.03)
    wrong = stereo.mismatched(flat(), 0.03, 4, rng())
    assert (wrong != 2).mean() == pytest.approx(0.03, abs=0.01) and 1.3 < wrong.min() < wrong.max() < 3


def test_a_kinect_rounds_its_disparity_and_casts_a_shadow():
    light = structured_light.draw(rng(), 0.5)._replace(
        steps=348.0, rounded=True, shadow=0.075, edges=0, dark=0, difficult=0, blobs=0, border=None, grazing=-1
    )
    z = structured_light.measure(scene(flat(2.0)), light, rng())
    steps = 348 / z[z > 0]
    assert np.abs(steps - np.rint(steps)).max() < 0.01
    for baseline, columns in ((0.08, slice(91, 100)), (-0.08, slice(140, 149))):
        shadow = losses.shadow(box(), CAMERA, baseline)  # 250 px · 8 cm · (1 / 1 m - 1 / 2 m) = 10 px
        assert shadow[70:110, columns].all() and 360 <= shadow.sum() <= 400


def test_the_range_of_a_kinects_errors_stays():
    errors, valid = [], []
    for seed in range(60):
        light = structured_light.draw(rng(seed), rng(seed).uniform(0.1, 1.0))
        z = structured_light.measure(scene(flat(1.5)), light, rng(seed))
        errors.append(np.abs(z[z > 0] - 1.5).mean() if z.any() else 0)
        valid.append((z > 0).mean())
    assert 0.001 < np.median(errors) < 0.006 and max(errors) < 0.03 and np.median(valid) > 0.7


def test_a_lidar_smears_edges_and_ends_at_its_range():
    clean = lidar.Lidar(0.5, 2.0, 0.0, 4.0, 0.0, 0.0, 5.0, 0.2, 5.0)
    z = lidar.measure(scene(box()), clean, rng())
    row = z[90, 120:160]
    assert ((row > 1.05) & (row < 1.95)).sum() in range(5, 10)  # a Gaussian of 2 px has 90 % within 6.6 px
    assert (np.diff(row) > -1e-4).all() and np.abs(z[10:50] - 2).max() < 1e-4
    noisy = lidar.measure(scene(flat()), clean._replace(noise=0.01), rng())
    assert (noisy / 2 - 1).std() == pytest.approx(0.01, rel=0.2) and correlation(noisy - 2, 4) > 0.6
    assert (lidar.measure(scene(flat(5.5)), clean, rng()) == 0).all()
    unsure = lidar.measure(scene(box()), clean._replace(unsure=0.5, smear=0.7), rng()) == 0
    assert 0.003 < unsure.mean() < 0.02 and not unsure[:60].any()
    holes = lidar.measure(scene(flat()), clean._replace(holes=0.2), rng()) == 0
    assert holes.mean() == pytest.approx(0.2, abs=0.03)


def tof(**values):
    """A time-of-flight camera with only these errors."""
    clean = time_of_flight.TimeOfFlight(
        flying=0,
        filtered=0,
        reach=1,
        smear=0,
        rounding=0,
        multipath=0,
        bias=0,
        corner=12,
        noise=0,
        dropout=0,
        albedo_spread=0.5,
        nearest=0.1,
        farthest=8.0,
    )
    return clean._replace(**values)


def test_pixels_fly_between_the_surfaces_of_an_edge():
    for reach in (1, 2, 3):
        z, lost = time_of_flight.flying_pixels(box(), tof(flying=0.6, filtered=0.25, reach=reach), rng())
        edge = (40 + 2 * reach) ** 2 - (40 - 2 * reach) ** 2
        between = (z > 1) & (z < 2)
        assert between.sum() / edge == pytest.approx(0.6, abs=0.08)
        assert lost.sum() / edge == pytest.approx(0.25, abs=0.08)
        assert not (between | lost)[:60].any() and z.min() >= 1 and z.max() <= 2
    assert (time_of_flight.flying_pixels(corner(), tof(flying=1.0), rng())[0] == corner()).all()


def test_multipath_moves_corners_away_and_rounds_them():
    z = corner()
    moved = time_of_flight.multipath(z, tof(multipath=2.0), rng()) - z
    assert moved.min() > -1e-6 and moved[:, 120:136].mean() > 3 * moved[:, 60:80].mean() and moved.max() > 0.005
    round_ = time_of_flight.multipath(z, tof(rounding=1.0), rng())
    assert round_[90, 124:132].mean() < z[90, 124:132].mean() - 0.005
    assert np.abs(round_ - z)[:, 60:80].max() < 0.004
    bias = time_of_flight.multipath(z, tof(bias=0.02), rng()) / z - 1
    assert -1e-6 < bias.min() and 0.005 < bias.mean() < 0.015 and bias.max() < 0.021


def test_dim_surfaces_lose_depth_and_are_noisier():
    z = np.broadcast_to(np.linspace(1, 5, SHAPE[1], dtype=np.float32), SHAPE).copy()
    lost = time_of_flight.measure(scene(z), tof(dropout=0.25), rng()) == 0
    assert lost.mean() == pytest.approx(0.25, abs=0.02)
    assert lost[:, 200:].mean() > 0.7 and lost[:, :100].mean() < 0.05
    error = np.abs(time_of_flight.measure(scene(z), tof(noise=0.003), rng()) / z - 1)
    assert error[:, 180:].mean() > 2 * error[:, :60].mean()
    colour = np.full((*SHAPE, 3), 200, np.uint8)
    colour[:, :64] = 5
    lost = time_of_flight.measure(scene(flat(), colour), tof(dropout=0.25), rng()) == 0
    assert lost[:, :64].mean() > 0.8 and lost[:, 64:].mean() < 0.1


def test_depth_is_shifted_and_late():
    shifted = registration.shifted(box(), (3, -2), 1.0)
    assert (shifted[68:108, 103:143] == 1).all() and (shifted == 1).sum() == 1600 and (shifted[-2:] == 0).all()
    # 2 cm to the right are 5 px at 1 m and 2.5 px at 2 m.
    late = registration.late(box(), CAMERA, (0.0, 0.0, 0.0), (0.02, 0.0, 0.0))
    assert (late[70:110, 105:145] == 1).all() and (late == 1).sum() == 1600 and (late[:, 3:100] == 2).all()
    # 1° about the vertical axis are 4.4 px.
    late = registration.late(box(), CAMERA, (0.0, np.pi / 180, 0.0), (0.0, 0.0, 0.0))
    columns = np.flatnonzero(late[90] < 1.5)
    assert columns[0] in (104, 105) and columns[-1] in (143, 144)
    # Surfaces stay smooth.
    late = registration.late(corner(), CAMERA, (0.004, -0.01, 0.005), (-0.015, 0.01, 0.02))[5:-5, 10:-10]
    assert np.abs(np.diff(late, axis=1)).max() < 0.04 and np.abs(np.diff(late, axis=0)).max() < 0.04
    late = registration.late(flat(), CAMERA, (0.0, 0.0, 0.0), (0.0, 0.0, 0.015))
    assert np.allclose(late[5:-5, 5:-5], 2.015)
    assert (registration.apply(box(), CAMERA, registration.NONE, rng()) == box()).all()


def test_a_warp_leaves_gaps():
    for across, down in ((1.21, 1.13), (1.53, 1.0), (1.0, 1.31)):
        for tilt, baseline in ((0, 0), (0.1, 0), (0.1, 0.05)):
            errors = registration.NONE._replace(pitch=(across, down), tilt=tilt, baseline=baseline)
            gaps = registration.unfilled(flat(), errors, CAMERA).mean()
            assert gaps == pytest.approx(1 - 1 / across / down, abs=0.02)
    single = registration.apply(flat(), CAMERA, registration.NONE._replace(random=0.4), rng()) == 0
    assert single.mean() == pytest.approx(0.4, abs=0.01) and abs(correlation(single - 0.4, 1)) < 0.02


@pytest.mark.parametrize("length", [1, 2, 5, 15])
def test_holes_have_their_share_and_size(length):
    for share in (0.05, 0.3, 0.6):
        masks = np.stack([losses.holes(SHAPE, share, length, rng(i)) for i in range(10)])
        assert masks.mean() == pytest.approx(share, abs=0.02)
    apart = np.mean([correlation(mask - 0.6, max(1, length)) for mask in masks])
    near = np.mean([correlation(mask - 0.6, max(1, length // 4)) for mask in masks])
    assert apart < 0.35 and (length == 1 or near > 0.35)


def test_half_of_the_samples_are_at_most_mild():
    drawn = [cameras.draw(rng(seed)) for seed in range(3000)]
    untouched = sum(camera is None for camera in drawn) / 3000
    gentle = sum(camera is None or camera.strength <= cameras.MILD for camera in drawn) / 3000
    assert 0.05 < untouched < 0.1 and gentle == pytest.approx(0.5, abs=0.03)
    drawn = [camera for camera in drawn if camera]
    assert {camera.kind for camera in drawn} == set(cameras.MODELS)
    for camera in drawn:
        mild, moved = camera.strength <= cameras.MILD, camera.registration
        assert np.abs(moved.shift).max() <= (1.7 if mild else 3) and abs(moved.scale - 1) <= 0.01
        assert not mild or moved.rotation == (0.0, 0.0, 0.0)
        assert np.linalg.norm(moved.translation) < 0.035 and np.abs(moved.rotation).max() <= 0.0175
        assert 1 - (1 - moved.random) / np.prod(moved.pitch) < 0.44
        assert 0.001 <= camera.step <= 0.005 and 2 <= camera.farthest <= 10
        assert camera.holes == 0 or not mild and 0.3 <= camera.holes <= 0.6
    noises = [c.model if c.kind == "noise" else c.model.noise for c in drawn if c.kind in ("noise", "stereo")]
    strengths = [camera.strength for camera in drawn if camera.kind in ("noise", "stereo")]
    for model, strength in zip(noises, strengths):
        assert (0.001 <= model.deviation < 0.005) if strength <= cameras.MILD else (0.0045 < model.deviation <= 0.05)
        assert 1.5 <= model.length <= 10
    fattening = np.array([max(camera.model.fatten) for camera in drawn if camera.kind == "stereo"])
    assert set(fattening) == {0, 1, 2, 3, 4}


def test_mild_cameras_change_normals_less_than_harsh_ones():
    z, colour, ids, camera = room()
    exact, changes = normals(z, augment.matrix(camera)), {}
    for kind in cameras.SHARES:
        for strength in (0.1, 0.9):
            angles = []
            for seed in range(12):
                drawn = cameras.draw_camera(kind, strength, rng(seed))
                out = cameras.measure_with(drawn, Scene(z, colour, ids, camera), rng(seed))
                cosine = (normals(out, augment.matrix(camera)) * exact).sum(0)[(out > 0) & (z > 0)]
                angles.append(np.degrees(np.arccos(np.clip(np.median(cosine), -1, 1))) if len(cosine) else 0)
            changes[kind, strength] = np.median(angles)
    for kind in cameras.SHARES:
        assert changes[kind, 0.1] < changes[kind, 0.9]
    assert changes["stereo", 0.9] > 2 * changes["stereo", 0.1]


@pytest.mark.parametrize("coloured", [False, True])
def test_measured_depth_depends_on_the_seed_alone_and_is_valid(coloured):
    z, colour, ids, camera = room(coloured)
    before, shares = z.copy(), []
    for seed in range(250):
        out = sensors.measure(z, colour, ids, camera, rng(seed))
        assert (out == sensors.measure(z, colour, ids, camera, rng(seed))).all()
        assert out.shape == SHAPE and out.dtype == np.float32 and np.isfinite(out).all()
        assert out.min() >= 0 and out.max() < 12
        shares.append((out > 0).mean())
    assert (z == before).all() and np.median(shares) > 0.6
    empty = np.zeros(SHAPE, np.float32)
    for seed in range(60):
        out = sensors.measure(empty, colour, ids, camera, rng(seed))
        assert np.isfinite(out).all() and (out == 0).all()


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_a_turned_camera_sees_turned_normals(turns):
    camera = np.array([250.0, 300, 120, 99])
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    z = (2 / (1 + 0.3 * (columns - 120) / 250 - 0.5 * (rows - 99) / 300)).astype(np.float32)
    z[50:90, 60:120] *= 0.7
    turned, moved = augment.turned((z,), camera, turns)
    x, y, forward = normals(z, augment.matrix(camera))
    for _ in range(turns):
        x, y = y, -x
    expected = np.stack([np.rot90(channel, turns) for channel in (x, y, forward)])
    actual = normals(turned, augment.matrix(moved))
    assert (np.abs(actual - expected).max(0) < 1e-3).all()


def test_turned_samples_have_the_size_of_all_others(tmp_path, monkeypatch):
    clutter.write(str(tmp_path), 1, seed=3)
    view = dataset.read_folder(str(tmp_path))[0][1]
    shapes, numbers = [], []

    def measure(z, colour, ids, camera, rng, _noisy):
        shapes.append(z.shape)
        z = z.copy()
        z[:, :20] = 0  # a band to the left, in the sensor's own frame
        return z

    monkeypatch.setattr(sensors, "measure", measure)
    monkeypatch.setattr(augment, "_turns", lambda share, rng: numbers.append(len(numbers) % 4) or numbers[-1])
    settings = augment.Settings(no_colour=0.0, no_depth=0.0, sheets=0.0)
    bands = [np.s_[:, :20], np.s_[-20:], np.s_[:, -20:], np.s_[:20]]
    for number in range(8):
        x, ids = augment.sample(view, settings, rng(number))
        assert x.shape == (8, 192, 256) and ids.shape == (96, 128) and np.isfinite(x).all()
        assert (x[4][bands[number % 4]] == 0).all() and x[4].mean() > 0.5
    assert shapes == [(192, 256), (256, 192)] * 4


def test_a_share_of_the_samples_is_turned():
    turns = [augment._turns(0.25, rng(seed)) for seed in range(2000)]
    shares = np.bincount(turns, minlength=4) / 2000
    assert shares[0] == pytest.approx(0.75, abs=0.03) and shares[2] < 0.05 and min(shares[1], shares[3]) > 0.09
    assert augment._turns(0.0, rng()) == 0


def test_pictures_of_all_models_are_written(tmp_path):
    clutter.write(str(tmp_path / "scenes"), 2, seed=3)
    folder, out = str(tmp_path / "scenes"), tmp_path / "out"
    __main__.main([folder, "--out", str(out), "--real", folder, "--views", "1"])
    assert cv2.imread(str(out / "models-0.png")).shape == (4 * 240, 6 * 320, 3)
    assert cv2.imread(str(out / "scenes-0.png")).shape == (240, 3 * 320, 3)


def test_noisy_cameras_have_noise():
    drawn = [cameras.draw_noisy(rng(seed)) for seed in range(300)]
    assert {camera.kind for camera in drawn} == set(cameras.NOISY_SHARES)
    assert min(camera.strength for camera in drawn) >= cameras.NOISY
    noises = [camera.model.deviation for camera in drawn if camera.kind == "noise"]
    assert min(noises) > 0.007
