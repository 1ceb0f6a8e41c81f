"""Checks a file of `splatseg run --save-coco` with pycocotools: it must load, and its masks must equal the id images.

pip install pycocotools pillow numpy
python tools/check_coco.py masks.json out
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image
from pycocotools.coco import COCO


def check(coco_file: Path, run_folder: Path) -> int:
    """Compares all masks; returns their number."""
    coco = COCO(str(coco_file))
    segments = run_folder / "segments"
    assert len(coco.imgs) == len(list(segments.glob("*.png"))), "not every frame is in the file"
    for image in coco.imgs.values():
        ids = np.asarray(Image.open(segments / Path(image["file_name"]).with_suffix(".png")))
        assert ids.shape == (image["height"], image["width"]), image
        annotations = coco.loadAnns(coco.getAnnIds(imgIds=image["id"]))
        assert {annotation["track_id"] for annotation in annotations} == set(np.unique(ids)) - {0}, image
        for annotation in annotations:
            mask = coco.annToMask(annotation).astype(bool)
            assert (mask == (ids == annotation["track_id"])).all(), annotation["id"]
            rows, columns = mask.nonzero()
            left, top = columns.min(), rows.min()
            box = [left, top, columns.max() + 1 - left, rows.max() + 1 - top]
            assert annotation["bbox"] == box and annotation["area"] == mask.sum(), annotation["id"]
            assert 0 <= annotation["score"] <= 1 and annotation["category_id"] in coco.cats, annotation["id"]
    return len(coco.anns)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    print(check(Path(sys.argv[1]), Path(sys.argv[2])), "masks equal those of the images")
