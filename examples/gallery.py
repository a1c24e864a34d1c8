"""The gallery of hairstyles: stands for figures 4-24 to 4-27 of the thesis.

Run `python examples/gallery.py [--out FILE]`. With `--each FOLDER`, each style is
written as a small picture of its own, too.
"""

import argparse
import pathlib
from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import UInt8
from sheet import PICTURES, Sheet, look_from, photograph

from hairfit.model import sample_strands
from hairfit.synthetic.gallery import GALLERY, make_gallery_tree

POINTS = 96
# Where each style is seen from, in degrees; the others from half left.
VIEWS = {
    "bun": 125.0,
    "braid": 155.0,
    "ponytail": 115.0,
    "mohawk": 50.0,
    "undercut": 40.0,
    "fringe": 20.0,
    "pigtails": 15.0,
    "parted": 20.0,
    "afro": 15.0,
}
SHOT = (700, 800)
CROP = (slice(118, 690), slice(140, 560))


def thumbnail(name: str, strands: int) -> UInt8[np.ndarray, "height width 3"]:
    """Return a picture of one style of the gallery."""
    tree = make_gallery_tree(name)
    hair = np.asarray(sample_strands(tree, strands, POINTS, jax.random.key(1)))
    low, high = (-0.14, -0.26, -0.16), (0.14, 0.17, 0.15)
    camera = look_from(VIEWS.get(name, 35.0), 8.0, SHOT, low, high)
    return photograph(hair, camera)[CROP]


def main(
    out: pathlib.Path,
    strands: int = 9_000,
    names: Sequence[str] = GALLERY,
    each: pathlib.Path | None = None,
) -> None:
    """Draw the sheet of thumbnails.

    Args:
        out: Where to write it.
        strands: Number of strands of each style.
        names: Which styles.
        each: Folder for one small picture of each style; None for no such pictures.
    """
    sheet = Sheet(-(-len(names) // 4), min(len(names), 4), (215, 293))
    for name in names:
        picture = thumbnail(name, strands)
        sheet.add(name, picture)
        if each is not None:
            alone = Sheet(1, 1, (170, 232))
            alone.add(name, picture)
            alone.save(each / f"{name}.jpg")
    caption = "A gallery of hairstyles, for figures 4-24 to 4-27"
    sheet.figure.text(0.5, 0.004, caption, ha="center", va="bottom", fontsize=8)
    sheet.save(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=PICTURES / "gallery.jpg")
    parser.add_argument("--each", type=pathlib.Path)
    given = parser.parse_args()
    main(given.out, each=given.each)
