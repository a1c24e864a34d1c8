"""Strands from elsewhere become a hair tree: section 7.5 of the thesis.

Run `python examples/treeify.py [--out FILE]`. Above: strands, with a wave of each one's
own, and hair of trees made from them, grown from new roots. Below: a twentieth of the
strands, the hair that their tree grows, strands with bare patches, and these filled.
"""

import argparse
import pathlib

import jax
import numpy as np
from jaxtyping import Float
from sheet import PICTURES, Sheet, draw_curves, look_from, photograph

from hairfit.fit.fill_in import fill_in
from hairfit.fit.root_scalp import scalp_for
from hairfit.fit.treeify import Treeified, TreeifyConfig, treeify
from hairfit.model import HairTree, children, sample_strands
from hairfit.synthetic.gallery import make_gallery_tree, make_subject
from hairfit.types import Strands

SIZE = (330, 430)
POINTS = 64
LONG, SHORT = "bob", "buzz-cut"
# Bare patches in the short hair: so many, and how wide, in metres.
PATCHES, RADIUS = 9, 0.012
# Of the waves that strands have for themselves, in metres.
HEIGHT, LENGTH = 0.002, 0.03


def styled(name: str, count: int) -> Float[np.ndarray, "strands points 3"]:
    """Return the strands of a hairstyle of the gallery."""
    tree = make_gallery_tree(name)
    return np.asarray(sample_strands(tree, count, POINTS, jax.random.key(1)))


def waved(
    hair: Float[np.ndarray, "strands points 3"],
) -> Float[np.ndarray, "strands points 3"]:
    """Return the strands, each waved for itself."""
    count = len(hair)
    rng = np.random.default_rng(0)
    steps = np.linalg.norm(np.diff(hair, axis=1), axis=2)
    along = np.concatenate([np.zeros((count, 1)), np.cumsum(steps, axis=1)], axis=1)
    phase = rng.uniform(0.0, 2.0 * np.pi, (count, 1, 3))
    wave = np.sin(2.0 * np.pi * along[..., None] / LENGTH + phase) - np.sin(phase)
    return hair + HEIGHT * np.minimum(along / 0.03, 1.0)[..., None] * wave


def tree_of(hair: Float[np.ndarray, "strands points 3"], **config) -> Treeified:
    """Return the tree of strands."""
    strands = Strands.from_array(hair)
    return treeify(
        strands, scalp_for(make_subject().head, strands), TreeifyConfig(**config)
    )


def torn(
    hair: Float[np.ndarray, "strands points 3"],
) -> Float[np.ndarray, "strands points 3"]:
    """Return the strands without those that are rooted in patches."""
    roots, rng = hair[:, 0], np.random.default_rng(3)
    upper = roots[roots[:, 1] > np.quantile(roots[:, 1], 0.4)]
    kept = np.ones(len(hair), bool)
    for middle in upper[rng.choice(len(upper), PATCHES, replace=False)]:
        kept &= np.linalg.norm(roots - middle, axis=1) > RADIUS
    return hair[kept]


def main(out: pathlib.Path, strands: int = 16_000) -> None:
    """Draw the sheet.

    Args:
        out: The picture.
        strands: Number of strands.
    """
    camera = look_from(35.0, 24.0, SIZE, (-0.065, -0.09, -0.07), (0.065, 0.09, 0.07))
    sheet = Sheet(2, 4, SIZE)

    def show(title: str, tree: HairTree) -> None:
        hair = sample_strands(tree, strands, POINTS, jax.random.key(2))
        sheet.add(title, photograph(np.asarray(hair), camera))

    hair = waved(styled(LONG, strands))
    sheet.add(f"7.5: {strands} strands from elsewhere", photograph(hair, camera))
    few = tree_of(hair, leaves=30, wisps=0).tree
    axes = sheet.add("their 30 leaf clusters", photograph(hair, camera))
    leaf = np.arange(few.count)[len(children(few, -1)) :]
    skeletons = np.asarray(few.cylinder.skeleton)[leaf]
    draw_curves(axes, skeletons, camera, color="tab:orange", linewidth=1.2)
    show("grown from 30 leaf clusters", few)
    wisps = max(2, strands // 16)
    show(f"from 100, and {wisps} wisps", tree_of(hair, leaves=100, wisps=wisps).tree)
    part = hair[::20]
    sheet.add(f"fill-in: {len(part)} strands", photograph(part, camera))
    show(f"{strands} grown from their tree", tree_of(part).tree)
    patchy = torn(styled(SHORT, strands))
    sheet.add("strands with bare patches", photograph(patchy, camera))
    found = tree_of(patchy, leaves=100, wisps=wisps)
    show("filled", fill_in(found.tree, found.uv, 1.2 * RADIUS))
    sheet.save(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=PICTURES / "treeify.jpg")
    main(parser.parse_args().out)
