"""Types of the package and its examples, and the reference page that is made from it."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest
import splatseg
from conftest import ROOT

PACKAGE = Path(splatseg.__file__).parent
CONFIG = ROOT / "python/pyproject.toml"


def checked(*arguments):
    """What a module of mypy prints, and its exit code."""
    # Without installed packages that are not needed: types of the package itself are checked.
    environment = {**os.environ, "MYPY_CACHE_DIR": str(ROOT / "target/mypy")}
    ended = subprocess.run(
        [sys.executable, "-m", *arguments], capture_output=True, text=True, check=False, cwd=ROOT, env=environment
    )
    return ended.returncode, ended.stdout + ended.stderr


def test_types_of_package_and_examples():
    pytest.importorskip("mypy")
    examples = sorted(str(path) for path in (ROOT / "python/examples").glob("*.py"))
    code, text = checked("mypy", "--config-file", str(CONFIG), str(ROOT / "python/package/splatseg"), *examples)
    modules = [path for kind in ("py", "pyi") for path in (ROOT / "python/package/splatseg").rglob(f"*.{kind}")]
    assert code == 0 and f"no issues found in {len(modules) + len(examples)} source files" in text, text


def test_load_has_the_type_of_its_class(tmp_path):
    pytest.importorskip("mypy")
    (tmp_path / "loads.py").write_text("import splatseg as ss\nreveal_type(ss.FastSamSplat.load('map.ply'))\n")
    code, text = checked("mypy", "--config-file", str(CONFIG), str(tmp_path / "loads.py"))
    assert code == 0 and 'Revealed type is "splatseg.pipeline.FastSamSplat"' in text, text


def test_the_stub_fits_the_compiled_part():
    pytest.importorskip("mypy")
    code, text = checked("mypy.stubtest", "splatseg._splatseg", "--mypy-config-file", str(CONFIG))
    assert code == 0, text


def test_the_reference_page_is_current():
    script = ROOT / "tools/make_python_reference.py"
    spec = importlib.util.spec_from_file_location("make_python_reference", script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    page = module.reference()
    assert module.PAGE.read_text() == page, f"run python {script.relative_to(ROOT)}"
    for name in splatseg.__all__:
        if name not in ("rerun", "__version__"):
            assert f"\n### `ss.{name}`" in page, name
