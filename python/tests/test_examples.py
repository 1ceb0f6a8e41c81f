"""The examples run."""

import doctest
import importlib
import importlib.util
import inspect
import json
import pkgutil
import re
import subprocess
import sys

import numpy as np
import pytest
import splatseg as ss
from conftest import ROOT


def example(name):
    path = ROOT / "python/examples" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def python_blocks(document):
    """The blocks of Python code of a document."""
    return re.findall(r"```python\n(.*?)```", (ROOT / document).read_text(), re.DOTALL)


@pytest.mark.parametrize("document", ["README.md", "python/README.md"])
def test_the_first_example_of_a_readme(document, tmp_path):
    # With nothing but the package and NumPy: optional packages cannot be imported.
    optional = ("PIL", "matplotlib", "pandas", "rerun", "supervision", "tqdm")
    program = f"import sys; sys.modules.update(dict.fromkeys({optional}))\n{python_blocks(document)[0]}"
    ended = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60
    )
    assert ended.returncode == 0, ended.stderr
    assert len(ended.stdout.splitlines()) >= 30 and (tmp_path / "map.ply").stat().st_size > 10_000


def test_a_frame_of_a_camera(room):
    """The second example of the package's README."""
    frame = room[0]
    names = {"seg": ss.FastSamSplat(segmenter="graph"), "rgb": frame.rgb, "K": frame.K, "pose": frame.camera_to_world}
    names |= {"depth": np.round(frame.depth * 1000).astype(np.uint16), "time": 1.5}
    exec(python_blocks("python/README.md")[1], names)  # noqa: S102
    assert names["r"].timestamp == 1.5 and names["r"].objects


def test_examples_of_docstrings_with_their_results():
    finder, runner = doctest.DocTestFinder(), doctest.DocTestRunner()
    # Cameras, Rerun and Ray need packages of their own.
    names = [module.name for module in pkgutil.iter_modules(ss.__path__)]
    for name in sorted(set(names) - {"__main__", "_splatseg", "camera", "ros2_node"}):
        module = importlib.import_module(f"splatseg.{name}")
        for test in finder.find(module, extraglobs={"ss": ss}):
            runner.run(test)
    assert runner.failures == 0 and runner.tries >= 4


def test_examples_in_sentences_of_docstrings():
    """Calls of classes of the package, such as ``Graph(min_area=50)``. Files that they name are missing."""
    tried = 0
    for name in ss.__all__:
        text = inspect.getdoc(getattr(ss, name)) or ""
        for call in re.findall(r"``((?:ss\.)?[A-Z]\w+\([^`]*\))``", text):
            try:
                eval(call, {"ss": ss, **vars(ss)})
            except ValueError as error:
                assert "No such file" in str(error), (name, call, error)
            tried += 1
    assert tried >= 5


def test_own_segmenter():
    assert len(example("own_segmenter").main().objects()) >= 3


def test_live_camera():
    pipeline = example("live_camera").main()
    assert 1 <= pipeline.frames <= 30 and len(pipeline.objects()) >= 3


def test_coco_export(tmp_path):
    module = example("coco_export")
    module.main(out=tmp_path / "coco.json")
    coco = json.loads((tmp_path / "coco.json").read_text())
    assert len(coco["images"]) == 6
    for annotation in coco["annotations"]:
        counts = annotation["segmentation"]["counts"]
        assert sum(counts) <= 96 * 72 and sum(counts[1::2]) == annotation["area"]
    mask = np.array([[1, 0, 0], [1, 0, 1]], bool)
    assert module.run_lengths(mask) == {"size": [2, 3], "counts": [0, 2, 3, 1]}


def test_compare_methods(tmp_path):
    scores = example("compare_methods").main(plot=tmp_path / "plot.png")
    assert scores["fastsam-splat"].stq > scores["fastsam"].stq
    assert (tmp_path / "plot.png").stat().st_size > 5000


def test_name_objects(tmp_path):
    module = example("name_objects")
    pipeline = module.main()
    named = [entry for entry in pipeline.objects() if entry.label]
    assert named and {entry.label for entry in named} <= set(module.COLORS)
    found = pipeline.find(named[0].label, top=100)
    assert named[0].id in [entry.object.id for entry in found]
    pipeline.save(tmp_path / "map.ply")
    loaded = ss.FastSamSplat.load(tmp_path / "map.ply")
    assert [entry.object.id for entry in loaded.find(named[0].label, top=100)] == [entry.object.id for entry in found]
    with pytest.raises(ValueError, match="4 numbers"):
        loaded.find([1, 2, 3, 4])


def test_open3d_odometry():
    pytest.importorskip("open3d", exc_type=ImportError)
    module = example("open3d_odometry")
    poses = module.main(frames=10)
    true = [frame.camera_to_world for frame in ss.open_scene(module.DEMO, max_frames=10)]
    moved = (np.linalg.inv(true[0]) @ true[-1])[:3, 3]
    assert np.linalg.norm(moved) > 0.5
    assert np.linalg.norm(poses[-1][:3, 3] - moved) < 0.03
