"""Strands: polylines that follow their clusters."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray, UInt32

from .curve import EXACT, catmull_rom_weights
from .cylinder import (
    GeneralizedCylinder,
    cylinder_frames,
    knot_sections,
    section_points,
    sections_between,
)
from .frame import Frames
from .ownership import find_owner, local_coordinates
from .scalp import Scalp, sample_roots, scalp_point
from .tree import HairTree, ScalpContour

# Rounds of sampling after which a scalp that is hardly covered counts as exhausted.
ROUNDS = 64


def grow_strands(
    tree: HairTree,
    uv: Float[Array, "strands 2"],
    owner: Int[Array, " strands"],
    eta: Float[Array, " strands"],
    points: int,
) -> Float[Array, "strands points 3"]:
    r"""Return the strands that grow from given roots, root first, in metres.

    A strand has one knot at each of its cluster's, by equation (4-4) at $\eta t$; the
    first one is the scalp's point itself (4-8). An interpolating Catmull-Rom spline
    through the knots makes it smooth (figure 4-11).

    Differentiable in all but `owner`. Trees with equal numbers of clusters and knots
    share one compiled program, whatever their topology.

    Args:
        tree: The tree.
        uv: The roots, in scalp space.
        owner: The leaf cluster of each strand, as `find_owner` has it. A strand
            without an owner (-1) does not grow: all its points are its root.
        eta: Share of the cluster's length that each strand reaches, 1 for all of it.
        points: Number of points of each strand, evenly spaced in the spline's
            parameter.
    """
    return grow(tree.scalp, tree.contour, tree.cylinder, uv, owner, eta, points)


@functools.partial(jax.jit, static_argnames="points")
def grow(
    scalp: Scalp,
    contour: ScalpContour,
    cylinder: GeneralizedCylinder,
    uv: Float[Array, "strands 2"],
    owner: Int[Array, " strands"],
    eta: Float[Array, " strands"],
    points: int,
) -> Float[Array, "strands points 3"]:
    """`grow_strands` on the arrays of a tree."""
    frames = jax.vmap(cylinder_frames)(cylinder)
    index = jnp.maximum(owner, 0)
    mine = jax.tree.map(lambda leaf: leaf[index], (contour, cylinder, frames))
    contour, cylinder, frames = mine
    knots = jax.vmap(strand_knots)(contour, cylinder, frames, uv, eta)
    root = jax.vmap(scalp_point, (None, 0))(scalp, uv)
    knots = jnp.where((owner >= 0)[:, None, None], knots, root[:, None])
    knots = knots.at[:, 0].set(root)
    t = jnp.linspace(0.0, 1.0, points, dtype=uv.dtype)
    weights = catmull_rom_weights(knots.shape[1], t)
    return jnp.einsum("pk,skx->spx", weights, knots, precision=EXACT)


def strand_knots(
    contour: ScalpContour,
    cylinder: GeneralizedCylinder,
    frames: Frames,
    uv: Float[Array, " 2"],
    eta: Float[Array, ""],
) -> Float[Array, "knots 3"]:
    """Return the knots of one strand by equation (4-4), not yet set on the scalp.

    Args:
        contour: The scalp contour of the strand's cluster.
        cylinder: The strand's cluster.
        frames: The frames at its knots.
        uv: The root.
        eta: Share of the cluster's length that the strand reaches.
    """
    r, theta = local_coordinates(contour, uv)
    sections = knot_sections(cylinder, frames, theta)
    knots = cylinder.skeleton.shape[0]
    t = eta * jnp.linspace(0.0, 1.0, knots, dtype=uv.dtype)
    return section_points(sections_between(sections, t), r, theta)


def sample_strands(
    tree: HairTree,
    count: int,
    points: int,
    key: PRNGKeyArray | UInt32[Array, " 2"],
) -> Float[Array, "strands points 3"]:
    """Return `count` strands of a tree, from random roots that have an owner.

    Roots are even over the scalp's area, and those that no cluster contains are left
    out. Tips vary as each cluster's `length_variation` says. Fewer strands come back
    only if clusters cover next to nothing of the scalp, and none if they cover nothing.

    Runs outside `jit`.

    Args:
        tree: The tree.
        count: Number of strands.
        points: Number of points of each strand.
        key: Randomness; the same key gives the same strands.
    """
    eta_key, *keys = jax.random.split(key, ROUNDS + 1)
    batch = max(count, 256)
    roots, owners, found = [], [], 0
    for root_key in keys:
        if found >= count:
            break
        uv = sample_roots(tree.scalp, batch, root_key)
        owner = np.asarray(find_owner(tree, uv))
        roots.append(np.asarray(uv)[owner >= 0])
        owners.append(owner[owner >= 0])
        found += len(owners[-1])
    uv = jnp.asarray(np.concatenate(roots)[:count])
    owner = jnp.asarray(np.concatenate(owners)[:count])
    vary = jax.random.uniform(eta_key, owner.shape, uv.dtype)
    eta = 1.0 - tree.length_variation[owner] * vary
    return grow_strands(tree, uv, owner, eta, points)
