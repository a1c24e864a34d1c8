"""What all hairstyles of the gallery start from: root clusters, and how they lie."""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...model import GeneralizedCylinder, HairTree, Scalp, sample_roots
from ...model.collide import (
    DistanceField,
    field_distance,
    push_out_tree,
    sample_field,
)
from ...model.cylinder import cylinder_knots
from ...model.reshape import Curl, curl
from ...model.scalp import points_on
from ...model.section import section_maps, with_section_maps
from ...model.subdivide import (
    child_contours,
    child_cylinders,
    owned_region,
    relax_centres,
    scatter_centres,
)
from ...model.tiling import fill, tile_contours
from ...model.tree import children, cluster, graft, leaves
from ...types import Mesh
from ..guides import Fall, smooth_step
from ..head import HIGH, LOW, head_distance, make_head, make_scalp
from ..styles import Style, plant_all, shape_sections
from ..tiling import scatter

# Contours reach this far beyond their cells, so that no root is left between them.
OVERLAP = 1.12
# Roots among which the centres of root clusters are chosen.
ROOTS = 4000
# Least distance of knots and contours from the skin, in metres; contours are looked at
# at some angles, in some rounds.
CLEAR, TURNS, LIFTS = 0.001, 8, 4
# Length up to which hair is cropped, in metres.
CROPPED = 0.02
# How far children's contours overlap.
BELOW = 1.4

Borders = Sequence[Float[np.ndarray, "points 2"]]
Guides = Float[np.ndarray, "clusters knots 3"]


class Subject(NamedTuple):
    """Whom the gallery styles: a head, and the scalp on it."""

    head: Mesh
    scalp: Scalp


@functools.cache
def make_subject() -> Subject:
    """Return the head of `make_head` and its scalp."""
    head = make_head()
    return Subject(head, make_scalp(head))


@dataclasses.dataclass(frozen=True)
class Lay:
    """How root clusters lie along their guides.

    Attributes:
        thickness: Thickness of a cluster's hair against its root's width.
        keep: Share of its width that a cluster keeps at the tip.
    """

    thickness: float = 0.3
    keep: float = 0.8


def root_clusters(
    scalp: Scalp,
    count: int,
    knots: int,
    seed: int,
    borders: Borders = (),
    vary: float = 0.1,
) -> HairTree:
    """Return a tree of straight root clusters that tile the scalp.

    Args:
        scalp: The scalp.
        count: Number of clusters.
        knots: Knots of each.
        seed: Of their places.
        borders: Polylines in scalp space that no cluster crosses.
        vary: Share of the length by which tips vary.
    """
    rng = np.random.default_rng(seed)
    uv = np.asarray(sample_roots(scalp, ROOTS, jax.random.key(seed)))
    p = np.asarray(points_on(scalp, jnp.asarray(uv)))
    centres = uv[scatter(p, count, rng)]
    contour = tile_contours(centres, OVERLAP, borders)
    cylinder = plant_all(scalp, contour, knots)
    dtype = scalp.control.dtype
    variation = jnp.full(count, vary, dtype)
    return HairTree(scalp, contour, cylinder, variation, (-1,) * count)


def roots_of(tree: HairTree) -> Float[np.ndarray, "clusters 3"]:
    """Return where the skeletons of all clusters start."""
    return np.asarray(tree.cylinder.skeleton[:, 0])


def lay(tree: HairTree, guides: Guides, how: Lay = Lay()) -> HairTree:
    """Return a tree of root clusters laid along guides, flat on the head."""
    # Only whether hair falls matters to the sections, not how.
    style = Style(fall=Fall(0.0, 0.0, 0.0, 0.0, 0.0), thickness=how.thickness)
    cylinder = shape_sections(style, tree.cylinder, guides, keep=how.keep)
    return eqx.tree_at(lambda t: t.cylinder, tree, cylinder)


