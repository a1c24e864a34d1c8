"""Styles: any sub-tree is a template that is pasted onto other clusters."""

import dataclasses
import functools
from collections.abc import Collection
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .bind import follow
from .contour import ANGLES, contour_radius
from .curve import EXACT, catmull_rom_weights, linear_weights
from .cylinder import GeneralizedCylinder
from .edit import edit_cluster
from .ownership import find_owner, local_coordinates, rehouse_wisps
from .scalp import Scalp, scalp_point
from .section import on_skeleton
from .tree import (
    HairTree,
    ScalpContour,
    children,
    cluster,
    descendants,
    drop_descendants,
    graft,
    plant,
    take,
)
from .vector import TINY, norm
from .wisp import Wisps

PARTS = (
    "children",
    "skeleton",
    "scale",
    "twist",
    "shear",
    "contour",
    "length_variation",
    "wisps",
)
# What a copy takes unless told otherwise: the target keeps the way that it runs.
ALL = frozenset(PARTS) - {"skeleton"}
# The fewest clusters that are pasted at once.
FEWEST = 4


class Rooted(NamedTuple):
    """One cluster and what it is rooted in."""

    scalp: Scalp
    contour: ScalpContour
    cylinder: GeneralizedCylinder


def extract_style(tree: HairTree, index: int) -> HairTree:
    """Return a cluster and all below it as a tree of its own: a style template.

    The template has the cluster as its only root cluster, with index 0. It can be
    kept in a file like any tree, and pasted onto any cluster of any tree.

    Args:
        tree: The tree.
        index: The cluster that bears the style.

    Raises:
        ValueError: If the tree has no such cluster.
    """
    check_index(tree, index)
    keep = np.zeros(tree.count, bool)
    keep[descendants(tree, index)] = True
    keep[index] = True
    parent = (*tree.parent[:index], -1, *tree.parent[index + 1 :])
    return take(dataclasses.replace(tree, parent=parent), keep)


def copy_style(
    tree: HairTree, source: int, target: int, *, what: Collection[str] = ALL
) -> HairTree:
    """Return the tree in which a cluster has the style of another one.

    Copy and paste of section 4.6.2 [Kim02]: `extract_style`, then `paste_style`, which
    says what happens. Any cluster can be copied onto any other one, at any depth.

    Args:
        tree: The tree.
        source: The cluster whose style is copied.
        target: The cluster that gets it. Its index stays; clusters behind those that
            are replaced change theirs.
        what: What is copied, some of `PARTS`.

    Raises:
        ValueError: If there are no such clusters or parts, if both clusters are the
            same, or if the target lies below the source: it would have to hold itself.
    """
    template = extract_style(tree, source)
    check_index(tree, target)
    if target == source:
        raise ValueError(
            f"cluster {source} cannot be copied onto itself; take another target."
        )
    if target in descendants(tree, source):
        raise ValueError(
            f"cluster {target} lies below cluster {source}, whose style would replace "
            "it; extract the style of a copy, or take a target elsewhere."
        )
    return paste_style(tree, template, target, what=what)


