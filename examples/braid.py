"""A braid by copy and paste at two scales: figures 4-18 and 4-19 of the thesis.

Run `python examples/braid.py [--out FILE]`. Cluster A is subdivided into three locks
that are plaited, and copied onto cluster B, which is wider and bent. Then the same
braid is pasted onto each of the three locks of a larger one.
"""

import argparse
import pathlib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from sheet import (
    PICTURES,
    Sheet,
    cross_sections,
    draw_curves,
    look_from,
    photograph,
)

from hairfit.model import (
    GeneralizedCylinder,
    HairTree,
    Scalp,
    ScalpContour,
    children,
    cluster,
    find_owner,
    grow_strands,
    leaves,
    local_coordinates,
    plant,
    resample,
    sample_strands,
    scalp_point,
    scalp_tangents,
    scalp_uv,
    stack,
)
from hairfit.model.bind import Bound, update_points
from hairfit.model.section import on_skeleton
from hairfit.model.style import ALL, copy_style, extract_style, paste_style
from hairfit.model.subdivide import subdivide
from hairfit.model.trim import end_at
from hairfit.model.vector import norm
from hairfit.render.camera import Camera
from hairfit.report.drawing import draw_hair
from hairfit.synthetic import make_style
from hairfit.synthetic.gallery import make_subject
from hairfit.synthetic.guides import TIE, hanging_tail

OUT = PICTURES / "braid.jpg"
KNOTS = 101
# How often the locks go to and fro: in the braid, and in the one that is made of it.
TURNS, LARGE_TURNS = 10.0, 2.3
COLOURS = ("tab:red", "tab:green", "tab:blue")
SIZE = (330, 560)


