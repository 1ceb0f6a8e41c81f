"""Segmenters: Python's for the library, and the library's for Python."""

import gc
import weakref

import numpy as np
import pytest
import splatseg as ss
from conftest import step


def test_a_function_is_a_segmenter(room):
    """The same masks give the same ids, in any form."""
    graph = ss.Graph()
    frames = room[:4]
    masks = {frame.depth.tobytes(): graph(frame.rgb, frame.depth, frame.K) for frame in frames}
    forms = {
        "graph": "graph",
        "pair": lambda rgb, depth: masks[depth.tobytes()],
        "list of scores": lambda rgb, depth: (masks[depth.tobytes()][0], masks[depth.tobytes()][1].tolist()),
    }
    results = {name: [] for name in forms}
    for name, form in forms.items():
        pipeline = ss.FastSamSplat(segmenter=form)
        for frame in frames:
            results[name].append(step(pipeline, frame).ids)
    for name in forms:
        np.testing.assert_array_equal(results[name], results["graph"], err_msg=name)


def test_a_subclass_with_its_own_call_is_called(room):
    calls = []

    class Own(ss.Segmenter):
        def __call__(self, rgb, depth=None, K=None, **more):
            calls.append(depth.shape)
            return np.ones((1, *depth.shape), bool), [1.0]

    class Logged(ss.Graph):
        def __call__(self, *frame, **more):
            calls.append("graph")
            return super().__call__(*frame, **more)

    assert len(step(ss.FastSamSplat(segmenter=Own()), room[0]).objects) == 1
    assert calls == [room[0].depth.shape]
    found = step(ss.FastSamSplat(segmenter=Logged()), room[0])
    assert calls[1:] == ["graph"] and len(found.objects) > 1

    class Named(ss.Graph):
        """Only another name."""

    assert ss.FastSamSplat(segmenter=Named(min_area=50)).settings["graph"]["min_area"] == 50


def test_keywords_override_the_settings_of_a_segmenter():
    for keywords, expected in [
        ({"graph": {"max_pixels": 70_000}}, (50, 70_000)),
        ({"graph": {"min_area": 70}}, (70, 120_000)),
        ({"graph.min_area": 70}, (70, 120_000)),
        ({"graph": None}, (50, 120_000)),
    ]:
        settings = ss.FastSamSplat(segmenter=ss.Graph(min_area=50), **keywords).settings["graph"]
        assert (settings["min_area"], settings["max_pixels"]) == expected
    weights = ss.Affinity("nothing.safetensors")
    with pytest.raises(ValueError, match=r"other\.safetensors"):
        ss.FastSamSplat(segmenter=weights, weights="other.safetensors")


def test_a_function_may_return_ids(room):
    frame = room[0]
    halves = np.zeros(frame.depth.shape, np.int64)
    halves[:, :48], halves[:, 48:] = 7, 9
    stacked = np.stack([halves == 7, halves == 9])
    by_ids = step(ss.FastSamSplat(segmenter=lambda rgb, depth: halves), frame).ids
    by_masks = step(ss.FastSamSplat(segmenter=lambda rgb, depth: stacked), frame).ids
    np.testing.assert_array_equal(by_ids, by_masks)
    assert len(np.unique(by_ids)) >= 2
    nothing = ss.FastSamSplat(segmenter=lambda rgb, depth: np.zeros((0, *depth.shape), bool))
    assert step(nothing, frame).objects == []


def test_a_function_gets_the_frame(room):
    frame, given = room[0], []
    pipeline = ss.FastSamSplat(
        segmenter=lambda rgb, depth: given.append((rgb, depth)) or np.zeros(depth.shape, np.uint8)
    )
    step(pipeline, frame)
    rgb, depth = given[0]
    np.testing.assert_array_equal(rgb, frame.rgb)
    np.testing.assert_array_equal(depth, frame.depth)
    assert (rgb.dtype, depth.dtype) == (np.uint8, np.float32)


def test_a_segmenter_that_refers_to_its_pipeline_is_freed(room):
    class Own:
        def __init__(self):
            self.pipeline = ss.FastSamSplat(segmenter=self)

        def __call__(self, rgb, depth):
            # Its own pipeline is at hand, e.g. for the frame's number.
            return np.full(depth.shape, 1 + (self.pipeline is None), np.uint8)

    owns = [Own() for _ in range(3)]
    for own in owns:
        step(own.pipeline, room[0])
        gc.collect()
        assert len(step(own.pipeline, room[1]).objects) == 1, "what is in use stays"
    freed = [weakref.ref(own) for own in owns]
    del own, owns
    gc.collect()
    assert [reference() for reference in freed] == [None] * 3


class OwnError(Exception):
    pass


def raise_own(rgb, depth):
    raise OwnError("the network has failed")


