"""Every example runs, in small form, and writes its picture."""

import importlib.util
import inspect
import pathlib
import sys

import numpy as np
import pytest

from hairfit.capture.photos import read_photo

EXAMPLES = pathlib.Path(__file__).parent.parent / "examples"
PICTURES = EXAMPLES.parent / "docs" / "pictures"
NAMES = sorted(p.stem for p in EXAMPLES.glob("*.py") if p.stem != "sheet")
# What makes each smaller than the picture in the documentation.
SMALL = {
    "braid": {"strands": 300, "height": 200},
    "combing": {"strands": 200},
    "editing": {"strands": 400},
    "four_steps": {"strands": 600, "copies": 2},
    "fur": {"hairs": 400},
    "gallery": {"strands": 200, "names": ("buzz-cut",)},
    "level_of_detail": {"strands": 300},
    "penetration": {"strands": 300},
    "subdivision": {"strands": 800, "children": 3},
    "transfer": {"strands": 300},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_an_example_draws_its_picture(name, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLES))
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, name, module)
    spec.loader.exec_module(module)
    assert set(SMALL.get(name, {})) <= set(inspect.signature(module.main).parameters)
    module.main(tmp_path / f"{name}.jpg", **SMALL.get(name, {}))
    picture = read_photo(tmp_path / f"{name}.jpg")
    assert np.ptp(picture) > 0.5


@pytest.mark.parametrize("name", NAMES)
def test_an_example_has_its_picture_in_the_documentation(name):
    assert (PICTURES / f"{name}.jpg").stat().st_size < 400_000
    pages = [p.read_text() for p in PICTURES.parent.glob("*.md")]
    assert any(f"pictures/{name}.jpg" in page for page in pages)
    assert any(f"examples/{name}.py" in page for page in pages)