def widen(
    tree: HairTree, share: Float[np.ndarray, "clusters knots"], rows=slice(None)
) -> HairTree:
    """Return the tree whose contours in the world are scaled knot by knot."""
    by = jnp.asarray(share, tree.cylinder.radius.dtype)
    return eqx.tree_at(
        lambda t: (t.cylinder.radius, t.cylinder.offset),
        tree,
        (
            tree.cylinder.radius.at[rows].multiply(by),
            tree.cylinder.offset.at[rows].multiply(by[..., None]),
        ),
    )


def along_of(guides: Guides) -> Float[np.ndarray, "clusters knots"]:
    """Return the lengths of curves from the root to each knot."""
    steps = np.linalg.norm(np.diff(guides, axis=1), axis=2)
    return np.concatenate([np.zeros((len(guides), 1)), np.cumsum(steps, 1)], 1)


def split(
    tree: HairTree,
    count: int | Int[np.ndarray, " leaves"],
    seed: int,
    borders: Borders = (),
    gather: float = 1.0,
) -> HairTree:
    """Return the tree in which each leaf is subdivided, all of them at once.

    The steps of `subdivide`, but for one `graft` of all children: what a leaf owns is
    what it owns before any other one is subdivided.

    Args:
        tree: The tree.
        count: Number of children of each leaf, or of the leaves in their order.
        seed: Of the children's places.
        borders: Polylines in scalp space that no child crosses.
        gather: How far hair gathers about each child; 1 leaves it where it is.
    """
    key = jax.random.key(seed)
    rows = leaves(tree)
    counts = np.broadcast_to(count, len(rows))
    found = []
    for index, number in zip(rows.tolist(), counts.tolist(), strict=True):
        one = jax.random.fold_in(key, index)
        region = owned_region(tree, index)
        centres = scatter_centres(tree.scalp, region, number, one)
        centres = relax_centres(tree.scalp, region, centres, borders)
        contour, cylinder = cluster(tree.contour, index), cluster(tree.cylinder, index)
        inner = child_contours(tree.scalp, contour, centres, BELOW, borders)
        filled = jax.tree.map(fill, inner)
        grown = child_cylinders(tree.scalp, contour, cylinder, filled, gather)
        grown = jax.tree.map(lambda leaf, n=number: np.asarray(leaf)[:n], grown)
        found.append((jax.tree.map(np.asarray, inner), grown))
    contour, cylinder = jax.tree.map(
        lambda *parts: jnp.asarray(np.concatenate(parts)), *found
    )
    above = np.repeat(rows, counts)
    variation = jnp.asarray(np.asarray(tree.length_variation)[above])
    return graft(tree, contour, cylinder, variation, above.tolist())


def below(tree: HairTree, rows: Sequence[int] | np.ndarray) -> Int[np.ndarray, " some"]:
    """Return the children of some clusters."""
    return np.concatenate([children(tree, int(row)) for row in rows])


