#!/usr/bin/env python3
"""Writes gsplat's results for small scenes of Gaussians, for `crates/render/tests/it/golden.rs`.

    pip install torch gsplat==1.5.3 safetensors numpy        # in a virtual environment; needs no GPU
    python tools/make_raster_test_data.py crates/render/tests/data
    python tools/make_raster_test_data.py --check FILE [PREFIX]   # renders a file's inputs and compares with its outputs

Projection uses gsplat's own PyTorch code, in float64. gsplat's index kernel exists only in CUDA, so blending is
reimplemented here, pixel by pixel, as `gsplat.rasterization` (classic mode, no background) defines it: alpha =
min(0.999, opacity · exp(-sigma)), skipped below 1/255. A pixel is finished when its transmittance would fall to 1e-4;
the Gaussian that would cause it is not blended. Outputs are rounded to float32. Pixels where float32 may take another
branch are marked in `fragile`.

    scene1  300 anisotropic Gaussians; scene1_grads has the gradients of a weighted sum of its colours and features
    scene2  one Gaussian per pixel of a depth image, from its own view (`same.`) and another one (`moved.`)

`scene3.safetensors`, 35 edge cases, was made in the same way; `--check` confirms it.
"""

import argparse
import sys
from pathlib import Path

import numpy
import torch
from gsplat.cuda._torch_impl import _fully_fused_projection, _quat_scale_to_covar_preci
from safetensors.numpy import load_file, save_file

FEATURES = 28
MIN_ALPHA = 1 / 255
MIN_TRANSMITTANCE = 1e-4


def project(scene, viewmat):
    """gsplat's projection, float64: means2d, conics, depths, radii by its torch and by its CUDA rule."""
    def tensor(name):
        return torch.from_numpy(scene[name].astype(numpy.float64))

    width, height = scene["width_height"]
    quats = torch.nn.functional.normalize(tensor("quats"), dim=-1)
    covars, _ = _quat_scale_to_covar_preci(quats, tensor("scales"), True, False)
    viewmats = torch.from_numpy(viewmat.astype(numpy.float64))[None]
    radii, means, depths, conics, _ = _fully_fused_projection(
        tensor("means"), covars, viewmats, tensor("K")[None], int(width), int(height)
    )
    radii, means, depths, conics = (part[0].numpy() for part in (radii, means, depths, conics))
    in_range = (depths > 0.01) & (depths < 1e10)
    means, conics = (numpy.where(in_range[:, None], part, 0) for part in (means, conics))
    # The CUDA kernel's box ends where alpha falls below 1/255.
    opacities = scene["opacities"].astype(numpy.float64)
    reach = numpy.minimum(3.33, numpy.sqrt(2 * numpy.log(numpy.maximum(opacities / MIN_ALPHA, 1))))
    determinants = conics[:, 0] * conics[:, 2] - conics[:, 1] ** 2
    with numpy.errstate(divide="ignore", invalid="ignore"):
        variances = numpy.nan_to_num(conics[:, [2, 0]] / determinants[:, None], posinf=0)
    boxes = numpy.ceil(reach[:, None] * numpy.sqrt(variances))
    outside = ((means + boxes <= 0) | (means - boxes >= scene["width_height"])).any(axis=1)
    boxes[outside | (opacities < MIN_ALPHA) | ~in_range] = 0
    return means, conics, depths, radii, boxes