def smooth_step(x):
    """Return 0 below 0, 1 above 1, and a smooth way between."""
    x = np.clip(x, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


def ceiling() -> Scalp:
    """Return a flat patch of 40 cm a side from which hair hangs down."""
    side = jnp.linspace(-0.2, 0.2, 13)
    x, z = jnp.meshgrid(side, side, indexing="ij")
    return Scalp(jnp.stack([x, jnp.zeros_like(x), z], axis=-1))


def circle(u: float, v: float, radius: float) -> ScalpContour:
    """Return a round contour on the scalp."""
    return ScalpContour(jnp.array([u, v]), jnp.asarray(radius), jnp.zeros(32))


def hang(
    scalp: Scalp, contour: ScalpContour, skeleton: Float[np.ndarray, "points 3"]
) -> GeneralizedCylinder:
    """Return a cluster planted on the scalp and laid along a polyline from there."""
    planted = plant(scalp, contour, 0.1, KNOTS)
    return on_skeleton(planted, jnp.asarray(skeleton, planted.skeleton.dtype))


def tapered(tree: HairTree, index: int, end: float = 0.55) -> HairTree:
    """Return the tree with a cluster that grows thin near its tip."""
    t = np.linspace(0.0, 1.0, KNOTS)
    share = jnp.asarray(1.0 - (1.0 - end) * smooth_step((t - 0.5) / 0.5))
    radius = tree.cylinder.radius
    radius = radius.at[index].multiply(share.astype(radius.dtype))
    return eqx.tree_at(lambda c: c.cylinder.radius, tree, radius)


def plait(
    tree: HairTree, index: int, turns: float, wide: float = 0.52, thick: float = 1.0
) -> HairTree:
    """Return the tree whose cluster has three children that are plaited.

    Seen in the cluster's contour, all three run along one figure of eight, a third of a
    turn apart: to and fro across, and twice as often forth and back.

    Args:
        tree: The tree.
        index: A leaf cluster.
        turns: How often each lock runs along the figure of eight.
        wide: Half of its width, as a share of the cluster's radius.
        thick: What the locks' radii are multiplied by.
    """
    tree = subdivide(tree, index, 3, jax.random.key(2))
    above = cluster(tree.cylinder, index)
    below = [int(i) for i in children(tree, index)]
    place = jax.vmap(local_coordinates, (None, 0))(
        cluster(tree.contour, index), tree.contour.centre[jnp.asarray(below)]
    )
    order = np.argsort(np.asarray(place.theta))
    t = np.linspace(0.0, 1.0, KNOTS)
    grip = smooth_step(t / 0.1)
    cylinder = tree.cylinder
    for number, k in enumerate(order):
        phase = 2.0 * np.pi * (turns * t + number / 3.0)
        r, theta = float(place.r[k]), float(place.theta[k])
        x = (1.0 - grip) * r * np.cos(theta) + grip * wide * np.sin(phase)
        y = (1.0 - grip) * r * np.sin(theta) + grip * 0.58 * wide * np.sin(2.0 * phase)
        dtype = above.skeleton.dtype
        path = [np.hypot(x, y), np.arctan2(y, x), t]
        r, theta, at = (jnp.asarray(p, dtype) for p in path)
        bound = Bound(r, theta, at, jnp.zeros(KNOTS, bool))
        child = cluster(cylinder, below[k])
        skeleton = update_points(above, bound).at[0].set(child.skeleton[0])
        child = on_skeleton(child, skeleton)
        share = jnp.asarray(1.0 + (thick - 1.0) * grip, dtype)
        child = eqx.tree_at(lambda c: c.radius, child, child.radius * share)
        cylinder = jax.tree.map(
            lambda every, one, i=below[k]: every.at[i].set(one), cylinder, child
        )
    return eqx.tree_at(lambda c: c.cylinder, tree, cylinder)


def two_clusters() -> HairTree:
    """Return clusters A and B that hang side by side; B is wider and bent."""
    scalp = ceiling()
    t = np.linspace(0.0, 1.0, KNOTS)
    contours = [circle(0.42, 0.5, 0.0225), circle(0.58, 0.5, 0.028)]
    roots = [np.asarray(scalp_point(scalp, c.centre)) for c in contours]
    down = np.outer(t, [0.0, -0.26, 0.0])
    bend = np.stack([0.03 * np.sin(2.6 * t), -0.29 * t, np.zeros_like(t)], axis=1)
    cylinders = [
        hang(scalp, contours[0], roots[0] + down),
        hang(scalp, contours[1], roots[1] + bend),
    ]
    tree = HairTree(scalp, stack(contours), stack(cylinders), jnp.zeros(2), (-1, -1))
    return tapered(tapered(tree, 0), 1)


def strands_in(
    tree: HairTree, roots: list[int], count: int, seed: int = 0
) -> Float[np.ndarray, "strands points 3"]:
    """Return strands whose roots are spread evenly over some root clusters."""
    rng = np.random.default_rng(seed)
    uv = []
    for index in roots:
        r, theta = np.sqrt(rng.uniform(size=count)), rng.uniform(0, 2 * np.pi, count)
        radius = float(tree.contour.radius[index])
        spoke = np.stack([np.cos(theta), np.sin(theta)], axis=1)
        centre = np.asarray(tree.contour.centre[index])
        uv.append(centre + 0.98 * radius * r[:, None] * spoke)
    uv = jnp.asarray(np.concatenate(uv), tree.contour.centre.dtype)
    owner = find_owner(tree, uv)
    eta = jnp.asarray(rng.uniform(0.93, 1.0, len(uv)), uv.dtype)
    return np.asarray(grow_strands(tree, uv, owner, eta, 2 * KNOTS))


def close_up(strands, camera: Camera):
    """Return a picture of hair alone."""
    return draw_hair(np.asarray(strands, np.float64), None, [camera])[0]


def large_braid(
    scalp: Scalp, contour: ScalpContour, skeleton: Float[np.ndarray, "points 3"]
) -> HairTree:
    """Return one cluster plaited of three locks."""
    tree = HairTree(
        scalp,
        stack([contour]),
        stack([hang(scalp, contour, skeleton)]),
        jnp.zeros(1, contour.centre.dtype),
        (-1,),
    )
    return plait(tapered(tree, 0, 0.7), 0, LARGE_TURNS, wide=0.62, thick=0.75)


def braid_of_braids(tree: HairTree, index: int, template: HairTree) -> HairTree:
    """Return the tree with a template on each of a cluster's locks.

    The locks keep their own thickness, so contours are not pasted.
    """
    for lock in children(tree, index):
        tree = paste_style(tree, template, int(lock), what=ALL - {"contour"})
    return tree


def tied_back() -> HairTree:
    """Return hair that is combed to a tie at the back of the head, and ends there."""
    tree = make_style("ponytail", 0, make_subject().scalp)
    skeleton = np.asarray(tree.cylinder.skeleton)
    nearest = np.linalg.norm(skeleton - TIE, axis=2).argmin(axis=1)
    end = jnp.asarray((nearest + 0.5) / (skeleton.shape[1] - 1), jnp.float32)
    return end_at(tree, np.arange(tree.count), end)


def braid_from_tie(template: HairTree) -> HairTree:
    """Return a braid of braids that hangs from the tie."""
    scalp = make_subject().scalp
    uv = scalp_uv(scalp, jnp.asarray(TIE, jnp.float32))
    root = np.asarray(scalp_point(scalp, uv))[None]
    path = np.concatenate([root, hanging_tail(np.zeros(2), 0.30)])
    skeleton = resample(jnp.asarray(path, jnp.float32), KNOTS)
    wide = norm(jnp.stack(scalp_tangents(scalp, uv))).mean()
    contour = circle(float(uv[0]), float(uv[1]), 0.022 / float(wide))
    tree = large_braid(scalp, contour, np.asarray(skeleton))
    return braid_of_braids(tree, 0, template)


def draw(axes, tree: HairTree, camera: Camera) -> None:
    """Draw the skeletons of leaves, in colours, and the contours of root clusters."""
    for root in children(tree, -1):
        rings = cross_sections(tree, int(root))[:: KNOTS // 12]
        draw_curves(axes, rings, camera, color="0.55", linewidth=0.6)
    skeleton = np.asarray(tree.cylinder.skeleton)
    above = np.asarray(tree.parent)
    for leaf in leaves(tree):
        colour, at = "0.3", int(leaf)
        while above[at] >= 0:  # in the end the lock of the largest braid
            number = np.searchsorted(children(tree, int(above[at])), at)
            colour, at = COLOURS[int(number)], int(above[at])
        draw_curves(axes, skeleton[leaf][None], camera, color=colour, linewidth=1.1)


def main(out: pathlib.Path = OUT, strands: int = 4000, height: int = SIZE[1]) -> None:
    """Write the picture.

    Args:
        out: Where to.
        strands: Number of strands of each braid.
        height: Height of each picture, in pixels.
    """
    size = (round(height * SIZE[0] / SIZE[1]), height)
    near = look_from(0.0, 4.0, size, (-0.035, -0.21, 0.0), (0.065, -0.08, 0.0))
    tree = plait(two_clusters(), 0, TURNS)
    template = extract_style(tree, 0)
    copied = copy_style(tree, 0, 1)
    sheet = Sheet(2, 4, size)
    paper = np.full((size[1], size[0], 3), 255, np.uint8)
    for title, one in (
        ("4-18a: a braid is designed on cluster A", tree),
        ("4-18c: the style of A copied to cluster B", copied),
    ):
        draw(sheet.add(f"{title}: skeletons, contours", paper), one, near)
        sheet.add(title, close_up(strands_in(one, [0, 1], strands), near))

    scalp, contour = ceiling(), circle(0.5, 0.5, 0.06)
    down = np.outer(np.linspace(0.0, 1.0, KNOTS), [0.0, -0.34, 0.0])
    large = large_braid(scalp, contour, down)
    both = braid_of_braids(large, 0, template)
    near = look_from(0.0, 4.0, size, (-0.04, -0.275, 0.0), (0.04, -0.065, 0.0))
    picture = close_up(strands_in(large, [0], 2 * strands), near)
    sheet.add("4-19: a larger braid", picture)
    draw(sheet.add("4-19: the braid of A on its locks", paper), both, near)
    picture = close_up(strands_in(both, [0], 2 * strands), near)
    sheet.add("4-19: a braid at two scales", picture)
    back = look_from(158.0, 6.0, size, (-0.09, -0.15, -0.12), (0.09, 0.05, 0.02))
    hair = sample_strands(tied_back(), 3 * strands, 2 * KNOTS, jax.random.key(0))
    tail = strands_in(braid_from_tie(template), [0], 2 * strands)
    hair = np.concatenate([np.asarray(hair), tail])
    sheet.add("4-19: the same on a head", photograph(hair, back))
    sheet.save(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Draw braids made by copy and paste.")
    parser.add_argument("--out", type=pathlib.Path, default=OUT)
    main(parser.parse_args().out)
