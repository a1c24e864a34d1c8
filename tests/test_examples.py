"""Every example has its picture, and a page that shows both."""

import pathlib

import pytest

EXAMPLES = pathlib.Path(__file__).parent.parent / "examples"
PICTURES = EXAMPLES.parent / "docs" / "pictures"
NAMES = sorted(p.stem for p in EXAMPLES.glob("*.py") if p.stem != "sheet")


@pytest.mark.parametrize("name", NAMES)
def test_an_example_has_its_picture_in_the_documentation(name):
    assert (PICTURES / f"{name}.jpg").stat().st_size < 400_000
    pages = [p.read_text() for p in PICTURES.parent.glob("*.md")]
    assert any(f"pictures/{name}.jpg" in page for page in pages)
    assert any(f"examples/{name}.py" in page for page in pages)