def blend(scene, projected, max_alpha=0.999):
    """Blend weights [pixels, N] in float64 and, per pixel, the number of blended Gaussians, the last of them, and the
    fragile flag."""
    means, conics, depths, radii, _ = projected
    width, height = (int(side) for side in scene["width_height"])
    rows, columns = numpy.mgrid[:height, :width] + 0.5
    pixels = numpy.stack([columns.ravel(), rows.ravel()], axis=-1)
    count = len(pixels)
    weights = numpy.zeros((count, len(depths)))
    light = numpy.ones(count)
    finished, fragile = numpy.zeros(count, bool), numpy.zeros(count, bool)
    counts, last = numpy.zeros(count, numpy.int32), numpy.full(count, -1, numpy.int32)
    visible = numpy.flatnonzero((radii > 0).all(axis=1))
    order = visible[numpy.argsort(depths[visible].astype(numpy.float32), kind="stable")]
    for index in order:
        dx, dy = (means[index] - pixels).T
        a, b, c = conics[index]
        sigma = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy
        alpha = numpy.minimum(max_alpha, scene["opacities"][index] * numpy.exp(-numpy.maximum(sigma, 0)))
        after = light * (1 - alpha)
        open_ = ~finished & (sigma >= 0)
        fragile |= open_ & (numpy.abs(alpha - MIN_ALPHA) < 2e-4 * MIN_ALPHA)
        blended = open_ & (alpha >= MIN_ALPHA)
        fragile |= blended & (numpy.abs(after - MIN_TRANSMITTANCE) < 1e-3 * MIN_TRANSMITTANCE)
        ends = blended & (after <= MIN_TRANSMITTANCE)
        finished |= ends
        blended &= ~ends
        weights[blended, index] = (alpha * light)[blended]
        light[blended] = after[blended]
        counts[blended] += 1
        last[blended] = index
    return weights, light, counts, last, fragile


def images(scene, projected, max_alpha=0.999):
    """All rendered images, float64 [height, width(, channels)]."""
    weights, light, counts, last, fragile = blend(scene, projected, max_alpha)
    width, height = (int(side) for side in scene["width_height"])
    shaped = {
        "color": weights @ scene["colors"].astype(numpy.float64),
        "feature": weights @ scene["features"].astype(numpy.float64),
        "alpha": 1 - light,
        "depth_acc": weights @ numpy.where(weights.any(axis=0), projected[2], 0),
        "n_contrib": counts,
        "last_id": last,
        "fragile": fragile.astype(numpy.uint8),
    }
    return {name: image.reshape(height, width, *image.shape[1:]) for name, image in shaped.items()}, weights


def view(scene, prefix, viewmat):
    """Projection and images of one view, named with the prefix, and the blend weights."""
    projected = project(scene, viewmat)
    rendered, weights = images(scene, projected)
    means, conics, depths, _, boxes = projected
    named = {"inter.means2d": means, "inter.conics": conics, "inter.depths": depths, "inter.radii_opacity": boxes}
    named |= {f"out.{name}": image for name, image in rendered.items()}
    return {f"{prefix}{name}": values for name, values in ({"viewmat": viewmat} | named).items()}, weights


def camera(position, turn_degrees):
    """World to camera, rotated about the y axis."""
    angle = numpy.deg2rad(turn_degrees)
    rotation = numpy.array(
        [[numpy.cos(angle), 0, -numpy.sin(angle)], [0, 1, 0], [numpy.sin(angle), 0, numpy.cos(angle)]]
    )
    matrix = numpy.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = -rotation @ position
    return matrix.astype(numpy.float32)


def scene1(random):
    count, width, height = 300, 48, 36
    scene = {
        "means": random.uniform([-2.2, -1.7, 1.5], [2.2, 1.7, 6.0], (count, 3)),
        "quats": random.normal(size=(count, 4)) * random.uniform(0.5, 2.0, (count, 1)),
        "scales": numpy.exp(random.uniform(numpy.log(0.02), numpy.log(0.4), (count, 3))),
        "opacities": random.uniform(0.05, 1.0, count),
        "colors": random.uniform(0, 1, (count, 3)),
        "features": random.normal(size=(count, FEATURES)) / numpy.sqrt(FEATURES),
        "K": numpy.array([[44.0, 0, 24.3], [0, 43.0, 17.6], [0, 0, 1]]),
    }
    scene = {name: values.astype(numpy.float32) for name, values in scene.items()}
    scene["width_height"] = numpy.array([width, height], numpy.int32)
    rendered, weights = view(scene, "", camera([0.3, -0.2, -0.4], 8))
    gradients = {}
    for name, channels in (("feature", FEATURES), ("color", 3)):
        weight = random.normal(size=(height, width, channels)).astype(numpy.float32)
        # A fragile pixel may blend one Gaussian more or less, so its weight in the loss is 0.
        weight[rendered["out.fragile"] > 0] = 0
        gradients[f"weight.{name}"] = weight
        gradients[f"grad.{name}s"] = weights.T @ weight.reshape(-1, channels).astype(numpy.float64)
    return scene | rendered, gradients


