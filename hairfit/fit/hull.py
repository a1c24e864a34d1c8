"""The visual hull of the hair: where every photograph allows hair to be."""

import dataclasses
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from ..abreast import abreast
from ..capture.capture import View
from ..capture.cranium import even_directions, find_cranium
from ..capture.distance import signed_distance
from ..capture.select import directions
from ..errors import InputError
from ..render.raster import Pixels, cells, project_points
from ..types import Mesh
from .grid import Grid, in_coarser
from .unexplained import share_unexplained

REACH = 0.6  # no hair farther than this from the cranium's centre, in metres
COARSE = 0.012  # metres
NEAR_SKIN = 0.01  # metres: hair that comes no nearer to the head does not grow on it
ACROSS_GAPS = 2  # voxels on both sides of a gap over which pieces of hair are one
AIRBORNE = 0.03  # share of the hair that may hang in the air until a tie is found
LEAST_VOXELS = 50  # smaller pieces are noise of the masks
MOST_VOXELS = 600_000  # beyond this the grid is made coarser
WITNESSES = 0.25  # share of the views that must see hair there, not the head before it
PICTURES = 2  # views that must have a place in the picture; one of two
WAYS = 2000  # even over all, from which one may look at the head
# Cosine between two views' axes beyond which they see the same outline, one of them
# perhaps from behind.
SAME_OUTLINE = 0.9
MASK_MARGIN = 1  # pixel: a mask's border is known no better
GAPS = 0.002  # metres: radius of the widest gaps between hairs where skin shows
# Of sparse hair, whose gaps leave more of what masks show before the head than this
# share without a place: 0.0 to 0.4 % of most heads, 18 % of wisps of shorn hair.
WIDER_GAPS, UNEXPLAINED = (0.004, 0.006), 0.03
PACE = 0.7  # of a voxel: the steps in which rays are followed


@dataclasses.dataclass(frozen=True)
class Hull:
    """Where hair can be.

    Attributes:
        grid: The voxels.
        hair: Voxels outside the head that no photograph excludes.
        distance: Signed distance to the border of `hair` in metres, negative inside.
        head: Signed distance to the head in metres, negative inside the head; exact
            near the hair, at least 2 cm elsewhere.
    """

    grid: Grid
    hair: Bool[np.ndarray, "x y z"]
    distance: Float[np.ndarray, "x y z"]
    head: Float[np.ndarray, "x y z"]

    def distance_at(
        self, points: Float[np.ndarray, "points 3"]
    ) -> Float[np.ndarray, " points"]:
        """Return `distance` at points, linear between voxels, inf beyond the grid."""
        at = (points - self.grid.origin) / self.grid.spacing - 0.5
        distance = ndimage.map_coordinates(
            self.distance, at.T, np.float64, order=1, mode="nearest"
        )
        return np.where(self.grid.inside(self.grid.voxel(points)), distance, np.inf)


class Carved(NamedTuple):
    """A hull, and the radius of the gaps between hairs that were closed, in metres."""

    hull: Hull
    gaps: float


def carve_sparse(
    views: Sequence[View],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
    head: Mesh,
    spacing: float,
) -> Carved:
    """Return what `carve` does, with gaps so wide that it explains the photographs.

    Where hairs are sparse, each has skin beside it that other views see before it.
    """
    for gaps in (GAPS, *WIDER_GAPS):
        hull = carve(views, depths, head, spacing, gaps)
        if share_unexplained(hull.grid, hull.hair, views, depths) < UNEXPLAINED:
            break
    return Carved(hull, gaps)


