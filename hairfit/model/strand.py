"""Strands: polylines that follow their clusters."""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int, PRNGKeyArray, UInt32

from ..host import on_device
from .curve import EXACT, catmull_rom_weights
from .cylinder import (
    GeneralizedCylinder,
    cylinder_frames,
    knot_sections,
    section_points,
    sections_between,
    together,
)
from .frame import Frames
from .fur import curl_each
from .locks import wind_along
from .maps import keep_roots, root_attributes
from .ownership import find_owner, local_coordinates
from .scalp import Scalp, sample_roots, scalp_point
from .tree import HairTree, ScalpContour, filled
from .wisp import nearest_wisp, wisp_points

# Rounds of sampling after which a scalp that is hardly covered counts as exhausted.
ROUNDS = 64
# The fewest strands that are grown at once when some clusters were edited.
FEWEST = 64


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
    share one compiled program, whatever their topology. In a tree with wisps, `uv` and
    `owner` must be known when the function is called: under `jit`, call `grow` with the
    wisps found before.

    Args:
        tree: The tree.
        uv: The roots, in scalp space.
        owner: The leaf cluster of each strand, as `find_owner` has it. A strand
            without an owner (-1) does not grow: all its points are its root.
        eta: Share of the cluster's length that each strand reaches, 1 for all of it.
        points: Number of points of each strand, evenly spaced in the spline's
            parameter.
    """
    offset = None
    if tree.wisps is not None:
        wisp = nearest_wisp(tree.wisps, uv, owner)
        offset = wisp_offsets(tree.wisps.offset, wisp)
    return grow(tree.scalp, tree.contour, tree.cylinder, uv, owner, eta, points, offset)


def regrow_strands(
    tree: HairTree,
    strands: Float[Array, "strands points 3"],
    uv: Float[Array, "strands 2"],
    owner: Int[Array, " strands"],
    eta: Float[Array, " strands"],
    edited: Sequence[int],
) -> Float[Array, "strands points 3"]:
    """Return strands of which only those of edited clusters are grown anew.

    An edit of some clusters then costs its share of the strands [Kim02, section 4.9].
    Their number is rounded up to a power of 2, so that few programs are compiled. Runs
    outside `jit`.

    Args:
        tree: The tree after the edit.
        strands: All strands as they grew before it.
        uv: As `grow_strands` takes it.
        owner: The same.
        eta: The same.
        edited: The leaf clusters that changed.
    """
    mine = np.flatnonzero(np.isin(np.asarray(owner), np.asarray(edited, int)))
    if not len(mine):
        return strands
    size = max(FEWEST, 1 << (len(mine) - 1).bit_length())
    index = jnp.asarray(np.resize(mine, size))  # repeats strands, which does no harm
    offset = None
    if tree.wisps is not None:
        wisp = nearest_wisp(tree.wisps, np.asarray(uv)[mine], np.asarray(owner)[mine])
        offset = wisp_offsets(tree.wisps.offset, jnp.resize(wisp, (size,)))
    parts = (tree.scalp, tree.contour, tree.cylinder)
    return regrow(*parts, strands, uv, owner, eta, index, offset)


@jax.jit
def regrow(
    scalp: Scalp,
    contour: ScalpContour,
    cylinder: GeneralizedCylinder,
    strands: Float[Array, "strands points 3"],
    uv: Float[Array, "strands 2"],
    owner: Int[Array, " strands"],
    eta: Float[Array, " strands"],
    index: Int[Array, " some"],
    offset: Float[Array, "some knots 3"] | None,
) -> Float[Array, "strands points 3"]:
    """Return strands, those at `index` grown anew, in one program."""
    some = (uv[index], owner[index], eta[index])
    grown = grow(scalp, contour, cylinder, *some, strands.shape[1], offset)
    return strands.at[index].set(grown)


def wisp_offsets(
    offset: Float[Array, "wisps knots 3"], wisp: Int[Array, " strands"]
) -> Float[Array, "strands knots 3"]:
    """Return each strand's offsets, 0 where it follows no wisp (-1)."""
    if not len(offset):
        return jnp.zeros((len(wisp), *offset.shape[1:]), offset.dtype)
    mine = offset[jnp.maximum(wisp, 0)]
    return jnp.where((wisp >= 0)[:, None, None], mine, 0.0)


