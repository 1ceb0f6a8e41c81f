"""Writes all masks as a COCO file with one `track_id` for each object.

    python coco_export.py [SCENE] [FILE.json]

`splatseg run --save-coco` writes the same for a recorded scene; this example is for frames from a program.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import splatseg as ss
from numpy.typing import NDArray


def run_lengths(mask: NDArray[np.bool_]) -> dict[str, Any]:
    """An uncompressed RLE: lengths of runs down the columns, starting with pixels outside the mask."""
    pixels = np.concatenate([[0], mask.ravel(order="F").astype(np.int8), [0]])
    changes = np.flatnonzero(np.diff(pixels))
    ends = np.concatenate([[0], changes, [mask.size]])
    counts = np.diff(ends)
    return {"size": list(mask.shape), "counts": counts[: len(counts) - (counts[-1] == 0)].tolist()}


def main(scene: str = "synthetic:frames=6,width=96,height=72,objects=6", out: str | Path = "coco.json") -> None:
    pipeline = ss.FastSamSplat()
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for number, result in enumerate(pipeline.run(scene), start=1):
        height, width = result.ids.shape
        images.append(
            {"id": number, "file_name": f"{result.name}.jpg", "width": width, "height": height, "video_id": 1}
        )
        for sighting, mask in zip(result.objects, result.masks, strict=True):
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": number,
                    "category_id": 1,
                    "track_id": sighting.id,
                    "segmentation": run_lengths(mask),
                    "area": sighting.area,
                    "bbox": list(sighting.bounding_box),
                    "iscrowd": 0,
                    "score": sighting.confidence,
                }
            )
    categories = [{"id": 1, "name": "object", "supercategory": "object"}]
    with open(out, "w") as file:
        json.dump({"images": images, "annotations": annotations, "categories": categories}, file)
    print(f"{len(annotations)} masks of {len({entry['track_id'] for entry in annotations})} objects in {out}")


if __name__ == "__main__":
    main(*sys.argv[1:])