def curl_each(
    tree: HairTree, rows: Int[np.ndarray, " some"], hows: Sequence[Curl], seed: int
) -> HairTree:
    """Return the tree in which leaves are curled, each with a phase of its own.

    Args:
        tree: The tree.
        rows: Leaves.
        hows: Ways to curl; each leaf gets one of them.
        seed: Of who gets which, and of the phases.
    """
    rng = np.random.default_rng(seed)
    phase = rng.uniform(-np.pi, np.pi, len(rows))
    choice = rng.integers(len(hows), size=len(rows))
    cylinder = tree.cylinder
    for number, how in enumerate(hows):
        mine = np.flatnonzero(choice == number)
        if not len(mine):
            continue
        # Filled up, so that the number of leaves does not decide about compiling.
        filled = np.resize(mine, 64 * -(-len(mine) // 64))
        some = jnp.asarray(rows[filled])
        turn = jnp.asarray(phase[filled], cylinder.radius.dtype)
        new = curler(how)(tree, some, turn)
        cylinder = jax.tree.map(
            lambda leaf, one, at=some: leaf.at[at].set(one), cylinder, new
        )
    return eqx.tree_at(lambda t: t.cylinder, tree, cylinder)


@functools.cache
def curler(how: Curl) -> Callable[..., GeneralizedCylinder]:
    """Return the program that curls stacked clusters with phases."""

    def one(scalp, contour, cylinder, phase):
        contour, cylinder = jax.tree.map(
            lambda leaf: leaf[None], (contour, turned(cylinder, phase))
        )
        even = jnp.zeros(1, phase.dtype)
        lonely = HairTree(scalp, contour, cylinder, even, (-1,))
        return cluster(curl(lonely, 0, how).cylinder, 0)

    @eqx.filter_jit
    def every(tree, rows, phase):
        contour, cylinder = jax.tree.map(
            lambda leaf: leaf[rows], (tree.contour, tree.cylinder)
        )
        return jax.vmap(one, (None, 0, 0, 0))(tree.scalp, contour, cylinder, phase)

    return every


def turned(
    cylinder: GeneralizedCylinder, angle: Float[Array, ""]
) -> GeneralizedCylinder:
    """Return the same cluster in frames turned about its skeleton.

    Its strands stay where they are, but a curl starts at another angle.
    """
    axis = cylinder.skeleton[1] - cylinder.skeleton[0]
    axis = axis / jnp.linalg.norm(axis)
    side = jnp.cross(axis, cylinder.normal)
    cos, sin = jnp.cos(angle), jnp.sin(angle)
    back = jnp.stack([jnp.stack([cos, sin]), jnp.stack([-sin, cos])])
    maps = jnp.einsum("ij,kjl->kil", back, section_maps(cylinder))
    cylinder = eqx.tree_at(
        lambda c: c.normal, cylinder, cos * cylinder.normal + sin * side
    )
    return with_section_maps(cylinder, maps)


@functools.cache
def field() -> DistanceField:
    """Return the distances around the head of `make_head`."""
    return sample_field(head_distance, LOW - 0.02, HIGH + 0.02, 0.004)


def settle(tree: HairTree) -> HairTree:
    """Return the tree with its hair outside of the head.

    Skeletons are pushed out by (4-9), and then moved on until the contours around
    their knots are outside, too. Cropped hair, which stands, stays as it is: its knots
    are so close that moving them would crumple it.
    """
    was = tree.cylinder.skeleton
    cropped = along_of(np.asarray(was))[:, -1] < CROPPED
    tree = push_out_tree(field(), tree, CLEAR)
    skeleton = clear_of(field(), tree.cylinder)
    skeleton = jnp.where(jnp.asarray(cropped)[:, None, None], was, skeleton)
    # Neither guides nor mirror images start on the scalp to the last digit.
    root = points_on(tree.scalp, tree.contour.centre)
    skeleton = skeleton.at[:, 0].set(root)
    return eqx.tree_at(lambda t: t.cylinder.skeleton, tree, skeleton)


@jax.jit
def clear_of(
    head: DistanceField, cylinder: GeneralizedCylinder
) -> Float[Array, "clusters knots 3"]:
    """Return skeletons moved away from a head until all contours are off it."""
    theta = jnp.linspace(0.0, 2.0 * jnp.pi, TURNS, endpoint=False)
    theta = theta.astype(cylinder.radius.dtype)
    around = jax.vmap(jax.vmap(cylinder_knots, (None, None, 0)), (0, None, None))
    look = jax.vmap(jax.vmap(field_distance, (None, 0)), (None, 0))

    def step(skeleton, _):
        bent = eqx.tree_at(lambda c: c.skeleton, cylinder, skeleton)
        outline = around(bent, jnp.ones((), theta.dtype), theta)
        distance = jax.vmap(look, (None, 0))(head, outline).distance
        missing = jnp.maximum(CLEAR - jnp.min(distance, axis=1), 0.0)
        missing = missing.at[:, 0].set(0.0)
        return skeleton + missing[..., None] * look(head, skeleton).gradient, None

    return jax.lax.scan(step, cylinder.skeleton, None, length=LIFTS)[0]


def ramp(x, low: float, high: float):
    """Return 0 below `low`, 1 above `high`, and a smooth way between."""
    return smooth_step((np.asarray(x) - low) / (high - low))