def paste_style(
    tree: HairTree, template: HairTree, target: int, *, what: Collection[str] = ALL
) -> HairTree:
    """Return the tree in which a cluster has the style of a template.

    With `"children"`, the clusters below the template's root cluster are bound to it
    and updated with the target as their parent; they replace what is below the target
    [Kim02, section 4.6.2, figure 4-18]. On the scalp, each of their points keeps its
    place (r, theta) in the contour of the root cluster, so they tile the target as they
    tile the source. Without `"children"`, the clusters below the target stay and follow
    it as after any other edit.

    Of the root cluster's own parameters the target gets those that `what` names:

    - `"scale"`, `"twist"` and `"shear"` are duplicated. What a planted cluster has
      of them (see `plant`) belongs to its place on the scalp, not to the style: it is
      taken off at the source and added at the target. On a conformal patch this is
      nothing, and they are duplicated to the letter.
    - `"contour"`: how the contour in the world changes from root to tip; at each
      angle it is scaled by the ratio of both clusters' contours at the root.
    - `"skeleton"`: the shape of the skeleton, turned as the scalp turns between both
      roots. It is not copied unless asked for.
    - `"length_variation"`.
    - `"wisps"`: what single hairs do, which replaces the target's wisps. Their offsets
      are scaled by the ratio of the sizes of their clusters. Without it, wisps of the
      target stay, with the leaves that own their roots now.

    If the numbers of knots differ, the one with fewer is resampled first.

    Args:
        tree: The tree.
        template: A tree with one root cluster, as `extract_style` returns it.
        target: The cluster that gets the style. Its index stays.
        what: What is pasted, some of `PARTS`.

    Raises:
        ValueError: If the template does not have one root cluster, or there is no such
            cluster or part.
    """
    wanted = chosen_parts(what)
    check_index(tree, target)
    tree, template = matched(tree, template)
    source = Rooted(
        template.scalp, cluster(template.contour, 0), cluster(template.cylinder, 0)
    )
    place = Rooted(
        tree.scalp, cluster(tree.contour, target), cluster(tree.cylinder, target)
    )
    after = restyle(source, place, tuple(sorted(wanted)))
    if "length_variation" in wanted:
        variation = tree.length_variation.at[target].set(template.length_variation[0])
        tree = eqx.tree_at(lambda t: t.length_variation, tree, variation)
    if "children" not in wanted:
        pasted = edit_cluster(tree, target, after)
        if "wisps" in wanted:
            pasted = paste_wisps(pasted, template, target, None)
        return pasted
    pasted = replace_children(tree, template, target, after)
    if "wisps" in wanted:
        first = pasted.count - template.count + 1
        return paste_wisps(pasted, template, target, first)
    return rehouse_wisps(pasted)


class Matched(NamedTuple):
    """A tree and a template with equal numbers of knots, in the tree's precision."""

    tree: HairTree
    template: HairTree


def matched(tree: HairTree, template: HairTree) -> Matched:
    """Return a tree and a template that fit together; the template is checked."""
    roots = len(children(template, -1))
    if roots != 1:
        raise ValueError(
            f"a template has one root cluster, got {roots}; make it by `extract_style`."
        )
    knots = max(t.cylinder.skeleton.shape[1] for t in (tree, template))
    dtype = tree.cylinder.skeleton.dtype
    template = jax.tree.map(
        lambda leaf: leaf.astype(dtype) if eqx.is_inexact_array(leaf) else leaf,
        template,
    )
    return Matched(resample_knots(tree, knots), resample_knots(template, knots))


def resample_knots(tree: HairTree, knots: int) -> HairTree:
    """Return the tree with another number of knots in each cluster.

    Skeletons are taken from their Catmull-Rom curves, everything else is interpolated
    linearly, as it is along a cluster.

    Args:
        tree: The tree.
        knots: Number of knots, 2 or more.

    Raises:
        ValueError: If there are fewer than two knots.
    """
    if knots < 2:
        raise ValueError(f"a cluster needs at least 2 knots, got {knots}.")
    before = tree.cylinder.skeleton.shape[1]
    if knots == before:
        return tree
    t = jnp.linspace(0.0, 1.0, knots, dtype=tree.cylinder.skeleton.dtype)
    curve, line = catmull_rom_weights(before, t), linear_weights(before, t)

    def between(values, weights=line):
        return jnp.einsum("pk,ck...->cp...", weights, values, precision=EXACT)

    old = tree.cylinder
    cylinder = eqx.tree_at(
        lambda c: (c.skeleton, c.radius, c.offset, c.scale, c.twist, c.shear),
        old,
        (
            between(old.skeleton, curve),
            *map(between, (old.radius, old.offset, old.scale, old.twist, old.shear)),
        ),
    )
    wisps = tree.wisps
    if wisps is not None:
        wisps = eqx.tree_at(lambda w: w.offset, wisps, between(wisps.offset))
    return dataclasses.replace(tree, cylinder=cylinder, wisps=wisps)


def check_index(tree: HairTree, index: int) -> None:
    """Raise if a tree has no cluster of the index."""
    if not 0 <= index < tree.count:
        raise ValueError(
            f"there is no cluster {index}; the tree has clusters 0 to {tree.count - 1}."
        )


def chosen_parts(what: Collection[str]) -> frozenset[str]:
    """Return the names of the parts to copy, checked."""
    wanted = frozenset([what] if isinstance(what, str) else what)
    unknown = sorted(wanted - frozenset(PARTS))
    if unknown:
        raise ValueError(
            f"a style has no {', '.join(unknown)}; take some of {', '.join(PARTS)}."
        )
    return wanted