def carve(
    views: Sequence[View],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
    head: Mesh,
    spacing: float,
    gaps: float | None = None,
) -> Hull:
    """Return the visual hull of the hair outside the head.

    A voxel may hold hair if each view that has it in the picture shows hair there or
    has the head in front of it, and a quarter shows hair (see `witnessed`). Beyond a
    border of the picture there is hair where the hair at the border goes on; if the
    border cuts hair off elsewhere, also where views that see no same outline show it,
    more of them than there are such borders. Skin that shows between hairs excludes
    none before it.

    Args:
        views: The photographs with their masks.
        depths: Depth of the head in each photograph, in metres.
        head: The head.
        spacing: Edge of a voxel in metres; made larger where memory asks for it.
        gaps: Radius of the gaps between hairs that are closed, in metres; `GAPS` if
            none is given.

    Raises:
        InputError: If no place agrees with all masks.
    """
    views = list(abreast(partial(without_gaps, gaps=gaps), views, depths))
    cranium = find_cranium(head)
    coarse = Grid.around(cranium.centre - REACH, cranium.centre + REACH, COARSE)
    margin = 2 * COARSE * max(v.camera.focal for v in views)
    everywhere = np.ones(coarse.shape, bool)
    allowed = allowed_voxels(coarse, everywhere, views, depths, margin)
    if not allowed.any():
        raise InputError(
            "no place in space lies inside all hair masks; check that `cameras.json` "
            "and `masks/hair` belong to these photographs."
        )
    found = coarse.centres(allowed)
    # A coarse voxel at the skin has its centre in the head, where nobody sees hair.
    allowed = np.asarray(ndimage.binary_dilation(allowed, np.ones((3, 3, 3))), bool)
    low, high = found.min(axis=0) - 2 * COARSE, found.max(axis=0) + 2 * COARSE
    while True:
        grid = Grid.around(low, high, spacing)
        near = in_coarser(grid, coarse, allowed)
        hair = allowed_voxels(grid, near, views, depths, 0.0)
        if hair.sum() <= MOST_VOXELS:
            break
        spacing *= 1.1 * float(np.cbrt(hair.sum() / MOST_VOXELS))
    return _outside_head(grid, hair, head)


def without_gaps(
    view: View, depth: Float[np.ndarray, "height width"], gaps: float | None = None
) -> View:
    """Return the view whose mask has no gaps before the head but wide ones.

    Args:
        view: The photograph with its mask.
        depth: Depth of the head in it in metres, infinite beside the head.
        gaps: Radius of the widest gaps that are closed, in metres; `GAPS` if none is
            given.
    """
    import cv2

    skin = np.isfinite(depth) & (depth > 0)
    if not skin.any():
        return view
    gaps = GAPS if gaps is None else gaps
    half = int(gaps * view.camera.focal / float(np.median(depth[skin])))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * half + 1, 2 * half + 1))
    closed = cv2.morphologyEx(view.hair.astype(np.uint8), cv2.MORPH_CLOSE, disc)
    return dataclasses.replace(view, hair=view.hair | (skin & (closed > 0)))


def allowed_voxels(
    grid: Grid,
    start: Bool[np.ndarray, "x y z"],
    views: Sequence[View],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
    margin: float,
    *,
    spare: int = 0,
) -> Bool[np.ndarray, "x y z"]:
    """Return the voxels of `start` that all views allow.

    Args:
        grid: The voxels.
        start: Those to look at.
        views: The photographs with their masks.
        depths: Depth of the head in each photograph, in metres.
        margin: How far masks are grown, in pixels times metres of depth.
        spare: Return what any choice of views allows that leaves out so many.
    """
    index = np.flatnonzero(start.ravel())
    points = grid.centres(start)
    against, denials, pictures = np.zeros((3, len(index)), int)
    shown = np.zeros((len(index), len(views)), bool)
    for k, (view, depth) in enumerate(zip(views, depths, strict=True)):
        if not len(points):
            break
        pixels = project_points(points, view.camera)
        z = pixels.depth
        grow = MASK_MARGIN + int(np.ceil(margin / max(float(np.median(z)), 0.05)))
        hair = np.asarray(ndimage.maximum_filter(view.hair, size=2 * grow + 1), bool)
        y, x, inside = cells(pixels, view.camera.width, view.camera.height)
        hidden = z > depth[y, x]
        # Of a point beyond the picture, its border tells; a picture without hair, none.
        told = z > 0 if view.hair.any() else inside
        none, cut_off = told & ~hair[y, x] & ~hidden, beyond_hair(pixels, view.hair)
        shown[:, k] = inside & hair[y, x] & ~hidden
        against += none & ~cut_off
        denials += none & cut_off
        pictures += inside
        keep = against <= spare
        index, points, shown = index[keep], points[keep], shown[keep]
        against, denials, pictures = against[keep], denials[keep], pictures[keep]
    denials -= spare
    allowed = witnessed(pictures, shown, views, spare)
    allowed &= (denials <= 0) | (ways_shown(shown, views) > denials)
    out = np.zeros(start.size, dtype=bool)
    out[index[allowed]] = True
    return out.reshape(grid.shape)


