"""What strands and photographs disagree about, as differentiable losses.

Each is in units of its own standard deviation and a mean over what it counts.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float, Int
from scipy import ndimage
from scipy.spatial import KDTree

from ..abreast import abreast
from ..capture.capture import View
from ..capture.orientation import OrientationMap
from ..host import on_device
from ..render.camera import Camera
from ..render.raster import cells, project_points, rasterise, visible_points
from .devices import BY_BOTH, BY_STRAND, BY_VIEW, EVERYWHERE, STRANDS, VIEWS

SIGMA_ANGLE = 0.15  # radians
SIGMA_OUTSIDE = 0.001  # metres
SEEN_DEPTH = 0.004  # metres into the hair that a photograph shows
AT_ONCE = 8  # photographs that are compared together
SHRINK = 2  # the maps are kept at one pixel for 2 by 2
SIGMA_BARE = 0.001  # metres
BARE = 0.002  # metres from a strand where hair counts as not covered
PROBES, PULLS = 4000, 1024  # pixels that are asked in each photograph, and those used
FINER = 6  # points for one, where a strand covers pixels
FARTHEST = 0.05  # metres beyond which a sample outside the mask pulls no more


class PhotoMaps(eqx.Module):
    """What all photographs say, stacked; smaller ones padded by zeros.

    Attributes:
        doubled: Confidence times cosine and sine of twice the angle of the hair.
        outside: Distance to the hair's mask in pixels, 0 inside it.
        head: Depth of the head in metres, infinite beside it.
        K: Intrinsics of the shrunken pictures.
        cam_from_world: Poses.
        focal: Focal length of the pictures as they were, in pixels.
    """

    doubled: Float[Array, "views height width 2"]
    outside: Float[Array, "views height width"]
    head: Float[Array, "views height width"]
    K: Float[Array, "views 3 3"]
    cam_from_world: Float[Array, "views 4 4"]
    focal: Float[Array, " views"]


def photo_maps(
    views: Sequence[View],
    maps: Sequence[OrientationMap],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
) -> PhotoMaps:
    """Return the photographs' maps for the losses."""
    height = max(v.camera.height for v in views) // SHRINK
    width = max(v.camera.width for v in views) // SHRINK

    def padded(values, fill=0.0):
        small = values[::SHRINK, ::SHRINK][:height, :width]
        rest = [(0, height - small.shape[0]), (0, width - small.shape[1])]
        rest += [(0, 0)] * (small.ndim - 2)
        return np.pad(small, rest, constant_values=fill).astype(np.float32)

    doubled, outside = [], []
    for view, found in zip(views, maps, strict=True):
        angle = 2 * found.angle
        pair = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        doubled.append(padded(pair * found.confidence[..., None]))
        outside.append(padded(ndimage.distance_transform_edt(~view.hair)))
    shrink = np.diag([1 / SHRINK, 1 / SHRINK, 1.0])
    intrinsic = np.stack([shrink @ np.asarray(v.camera.K) for v in views])
    poses = np.stack([np.asarray(v.camera.cam_from_world) for v in views])
    return PhotoMaps(
        on_device(np.stack(doubled)),
        on_device(np.stack(outside)),
        on_device(np.stack([padded(d, np.inf) for d in depths])),
        on_device(intrinsic, jnp.float32),
        on_device(poses, jnp.float32),
        on_device(intrinsic[:, 0, 0] * SHRINK, jnp.float32),
    )


def seen_segments(
    strands: Float[np.ndarray, "strands knots 3"],
    views: Sequence[View],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
) -> Bool[np.ndarray, "views strands segments"]:
    """Return which segments' middles each photograph sees."""
    middle = (0.5 * (strands[:, 1:] + strands[:, :-1])).reshape(-1, 3)

    def seen_by(view, head_depth):
        # Few strands stand for many: each hides a few pixels beside it as well.
        front = rasterise(strands, view.camera, mesh_depth=head_depth, radius_px=3.0)
        seen = visible_points(middle, view.camera, front.depth, head_depth, SEEN_DEPTH)
        return seen.reshape(len(strands), -1)

    return np.stack(list(abreast(seen_by, views, depths)))


