"""Which cluster owns a strand, and where in it the strand runs."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .contour import ANGLES, contour_radius
from .tree import HairTree, ScalpContour, descendants, leaves, levels
from .vector import TINY, norm

# Strands whose distances to leaves are held at once.
CHUNK = 4096


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
    distances go to the smaller index.

    This is topology, without gradients, and runs outside `jit`.

    Args:
        tree: The tree.
        uv: The roots.
    """
    roots = np.asarray(uv, np.float64)
    size = np.asarray(tree.contour.radius, np.float64)
    reach = size[:, None] + np.asarray(tree.contour.offset, np.float64)
    centre = np.asarray(tree.contour.centre, np.float64)
    parent = np.asarray(tree.parent, int)
    owner = np.full(len(roots), -1, np.int32)
    for level in levels(tree):
        # By holder and then by u: what a contour may contain is one slice.
        order = np.lexsort((roots[:, 0], owner))
        sorted_roots = roots[order]
        start = np.searchsorted(owner[order], np.arange(-1, tree.count + 1))
        nearest = np.full(len(roots), np.inf)
        for index in level:
            held = slice(start[parent[index] + 1], start[parent[index] + 2])
            inside, distance = roots_inside(
                centre[index], reach[index], sorted_roots[held]
            )
            strand = order[held][inside]
            closer = distance < nearest[strand]
            nearest[strand[closer]] = distance[closer]
            owner[strand[closer]] = index
    to_closest_leaf(tree, roots, owner)
    return jnp.asarray(owner)


class Inside(NamedTuple):
    """Which roots a contour contains, and their distances from its centre."""

    index: np.ndarray
    distance: np.ndarray


def roots_inside(centre: np.ndarray, reach: np.ndarray, roots: np.ndarray) -> Inside:
    """Return which of many roots, sorted by u, one contour contains.

    `contains` on the host, after a box around the contour as in the thesis.

    Args:
        centre: Centre of the contour.
        reach: Its radii at the 32 even angles.
        roots: The roots.
    """
    box = reach.max()
    first, last = np.searchsorted(roots[:, 0], [centre[0] - box, centre[0] + box])
    near = np.abs(roots[first:last, 1] - centre[1]) <= box
    index = first + np.flatnonzero(near)
    du, dv = (roots[index] - centre).T
    distance = np.sqrt(du * du + dv * dv)
    angles = np.arange(ANGLES) * (2.0 * np.pi / ANGLES)
    radius = np.interp(np.arctan2(dv, du), angles, reach, period=2.0 * np.pi)
    inside = distance <= radius
    return Inside(index[inside], distance[inside])


def to_closest_leaf(tree: HairTree, roots: np.ndarray, owner: np.ndarray) -> None:
    """Hand on, in place, what clusters with children own to the closest leaf below."""
    is_leaf = np.zeros(tree.count, bool)
    is_leaf[leaves(tree)] = True
    centre = np.asarray(tree.contour.centre, np.float64)
    stopped = np.flatnonzero((owner >= 0) & ~is_leaf[owner])
    for index in np.unique(owner[stopped]):
        below = descendants(tree, int(index))
        below = below[is_leaf[below]]
        mine = stopped[owner[stopped] == index]
        for i in range(0, len(mine), CHUNK):
            some = mine[i : i + CHUNK]
            rest = roots[some, None] - centre[None, below]
            owner[some] = below[np.argmin(np.hypot(rest[..., 0], rest[..., 1]), axis=1)]


def rehouse_wisps(tree: HairTree) -> HairTree:
    """Return the tree whose wisps belong to the leaves that own their roots now.

    To be called where leaves got children or contours moved: a wisp whose root no leaf
    owns is dropped.
    """
    if tree.wisps is None:
        return tree
    owner = np.asarray(find_owner(tree, tree.wisps.uv))
    held = np.flatnonzero(owner >= 0)
    wisps = jax.tree.map(lambda leaf: leaf[held], tree.wisps)
    owner = jnp.asarray(owner[held], wisps.owner.dtype)
    wisps = eqx.tree_at(lambda w: w.owner, wisps, owner)
    return eqx.tree_at(lambda t: t.wisps, tree, wisps)