def beyond_hair(
    pixels: Pixels, hair: Bool[np.ndarray, "height width"]
) -> Bool[np.ndarray, " points"]:
    """Return which points are beyond a side of the picture that cuts hair off."""
    height, width = hair.shape
    x, y = pixels.pixel.T
    sides = (
        (x < 0, hair[:, 0]),
        (x >= width, hair[:, -1]),
        (y < 0, hair[0]),
        (y >= height, hair[-1]),
    )
    return np.any([outside & edge.any() for outside, edge in sides], axis=0)


def witnessed(
    pictures: Int[np.ndarray, " voxels"],
    shown: Bool[np.ndarray, "voxels views"],
    views: Sequence[View],
    spare: int = 0,
) -> Bool[np.ndarray, " voxels"]:
    """Return the voxels that a quarter of the views see, or those of a quarter of ways.

    Each view stands for the ways to look at the head to which it is nearest: where
    photographs were taken from one side, few see the other, but from far apart.

    Args:
        pictures: How many views have each voxel in the picture; `PICTURES` must.
        shown: Which views see hair there.
        views: The photographs.
        spare: So many of them may be wrong.
    """
    nearest = np.argmin(even_directions(WAYS, -1.0) @ directions(views).T, axis=1)
    share = np.bincount(nearest, minlength=len(views)) / WAYS
    count = len(views) - spare
    enough = shown.sum(axis=1) >= max(1, WITNESSES * count)
    enough |= shown @ share >= WITNESSES
    return enough & (pictures >= min(PICTURES, 0.5 * count))


def ways_shown(
    shown: Bool[np.ndarray, "voxels views"], views: Sequence[View]
) -> Int[np.ndarray, " voxels"]:
    """Return how many views see each voxel, as one those that see the same outline."""
    axis = directions(views)
    first = np.argmax(np.abs(axis @ axis.T) > SAME_OUTLINE, axis=1)
    way = first[:, None] == np.unique(first)
    return np.sum(shown.astype(int) @ way.astype(int) > 0, axis=1)


def _outside_head(grid: Grid, hair: Bool[np.ndarray, "x y z"], head: Mesh) -> Hull:
    """Take the head out of the hull and measure distances."""
    near = np.asarray(ndimage.binary_dilation(hair, iterations=4), bool)
    skin = np.full(grid.shape, 0.02)
    skin[near] = signed_distance(head, grid.centres(near))
    hair = hair & (skin > -0.001)
    parts = np.zeros(grid.shape, np.int32)
    ndimage.label(hair, output=parts)
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    hair = np.isin(parts, np.flatnonzero(sizes >= LEAST_VOXELS))
    hair = rooted_pieces(hair, skin)
    if not hair.any():
        raise InputError(
            "the hair masks leave no room for hair outside the head; check that "
            "`head.obj` stands where the cameras see the head."
        )
    return hull_of(grid, hair, skin)


def hull_of(
    grid: Grid, hair: Bool[np.ndarray, "x y z"], head: Float[np.ndarray, "x y z"]
) -> Hull:
    """Return the hull of some voxels, given the distance of all from the head."""
    both = abreast(ndimage.distance_transform_edt, (~hair, hair))
    outside, inside = map(np.asarray, both)
    distance = np.where(hair, 0.5 - inside, outside - 0.5) * grid.spacing
    return Hull(grid, hair, distance, head)


