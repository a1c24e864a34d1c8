"""Subdivision of hair clusters: figures 4-9, 4-10, 4-13 and 4-14 of the thesis.

Run `python examples/subdivision.py [--out FILE]`. Drawings are in scalp space (u, v):
roots in the colour of their owner, contours as lines. The photographs show the hair of
36 root clusters, and of eight children of each, narrowed towards their tips.
"""

import argparse
import pathlib

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
from sheet import PICTURES, Sheet, look_from, photograph

from hairfit.model import (
    HairTree,
    ScalpContour,
    cluster,
    find_owner,
    leaves,
    plant,
    sample_roots,
    sample_strands,
    take,
)
from hairfit.model.subdivide import (
    child_contours,
    relax_centres,
    scatter_centres,
    subdivide,
    subdivide_into,
)
from hairfit.model.tiling import contour_outline, tile_contours
from hairfit.synthetic import make_style
from hairfit.synthetic.gallery import make_subject

OUT = PICTURES / "subdivision.jpg"
# A parting beside the middle, in scalp space.
PARTING = np.array([[0.36, -0.1], [0.42, 0.4], [0.4, 0.62], [0.47, 1.1]])
# Contours that overlap, as a user may place them: u, v, radius, lobes.
PLACED = (
    (0.25, 0.3, 0.2, 3),
    (0.45, 0.42, 0.2, 0),
    (0.7, 0.3, 0.22, 2),
    (0.35, 0.68, 0.24, 4),
    (0.68, 0.68, 0.24, 3),
)
KEY = jax.random.key(7)
SIZE = (300, 340)


def placed_tree() -> HairTree:
    """Return straight root clusters over the contours that overlap."""
    u, v, radius, lobes = jnp.asarray(PLACED).T
    angle = jnp.arange(32.0) * (2.0 * jnp.pi / 32.0)
    waves = (
        jnp.cos(lobes[:, None] * angle[None]) * jnp.where(lobes > 0, 0.16, 0.0)[:, None]
    )
    contour = jax.vmap(ScalpContour)(
        jnp.stack([u, v], axis=1), radius, radius[:, None] * waves
    )
    return planted(contour)


def planted(contour: ScalpContour) -> HairTree:
    """Return straight root clusters over stacked contours."""
    scalp = make_subject().scalp
    cylinder = jax.vmap(lambda one: plant(scalp, one, 0.1, 6))(contour)
    count = len(contour.radius)
    return HairTree(scalp, contour, cylinder, jnp.zeros(count), (-1,) * count)


def draw_owners(axes, tree: HairTree, uv: np.ndarray, borders=()) -> None:
    """Draw roots in the colour of their owner, leaves' contours, and borders."""
    owner = np.asarray(find_owner(tree, uv))
    held = owner >= 0
    shade = matplotlib.colormaps["tab20"](owner[held] * 7 % 20)
    axes.scatter(*uv[~held].T, s=1.0, c="0.85", linewidths=0)
    axes.scatter(*uv[held].T, s=4.0, c=shade, linewidths=0)
    for index in leaves(tree):
        outline = contour_outline(cluster(tree.contour, int(index)))
        axes.plot(*np.asarray(outline).T, "k", lw=0.6)
    axes.plot(*np.asarray(tree.contour.centre)[leaves(tree)].T, "k.", ms=2)
    for border in borders:
        axes.plot(*border.T, color="crimson", lw=1.6)
    axes.set(xlim=(-0.04, 1.04), ylim=(-0.04, 1.04), xticks=[], yticks=[])
    axes.set_aspect("equal")


def draw_tilings(sheet: Sheet, uv: np.ndarray) -> None:
    """Add figures 4-10, 4-13 and 4-14."""
    scalp = make_subject().scalp
    draw_owners(
        sheet.add("4-9, 4-10: contours overlap; the closest centre owns a root", None),
        placed_tree(),
        uv,
    )
    whole = jax.vmap(ScalpContour)(
        jnp.array([[0.5, 0.5]]), jnp.array([0.46]), jnp.zeros((1, 32))
    )
    tree, contour = planted(whole), cluster(whole, 0)
    random = scatter_centres(scalp, contour, 14, KEY)
    even = relax_centres(scalp, contour, random)
    for title, centres in (
        ("4-13a: random positions", random),
        ("4-13b: relaxed (rho = 1.4 in both)", even),
    ):
        contours = child_contours(scalp, contour, centres)
        draw_owners(sheet.add(title, None), subdivide_into(tree, 0, contours), uv)
    tree = subdivide(tree, 0, 7, KEY)
    for index, count in ((1, 5), (3, 5), (4, 4), (9, 4)):
        tree = subdivide(tree, index, count, jax.random.fold_in(KEY, index))
    title = "4-13c, 4-14a: after a few subdivisions, closest within contours"
    draw_owners(sheet.add(title, None), tree, uv)
    tree = subdivide(planted(whole), 0, 8, KEY, borders=[PARTING])
    for index in (1, 4, 6):
        key = jax.random.fold_in(KEY, index)
        tree = subdivide(tree, index, 4, key, borders=[PARTING])
    title = "4-14b: subdivided with a border that no child crosses"
    draw_owners(sheet.add(title, None), tree, uv, [PARTING])
    tiles = planted(tile_contours(even, 1.0, [PARTING]))
    title = "4-14b: Voronoi contours on both sides of a border"
    draw_owners(sheet.add(title, None), tiles, uv, [PARTING])


def draw_hair(sheet: Sheet, strands: int, children: int) -> None:
    """Add photographs before and after the subdivision of all clusters."""
    tree = make_style("wavy", 2, make_subject().scalp)
    tree = take(tree, np.asarray(tree.parent) < 0)
    low, high = (-0.1, -0.17, -0.1), (0.1, 0.12, 0.1)
    camera = look_from(120.0, 12.0, SIZE, low, high)

    def add(title, tree):
        hair = sample_strands(tree, strands, 64, KEY)
        sheet.add(title, photograph(np.asarray(hair), camera))

    count = tree.count
    add(f"4.5: {count} clusters", tree)
    for index in range(count):
        tree = subdivide(tree, index, children, jax.random.fold_in(KEY, index))
    narrow = jnp.linspace(1.0, 0.15, tree.cylinder.radius.shape[1])
    scale = jnp.where(jnp.arange(tree.count) < count, 1.0, narrow[:, None]).T
    tree = eqx.tree_at(
        lambda t: t.cylinder.scale, tree, tree.cylinder.scale * scale[:, :, None]
    )
    title = f"4.5: each subdivided into {children}, narrowed to the tips"
    add(title, tree)


def main(out: pathlib.Path = OUT, strands: int = 14000, children: int = 8) -> None:
    """Write the sheet."""
    sheet = Sheet(2, 4, SIZE)
    uv = np.asarray(sample_roots(make_subject().scalp, strands // 4, KEY))
    draw_tilings(sheet, uv)
    draw_hair(sheet, strands, children)
    sheet.save(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=OUT)
    main(parser.parse_args().out)
