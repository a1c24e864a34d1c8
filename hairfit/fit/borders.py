"""Scalp contours of clusters whose strands are known, drawn by majority."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from ..model.contour import ANGLES
from ..model.tiling import star_contours
from ..model.tree import ScalpContour

SPOKE = 2.0 * np.pi / ANGLES


def draw_contours(
    uv: Float[np.ndarray, "strands 2"],
    label: Int[np.ndarray, " strands"],
    middle: Float[np.ndarray, "clusters 2"],
    *,
    against: float,
    margin: float,
) -> ScalpContour:
    """Return stacked contours that hold as many own roots and as few others as can be.

    Clusters that were gathered by the shape of strands overlap on the scalp. Along each
    spoke a contour ends where the sum of the votes of the roots inside it is greatest:
    1 for each own one, `-against` for each other.

    Args:
        uv: Roots in scalp space.
        label: The cluster of each root.
        middle: Centres of the clusters.
        against: What other roots count; at 0 all own roots are inside.
        margin: How far contours reach beyond that, in scalp space.
    """
    order = np.argsort(label, kind="stable")
    first = np.searchsorted(label[order], np.arange(len(middle) + 1))
    near = KDTree(uv)
    reach = np.full((len(middle), ANGLES), margin)
    for index, centre in enumerate(middle):
        members = order[first[index] : first[index + 1]]
        if len(members):
            far = np.linalg.norm(uv[members] - centre, axis=1).max()
            around = np.array(near.query_ball_point(centre, far + 1e-9))
            own = label[around] == index
            reach[index] += voted_reach(uv[around] - centre, own, against)
    return star_contours(middle, reach)


def voted_reach(
    away: Float[np.ndarray, "roots 2"], own: Bool[np.ndarray, " roots"], against: float
) -> Float[np.ndarray, " 32"]:
    """Return how far along the spokes the votes of roots are won.

    Args:
        away: Places of the roots from the centre.
        own: Which of them vote for the contour.
        against: What the others count.
    """
    distance = np.linalg.norm(away, axis=1)
    sector = np.floor(np.arctan2(away[:, 1], away[:, 0]) / SPOKE).astype(int)
    # A root votes at the two spokes beside it.
    spoke = np.concatenate([sector, sector + 1]) % ANGLES
    distance, vote = np.tile(distance, 2), np.tile(np.where(own, 1.0, -against), 2)
    order = np.lexsort((distance, spoke))
    spoke, distance, vote = spoke[order], distance[order], vote[order]
    reach = np.zeros(ANGLES)
    for index in np.unique(spoke):
        mine = slice(*np.searchsorted(spoke, [index, index + 1]))
        won = np.cumsum(vote[mine])
        best = len(won) - 1 - np.argmax(won[::-1])
        reach[index] = distance[mine][best] if won[best] > 0.0 else 0.0
    return reach


def move_starved(
    uv: Float[np.ndarray, "strands 2"],
    label: Int[np.ndarray, " strands"],
    centre: Float[np.ndarray, "clusters 2"],
    starved: Bool[np.ndarray, " clusters"],
) -> Float[np.ndarray, "clusters 2"]:
    """Return centres, some moved to the own root that is farthest from all others.

    Args:
        uv: Roots in scalp space.
        label: The cluster of each root.
        centre: The centres.
        starved: Which ones to move, one after the other.
    """
    centre = centre.copy()
    for index in np.flatnonzero(starved):
        mine = uv[label == index]
        others = np.delete(centre, index, axis=0)
        apart = KDTree(others).query(mine)[0]
        centre[index] = mine[np.argmax(apart)]
    return centre
