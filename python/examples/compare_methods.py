"""Compares two methods on one scene, with a plot of the number of ids that each has assigned.

pip install matplotlib
python compare_methods.py [SCENE] [PLOT.png]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
import splatseg as ss
from numpy.typing import NDArray

METHODS = ["fastsam-splat", "fastsam"]


def save_ids(ids: NDArray[np.uint32], path: Path) -> None:
    """Writes an id image in the format that `splatseg eval` reads."""
    from PIL import Image

    Image.fromarray(ids.astype("uint16")).save(path)


def main(
    scene: str = "synthetic:frames=20,width=96,height=72,objects=6", plot: str | Path = "methods.png"
) -> dict[str, ss.Scores]:
    curves: dict[str, list[int]] = {}
    scores: dict[str, ss.Scores] = {}
    for method in METHODS:
        pipeline = ss.Pipeline(method)
        seen: set[int] = set()
        curves[method] = []
        with tempfile.TemporaryDirectory() as folder:
            for result in pipeline.run(scene):
                seen |= {sighting.id for sighting in result.objects}
                curves[method].append(len(seen))
                save_ids(result.ids, Path(folder) / f"{result.name}.png")
            scores[method] = ss.evaluate(scene, folder, protocol="strict")
        print(f"{method}: {len(seen)} ids, VSQ {scores[method].vsq:.1f}, STQ {scores[method].stq:.1f}")
    draw(curves, plot)
    return scores


def draw(curves: dict[str, list[int]], plot: str | Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    for method, curve in curves.items():
        pyplot.plot(range(1, len(curve) + 1), curve, label=method)
    pyplot.xlabel("frames")
    pyplot.ylabel("ids so far")
    pyplot.legend()
    pyplot.savefig(plot)


if __name__ == "__main__":
    main(*sys.argv[1:])
