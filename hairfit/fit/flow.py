r"""Which way hair grows along a field of directions that has no sign.

Hair is conserved: what grows out of the scalp runs on until it ends somewhere farther
out. So the field is taken as a conductor that lets hair pass along its direction alone.
Each place at the scalp gives as much as any other, all places farther out take a little
for the tips that end there, and the flow between has a sign, everywhere at once: away
from partings, along the skull to a tie, out of it into a tail. It also says where hair
must spread so that none of the hull stays empty, as the flow fills all of it.

Where hair ends, nobody sees: it is said to end anywhere well away from the scalp. So
the flow goes astray where much hair leaves through a narrow place, as tied hair does,
and its sense is that of the field's lines (`sense.py`) wherever those have one.

The flow is a potential's, $-K\nabla\varphi$ with
$\lambda\varphi - \nabla\cdot(K\nabla\varphi) = q$: one symmetric linear system.
Propagating signs from the scalp along a spanning tree, as Dr.Hair has it [CVPR 2024,
arXiv 2403.17496], needs no system but decides neighbour by neighbour.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse
from scipy.sparse.linalg import cg
from scipy.spatial import KDTree

from ..capture.capture import View
from .curls import Curls
from .evidence import Evidence, Field, diffuse, gather
from .grid import nearest_in, neighbours
from .hull import Hull
from .sense import growth_sense
from .shorn import LENGTH
from .tails import Tails, find_tails, pull_of

# How sharply hair runs along the direction: the exponent of the cosine between the
# direction and the step to a neighbour.
ALONG = 4
ACROSS = 0.01  # conductance where the cosine is 0, against 1 along the direction
SCALP_REACH = 2.0  # voxels from the scalp's samples where hair comes out


# Where tips are and how they take: shares of how far hair reaches from the scalp, and
# the most metres.
FIRST = (0.1, 0.01)  # hair ends nowhere nearer to the scalp
FULLY = (0.3, 0.03)  # beyond this it ends everywhere alike
TRAVEL = (0.5, 0.05)  # what tips take leaves about a third after so far
LINES_COUNT = 64.0  # what a field's lines say of the sense, against the flow
FARTHEST_SHARE = 0.9  # of the hull lies nearer to the scalp than hair is said to reach
# How much hair falls that nobody sees, against how much it flows: hair that stands as
# high on the crown as it reaches anywhere, and hair that does not.
STANDS, HANGS = 0.4, 1.0
LOW, HIGH = 0.65, 0.85  # these heights, against its reach
CROWN = 0.8  # least cosine between a scalp's normal and straight up on the crown
GUESSED = 0.5  # its anisotropy
GUESS_WEIGHT = 0.015  # of what is likely, against one sharp photograph
STEPS = np.array(
    [
        (i, j, k)
        for i in (-1, 0, 1)
        for j in (-1, 0, 1)
        for k in (-1, 0, 1)
        if (i, j, k) > (0, 0, 0)
    ]
)
TOLERANCE = 1e-4
MOST_STEPS = 3000


class Links(NamedTuple):
    """Pairs of neighbouring voxels, each once."""

    first: Int[np.ndarray, " links"]
    second: Int[np.ndarray, " links"]
    weight: Float[np.ndarray, " links"]
    step: Float[np.ndarray, "links 3"]


def hair_flow(
    hull: Hull,
    field: Field,
    scalp_points: Float[np.ndarray, "points 3"],
    curly: bool = False,
) -> Float[np.ndarray, "x y z 3"]:
    """Return the unit direction of growth in every voxel, also outside the hair.

    Args:
        hull: Where hair can be.
        field: Directions without sign.
        scalp_points: Points all over the scalp where hair grows, in metres.
        curly: Whether hair curls.
    """
    links = _links(hull, field)
    away = KDTree(scalp_points).query(hull.grid.centres(hull.hair), workers=-1)[0]
    short = np.zeros(len(away))
    if field.stubble is not None:
        short[field.stubble[hull.hair]] = 1.0
    if field.shorn is not None:
        lies = field.shorn[hull.hair]
        short[lies] = np.maximum(short[lies], (hull.grid.spacing / LENGTH) ** 2)
    spread = _unit_flow(links, away, short, hull.grid.spacing)
    direction = field.direction[hull.hair]
    along = (spread * direction).sum(axis=1)
    sense = growth_sense(hull, field, away, curly)
    turned = along * (along + LINES_COUNT * sense) < 0.0
    flow = spread - np.where(turned, 2.0 * along, 0.0)[:, None] * direction
    out = np.zeros((*hull.grid.shape, 3))
    out[hull.hair] = flow
    return out[nearest_in(hull.hair)]


def hair_field(
    hull: Hull,
    views: Sequence[View],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
    curls: Curls,
    scalp_points: Float[np.ndarray, "points 3"],
    scalp_normals: Float[np.ndarray, "points 3"],
) -> Field:
    """Return which way hair runs: what photographs tell, or its outline if they do not.

    Where hair curls, part of what they tell is wrong, and that locks hang joins in; so
    does that hair runs to a tie, where one is near.

    Args:
        hull: Where hair can be.
        views: The photographs.
        depths: Depth of the head in each photograph, in metres.
        curls: How curly the hair is, with the orientation maps of its locks.
        scalp_points: Points all over the scalp where hair grows, in metres.
        scalp_normals: Unit normals of the scalp there.
    """
    if not curls.told:
        fall = how_it_falls(hull, scalp_points, scalp_normals)
        return fallen(hull, scalp_points, fall)
    centres = hull.grid.centres(hull.hair)
    away = KDTree(scalp_points).query(centres, workers=-1)[0]
    tails = find_tails(hull, away)
    guesses = [_to_ties(tails, centres)]
    if curls.radius > 0.0:
        hanging = fallen(hull, scalp_points, HANGS).direction[hull.hair]
        guesses.append(Evidence(hanging, np.full(len(hanging), GUESS_WEIGHT)))
    told = gather(hull, views, curls.maps, depths, tied=bool(len(tails.ties)))
    return diffuse(hull, told, guesses)


def _to_ties(tails: Tails, centres: Float[np.ndarray, "voxels 3"]) -> Evidence:
    """Return the guess that hair near a tie runs straight to it."""
    pull = pull_of(tails, centres)
    weight = np.where(tails.hair, 0.0, GUESS_WEIGHT * pull.nearness)
    return Evidence(pull.towards, weight)


def how_it_falls(
    hull: Hull,
    scalp_points: Float[np.ndarray, "points 3"],
    scalp_normals: Float[np.ndarray, "points 3"],
) -> float:
    """Return how much hair falls, against how much it flows, by its outline alone.

    Hair of an afro reaches as far up from the crown as to the sides, locks that hang do
    not: `STANDS` and `HANGS`, and between them what is between.

    Args:
        hull: Where hair can be.
        scalp_points: Points all over the scalp where hair grows, in metres.
        scalp_normals: Unit normals of the scalp there.
    """
    away, nearest = KDTree(scalp_points).query(hull.grid.centres(hull.hair), workers=-1)
    over = scalp_normals[nearest, 1] > CROWN
    if not over.any():
        return STANDS
    height, reach = (np.quantile(one, FARTHEST_SHARE) for one in (away[over], away))
    share = np.clip((HIGH - height / max(reach, 1e-3)) / (HIGH - LOW), 0.0, 1.0)
    return float(STANDS + share * (HANGS - STANDS))


def fallen(
    hull: Hull, scalp_points: Float[np.ndarray, "points 3"], fall: float
) -> Field:
    """Return the field of hair of which nothing but its outline is known.

    It flows out of the scalp to where the hull lets it end, up or down more easily than
    aside, and falls.

    Args:
        hull: Where hair can be.
        scalp_points: Points all over the scalp where hair grows, in metres.
        fall: How much it falls, against how much it flows.
    """
    down = np.zeros((*hull.grid.shape, 3))
    down[..., 1] = -1.0
    upright = Field(down, np.zeros(hull.grid.shape))
    direction = hair_flow(hull, upright, scalp_points) + fall * down
    size = np.linalg.norm(direction, axis=-1, keepdims=True)
    return Field(direction / np.maximum(size, 1e-30), np.full(size.shape[:-1], GUESSED))


def _unit_flow(
    links: Links,
    away: Float[np.ndarray, " voxels"],
    short: Float[np.ndarray, " voxels"],
    spacing: float,
) -> Float[np.ndarray, "voxels 3"]:
    """Return the direction of the flow in every voxel of hair.

    Args:
        links: The conductances.
        away: How far each voxel is from the scalp, in metres.
        short: 1 where stubble ends, which takes all there is.
        spacing: Edge of a voxel, in metres.
    """
    reach = float(np.quantile(away, FARTHEST_SHARE))
    near, far, travel = (
        max(min(share * reach, most), 1e-3) for share, most in (FIRST, FULLY, TRAVEL)
    )
    ends = np.clip((away - near) / max(far - near, 1e-3), 0.0, 1.0)
    # A little everywhere, so that pieces of hair without scalp are decided as well.
    takes = (spacing / travel) ** 2 * ends + 1e-6 + short
    gives = (away < SCALP_REACH * spacing).astype(float)
    potential = solve_potential(links, takes, gives)
    flow = np.zeros((len(away), 3))
    share = links.weight * (potential[links.first] - potential[links.second])
    moved = share[:, None] * links.step
    for axis in range(3):
        for end in (links.first, links.second):
            flow[:, axis] += np.bincount(end, moved[:, axis], minlength=len(away))
    return flow / np.maximum(np.linalg.norm(flow, axis=1, keepdims=True), 1e-30)


def _links(hull: Hull, field: Field) -> Links:
    """Return the conductances between each voxel of hair and its 26 neighbours."""
    index = np.argwhere(hull.hair)
    direction = field.direction[hull.hair]
    parts = []
    for step, neighbour in zip(STEPS, neighbours(index, STEPS).T, strict=True):
        first = np.flatnonzero(neighbour < len(index))
        second = neighbour[first]
        square = float(step @ step)
        along = step / np.sqrt(square)
        cosines = np.abs(direction @ along) ** ALONG
        weight = (0.5 * (cosines[first] + cosines[second]) + ACROSS) / square
        parts.append((first, second, weight, np.tile(along, (len(first), 1))))
    return Links(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def solve_potential(
    links: Links,
    takes: Float[np.ndarray, " voxels"],
    gives: Float[np.ndarray, " voxels"],
) -> Float[np.ndarray, " voxels"]:
    """Return the potential at which every voxel gives on what it gets."""
    count = len(takes)
    rows = np.concatenate([links.first, links.second])
    columns = np.concatenate([links.second, links.first])
    weight = np.concatenate([links.weight, links.weight])
    between = sparse.csr_matrix((weight, (rows, columns)), shape=(count, count))
    diagonal = np.bincount(rows, weight, minlength=count) + takes
    system = sparse.diags(diagonal) - between
    # What is not solved to the end is a direction slightly wrong, far from the scalp.
    potential, _ = cg(
        system,
        gives,
        rtol=TOLERANCE,
        maxiter=MOST_STEPS,
        M=sparse.diags(1.0 / diagonal),
    )
    return potential
