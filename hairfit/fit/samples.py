"""The strands of a tree that are compared with photographs.

A refinement moves skeletons, scales, twists and shears. Roots and contours stay, and
with them each strand's place in its cluster: it is found once, and growing the strands
anew, and the gradient of that, becomes a small program.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..host import on_device
from ..model.contour import contour_radius
from ..model.curve import EXACT, catmull_rom_weights
from ..model.cylinder import (
    GeneralizedCylinder,
    Sections,
    cylinder_frames,
    section_points,
)
from ..model.ownership import find_owner, local_coordinates
from ..model.scalp import Scalp, sample_roots, scalp_point
from ..model.tree import Clusters, HairTree, filled


class Samples(NamedTuple):
    """The strands that are compared: roots and their leaf clusters."""

    uv: Float[Array, "strands 2"]
    owner: Int[Array, " strands"]


class Placed(NamedTuple):
    """Whole strands by their places in their clusters.

    Attributes:
        owner: Their leaf clusters.
        root: Where they stand on the scalp, in metres.
        away: How far they are from the skeleton at its knots, in metres, before scale
            and shear.
        theta: The angle at which they are there, before the twist.
    """

    owner: Int[Array, " strands"]
    root: Float[Array, "strands 3"]
    away: Float[Array, "strands knots"]
    theta: Float[Array, " strands"]


def samples_of(tree: HairTree, count: int, seed: int) -> Samples:
    """Return the roots at which a tree and photographs are compared.

    Args:
        tree: The tree.
        count: How many come back, also where a tree owns less of its scalp.
        seed: Of the roots that are drawn.
    """
    key = jax.random.fold_in(jax.random.key(seed), 1)
    uv = np.asarray(sample_roots(tree.scalp, count, key))
    owner = np.asarray(find_owner(tree, uv))
    held = owner >= 0
    # A constant size, or every capture would be compiled anew.
    index = np.resize(np.flatnonzero(held), len(uv))
    return Samples(on_device(uv[index], jnp.float32), on_device(owner[index]))


@jax.jit
def place(scalp: Scalp, clusters: Clusters, samples: Samples) -> Placed:
    """Return where strands run in their clusters, by equations (4-7) and (4-8)."""

    def one(uv, owner):
        contour, cylinder = jax.tree.map(lambda leaf: leaf[owner], clusters)
        r, theta = local_coordinates(contour, uv)
        at_knots = jax.vmap(contour_radius, (0, 0, None))
        away = r * at_knots(cylinder.radius, cylinder.offset, theta)
        return Placed(owner, scalp_point(scalp, uv), away, theta)

    return jax.vmap(one)(*samples)


@functools.partial(jax.jit, static_argnames="points")
def grow_placed(
    cylinder: GeneralizedCylinder, placed: Placed, points: int
) -> Float[Array, "strands points 3"]:
    """Return what `grow` does of strands that are as long as their clusters, in metres.

    Args:
        cylinder: The clusters, which may have moved since the strands were placed.
        placed: The strands.
        points: Number of points of each, evenly spaced in the spline's parameter.
    """
    frames = jax.vmap(cylinder_frames)(cylinder)
    scale, twist, shear = cylinder.scale, cylinder.twist, cylinder.shear
    every = Sections(cylinder.skeleton, frames, cylinder.radius, scale, twist, shear)
    mine = jax.tree.map(lambda leaf: leaf[placed.owner], every)
    mine = mine._replace(radius=placed.away)
    knots = jax.vmap(section_points, (0, None, 0))(mine, 1.0, placed.theta)
    knots = knots.at[:, 0].set(placed.root)
    t = jnp.linspace(0.0, 1.0, points, dtype=knots.dtype)
    weights = catmull_rom_weights(knots.shape[1], t)
    return jnp.einsum("pk,skx->spx", weights, knots, precision=EXACT)


def sampled_strands(
    tree: HairTree, samples: Samples, points: int, room: int = 0
) -> Float[np.ndarray, "strands points 3"]:
    """Return the strands of a tree that are compared, in metres.

    Args:
        tree: The tree.
        samples: The strands, each owned by a leaf.
        points: Number of points of each.
        room: Arrays hold so many clusters, if the tree has fewer: trees of different
            counts then share their compiled programs.
    """
    clusters = filled(tree, room)
    placed = place(tree.scalp, clusters, samples)
    return np.asarray(grow_placed(clusters.cylinder, placed, points), np.float64)