def image_loss(
    strands: Float[Array, "strands knots 3"],
    seen: Bool[Array, "views strands segments"],
    maps: PhotoMaps,
    mesh: Mesh | None = None,
) -> Float[Array, ""]:
    """Return how far strands are from the photographs' orientation and masks.

    Args:
        strands: The strands, in metres.
        seen: Which segments each photograph shows.
        maps: What photographs say.
        mesh: The devices over which photographs and strands are shared out.
    """

    def totals(strands, seen, maps):
        def one(view):
            found, visible = view
            angle, weight, beyond, open_sight = _compare(strands, visible, found)
            return jnp.stack(
                [jnp.sum(angle), jnp.sum(weight), jnp.sum(beyond), open_sight]
            )

        # Some photographs at once keep all cores busy; all would take much memory.
        found = jax.lax.map(one, (maps, seen), batch_size=min(len(seen), AT_ONCE))
        mine = jnp.sum(found, axis=0)
        return mine if mesh is None else jax.lax.psum(mine, (VIEWS, STRANDS))

    if mesh is not None:
        given = BY_STRAND, BY_BOTH, BY_VIEW
        totals = jax.shard_map(totals, mesh=mesh, in_specs=given, out_specs=EVERYWHERE)
    angle, weight, beyond, open_sight = totals(strands, seen, maps)
    return angle / (weight + 1e-3) + beyond / (open_sight + 1.0)


def _compare(strands, visible, found: PhotoMaps):
    """Return angle and mask residuals of one view with their weights, per segment."""
    height, width = found.outside.shape
    camera = Camera(found.K, found.cam_from_world, width, height)
    flat = strands.reshape(-1, 3)
    pixel, depth = jax.vmap(camera.project)(flat)
    pixel = pixel.reshape(*strands.shape[:2], 2)
    depth = depth.reshape(strands.shape[:2])
    along = pixel[:, 1:] - pixel[:, :-1]
    middle = 0.5 * (pixel[:, 1:] + pixel[:, :-1])
    index, inside = _pixel_index(middle, width, height)
    doubled = found.doubled[index]
    confidence = jnp.sqrt(jnp.sum(doubled**2, axis=-1))
    square = jnp.sum(along**2, axis=-1) + 1e-6
    cosine = (along[..., 0] ** 2 - along[..., 1] ** 2) / square
    sine = 2 * along[..., 0] * along[..., 1] / square
    agreement = cosine * doubled[..., 0] + sine * doubled[..., 1]
    # A strand that points at the camera shows no direction.
    weight = jnp.where(visible & inside, square / (square + 1.0), 0.0)
    off = jnp.sqrt(jnp.maximum(0.5 * (confidence - agreement) * confidence, 0.0) + 1e-6)
    angle = weight * (off - 1e-3) / SIGMA_ANGLE
    distance = _bilinear(found.outside, middle)
    middle_depth = 0.5 * (depth[:, 1:] + depth[:, :-1])
    in_front = (middle_depth > 0) & (middle_depth < found.head[index]) & inside
    metres = jnp.minimum(distance * middle_depth / found.focal, FARTHEST)
    beyond = jnp.where(in_front, jnp.maximum(metres - 1e-3, 0.0) / SIGMA_OUTSIDE, 0.0)
    return angle, weight * confidence, beyond, jnp.sum(in_front, dtype=angle.dtype)


def _pixel_index(pixel, width: int, height: int):
    """Return the row and column of each pixel position, and whether it is inside."""
    x, y = pixel[..., 0], pixel[..., 1]
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    at = jnp.floor(jax.lax.stop_gradient(pixel)).astype(jnp.int32)
    row = jnp.clip(at[..., 1], 0, height - 1)
    return (row, jnp.clip(at[..., 0], 0, width - 1)), inside


def _bilinear(image: Float[Array, "height width"], pixel: Float[Array, "*batch 2"]):
    """Return an image between its pixels' centres, with gradients by the position."""
    height, width = image.shape
    at_x = jnp.clip(pixel[..., 0] - 0.5, 0.0, width - 1.001)
    at_y = jnp.clip(pixel[..., 1] - 0.5, 0.0, height - 1.001)
    x = jnp.floor(jax.lax.stop_gradient(at_x)).astype(jnp.int32)
    y = jnp.floor(jax.lax.stop_gradient(at_y)).astype(jnp.int32)
    right, down = at_x - x.astype(at_x.dtype), at_y - y.astype(at_y.dtype)
    upper = image[y, x] * (1 - right) + image[y, x + 1] * right
    lower = image[y + 1, x] * (1 - right) + image[y + 1, x + 1] * right
    return upper * (1 - down) + lower * down


