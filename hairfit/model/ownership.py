"""Which cluster owns a strand, and where in it the strand runs."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..host import on_device
from .contour import ANGLES, contour_radius
from .tree import HairTree, ScalpContour, leaves, levels, rows_of
from .vector import TINY, norm

# Distances from strands to leaves that are held at once.
CHUNK = 2**18
# The 32 even angles as the arctangent has them, with both of its ends.
TURN = np.linspace(-np.pi, np.pi, ANGLES + 1)


class LocalCoordinates(NamedTuple):
    """A strand's place in its cluster, the same from root to tip.

    Attributes:
        r: Share of the contour's radius; up to 1 inside.
        theta: Angle in radians, in [0, 2 pi).
    """

    r: Float[Array, ""]
    theta: Float[Array, ""]


def local_coordinates(
    contour: ScalpContour, uv: Float[Array, " 2"]
) -> LocalCoordinates:
    r"""Return $(r, \theta)$ of a root in a scalp contour, by equation (4-7).

    The thesis has $\theta = \cos^{-1}(\Delta u / d)$ with
    $d = \sqrt{\Delta u^2 + \Delta v^2}$, and $2 \pi - \theta$ "if $\Delta u < 0$". That
    is a misprint: the cosine gives $\Delta u$ its sign already, for both halves of
    $[0, \pi]$; what it loses is the sign of $\Delta v = d \sin \theta$. So the angle is
    reflected where $\Delta v < 0$, which is the two-argument arctangent.

    At the centre, where the angle is undefined, it is 0. A contour without a radius
    in the root's direction gives $r = 0$. Both have gradients of zero.

    Args:
        contour: One contour.
        uv: The root.
    """
    delta = uv - contour.centre
    distance = norm(delta)
    apart = distance > 0.0
    u = jnp.where(apart, delta[0], 1.0)
    v = jnp.where(apart, delta[1], 0.0)
    theta = jnp.arctan2(v, u)
    theta = jnp.where(theta < 0.0, theta + 2.0 * jnp.pi, theta)
    radius = contour_radius(contour.radius, contour.offset, theta)
    some = radius > TINY
    r = jnp.where(some, distance / jnp.where(some, radius, 1.0), 0.0)
    return LocalCoordinates(r, theta)


def contains(contour: ScalpContour, uv: Float[Array, " 2"]) -> Bool[Array, ""]:
    r"""Return whether a root lies in a scalp contour, its border included.

    The thesis prints $R^s(\theta_h) \le \sqrt{\Delta u^2 + \Delta v^2}$, which holds
    outside: with $r_h$ as its quotient, "inside" would be $r_h \ge 1$. The test is the
    other way round.
    """
    theta = local_coordinates(contour, uv).theta
    radius = contour_radius(contour.radius, contour.offset, theta)
    return norm(uv - contour.centre) <= radius


def find_owner(
    tree: HairTree, uv: Float[Array | np.ndarray, "strands 2"]
) -> Int[Array, " strands"]:
    """Return the leaf cluster that owns each root, -1 where there is none.

    Figure 4-15 of the thesis. From the root clusters down, a strand goes to the one
    among the siblings that contain it whose centre is closest, until no child
    contains it. If it has stopped above the leaves, it goes to the leaf below with the
    closest centre. So:

    - a root in no root cluster has no owner, even if a deeper contour reaches it;
    - in overlaps the closest centre wins, level by level and not over all leaves;
    - a contour that contains a root beats a closer centre that does not;
    - only leaves own strands.

    Taken by the letter, the figure compares a child with its parent too ("closer to H
    than O", while O is the parent), and could return a parent. The text rules both
    out, so the comparison starts afresh at each level and among the leaves. Equal
    distances go to the smaller index. In a tree without clusters no root has an owner.

    A cluster that gets children loses no root: what none of them contains goes to the
    closest leaf below. So subdivision keeps the number of strands.

    This is topology, without gradients, and runs outside `jit`.

    Args:
        tree: The tree.
        uv: The roots.
    """
    roots = np.asarray(uv, np.float64)
    along_u = np.argsort(roots[:, 0], kind="stable")
    u, v = roots[along_u].T
    u, v = np.ascontiguousarray(u), np.ascontiguousarray(v)
    outlines = outlines_of(tree.contour)
    parent = np.asarray(tree.parent, int)
    # Small numbers are sorted in one pass.
    narrow = np.int16 if tree.count < 2**15 else np.int32
    owner = np.full(len(roots), -1, narrow)
    for level in levels(tree):
        # By holder and then by u: what a contour may contain is one slice.
        order = np.argsort(owner, kind="stable")
        start = np.searchsorted(owner[order], np.arange(-1, tree.count + 1))
        held = Held(u[order], v[order], owner[order], np.full(len(order), np.inf))
        for index in level:
            holder = parent[index] + 1
            mine = slice(start[holder], start[holder + 1])
            claim(outlines, int(index), Held(*(x[mine] for x in held)))
        owner[order] = held.owner
    to_closest_leaf(tree, u, v, owner)
    found = np.empty(len(roots), np.int32)
    found[along_u] = owner
    return on_device(found)


class Outlines(NamedTuple):
    """The contours of all clusters, on the host.

    Attributes:
        centre: Their centres.
        reach: Their radii at the 32 even angles from -pi to pi, both ends included.
        inner: The radius within which a contour contains everything.
        outer: The radius beyond which it contains nothing.
    """

    centre: np.ndarray
    reach: np.ndarray
    inner: np.ndarray
    outer: np.ndarray


class Held(NamedTuple):
    """The roots that siblings share out, sorted by u; `owner`, `nearest` are written.

    Attributes:
        u: Of the roots.
        v: Of the roots.
        owner: The sibling that has each root by now, else what it was before.
        nearest: Square of the distance from that sibling's centre, else infinite.
    """

    u: np.ndarray
    v: np.ndarray
    owner: np.ndarray
    nearest: np.ndarray


def outlines_of(contour: ScalpContour) -> Outlines:
    """Return stacked contours as `claim` takes them."""
    size = np.asarray(contour.radius, np.float64)
    reach = size[:, None] + np.asarray(contour.offset, np.float64)
    # Rounding in between may leave the range of the 32 radii by a hair.
    inner, outer = reach.min(axis=1) - TINY, reach.max(axis=1) + TINY
    reach = np.roll(reach, ANGLES // 2, axis=1)
    reach = np.concatenate([reach, reach[:, :1]], axis=1)
    return Outlines(np.asarray(contour.centre, np.float64), reach, inner, outer)


def claim(outlines: Outlines, index: int, held: Held) -> None:
    """Give a sibling, in place, the roots that it contains and is closest to by now.

    The thesis tests a box around the contour first. Here the circles around and within
    it decide for most roots, and only the ring between them needs the angle.
    """
    (cu, cv), outer = outlines.centre[index], outlines.outer[index]
    if outer < 0.0:
        return
    first, last = held.u.searchsorted((cu - outer, cu + outer))
    du, dv = held.u[first:last] - cu, held.v[first:last] - cv
    square = du * du + dv * dv
    nearest = held.nearest[first:last]
    some = np.flatnonzero(square <= np.minimum(nearest, outer * outer))
    if not len(some):
        return
    square = square[some]
    distance = np.sqrt(square)
    # Of equal distances the first sibling keeps the root.
    inside = distance < np.sqrt(nearest[some])
    ring = np.flatnonzero(inside & (distance > outlines.inner[index]))
    if len(ring):
        at = some[ring]
        radius = np.interp(np.arctan2(dv[at], du[at]), TURN, outlines.reach[index])
        inside[ring] = distance[ring] <= radius
    won = first + some[inside]
    held.owner[won] = index
    held.nearest[won] = square[inside]


def to_closest_leaf(
    tree: HairTree, u: np.ndarray, v: np.ndarray, owner: np.ndarray
) -> None:
    """Hand on, in place, what clusters with children own to the closest leaf below."""
    stops = np.setdiff1d(owner, np.append(leaves(tree), -1))
    below = {int(index): [] for index in stops}
    for leaf in leaves(tree):
        above = tree.parent[leaf]
        while above >= 0:
            if above in below:
                below[above].append(leaf)
            above = tree.parent[above]
    centre = np.asarray(tree.contour.centre, np.float64)
    for index, found in below.items():
        leaf = np.array(found)
        mine = np.flatnonzero(owner == index)
        step = max(1, CHUNK // len(leaf))
        for i in range(0, len(mine), step):
            some = mine[i : i + step]
            du = u[some, None] - centre[None, leaf, 0]
            dv = v[some, None] - centre[None, leaf, 1]
            closest = np.argmin(np.sqrt(du * du + dv * dv), axis=1)
            owner[some] = leaf[closest]


def rehouse_wisps(tree: HairTree) -> HairTree:
    """Return the tree whose wisps belong to the leaves that own their roots now.

    To be called where leaves got children or contours moved: a wisp whose root no leaf
    owns is dropped.
    """
    if tree.wisps is None:
        return tree
    owner = np.asarray(find_owner(tree, tree.wisps.uv))
    held = np.flatnonzero(owner >= 0)
    wisps = jax.tree.map(lambda leaf: rows_of(leaf, held), tree.wisps)
    owner = jnp.asarray(owner[held], wisps.owner.dtype)
    wisps = eqx.tree_at(lambda w: w.owner, wisps, owner)
    return eqx.tree_at(lambda t: t.wisps, tree, wisps)