@functools.partial(jax.jit, static_argnums=2)
def restyle(
    source: Rooted, target: Rooted, what: tuple[str, ...]
) -> GeneralizedCylinder:
    """Return the target's cylinder with the parameters of the source that are named."""
    from_a, to_b = source.cylinder, target.cylinder
    own_a = plant(source.scalp, source.contour, 1.0, 2)
    own_b = plant(target.scalp, target.contour, 1.0, 2)
    new = {}
    if "skeleton" in what:
        turn = jnp.matmul(root_frame(own_a).T, root_frame(own_b), precision=EXACT)
        shape = from_a.skeleton - own_a.skeleton[:1]
        new["skeleton"] = own_b.skeleton[:1] + jnp.matmul(shape, turn, precision=EXACT)
        new["normal"] = jnp.matmul(from_a.normal, turn, precision=EXACT)
    if "scale" in what:
        new["scale"] = from_a.scale * (own_b.scale[:1] / own_a.scale[:1])
    if "twist" in what:
        new["twist"] = from_a.twist
    if "shear" in what:
        new["shear"] = from_a.shear + (own_b.shear[:1] - own_a.shear[:1])
    if "contour" in what:
        along = from_a.radius[:, None] + from_a.offset
        reach = along * quotient(to_b.radius[:1, None] + to_b.offset[:1], along[:1])
        new["radius"] = jnp.mean(reach, axis=1)
        new["offset"] = reach - new["radius"][:, None]
    return dataclasses.replace(to_b, **new)


def root_frame(planted: GeneralizedCylinder) -> Float[Array, "3 3"]:
    """Return the frame of the scalp under a planted cluster; its rows are the axes."""
    up = planted.skeleton[1] - planted.skeleton[0]
    return jnp.stack([planted.normal, jnp.cross(up, planted.normal), up])


def replace_children(
    tree: HairTree, template: HairTree, target: int, after: GeneralizedCylinder
) -> HairTree:
    """Return the tree whose target is `after`, with the template's clusters below it.

    Wisps of what was below the target go to the target.
    """
    if tree.wisps is not None:
        owner = np.array(tree.wisps.owner)
        owner[np.isin(owner, descendants(tree, target))] = target
        wisps = dataclasses.replace(tree.wisps, owner=jnp.asarray(owner))
        tree = dataclasses.replace(tree, wisps=wisps)
    kept = drop_descendants(tree, target)
    cylinder = jax.tree.map(
        lambda leaf, one: leaf.at[target].set(one), kept.cylinder, after
    )
    kept = dataclasses.replace(kept, cylinder=cylinder)
    if template.count == 1:
        return kept
    before = cluster(template.cylinder, 0)
    contour, below = jax.tree.map(
        lambda leaf: leaf[1:], (template.contour, template.cylinder)
    )
    ends = cluster(template.contour, 0), cluster(kept.contour, target)
    # Their number is rounded up to a power of 2, so that few programs are compiled.
    number = template.count - 1
    index = np.resize(np.arange(number), max(FEWEST, 1 << (number - 1).bit_length()))
    contour, below = jax.tree.map(lambda leaf: leaf[index], (contour, below))
    contour = move_contours(*ends, contour)
    below = place_below(tree.scalp, contour, before, after, below)
    contour, below = jax.tree.map(lambda leaf: leaf[:number], (contour, below))
    above = [target if p == 0 else kept.count + p - 1 for p in template.parent[1:]]
    return graft(kept, contour, below, template.length_variation[1:], above)


@jax.jit
def place_below(
    scalp: Scalp,
    contour: ScalpContour,
    before: GeneralizedCylinder,
    after: GeneralizedCylinder,
    below: GeneralizedCylinder,
) -> GeneralizedCylinder:
    """Return a template's clusters as they run below another cluster.

    They follow from `before` to `after`. `follow` widens their scales where the
    contour of `after` is wider; that share is given to their contours, as in the
    thesis. Their roots are set on the scalp, and what that moves fades out
    towards the tips.

    Args:
        scalp: The scalp.
        contour: Scalp contours of the clusters, stacked.
        before: The root cluster of the template.
        after: The cluster that they are pasted onto.
        below: The clusters, stacked.
    """
    ratio = quotient(after.radius, before.radius)
    ratio = jnp.where(ratio > TINY, ratio, 1.0)

    def place(one: GeneralizedCylinder, uv: Float[Array, " 2"]) -> GeneralizedCylinder:
        shift = scalp_point(scalp, uv) - one.skeleton[0]
        fade = jnp.linspace(1.0, 0.0, ratio.shape[0], dtype=shift.dtype)
        one = on_skeleton(one, one.skeleton + fade[:, None] * shift[None])
        return dataclasses.replace(
            one,
            radius=one.radius * ratio,
            offset=one.offset * ratio[:, None],
            scale=one.scale / ratio[:, None],
            shear=one.shear / ratio,
        )

    return jax.vmap(place)(follow(before, after, below), contour.centre)