def scene2(random):
    width, height, focal = 25, 20, 23.0
    center = numpy.array([width / 2 + 0.2, height / 2 - 0.3])
    rows, columns = numpy.mgrid[:height, :width]
    # A wall that recedes to the right, and a box in front of it.
    depth = 2.6 + 0.05 * columns + 0.03 * rows + random.uniform(0, 0.02, (height, width))
    depth[6:15, 8:17] = 1.4 + 0.01 * rows[6:15, 8:17]
    depth = depth.astype(numpy.float32)
    rays = numpy.stack([(columns + 0.5 - center[0]) / focal, (rows + 0.5 - center[1]) / focal, numpy.ones_like(depth)])
    count = width * height
    opacities = random.uniform(0.97, 1.0, count)
    opacities[random.uniform(size=count) < 0.15] = 1
    scene = {
        "means": (rays * depth).reshape(3, -1).T,
        "quats": numpy.tile([1.0, 0, 0, 0], (count, 1)),
        "scales": numpy.repeat(depth.reshape(-1, 1) / focal, 3, axis=1),
        "opacities": opacities,
        "colors": random.uniform(0, 1, (count, 3)),
        "features": random.normal(size=(count, FEATURES)) / numpy.sqrt(FEATURES),
        "K": numpy.array([[focal, 0, center[0]], [0, focal, center[1]], [0, 0, 1]]),
    }
    scene = {name: values.astype(numpy.float32) for name, values in scene.items()}
    scene["width_height"] = numpy.array([width, height], numpy.int32)
    result = dict(scene)
    for prefix, viewmat in (("same.", numpy.eye(4, dtype=numpy.float32)), ("moved.", camera([0.25, 0.0, 0.0], 9))):
        rendered, weights = view(scene, prefix, viewmat)
        weight = random.normal(size=(height, width, FEATURES)).astype(numpy.float32)
        weight[rendered[f"{prefix}out.fragile"] > 0] = 0
        capped, _ = images(scene, project(scene, viewmat), max_alpha=0.99)
        result |= rendered
        result |= {f"{prefix}out_max099.{name}": capped[name] for name in ("color", "fragile")}
        result[f"{prefix}grad.weight"] = weight
        result[f"{prefix}grad.features"] = weights.T @ weight.reshape(count, FEATURES).astype(numpy.float64)
    return result


def save(path, tensors):
    def stored(name, values):
        if name.endswith(("n_contrib", "last_id", "radii_opacity")):
            return numpy.ascontiguousarray(values, numpy.int32)
        return numpy.ascontiguousarray(values, numpy.float32 if values.dtype.kind == "f" else values.dtype)

    save_file({name: stored(name, values) for name, values in tensors.items()}, path)
    print(path, path.stat().st_size, "bytes")


def check(path, prefix):
    """Prints the largest differences between a file's outputs and those computed from its inputs."""
    scene = load_file(path)
    rendered, _ = view(scene, prefix, scene[f"{prefix}viewmat"])
    stable = scene[f"{prefix}out.fragile"] == 0
    for name in ("color", "feature", "alpha", "depth_acc", "n_contrib", "last_id"):
        found, expected = rendered[f"{prefix}out.{name}"], scene[f"{prefix}out.{name}"]
        difference = numpy.abs(found[stable] - expected[stable]) / numpy.maximum(1, numpy.abs(expected[stable]))
        print(f"{prefix}out.{name}: off by {difference.max():.1e}")
    for name in ("means2d", "conics", "radii_opacity"):
        found, expected = rendered[f"{prefix}inter.{name}"], scene[f"{prefix}inter.{name}"]
        print(f"{prefix}inter.{name}: off by {numpy.abs(found - expected).max():.1e}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--check", nargs="+", metavar=("FILE", "PREFIX"))
    arguments = parser.parse_args()
    if arguments.check:
        return check(arguments.check[0], arguments.check[1] if len(arguments.check) > 1 else "")
    if not arguments.folder:
        parser.error("a folder is needed")
    random = numpy.random.default_rng(1)
    scene, gradients = scene1(random)
    save(arguments.folder / "scene1.safetensors", scene)
    save(arguments.folder / "scene1_grads.safetensors", gradients)
    save(arguments.folder / "scene2.safetensors", scene2(random))


if __name__ == "__main__":
    sys.exit(main())