@functools.partial(jax.jit, static_argnames="points")
def grow(
    scalp: Scalp,
    contour: ScalpContour,
    cylinder: GeneralizedCylinder,
    uv: Float[Array, "strands 2"],
    owner: Int[Array, " strands"],
    eta: Float[Array, " strands"],
    points: int,
    offset: Float[Array, "strands knots 3"] | None = None,
) -> Float[Array, "strands points 3"]:
    """`grow_strands` on the arrays of a tree, with the offsets of its wisps."""
    frames = jax.vmap(cylinder_frames)(cylinder)
    index = jnp.maximum(owner, 0)
    mine = jax.tree.map(lambda leaf: leaf[index], (contour, cylinder, frames))
    contour, cylinder, frames = mine
    knots = jax.vmap(strand_knots)(contour, cylinder, frames, uv, eta, offset)
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
    offset: Float[Array, "knots 3"] | None = None,
) -> Float[Array, "knots 3"]:
    """Return the knots of one strand by equation (4-4), not yet set on the scalp.

    Args:
        contour: The scalp contour of the strand's cluster.
        cylinder: The strand's cluster.
        frames: The frames at its knots.
        uv: The root.
        eta: Share of the cluster's length that the strand reaches.
        offset: Offsets of the strand's wisp, if it follows one.
    """
    r, theta = local_coordinates(contour, uv)
    sections = knot_sections(cylinder, frames, theta)
    knots = cylinder.skeleton.shape[0]
    t = eta * jnp.linspace(0.0, 1.0, knots, dtype=uv.dtype)
    here = sections_between(sections, t)
    at = section_points(here, r, theta)
    return at if offset is None else at + wisp_points(here, offset, t)


class Hair(NamedTuple):
    """Strands, and where in the tree they grow.

    Attributes:
        strands: Root first, in metres.
        uv: The roots in scalp space; `root_attributes` says what the maps have there.
        owner: The leaf cluster of each.
        eta: Share of the cluster's length that each reaches.
    """

    strands: Float[Array, "strands points 3"]
    uv: Float[Array, "strands 2"]
    owner: Int[Array, " strands"]
    eta: Float[Array, " strands"]


def sample_strands(
    tree: HairTree,
    count: int,
    points: int,
    key: PRNGKeyArray | UInt32[Array, " 2"],
) -> Float[Array, "strands points 3"]:
    """Return `count` strands of a tree; see `sample_hair`."""
    return sample_hair(tree, count, points, key).strands


def with_room(tree: HairTree) -> HairTree:
    """Return a tree whose arrays hold some more clusters, of which no strand grows.

    Trees of about as many clusters so share the program that grows their strands. One
    whose values are not known yet stays as it is.
    """
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(tree)):
        return tree
    many = filled(tree, together(tree.count))
    return eqx.tree_at(lambda t: (t.contour, t.cylinder), tree, tuple(many))


def sample_hair(
    tree: HairTree,
    count: int,
    points: int,
    key: PRNGKeyArray | UInt32[Array, " 2"],
) -> Hair:
    """Return `count` strands of a tree, from random roots that have an owner.

    Roots are even over the scalp's area, and those that no cluster contains are left
    out. Tips vary as each cluster's `length_variation` says. In a tree with maps, the
    share of the roots that grow, their lengths and the curls of single hairs are as
    painted; the curls of a cluster wind as its lock does, if the tree has locks. Fewer
    strands come back only if clusters cover next to nothing of the scalp, and none if
    they cover nothing.

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
        grows = owner >= 0
        if tree.maps is not None:
            keep_key = jax.random.fold_in(root_key, 1)
            grows &= np.asarray(keep_roots(tree.maps, uv, keep_key))
        roots.append(np.asarray(uv)[grows])
        owners.append(owner[grows])
        found += len(owners[-1])
    uv = on_device(np.concatenate(roots)[:count])
    owner = on_device(np.concatenate(owners)[:count])
    eta = _varied(tree.length_variation, owner, uv, eta_key)
    roomy = with_room(tree)
    if tree.maps is None:
        return Hair(grow_strands(roomy, uv, owner, eta, points), uv, owner, eta)
    painted = root_attributes(tree.maps, uv)
    eta = eta * painted.length.astype(eta.dtype)
    strands = grow_strands(roomy, uv, owner, eta, points)
    locks = tree.locks
    winding = None if locks is None else wind_along(locks, owner, eta, points)
    curl_key = jax.random.fold_in(eta_key, 1)
    strands = curl_each(strands, painted.curl, curl_key, winding)
    return Hair(strands, uv, owner, eta)


@jax.jit
def _varied(
    variation: Float[Array, " clusters"],
    owner: Int[Array, " strands"],
    uv: Float[Array, "strands 2"],
    key: PRNGKeyArray | UInt32[Array, " 2"],
) -> Float[Array, " strands"]:
    """Return what share of their clusters' lengths strands reach."""
    vary = jax.random.uniform(key, owner.shape, uv.dtype)
    return 1.0 - variation[owner] * vary