def paste_wisps(
    tree: HairTree, template: HairTree, target: int, first: int | None
) -> HairTree:
    """Return the tree with a template's wisps instead of the target's.

    Args:
        tree: The tree after the paste of everything else.
        template: The template.
        target: The cluster that the template was pasted onto.
        first: Index of the template's second cluster in the tree; None if the target
            has kept its own children. Then a wisp goes to the leaf that owns its root.
    """
    mine = np.append(descendants(tree, target), target)
    found: list[Wisps] = []
    if tree.wisps is not None:
        others = np.flatnonzero(~np.isin(np.asarray(tree.wisps.owner), mine))
        found.append(jax.tree.map(lambda leaf: leaf[others], tree.wisps))
    if template.wisps is not None:
        was = np.asarray(template.wisps.owner)
        ends = cluster(template.contour, 0), cluster(tree.contour, target)
        uv = move_roots(*ends, template.wisps.uv)
        if first is None:
            owner = np.asarray(find_owner(tree, uv))
        else:
            owner = np.where(was == 0, target, first + was - 1)
        held = np.flatnonzero(np.isin(owner, mine))
        size, source = widths(tree.cylinder), widths(template.cylinder)
        ratio = quotient(size[owner[held]], source[was[held]])
        offset = template.wisps.offset[held] * ratio[:, :, None]
        owner = jnp.asarray(owner[held], template.wisps.owner.dtype)
        found.append(Wisps(uv[held], owner, offset))
    if not found:
        return tree
    wisps = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *found)
    return dataclasses.replace(tree, wisps=wisps)


def widths(cylinder: GeneralizedCylinder) -> Float[Array, "clusters knots"]:
    """Return the mean radius of the cross-sections of stacked clusters, in metres."""
    area = jnp.abs(cylinder.scale[..., 0] * cylinder.scale[..., 1])
    return cylinder.radius * jnp.sqrt(area)


def quotient(
    above: Float[Array, "*batch"], below: Float[Array, "*batch"]
) -> Float[Array, "*batch"]:
    """Return quotients, 1 where the divisor vanishes."""
    some = jnp.abs(below) > TINY
    return jnp.where(some, above / jnp.where(some, below, 1.0), 1.0)


def moved_root(
    source: ScalpContour, target: ScalpContour, uv: Float[Array, " 2"]
) -> Float[Array, " 2"]:
    """Return the root that has the place in `target` that `uv` has in `source`."""
    theta = local_coordinates(source, uv).theta
    a = contour_radius(source.radius, source.offset, theta)
    b = contour_radius(target.radius, target.offset, theta)
    return target.centre + quotient(b, a) * (uv - source.centre)


def moved_contour(
    source: ScalpContour, target: ScalpContour, contour: ScalpContour
) -> ScalpContour:
    """Return a scalp contour whose border is moved as `moved_root` moves its points.

    Away from the middle of `source` its angles turn a little where the ratio of both
    contours varies; the border is interpolated between them.
    """
    dtype = contour.offset.dtype
    angle = jnp.arange(ANGLES, dtype=dtype) * (2.0 * jnp.pi / ANGLES)
    reach = contour.radius + contour.offset
    spoke = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)
    border = contour.centre[None] + reach[:, None] * spoke
    centre = moved_root(source, target, contour.centre)
    border = jax.vmap(moved_root, (None, None, 0))(source, target, border)
    delta = border - centre[None]
    distance = norm(delta)
    # A border point at the centre keeps its angle.
    delta = jnp.where((distance > TINY)[:, None], delta, spoke)
    turned = jnp.arctan2(delta[:, 1], delta[:, 0])
    reach = jnp.interp(angle, turned, distance, period=2.0 * jnp.pi)
    radius = jnp.mean(reach)
    return ScalpContour(centre, radius, reach - radius)


move_roots = jax.jit(jax.vmap(moved_root, (None, None, 0)))
move_contours = jax.jit(jax.vmap(moved_contour, (None, None, 0)))