def rooted_pieces(
    hair: Bool[np.ndarray, "x y z"],
    skin: Float[np.ndarray, "x y z"],
    *,
    airborne: float = AIRBORNE,
) -> Bool[np.ndarray, "x y z"]:
    """Return the hair without pieces in the air, where cones of views happen to meet.

    A piece that comes near the head at no place grew from none; all stay if none does.

    Args:
        hair: The voxels.
        skin: Signed distance to the head, in metres.
        airborne: Pieces in the air that are as large a share of the hair stay: they may
            be a tail, whose tie no mask shows.
    """
    joined = np.asarray(ndimage.binary_dilation(hair, iterations=ACROSS_GAPS), bool)
    pieces = np.zeros(hair.shape, np.int32)
    ndimage.label(joined, output=pieces)
    at_skin = np.unique(pieces[hair & (skin < NEAR_SKIN)])
    sizes = np.bincount(pieces[hair])
    large = np.flatnonzero(sizes >= airborne * hair.sum())
    stays = np.isin(pieces, np.concatenate([at_skin, large]))
    return hair & stays if len(at_skin) else hair


def pixel_sizes(hull: Hull, views: Sequence[View]) -> list[float]:
    """Return how wide a pixel of each view is at the middle of the hair, in metres."""
    middle = hull.grid.centres(hull.hair).mean(axis=0, keepdims=True)
    return [
        float(project_points(middle, view.camera).depth[0]) / view.camera.focal
        for view in views
    ]


class Walls(NamedTuple):
    """What rays ask of a hull; see `walls_of`.

    Attributes:
        grid: The voxels.
        middles: Of those of hair, in metres.
        distance: How far the hull is at least, in metres, negative in hair; with a
            voxel more at each border of the grid.
    """

    grid: Grid
    middles: Float[np.ndarray, "voxels 3"]
    distance: Float[np.ndarray, "x y z"]


def walls_of(hull: Hull) -> Walls:
    """Return what rays ask of a hull."""
    # Beyond the grid is no hair; it is as far as from the grid's border at least.
    distance = np.maximum(np.pad(hull.distance.astype(np.float32), 1, mode="edge"), 0)
    distance[1:-1, 1:-1, 1:-1][hull.hair] = -1.0
    return Walls(hull.grid, hull.grid.centres(hull.hair), distance)


def first_hit(
    walls: Walls, view: View, *, step: int = 2
) -> Float[np.ndarray, "rows columns"]:
    """Return the depth at which each ray through hair enters the hull, in metres.

    Args:
        walls: The hull.
        view: The photograph; rays go through its pixels of hair.
        step: One ray for `step` by `step` pixels.

    Returns:
        Depths, one a block of pixels, infinite where there is no hair.
    """
    height, width = view.hair.shape
    rows, columns = height // step, width // step
    blocks = view.hair[: rows * step, : columns * step]
    wanted = blocks.reshape(rows, step, columns, step).any(axis=(1, 3))
    y, x = np.nonzero(wanted)
    intrinsic = np.asarray(view.camera.K, np.float64)
    cam = np.asarray(view.camera.cam_from_world, np.float64)
    pixel = np.stack([(x + 0.5) * step, (y + 0.5) * step, np.ones(len(x))])
    rays = np.linalg.solve(intrinsic, pixel).T @ cam[:3, :3]
    eye = -cam[:3, :3].T @ cam[:3, 3]
    seen = project_points(walls.middles, view.camera).depth
    spacing = walls.grid.spacing
    depths = np.arange(max(seen.min(), 0.01) - spacing, seen.max(), PACE * spacing)
    shape, distance = walls.distance.shape, walls.distance.ravel()
    # No hair is nearer to any point of a voxel than its distance, less so much.
    around = (np.sqrt(3.0) - 0.5) * spacing
    pace = PACE * spacing * np.linalg.norm(rays, axis=1)
    start, way = (eye - walls.grid.origin) / spacing + 1.0, (rays / spacing).T
    hit = np.full(len(rays), np.inf)
    alive, at = np.arange(len(rays)), np.zeros(len(rays), int)
    while len(alive):
        depth = depths[at]
        cell = np.zeros(len(alive), int)
        for axis, size in enumerate(shape):
            along = np.floor(start[axis] + way[axis] * depth)
            cell = cell * size + np.clip(along, 0, size - 1).astype(int)
        near = distance[cell]
        struck = near < 0.0
        hit[alive[struck]] = depth[struck]
        at += np.maximum((near - around) / pace, 1.0).astype(int)
        goes = ~struck & (at < len(depths))
        alive, at, pace, way = alive[goes], at[goes], pace[goes], way[:, goes]
    out = np.full((rows, columns), np.inf)
    out[y, x] = hit
    return out