@pytest.mark.parametrize(
    ("returned", "error", "message"),
    [
        (lambda depth: None, TypeError, "the segmenter's result is of type NoneType"),
        (lambda depth: [[1]], TypeError, "is of type list"),
        (lambda depth: np.zeros((5, 5), np.uint8), ValueError, "masks of 5x5 pixels, expected 96x72"),
        (lambda depth: np.zeros((2, 5, 5), bool), ValueError, "masks of 5x5 pixels, expected 96x72"),
        (lambda depth: np.zeros((2, *depth.shape), np.uint8), TypeError, "is an array of uint8"),
        (lambda depth: np.zeros(depth.shape, bool), TypeError, "is an array of bool"),
        (lambda depth: np.full(depth.shape, -1), ValueError, "has the id -1, expected 0 to 16777215"),
        (lambda depth: (np.zeros((2, *depth.shape), bool), [1.0]), ValueError, r"scores has shape \(1,\)"),
        (lambda depth: (np.zeros((2, *depth.shape), bool), [0.5, 90]), ValueError, "scores contains 90, expected 0 to 1"),
        (lambda depth: (np.zeros((1, *depth.shape), bool), [-0.1]), ValueError, "scores contains -0.1, expected 0 to 1"),
        (lambda depth: np.ma.zeros(depth.shape, int), TypeError, r"is a masked array.* pass array\.filled\(0\)"),
        (lambda depth: (1, 2, 3), ValueError, "a tuple of length 3"),
    ],
)
def test_wrong_results_of_a_function_are_told(room, returned, error, message):
    with pytest.raises(error, match=message):
        step(ss.FastSamSplat(segmenter=lambda rgb, depth: returned(depth)), room[0])


def test_scores_may_be_rounded(room):
    def segmenter(rgb, depth):
        return np.ones((1, *depth.shape), bool), np.float32([1.0000001])

    assert step(ss.FastSamSplat(segmenter=segmenter), room[0]).objects[0].confidence <= 1


def test_settings_of_other_segmenters_are_refused_with_a_function(tmp_path):
    def segmenter(rgb, depth):
        return np.zeros(depth.shape, int)

    for unused, name in [
        ({"affinity": {"min_area": 7}}, "affinity.min_area"),
        ({"graph": {"min_area": 7}}, "graph.min_area"),
        ({"weights": "nope.pt"}, "weights"),
        ({"detail": "fine"}, "detail"),
        ({"device": "cpu"}, "device"),
        ({"masks": "nope"}, "masks"),
    ]:
        with pytest.raises(ValueError, match=rf"{name} is not used here: .* but segmenter is a function"):
            ss.FastSamSplat(segmenter=segmenter, **unused)
    settings = ss.FastSamSplat(segmenter=segmenter, memory={"max_votes": 3}, min_area=7).settings
    assert (settings["segmenter"], settings["memory"]["max_votes"], settings["min_area"]) == ("python", 3, 7)
    assert not {"affinity", "graph", "weights", "detail", "device"} & set(settings)
    (tmp_path / "run.toml").write_text("seed = 4\n[affinity]\nmin_area = 70\n")
    settings = ss.FastSamSplat(segmenter=segmenter, config=tmp_path / "run.toml").settings
    assert settings["seed"] == 4 and "affinity" not in settings


def test_exceptions_of_a_function_come_through(room):
    pipeline = ss.FastSamSplat(segmenter=raise_own)
    with pytest.raises(OwnError, match="the network has failed"):
        step(pipeline, room[0])


def test_segmenters_of_the_library_can_be_called(room):
    frame = room[0]
    masks, scores = ss.Graph(min_area=20)(frame.rgb, frame.depth, frame.K)
    assert masks.dtype == bool and masks.shape[1:] == frame.depth.shape and scores.shape == (len(masks),)
    assert masks.any(axis=(1, 2)).all()
    assert "min_area=20" in repr(ss.Graph(min_area=20))
    masks, scores = ss.Affinity(min_area=20)(frame.rgb, frame.depth, frame.K)
    assert masks.dtype == bool and masks.any(axis=(1, 2)).all() and scores.shape == (len(masks),)
    with pytest.raises(ValueError, match=r"nothing\.safetensors"):
        ss.Affinity("nothing.safetensors")(frame.rgb)
    with pytest.raises(TypeError, match=r"there is no setting graph\.min_aria, did you mean graph\.min_area"):
        ss.Graph(min_aria=20)
    with pytest.raises(ValueError, match=r"fastsam\.confidence is 2"):
        ss.FastSam("nothing.pt", confidence=2)
    with pytest.raises(ValueError, match=r"nothing\.pt"):
        ss.FastSam("nothing.pt")(frame.rgb)
