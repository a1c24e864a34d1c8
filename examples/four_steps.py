"""Multiresolution design in four steps: figure 4-1 of the thesis.

Run `python examples/four_steps.py [--out FILE]`. A rough hairstyle of 30 clusters; one
of them is subdivided and curled; the curly cluster is copied onto others; the bang
cluster is subdivided and refined.
"""

import argparse
import dataclasses
import functools
import pathlib
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.patches import Ellipse
from sheet import PICTURES, Sheet, look_from, photograph

from hairfit.model import (
    HairTree,
    catmull_rom_weights,
    children,
    cluster,
    resample,
    sample_strands,
    take,
)
from hairfit.model.collide import DistanceField, push_out_strands, sample_field
from hairfit.model.edit import edit_cluster
from hairfit.model.reshape import Curl, curl
from hairfit.model.section import on_skeleton
from hairfit.model.style import copy_style
from hairfit.model.subdivide import subdivide
from hairfit.render.camera import Camera
from hairfit.render.raster import project_points
from hairfit.synthetic.gallery import make_subject
from hairfit.synthetic.head import HIGH, LOW, head_distance
from hairfit.synthetic.styles import CONFIGS, grow_tree

OUT = PICTURES / "four_steps.jpg"
CLUSTERS, KNOTS = 30, 48
# What a copy takes: children alone, since each cluster lies flat on its own place.
DETAIL = ("children", "length_variation")
# The clusters that the figure encircles, and the way that the bang takes.
CURLY, BANG = 19, 16
FOREHEAD = np.array(
    [
        [-0.012, 0.110, 0.078],
        [-0.042, 0.082, 0.099],
        [-0.072, 0.040, 0.091],
        [-0.090, -0.004, 0.068],
        [-0.098, -0.050, 0.052],
    ]
)
SIZE = (400, 440)


def rough_style() -> HairTree:
    """Return 30 root clusters that roughly design a hairstyle."""
    style = dataclasses.replace(
        CONFIGS["straight"], roots=CLUSTERS, children=1, knots=KNOTS
    )
    tree = grow_tree(style, make_subject().scalp, 3)
    tree = take(tree, np.arange(tree.count) < CLUSTERS)
    # The bang leaves the parting towards the forehead and is swept aside.
    root = np.asarray(tree.cylinder.skeleton[BANG, 0])
    path = catmull_rom_curve(np.concatenate([root[None], FOREHEAD]))
    bang = on_skeleton(cluster(tree.cylinder, BANG), resample(path, KNOTS))
    return edit_cluster(tree, BANG, bang)


def catmull_rom_curve(
    control: Float[np.ndarray, "knots 3"],
) -> Float[Array, "points 3"]:
    """Return many points of the curve through control points."""
    t = jnp.linspace(0.0, 1.0, 20 * len(control), dtype=jnp.float32)
    return catmull_rom_weights(len(control), t) @ jnp.asarray(control, jnp.float32)


def gather(tree: HairTree, index: Sequence[int], tip: float) -> HairTree:
    """Return the tree with clusters that narrow towards their tips."""
    t = np.linspace(0.0, 1.0, KNOTS)
    share = np.ones((tree.count, KNOTS), np.float32)
    share[list(index)] = 1.0 + (tip - 1.0) * np.minimum(2.0 * t, 1.0)
    by = jnp.asarray(share, tree.cylinder.radius.dtype)
    return eqx.tree_at(
        lambda c: (c.cylinder.radius, c.cylinder.offset),
        tree,
        (tree.cylinder.radius * by, tree.cylinder.offset * by[:, :, None]),
    )


def make_curly(tree: HairTree, index: int) -> HairTree:
    """Return the tree with a cluster subdivided and made curly."""
    tree = subdivide(tree, index, 6, jax.random.key(1))
    locks = [int(i) for i in children(tree, index)]
    tree = gather(tree, locks, 0.55)
    for number, lock in enumerate(locks):
        how = Curl(0.0075, 0.042, start=0.2, ramp=0.3, phase=2.4 * number)
        tree = curl(tree, lock, how)
    return tree


def refine(tree: HairTree, index: int, seed: int = 0) -> HairTree:
    """Return the tree with a cluster of many thin locks that go slightly apart."""
    tree = subdivide(tree, index, 7, jax.random.key(seed))
    locks = [int(i) for i in children(tree, index)]
    tree = gather(tree, locks, 0.75)
    vary = tree.length_variation.at[jnp.asarray(locks)].set(0.25)
    tree = eqx.tree_at(lambda c: c.length_variation, tree, vary)
    rng = np.random.default_rng(seed)
    for lock in locks:
        how = Curl(0.003, 0.09, depth=0.3, start=0.1, phase=rng.uniform(0.0, 6.0))
        tree = curl(tree, lock, how)
    return tree


@functools.cache
def field() -> DistanceField:
    """Return the distance from the head."""
    return sample_field(head_distance, LOW - 0.02, HIGH + 0.02, 0.004)


def hair_of(tree: HairTree, strands: int) -> Float[np.ndarray, "strands points 3"]:
    """Return the tree's strands, kept out of the head."""
    hair = sample_strands(tree, strands, 2 * KNOTS, jax.random.key(0))
    return np.asarray(push_out_strands(field(), hair, 0.0015))


def encircle(axes, tree: HairTree, index: int, camera: Camera) -> None:
    """Draw an ellipse around a cluster."""
    p = np.asarray(tree.cylinder.skeleton[index], float)
    pixels = np.asarray(project_points(p, camera)[0])
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    wide, tall = np.maximum(1.25 * (high - low), 70.0)
    ring = Ellipse(tuple((low + high) / 2), wide, tall, fill=False, color="tab:red")
    ring.set_linewidth(1.5)
    axes.add_patch(ring)


def main(out: pathlib.Path = OUT, strands: int = 20000, copies: int = CLUSTERS) -> None:
    """Write the picture.

    Args:
        out: Where to.
        strands: Number of strands.
        copies: Onto how many clusters, at most, the curly one is copied.
    """
    camera = look_from(-32.0, 6.0, SIZE, (-0.09, -0.12, -0.05), (0.09, 0.12, 0.05))
    sheet = Sheet(1, 4, SIZE)

    def show(title: str, tree: HairTree, index: int | None = None) -> None:
        axes = sheet.add(title, photograph(hair_of(tree, strands), camera))
        if index is not None:
            encircle(axes, tree, index, camera)

    tree = rough_style()
    show(f"4-1, 1: a rough style, {tree.count} clusters", tree)
    tree = make_curly(tree, CURLY)
    show("4-1, 2: one is subdivided, made curly", tree, CURLY)
    others = [i for i in range(CLUSTERS) if i not in (CURLY, BANG)]
    for target in others[:copies]:
        tree = copy_style(tree, CURLY, target, what=DETAIL)
    show("4-1, 3: it is copied onto others", tree)
    tree = refine(tree, BANG)
    show("4-1, 4: the bang is refined", tree, BANG)
    sheet.save(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Design a hairstyle in four steps.")
    parser.add_argument("--out", type=pathlib.Path, default=OUT)
    main(parser.parse_args().out)
