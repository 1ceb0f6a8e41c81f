"""Your own segmenter: any function from a picture to masks.

    python own_segmenter.py [SCENE]

This one cuts the picture where depth or colour changes, in a few lines of NumPy. A PyTorch network can be used in the
same way.
"""

import sys

import numpy as np
import splatseg as ss
from numpy.typing import NDArray


def cut_at_edges(rgb: NDArray[np.uint8], depth: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Ids of the parts separated by depth and colour edges, ``(height, width)``."""
    edges = depth == 0
    for axis in (0, 1):
        depth_step = np.abs(np.diff(depth, axis=axis, append=np.take(depth, [-1], axis)))
        colors = rgb.astype(np.int16)
        color_step = np.abs(np.diff(colors, axis=axis, append=np.take(colors, [-1], axis))).sum(axis=2)
        edges |= (depth_step > 0.05 * depth) | (color_step > 60)
    ids = np.where(edges, 0, np.arange(1, depth.size + 1).reshape(depth.shape))
    while True:  # Every pixel takes the largest neighbouring id until nothing changes.
        padded = np.pad(ids, 1)
        beside = np.maximum.reduce([padded[1:-1, :-2], padded[1:-1, 2:], padded[:-2, 1:-1], padded[2:, 1:-1], ids])
        spread = np.where(ids > 0, beside, 0)
        if (spread == ids).all():
            break
        ids = spread
    values, inverse, areas = np.unique(ids, return_inverse=True, return_counts=True)
    large = np.where((values > 0) & (areas > 50), np.cumsum((values > 0) & (areas > 50)), 0)
    return large[inverse].reshape(depth.shape).astype(np.uint16)


def main(scene: str = "synthetic:frames=12,width=96,height=72,objects=6") -> ss.Pipeline:
    pipeline = ss.FastSamSplat(segmenter=cut_at_edges)
    for result in pipeline.run(scene):
        print(result.name, [sighting.id for sighting in result.objects])
    return pipeline


if __name__ == "__main__":
    main(*sys.argv[1:])
