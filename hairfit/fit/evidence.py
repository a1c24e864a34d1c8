"""What the photographs say about the direction of hair in space.

In each voxel the photographs that see it give planes that hold the hair; the direction
nearest to all planes is the evidence. Inside the hair, where nobody looks, the
structure tensor is diffused: it has no sign, so neither has its mean.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy import ndimage

from ..abreast import abreast
from ..capture.capture import View
from ..capture.orientation import OrientationMap
from ..host import on_device
from ..render.raster import cells, project_points, unit
from .grid import nearest_in, neighbours, uphill
from .hull import Hull, Walls, first_hit, pixel_sizes, walls_of
from .shorn import KINDS, find_shorn, streak_ends, streaks_at
from .stubble import enough, find_stubble, thin_hair

DEPTH_SCALE = 0.006  # metres behind the hull's surface where a photograph fades
STRAIGHT = 0.5  # of the way a line came, against that of the field ahead
SURFACE_WEIGHT = 0.1  # of "hair lies in the surface", against one sharp photograph
SMOOTHING = 0.3  # of the diffusion, against one voxel of full evidence
TOLERANCE = 2e-3  # relative residual at which the diffusion stops
MOST_STEPS = 400
FACES = np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])


class Evidence(NamedTuple):
    """Directions in the voxels of a hull's hair, one row a voxel.

    Attributes:
        direction: Unit direction without sign.
        weight: How much the photographs say; 0 where none looks, 1 a sharp view.
        stubble: Which voxels hold stubble; None for none.
        shorn: Which voxels hold shorn hair that lies; None for none.
    """

    direction: Float[np.ndarray, "voxels 3"]
    weight: Float[np.ndarray, " voxels"]
    stubble: Bool[np.ndarray, " voxels"] | None = None
    shorn: Bool[np.ndarray, " voxels"] | None = None


class Field(NamedTuple):
    """A direction without sign at every voxel of a grid, also outside the hair.

    Attributes:
        direction: Unit direction.
        anisotropy: How sure it is, from 0 (any direction) to 1 (one direction).
        stubble: Where stubble ends; None for nowhere.
        shorn: Where shorn hair lies; None for nowhere.
    """

    direction: Float[np.ndarray, "x y z 3"]
    anisotropy: Float[np.ndarray, "x y z"]
    stubble: Bool[np.ndarray, "x y z"] | None = None
    shorn: Bool[np.ndarray, "x y z"] | None = None

    def onwards(
        self, at: tuple[np.ndarray, ...], heading: Float[np.ndarray, "lines 3"]
    ) -> Float[np.ndarray, "lines 3"]:
        """Return which way lines go on from voxels, given the way they came."""
        along = self.direction[at]
        same = np.sign((along * heading).sum(axis=1))[:, None]
        return unit(STRAIGHT * heading + same * along)


def gather(
    hull: Hull,
    views: Sequence[View],
    maps: Sequence[OrientationMap],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
    tied: bool = False,
) -> Evidence:
    r"""Return the least eigenvector of $\sum w\,n n^T$ in every voxel of hair.

    $n$ is the normal of the plane through the camera and the line in the picture. The
    normal of the hull's surface joins in weakly: hair mostly lies in the surface, which
    decides where views agree on a plane only. Stubble stands out of it instead, and is
    as sure as a sharp view, however little is seen of each hair.

    Args:
        hull: The hull.
        views: The photographs.
        maps: Their orientation maps.
        depths: Depth of the head in each photograph, in metres.
        tied: Whether a tail leaves the head: hair then is stubble only where streaks
            are told of.
    """
    points = hull.grid.centres(hull.hair)
    entries = np.zeros((len(points), 6))
    total, looks = np.zeros(len(points)), np.zeros(len(points))
    walls, thin = walls_of(hull), thin_hair(hull)
    asked, runs = enough(hull, thin), np.zeros((len(points), KINDS))
    outwards = uphill(hull.head)[hull.hair]

    def tell(view, found, depth, pixel):
        planes = find_planes(walls, points, view, found, depth)
        if not asked:
            return planes, 0.0
        seen = view, found, pixel, planes.seen, planes.at
        return planes, streaks_at(points, outwards, *seen)

    told = abreast(tell, views, maps, depths, pixel_sizes(hull, views))
    for (weighted, seen, confidence, _), run in told:
        entries += weighted
        total += seen * confidence
        looks += seen
        runs += run
    planes = full_matrix(entries)
    streaks = streak_ends(hull, thin, runs)
    stands, upright = find_stubble(hull, thin, planes, total, looks, len(views))
    if not streaks.mostly(stands) or (tied and not (stands & streaks.told).any()):
        stands, upright = np.zeros_like(stands), upright[:0]
    surface = _surface_normal(hull)
    share = SURFACE_WEIGHT * np.minimum(total, 1.0)
    planes += share[:, None, None] * surface[:, :, None] * surface[:, None, :]
    values, vectors = np.linalg.eigh(planes)
    gap = (values[:, 1] - values[:, 0]) / np.maximum(values[:, 1] + values[:, 0], 1e-12)
    direction, weight = vectors[:, :, 0], total * np.clip(gap, 0.0, 1.0)
    direction[stands] = upright
    weight[stands] = np.maximum(weight[stands], 1.0)
    return Evidence(direction, weight, stands, find_shorn(hull, streaks))


class Planes(NamedTuple):
    """The planes through a camera that hold the hair which it sees, at many points.

    Attributes:
        entries: Of $n n^T$ of the unit normals, by how well a point is seen and by the
            confidence; see `matrix_entries`.
        seen: How well each point is seen: 1 at the hull's surface, 0 behind.
        confidence: Of the angle in the photograph, from 0 to 1.
        at: Row and column of the pixel in which each point lands.
    """

    entries: Float[np.ndarray, "points 6"]
    seen: Float[np.ndarray, " points"]
    confidence: Float[np.ndarray, " points"]
    at: tuple[Int[np.ndarray, " points"], Int[np.ndarray, " points"]]


def find_planes(
    walls: Walls,
    points: Float[np.ndarray, "points 3"],
    view: View,
    found: OrientationMap,
    head_depth: Float[np.ndarray, "height width"],
) -> Planes:
    """Return the plane that one view tells at every point.

    Args:
        walls: The hull, which hides what is behind it.
        points: The points, in metres.
        view: The photograph.
        found: Its orientation map.
        head_depth: Depth of the head in it, in metres.
    """
    step = 2
    hit = first_hit(walls, view, step=step)
    pixels = project_points(points, view.camera)
    pixel, depth = pixels
    y, x, seen = cells(pixels, view.camera.width, view.camera.height)
    row = np.minimum(y // step, hit.shape[0] - 1)
    column = np.minimum(x // step, hit.shape[1] - 1)
    seen &= view.hair[y, x] & (depth < head_depth[y, x] + 0.002)
    behind = np.maximum(depth - hit[row, column], 0.0)
    fade = np.exp(-((behind / DEPTH_SCALE) ** 2))
    angle = found.angle[y, x]
    inverse = np.linalg.inv(np.asarray(view.camera.K, np.float64))
    ray = np.column_stack([pixel, np.ones(len(pixel))]) @ inverse.T
    line = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))])
    cam = np.asarray(view.camera.cam_from_world, np.float64)
    normal = np.cross(ray, line @ inverse.T) @ cam[:3, :3]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    confidence = np.asarray(found.confidence[y, x], np.float64)
    fade = np.where(seen, fade, 0.0)
    entries = (fade * confidence)[:, None] * matrix_entries(normal)
    return Planes(entries, fade, confidence, (y, x))


def _surface_normal(hull: Hull) -> Float[np.ndarray, "voxels 3"]:
    """Return the outward normal of hair and head together, smoothed over 2 voxels."""
    solid = ndimage.gaussian_filter((hull.hair | (hull.head < 0)).astype(float), 2.0)
    return -uphill(solid)[hull.hair]


def diffuse(hull: Hull, evidence: Evidence, guesses: Sequence[Evidence] = ()) -> Field:
    r"""Fill the hull with directions from the evidence, and carry them past its border.

    The tensors $T$ of all voxels minimise $w |T - d d^T|^2 + \lambda |\nabla T|^2$, and
    for each guess $g$ also $w_g |T - g g^T|^2$; conjugate gradients, first on every
    second voxel, then on all.

    Args:
        hull: Where hair can be.
        evidence: What photographs say.
        guesses: What is likely without them.
    """
    index = np.argwhere(hull.hair)
    told = (evidence, *guesses)
    weight = sum((one.weight for one in told), np.zeros(len(index)))
    known = [one.weight[:, None] * matrix_entries(one.direction) for one in told]
    target = sum(known, np.zeros((len(index), 6)))
    target /= np.maximum(weight, 1e-12)[:, None]
    half, member = np.unique(index // 2, axis=0, return_inverse=True)
    member = member.ravel()
    total = np.bincount(member, weight)
    mean = np.stack(
        [np.bincount(member, weight * target[:, j]) for j in range(6)], axis=1
    )
    mean /= np.maximum(total, 1e-9)[:, None]
    start = _solve(half, total / 8, mean, np.zeros_like(mean), 4 * SMOOTHING / 8)
    tensor = _solve(index, weight, target, start[member], SMOOTHING)
    values, vectors = np.linalg.eigh(full_matrix(tensor))
    sure = (values[:, 2] - values[:, 1]) / np.maximum(values[:, 2], 1e-12)
    direction = np.zeros((*hull.grid.shape, 3))
    anisotropy = np.zeros(hull.grid.shape)
    direction[hull.hair] = vectors[:, :, 2]
    anisotropy[hull.hair] = np.clip(sure, 0.0, 1.0)
    nearest = nearest_in(hull.hair)

    def spread(voxels: Bool[np.ndarray, " voxels"] | None) -> Bool[np.ndarray, "x y z"]:
        everywhere = np.zeros(hull.grid.shape, bool)
        if voxels is not None:
            everywhere[hull.hair] = voxels
        return everywhere[nearest]

    ends = spread(evidence.stubble), spread(evidence.shorn)
    return Field(direction[nearest], anisotropy[nearest], *ends)


def matrix_entries(d: Float[np.ndarray, "voxels 3"]) -> Float[np.ndarray, "voxels 6"]:
    """Return the six different entries of $d d^T$."""
    x, y, z = d[:, 0], d[:, 1], d[:, 2]
    return np.stack([x * x, y * y, z * z, x * y, x * z, y * z], axis=1)


def full_matrix(t: Float[np.ndarray, "voxels 6"]) -> Float[np.ndarray, "voxels 3 3"]:
    """Return symmetric matrices from their six different entries."""
    return t[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]


def _solve(
    index: Int[np.ndarray, "voxels 3"],
    weight: Float[np.ndarray, " voxels"],
    target: Float[np.ndarray, "voxels 6"],
    start: Float[np.ndarray, "voxels 6"],
    smoothing: float,
) -> Float[np.ndarray, "voxels 6"]:
    """Return the minimum of weighted differences and smoothness on a set of voxels."""
    around = neighbours(index, FACES)
    # A size that repeats between captures would be chance: pad, so that few compile.
    rows = -(-len(index) // 32768) * 32768
    spare = rows - len(index)
    around = np.where(around == len(index), rows, around)
    around = np.pad(around, ((0, spare), (0, 0)), constant_values=rows)

    def padded(values):
        values = values.reshape(len(index), -1)
        return on_device(np.pad(values, ((0, spare), (0, 0))), jnp.float32)

    solution = _conjugate_gradients(
        on_device(around, jnp.int32),
        padded(weight),
        padded(target),
        padded(start),
        jnp.float32(smoothing),
    )
    return np.asarray(solution, np.float64)[: len(index)]


@jax.jit
def _conjugate_gradients(
    around: Int[Array, "voxels 6"],
    weight: Float[Array, "voxels 1"],
    target: Float[Array, "voxels 6"],
    start: Float[Array, "voxels 6"],
    smoothing: Float[Array, ""],
) -> Float[Array, "voxels 6"]:
    r"""Solve $(w + \lambda L) T = w T_0$ with a diagonal preconditioner."""
    degree = (around < len(weight)).sum(axis=1, keepdims=True)
    # The last term keeps voxels that no evidence reaches at zero, not undefined.
    diagonal = weight + smoothing * degree.astype(weight.dtype) + 1e-6

    def apply(x):
        wide = jnp.concatenate([x, jnp.zeros((1, 6), x.dtype)])
        near = sum(wide[around[:, j]] for j in range(6))
        return diagonal * x - smoothing * near

    right = weight * target
    limit = TOLERANCE**2 * jnp.sum(right**2)

    def go_on(state):
        _, residual, _, _, step = state
        return (jnp.sum(residual**2) > limit) & (step < MOST_STEPS)

    def advance(state):
        x, residual, search, product, step = state
        applied = apply(search)
        alpha = product / jnp.maximum(jnp.sum(search * applied), 1e-30)
        x = x + alpha * search
        residual = residual - alpha * applied
        preconditioned = residual / diagonal
        new = jnp.sum(residual * preconditioned)
        search = preconditioned + new / jnp.maximum(product, 1e-30) * search
        return x, residual, search, new, step + 1

    residual = right - apply(start)
    search = residual / diagonal
    state = (start, residual, search, jnp.sum(residual * search), 0)
    return jax.lax.while_loop(go_on, advance, state)[0]
