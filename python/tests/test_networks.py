"""FastSAM and SAM 2.1, with the small checkpoints of `../shared`."""

import numpy as np
import pytest
import splatseg as ss
from conftest import ROOT, step

FASTSAM = ROOT.parent / "shared/models/fastsam-rooms-n.pt"
SAM2 = ROOT.parent / "shared/golden/sam2/sam2_mini.pt"


def needs(path):
    return pytest.mark.skipif(not path.exists(), reason=f"{path.name} is not in ../shared")


@needs(SAM2)
def test_objects_are_prompted_and_followed(room):
    sam = ss.Sam2(SAM2)
    with pytest.raises(ValueError, match="call step first"):
        sam.add_clicks(1, [[5, 5]])
    assert sam.step(room[0].rgb).ids == []
    truth = room[0].ground_truth
    largest = truth == np.bincount(truth[truth > 0]).argmax()
    mask = sam.add_mask(3, largest)
    assert (mask & largest).sum() > 0.9 * (mask | largest).sum()
    one = sam.add_clicks(9, [[48, 36]])
    assert (sam.add_clicks(9, [[10, 10]], [0], more=True) != one).any()
    assert sam.add_box(8, [10, 10, 40, 40]).shape == truth.shape
    tracks = sam.step(room[1].rgb)
    assert (tracks.ids, tracks.masks.shape, tracks.masks.dtype) == ([3, 8, 9], (3, *truth.shape), bool)
    # The checkpoint is untrained, so the position of the masks is meaningless.
    np.testing.assert_array_equal(tracks[9], tracks.masks[2])
    sam.remove(8)
    assert sam.step(room[2].rgb).ids == [3, 9]
    for prompt, error, message in [
        (lambda: sam.add_mask(1, truth), TypeError, "mask is an array of uint32"),
        (lambda: sam.add_mask(1, np.zeros((5, 5), bool)), ValueError, "5x5 pixels"),
        (lambda: sam.add_clicks(1, [[500, 5]]), ValueError, r"point \(500, 5\)"),
        (lambda: sam.add_clicks(1, [[5, 5]], [3]), ValueError, "labels contains 3"),
        (lambda: sam.add_clicks(1, [5, 5]), ValueError, r"points has shape \(2,\)"),
        (lambda: ss.Sam2(SAM2, image_sizes=3), TypeError, r"did you mean sam2\.image_size"),
    ]:
        with pytest.raises(error, match=message):
            prompt()


@needs(SAM2)
def test_sam2_splat(room):
    pipeline = ss.Sam2Splat(SAM2, segmenter="graph")
    for frame in room[:3]:
        result = step(pipeline, frame)
    assert result.masks.shape == (len(result.objects), *room[0].depth.shape) and len(result.objects) > 2
    assert len(pipeline.memory) > 100


@needs(FASTSAM)
def test_fastsam(room):
    segmenter = ss.FastSam(FASTSAM, image_size=320)
    masks, scores = segmenter(room[0].rgb)
    assert masks.shape == (len(scores), *room[0].depth.shape)
    by_object, by_name = (
        ss.FastSamSplat(segmenter),
        ss.FastSamSplat("fastsam", weights=FASTSAM, fastsam={"image_size": 320}),
    )
    for frame in room[:3]:
        np.testing.assert_array_equal(step(by_object, frame).ids, step(by_name, frame).ids)