class Pulls(eqx.Module):
    """Pixels of hair that no strand covers, and the strand's point that is nearest.

    Attributes:
        strand: Index of the strand.
        point: Index of its point.
        pixel: The pixel, in the shrunken pictures of `PhotoMaps`.
        share: Weight; the weights of a view add up to the uncovered share of its hair.
    """

    strand: Int[Array, "views pulls"]
    point: Int[Array, "views pulls"]
    pixel: Float[Array, "views pulls 2"]
    share: Float[Array, "views pulls"]


def subdivided(
    strands: Float[np.ndarray, "strands knots 3"], finer: int
) -> Float[np.ndarray, "strands points 3"]:
    """Return `finer` points for each segment of the strands, without the tips."""
    share = np.linspace(0.0, 1.0, finer, endpoint=False)[None, None, :, None]
    ahead = strands[:, 1:] - strands[:, :-1]
    fine = strands[:, :-1, None] + share * ahead[:, :, None]
    return fine.reshape(len(strands), -1, 3)


def tree_of_many(points: Float[np.ndarray, "points dim"]) -> KDTree:
    """Return the tree of many points, made quickly: few places will be asked for.

    Boxes are split at their middles, not at medians, which takes a third of the time.
    """
    return KDTree(points, balanced_tree=False, compact_nodes=False)


def point_of(at: Int[np.ndarray, " pulls"], finer: int) -> Int[np.ndarray, " pulls"]:
    """Return the strand's own point that is closest to a subdivided one, not its root.

    Args:
        at: Index along the subdivided strand.
        finer: How it was subdivided.
    """
    return np.maximum((at + finer // 2) // finer, 1)


def find_pulls(
    strands: Float[np.ndarray, "strands knots 3"],
    views: Sequence[View],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
    seed: int,
) -> Pulls:
    """Return what draws strands to hair that they leave bare."""
    rng = np.random.default_rng(seed)
    # Between its points a strand covers pixels as well.
    fine = np.concatenate([subdivided(strands, FINER), strands[:, -1:]], axis=1)
    knots = fine.shape[1]
    probes = []
    for view in views:
        hair = np.argwhere(view.hair)[:, ::-1] + 0.5
        some = rng.choice(len(hair), min(PROBES, len(hair)), replace=False)
        probes.append(hair[some])

    def pulls_of(view, head_depth, chosen):
        found = project_points(fine.reshape(-1, 3), view.camera)
        y, x, _ = cells(found, view.camera.width, view.camera.height)
        # Not the roots, which stay, nor what the head hides.
        free = (np.arange(len(x)) % knots > 0) & (found.depth > 0)
        free &= found.depth < head_depth[y, x]
        usable = np.flatnonzero(free)
        if not len(usable):
            chosen = chosen[:0]
        apart, nearest = map(
            np.asarray, tree_of_many(found.pixel[usable]).query(chosen)
        )
        metres = apart * found.depth[usable[nearest]] / view.camera.focal
        bare = np.flatnonzero((metres > BARE) & (metres < FARTHEST))[:PULLS]
        spare = PULLS - len(bare)
        index = np.pad(usable[nearest[bare]], (0, spare))
        return (
            index // knots,
            point_of(index % knots, FINER),
            np.pad(chosen[bare], ((0, spare), (0, 0))) / SHRINK,
            np.pad(np.full(len(bare), 1.0 / max(len(chosen), 1)), (0, spare)),
        )

    found = abreast(pulls_of, views, depths, probes)
    strand, point, pixel, share = zip(*found, strict=True)
    return Pulls(
        on_device(np.stack(strand), jnp.int32),
        on_device(np.stack(point), jnp.int32),
        on_device(np.stack(pixel), jnp.float32),
        on_device(np.stack(share), jnp.float32),
    )


def bare_loss(
    strands: Float[Array, "strands knots 3"], pulls: Pulls, maps: PhotoMaps
) -> Float[Array, ""]:
    """Return how far strands are from the hair that they should cover."""

    def one(pull, found):
        height, width = found.outside.shape
        camera = Camera(found.K, found.cam_from_world, width, height)
        pixel, depth = jax.vmap(camera.project)(strands[pull.strand, pull.point])
        away = jnp.sqrt(jnp.sum((pixel - pull.pixel) ** 2, axis=1) + 1e-4)
        metres = away * SHRINK * depth / found.focal
        return jnp.sum(pull.share * jnp.minimum(metres, FARTHEST)) / SIGMA_BARE

    return jnp.mean(jax.vmap(one)(pulls, maps))
