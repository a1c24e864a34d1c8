"""How long clusters are: hair that grows, is stretched, or is cut."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, ScalarLike

from .bind import make_binder, speed_at
from .closest import PER_SEGMENT, nearest
from .curve import EXACT, arc_length, catmull_rom_weights, linear_weights
from .cylinder import (
    GeneralizedCylinder,
    cylinder_frames,
    knot_sections,
    sections_between,
)
from .edit import WHOLE, Grip, Plane, binders, check_cluster, edit_each, followers
from .reshape import Indices, place_on
from .section import plane_of, section_maps, with_section_maps
from .tree import HairTree, cluster
from .vector import TINY
from .wisp import Wisps


def lengthen(
    tree: HairTree,
    index: Indices,
    factor: ScalarLike,
    grip: Grip = WHOLE,
    *,
    stretch: bool = False,
) -> HairTree:
    """Return the tree in which a cluster is longer, or shorter, by a factor.

    Hair grows on along the tangent at its tip, each cluster below by the factor of its
    own length; contour, scale and twist go on as they are at the tip. Stretched hair
    keeps its shape instead and becomes larger along the skeleton, and all below
    follows.

    Args:
        tree: The tree.
        index: The cluster, or several.
        factor: Of the length; below 1 hair is cut, or shrinks.
        grip: Who follows; which knot is picked does not matter.
        stretch: Whether to stretch the cluster.
    """
    if stretch:

        def change(cylinder: GeneralizedCylinder) -> GeneralizedCylinder:
            root = cylinder.skeleton[:1]
            return place_on(cylinder, root + factor * (cylinder.skeleton - root))

        return edit_each(tree, index, change, grip)
    family = families(tree, index, grip)
    some = jax.tree.map(lambda leaf: leaf[family], tree.cylinder)
    by = jnp.asarray(factor, some.radius.dtype)
    return end_at(tree, family, jax.jit(jax.vmap(grown_end, (0, None)))(some, by))


def cut(
    tree: HairTree, index: Indices, at: ScalarLike | Plane, grip: Grip = WHOLE
) -> HairTree:
    """Return the tree in which a cluster, and all below it, is cut.

    At `t` of the cluster: clusters below are cut where they pass there. By a plane:
    each where it first goes to the side that the normal points to; a cluster whose root
    is there already stays as it is. Control points are spread anew over what is left.

    The place of a cut has gradients by the skeletons.

    Args:
        tree: The tree.
        index: The cluster, or several.
        at: Where along the cluster, from 0 to 1; or a plane.
        grip: Who follows; which knot is picked does not matter.
    """
    for i in np.atleast_1d(np.asarray(index, int)):
        family = families(tree, int(i), grip)
        some = jax.tree.map(lambda leaf, rows=family: leaf[rows], tree.cylinder)
        dtype = some.radius.dtype
        if isinstance(at, Plane):
            point, normal = (jnp.asarray(x, dtype) for x in at)
            end = ends_at_plane(some.skeleton, point, normal)
        else:
            end = ends_at(cluster(some, 0), some.skeleton, jnp.asarray(at, dtype))
        tree = end_at(tree, family, end)
    return tree


def families(tree: HairTree, index: Indices, grip: Grip) -> Int[np.ndarray, " some"]:
    """Return clusters and all that follow them, each once, those named first."""
    bound = binders(tree, grip.binder_of or {})
    found: dict[int, None] = {}
    for i in np.atleast_1d(np.asarray(index, int)):
        check_cluster(tree, int(i))
        found.update(dict.fromkeys([int(i), *sorted(followers(bound, int(i)))]))
    return np.array(list(found), np.int32)


def grown_end(
    cylinder: GeneralizedCylinder, factor: Float[Array, ""]
) -> Float[Array, ""]:
    """Return the `t` at which a cluster is longer by a factor."""
    t = jnp.linspace(0.0, 1.0, dense_count(cylinder.skeleton), dtype=factor.dtype)
    weights = catmull_rom_weights(cylinder.skeleton.shape[0], t)
    along = arc_length(jnp.matmul(weights, cylinder.skeleton, precision=EXACT))
    length = factor * along[-1]
    speed = speed_at(make_binder(cylinder), jnp.ones_like(factor))
    speed = jnp.where(speed > TINY, speed, jnp.maximum(along[-1], TINY))
    beyond = 1.0 + (length - along[-1]) / speed
    return jnp.where(factor > 1.0, beyond, jnp.interp(length, along, t))


def dense_count(skeleton: Float[Array, "knots 3"]) -> int:
    """Return how many points of a skeleton are looked at."""
    return PER_SEGMENT * (skeleton.shape[0] - 1) + 1


@jax.jit
def ends_at(
    cylinder: GeneralizedCylinder,
    skeletons: Float[Array, "some knots 3"],
    t: Float[Array, ""],
) -> Float[Array, " some"]:
    """Return where skeletons first pass a place of a cluster; 1 where they do not."""
    binder = make_binder(cylinder)
    ends = jax.vmap(
        lambda skeleton: crossing(skeleton, lambda p: nearest(binder.axis, p).t - t)
    )(skeletons)
    return ends.at[0].set(t)


@jax.jit
def ends_at_plane(
    skeletons: Float[Array, "some knots 3"],
    point: Float[Array, " 3"],
    normal: Float[Array, " 3"],
) -> Float[Array, " some"]:
    """Return where skeletons first pass a plane; 1 where they do not."""
    return jax.vmap(
        lambda skeleton: crossing(skeleton, lambda p: jnp.dot(p - point, normal))
    )(skeletons)


def crossing(skeleton: Float[Array, "knots 3"], height) -> Float[Array, ""]:
    """Return the `t` at which a function along a skeleton first becomes positive.

    1 where it does not, or is positive at the root.
    """
    count = dense_count(skeleton)
    t = jnp.linspace(0.0, 1.0, count, dtype=skeleton.dtype)
    weights = catmull_rom_weights(skeleton.shape[0], t)
    value = jax.vmap(height)(jnp.matmul(weights, skeleton, precision=EXACT))
    passed = (value[:-1] <= 0.0) & (value[1:] > 0.0)
    first = jnp.argmax(passed)
    low, high = value[first], value[first + 1]
    share = -low / jnp.where(high > low, high - low, 1.0)
    there = t[first] + share / (count - 1)
    return jnp.where(jnp.any(passed) & (value[0] <= 0.0), there, 1.0)


def end_at(
    tree: HairTree, some: Int[np.ndarray, " some"], end: Float[Array, " some"]
) -> HairTree:
    """Return the tree in which some clusters end at other places of themselves.

    Wisps of theirs end there as well.
    """
    old = jax.tree.map(lambda leaf: leaf[some], tree.cylinder)
    new = respan_all(old, end)
    cylinder = jax.tree.map(lambda leaf, n: leaf.at[some].set(n), tree.cylinder, new)
    wisps = tree.wisps
    if wisps is not None and len(wisps.owner):
        row = np.full(tree.count, -1)
        row[some] = np.arange(len(some))
        mine = row[np.asarray(wisps.owner)]
        wisps = respan_wisps(wisps, jnp.asarray(mine >= 0), end[np.maximum(mine, 0)])
    return dataclasses.replace(tree, cylinder=cylinder, wisps=wisps)


@jax.jit
def respan_wisps(wisps: Wisps, mine: Array, end: Float[Array, " wisps"]) -> Wisps:
    """Return wisps of which some end at other places of themselves."""

    def one(offset, end):
        return jnp.matmul(span_weights(offset, end), offset, precision=EXACT)

    offset = jax.vmap(one)(wisps.offset, end)
    offset = jnp.where(mine[:, None, None], offset, wisps.offset)
    return eqx.tree_at(lambda w: w.offset, wisps, offset)


def span_weights(
    values: Float[Array, "knots axes"], end: Float[Array, ""]
) -> Float[Array, "knots knots"]:
    """Return the weights that give values at even knots up to `end`."""
    knots = values.shape[0]
    t = end * jnp.linspace(0.0, 1.0, knots, dtype=values.dtype)
    return linear_weights(knots, t)


@jax.jit
def respan_all(
    cylinders: GeneralizedCylinder, end: Float[Array, " some"]
) -> GeneralizedCylinder:
    """Return stacked clusters that end at other places of themselves."""
    return jax.vmap(respan)(cylinders, end)


def respan(cylinder: GeneralizedCylinder, end: Float[Array, ""]) -> GeneralizedCylinder:
    """Return one cluster from its root to its own `t = end`, with even knots.

    Cross-sections are those of the cluster there, though the frames of the new knots
    are not exactly the interpolated ones. Beyond the tip they stay as at the tip.
    """
    frames = cylinder_frames(cylinder)
    knots, dtype = cylinder.twist.shape[0], cylinder.twist.dtype
    t = end * jnp.linspace(0.0, 1.0, knots, dtype=dtype)
    line = linear_weights(knots, t)
    here = sections_between(knot_sections(cylinder, frames, 0.0), t)
    there = eqx.tree_at(
        lambda c: (c.skeleton, c.radius, c.offset, c.scale, c.twist, c.shear),
        cylinder,
        (
            here.centre,
            jnp.matmul(line, cylinder.radius, precision=EXACT),
            jnp.matmul(line, cylinder.offset, precision=EXACT),
            here.scale,
            here.twist,
            here.shear,
        ),
    )
    maps = jnp.swapaxes(plane_of(cylinder_frames(there)), 1, 2)
    for factor in (plane_of(here.frames), section_maps(there)):
        maps = jnp.matmul(maps, factor, precision=EXACT)
    return with_section_maps(there, maps)
