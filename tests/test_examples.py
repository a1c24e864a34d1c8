"""Every example has its picture, a page that shows both, and still draws it."""

import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

EXAMPLES = pathlib.Path(__file__).parent.parent / "examples"
PICTURES = EXAMPLES.parent / "docs" / "pictures"
NAMES = sorted(p.stem for p in EXAMPLES.glob("*.py") if p.stem != "sheet")
# What `main` is called with, so that an example takes seconds.
SMALL = {
    "antialiasing": "strands=800",
    "braid": "strands=300",
    "combing": "strands=400",
    "editing": "strands=400",
    "four_steps": "strands=600, copies=8",
    "fur": "hairs=4000",
    "gallery": "strands=400, names=('bob', 'braid', 'afro')",
    "level_of_detail": "strands=600",
    "penetration": "strands=600",
    "phase_functions": "rays=200_000",
    "render": "strands=2500",
    "selection": "",
    "shadows": "strands=800, hairs=3000",
    "subdivision": "strands=800, children=3",
    "transfer": "strands=800",
    "treeify": "strands=1500",
}
# Of the small picture with that of the documentation, both 64 pixels wide.
LEAST_CORRELATION = 0.6


def thumbnail(path: pathlib.Path, size: tuple[int, int]):
    with Image.open(path) as picture:
        return np.asarray(picture.convert("L").resize(size), float).ravel()


@pytest.mark.parametrize("name", NAMES)
def test_an_example_has_its_picture_in_the_documentation(name):
    assert (PICTURES / f"{name}.jpg").stat().st_size < 400_000
    pages = [p.read_text() for p in PICTURES.parent.glob("*.md")]
    assert any(f"pictures/{name}.jpg" in page for page in pages)
    assert any(f"examples/{name}.py" in page for page in pages)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_an_example_in_small_form_draws_the_picture_of_the_documentation(
    name, tmp_path
):
    out = tmp_path / "small.jpg"
    code = (
        f"import pathlib, sys; sys.path.insert(0, sys.argv[1]); import {name}; "
        f"{name}.main(pathlib.Path(sys.argv[2]), {SMALL[name]})"
    )
    # Examples run as users run them: in float32 and without the strict rules of tests.
    done = subprocess.run(
        [sys.executable, "-c", code, str(EXAMPLES), str(out)],
        env=os.environ,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    picture = PICTURES / f"{name}.jpg"
    with Image.open(out) as drawn, Image.open(picture) as shown:
        sizes = drawn.size, shown.size
    if name == "gallery":  # some of its styles only
        assert thumbnail(out, (64, 64)).std() > 20.0
    else:
        assert sizes[0] == sizes[1]
        size = (64, round(64 * sizes[1][1] / sizes[1][0]))
        small, whole = thumbnail(out, size), thumbnail(picture, size)
        assert np.corrcoef(small, whole)[0, 1] > LEAST_CORRELATION
