"""Writes all masks as a COCO file with one `track_id` for each object.

    python coco_export.py [SCENE] [FILE.json]

`splatseg run --save-coco` writes the same for a recorded scene; this example is for frames from a program.
"""

import json
import sys

import numpy as np
import splatseg as ss


def run_lengths(mask):
    """An uncompressed RLE: lengths of runs down the columns, starting with pixels outside the mask."""
    pixels = np.concatenate([[0], mask.ravel(order="F").astype(np.int8), [0]])
    changes = np.flatnonzero(np.diff(pixels))
    ends = np.concatenate([[0], changes, [mask.size]])
    counts = np.diff(ends)
    return {"size": list(mask.shape), "counts": counts[: len(counts) - (counts[-1] == 0)].tolist()}


def main(scene="synthetic:frames=6,width=96,height=72,objects=6", out="coco.json"):
    pipeline = ss.FastSamSplat()
    images, annotations = [], []
    for number, frame in enumerate(ss.open_scene(scene), start=1):
        result = pipeline.step(frame.rgb, frame.depth, K=frame.K, camera_to_world=frame.camera_to_world)
        height, width = result.ids.shape
        images.append({"id": number, "file_name": f"{frame.name}.jpg", "width": width, "height": height, "video_id": 1})
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
