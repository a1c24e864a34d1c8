"""Strands and meshes into depth pictures: an exact, repeatable z-buffer in NumPy."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..types import Mesh
from .camera import Camera

NEAR = 1e-3
SAMPLES_AT_ONCE = 1 << 17  # what stays in the cache of one core


class Raster(NamedTuple):
    """What a camera sees of strands, pixel by pixel.

    Attributes:
        depth: Depth of the front-most hair in metres, infinite where there is none.
        orientation: Angle of its projected tangent from +x towards +y, in [0, pi).
        coverage: Whether there is hair.
        strand: Index of the front-most strand, -1 where there is none.
        segment: Which of its segments it is, from the root, -1 where there is none.
    """

    depth: Float[np.ndarray, "height width"]
    orientation: Float[np.ndarray, "height width"]
    coverage: Bool[np.ndarray, "height width"]
    strand: Int[np.ndarray, "height width"]
    segment: Int[np.ndarray, "height width"]


class Hits(NamedTuple):
    """What the ray through the centre of every pixel meets first.

    Attributes:
        depth: Depth along the optical axis in metres, infinite where there is nothing.
        face: Index of the face, -1 where there is none.
    """

    depth: Float[np.ndarray, "height width"]
    face: Int[np.ndarray, "height width"]


class Pixels(NamedTuple):
    """Where points land: pixels (first centre at 0.5, 0.5), and depth in metres."""

    pixel: Float[np.ndarray, "*points 2"]
    depth: Float[np.ndarray, "*points"]


class Cells(NamedTuple):
    """The pixels of a picture in which points land.

    Attributes:
        row: Row of each point's pixel; of the nearest one, for points outside.
        column: Its column, alike.
        inside: Whether the point lies in the picture and before the camera.
    """

    row: Int[np.ndarray, " points"]
    column: Int[np.ndarray, " points"]
    inside: Bool[np.ndarray, " points"]


class Segments(NamedTuple):
    """Straight pieces of strands, clipped to the picture; inverse depth is linear."""

    start: Float[np.ndarray, "segments 2"]
    step: Float[np.ndarray, "segments 2"]
    inverse_depth: Float[np.ndarray, "segments 2"]
    number: Int[np.ndarray, " segments"]


def project_points(points: Float[np.ndarray, "*points 3"], camera: Camera) -> Pixels:
    """Return where points of the world land, as `Camera.project` but in NumPy.

    Points behind the camera have a depth that is not positive and no useful pixel.
    """
    view = np.asarray(camera.cam_from_world, np.float64)
    p_cam = np.asarray(points, np.float64) @ view[:3, :3].T + view[:3, 3]
    depth = p_cam[..., 2]
    safe = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
    pixel = (p_cam / safe[..., None]) @ np.asarray(camera.K, np.float64)[:2].T
    return Pixels(pixel, depth)


def cells(pixels: Pixels, width: int, height: int) -> Cells:
    """Return the pixels in which points land, to look up what a picture says there."""
    x, y = np.floor(pixels.pixel).astype(int).T
    inside = (pixels.depth > 0) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
    return Cells(np.clip(y, 0, height - 1), np.clip(x, 0, width - 1), inside)


def rasterise(
    points: Float[np.ndarray, "strands knots 3"],
    camera: Camera,
    *,
    mesh_depth: Float[np.ndarray, "height width"] | None = None,
    radius_px: float = 0.0,
    step_px: float = 0.7,
) -> Raster:
    """Return depth, orientation and owner of the front-most hair in every pixel.

    A segment colours the pixels that hold one of its samples, or lie within `radius_px`
    of such a pixel. Segments that reach behind the camera are left out.

    Args:
        points: Strands of equal counts of points, in metres.
        camera: The camera.
        mesh_depth: Depth of what hides hair, infinite where nothing does.
        radius_px: Half of the width of a strand beyond its own pixels.
        step_px: Greatest distance between two samples of a segment.
    """
    return next(rasterise_wider(points, camera, (radius_px,), mesh_depth, step_px))


def rasterise_wider(
    points: Float[np.ndarray, "strands knots 3"],
    camera: Camera,
    radii_px: Sequence[float],
    mesh_depth: Float[np.ndarray, "height width"] | None = None,
    step_px: float = 0.7,
) -> Iterator[Raster]:
    """Give what `rasterise` returns for each radius, sampling strands once."""
    width, height = camera.width, camera.height
    pixels = project_points(points, camera)
    angle = np.arctan2(
        np.diff(pixels.pixel[..., 1], axis=1), np.diff(pixels.pixel[..., 0], axis=1)
    ).reshape(-1)
    segments = picture_segments(pixels, width, height)
    thin = front_most(segments, width, height, step_px)
    for radius_px in radii_px:
        front = dilate(thin, radius_px)
        covered = front > 0
        depth = np.full((height, width), np.inf)
        bits = (front[covered] >> 32).astype(np.int32)
        depth[covered] = 1.0 / bits.view(np.float32).astype(np.float64)
        if mesh_depth is not None:
            covered &= depth <= mesh_depth
            depth[~covered] = np.inf
        index = (1 << 32) - 1 - (front[covered] & 0xFFFFFFFF)
        orientation = np.zeros((height, width))
        # Rounding can bring the smallest negative angle to pi itself.
        folded = np.mod(angle[index], np.pi)
        orientation[covered] = np.where(folded >= np.pi, 0.0, folded)
        strand = np.full((height, width), -1, np.int32)
        segment = strand.copy()
        owner = np.divmod(index, max(points.shape[1] - 1, 1))
        strand[covered], segment[covered] = owner
        yield Raster(depth, orientation, covered, strand, segment)


def picture_segments(pixels: Pixels, width: int, height: int) -> Segments:
    """Return the segments of strands that touch the picture, clipped to it.

    Liang and Barsky's clipping bounds the number of samples, however near the hair is.
    """
    start, end = (
        pixels.pixel[:, k].reshape(-1, 2) for k in (slice(-1), slice(1, None))
    )
    z0, z1 = (pixels.depth[:, k].reshape(-1) for k in (slice(-1), slice(1, None)))
    safe = np.where(np.minimum(z0, z1) > NEAR)[0]
    start, end, z0, z1 = start[safe], end[safe], z0[safe], z1[safe]
    delta = end - start
    enter, leave = np.zeros(len(safe)), np.ones(len(safe))
    size = np.array([width, height], np.float64)
    within = ((start >= 0.0) & (start < size) & (end >= 0.0) & (end < size)).all(1)
    crossing = np.flatnonzero(~within)
    enter[crossing], leave[crossing] = clipped(start[crossing], delta[crossing], size)
    keep = np.flatnonzero(enter <= leave)
    enter, leave = enter[keep], leave[keep]
    inverse0, inverse1 = 1.0 / z0[keep], 1.0 / z1[keep]
    slope = inverse1 - inverse0
    return Segments(
        start[keep] + enter[:, None] * delta[keep],
        (leave - enter)[:, None] * delta[keep],
        np.stack([inverse0 + enter * slope, (leave - enter) * slope], 1),
        safe[keep],
    )


def clipped(
    start: Float[np.ndarray, "segments 2"],
    delta: Float[np.ndarray, "segments 2"],
    size: Float[np.ndarray, " 2"],
) -> tuple[Float[np.ndarray, " segments"], Float[np.ndarray, " segments"]]:
    """Return at which share of itself each segment enters a picture and leaves it.

    It leaves before it enters where it passes beside the picture.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = -start / delta, (size - start) / delta
    level = delta == 0.0
    outside = level & ((start < 0.0) | (start >= size))
    enter = np.where(level, -np.inf, np.minimum(low, high)).max(1).clip(0.0, None)
    leave = np.where(level, np.inf, np.maximum(low, high)).min(1).clip(None, 1.0)
    return enter, np.where(outside.any(1), -np.inf, leave)


def front_most(
    segments: Segments, width: int, height: int, step_px: float
) -> Int[np.ndarray, "height width"]:
    """Return per pixel the nearest segment, packed: inverse depth over inverse index.

    The bits of a positive float32 are ordered as the number is, hence one integer
    maximum keeps the nearest sample and, among equals, the first segment. 0 is empty.
    """
    buffer = np.zeros(width * height, np.int64)
    length = np.linalg.norm(segments.step, axis=1)
    count = np.maximum(np.ceil(length / step_px), 1.0).astype(np.int64) + 1
    # Segments of the same number of samples form plain rectangles of samples.
    order = np.argsort(count, kind="stable")
    start = segments.start[order].astype(np.float32)
    step = segments.step[order].astype(np.float32)
    inverse = segments.inverse_depth[order].astype(np.float32)
    label = (1 << 32) - 1 - segments.number[order]
    numbers, firsts, sizes = np.unique(
        count[order], return_index=True, return_counts=True
    )
    for number, first, last in zip(numbers, firsts, firsts + sizes, strict=True):
        share = np.linspace(0.0, 1.0, number, dtype=np.float32)[:, None]
        rows = max(1, SAMPLES_AT_ONCE // int(number))
        for begin in range(first, last, rows):
            part = slice(begin, min(begin + rows, last))
            x = (start[part, 0] + share * step[part, 0]).astype(np.int32)
            y = (start[part, 1] + share * step[part, 1]).astype(np.int32)
            np.minimum(x, width - 1, out=x)
            np.minimum(y, height - 1, out=y)
            y *= width
            y += x
            near = inverse[part, 0] + share * inverse[part, 1]
            packed = near.view(np.int32).astype(np.int64)
            packed <<= 32
            packed |= label[part]
            np.maximum.at(buffer, y.reshape(-1).astype(np.intp), packed.reshape(-1))
    return buffer.reshape(height, width)


def dilate(
    front: Int[np.ndarray, "height width"], radius_px: float
) -> Int[np.ndarray, "height width"]:
    """Return the packed buffer with every sample stamped as a disc of pixels."""
    reach = int(radius_px)
    padded = np.pad(front, reach)
    height, width = front.shape
    out = front.copy()
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            if 0 < dx * dx + dy * dy <= radius_px**2:
                row, column = reach + dy, reach + dx
                shifted = padded[row : row + height, column : column + width]
                np.maximum(out, shifted, out=out)
    return out


def mesh_depth(mesh: Mesh, camera: Camera) -> Float[np.ndarray, "height width"]:
    """Return the depth of a mesh at the centre of every pixel, infinite beside it.

    Depth runs along the optical axis, as that of the strands: not along the ray.
    """
    return mesh_hits(mesh, camera).depth


def mesh_hits(mesh: Mesh, camera: Camera) -> Hits:
    """Return the front-most face of a mesh and its depth in every pixel."""
    import trimesh

    width, height = camera.width, camera.height
    out = Hits(np.full((height, width), np.inf), np.full((height, width), -1, np.int32))
    column, row = np.meshgrid(np.arange(width), np.arange(height))
    near = window(mesh, camera)
    column, row = column[near].reshape(-1), row[near].reshape(-1)
    if len(column) == 0:
        return out
    centre = np.stack([column + 0.5, row + 0.5, np.ones(len(row))], 1)
    p_cam = centre @ np.linalg.inv(np.asarray(camera.K, np.float64)).T
    view = np.asarray(camera.cam_from_world, np.float64)
    ray = p_cam @ view[:3, :3]
    eye = -view[:3, :3].T @ view[:3, 3]
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    origins = np.broadcast_to(eye, ray.shape)
    face = surface.ray.intersects_first(origins, ray)
    hit = np.where(face >= 0)[0]
    # The z of `p_cam` is 1, so the share of `ray` up to the face's plane is the depth.
    depth = share_to_faces(mesh, face[hit], eye, ray[hit])
    ahead = depth > NEAR
    at = row[hit[ahead]], column[hit[ahead]]
    out.depth[at], out.face[at] = depth[ahead], face[hit[ahead]]
    return out


def share_to_faces(
    mesh: Mesh,
    face: Int[np.ndarray, " rays"],
    start: Float[np.ndarray, "*starts 3"],
    ray: Float[np.ndarray, "rays 3"],
) -> Float[np.ndarray, " rays"]:
    """Return which share of each ray leads to its face's plane; 0 if it never meets it.

    Args:
        mesh: The mesh.
        face: The face of each ray.
        start: Where rays start: one place for all, or one a ray.
        ray: Their directions, of any length.
    """
    corner = np.asarray(mesh.vertices, np.float64)[mesh.faces[face]]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    along = np.einsum("ij,ij->i", ray, normal)
    return np.einsum("ij,ij->i", corner[:, 0] - start, normal) / np.where(
        along == 0.0, np.inf, along
    )


def window(mesh: Mesh, camera: Camera) -> tuple[slice, slice]:
    """Return the rows and columns outside of which no ray can meet the mesh."""
    pixels = project_points(np.asarray(mesh.vertices, np.float64), camera)
    if len(pixels.depth) == 0:
        return slice(0, 0), slice(0, 0)
    if pixels.depth.min() <= NEAR:
        return slice(None), slice(None)
    size = np.array([camera.width, camera.height])
    first = np.clip(np.floor(pixels.pixel.min(0)), 0, size).astype(int)
    last = np.clip(np.ceil(pixels.pixel.max(0)), 0, size).astype(int)
    return slice(first[1], last[1]), slice(first[0], last[0])


def vertex_normals(mesh: Mesh) -> Float[np.ndarray, "vertices 3"]:
    """Return unit normals at the vertices, weighted by the areas of their faces."""
    corner = np.asarray(mesh.vertices, np.float64)[mesh.faces]
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    out = np.zeros((len(mesh.vertices), 3))
    np.add.at(out, mesh.faces.reshape(-1), np.repeat(cross, 3, 0))
    return unit(out)


def unit(v: Float[np.ndarray, "*vectors 3"]) -> Float[np.ndarray, "*vectors 3"]:
    """Return vectors of length 1; those of length 0 stay."""
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12)


def visible_points(
    points: Float[np.ndarray, "points 3"],
    camera: Camera,
    depth: Float[np.ndarray, "height width"],
    mesh_depth: Float[np.ndarray, "height width"] | None,
    tolerance: float,
) -> Bool[np.ndarray, " points"]:
    """Return which points of hair a camera sees.

    A point is seen if it lies in the picture, not behind the mesh, and at most
    `tolerance` behind the front-most hair of its pixel. Both tests leave the footprint
    of one pixel, which is how far a depth picture knows where a surface is.

    Args:
        points: Points, in metres.
        camera: The camera.
        depth: Depth of the front-most hair, as `rasterise` has it.
        mesh_depth: Depth of the mesh, or None if nothing but hair hides hair.
        tolerance: How deep into hair one sees, in metres.
    """
    pixels = project_points(points, camera)
    inside = (
        (pixels.depth > NEAR)
        & (pixels.pixel >= 0.0).all(1)
        & (pixels.pixel < [camera.width, camera.height]).all(1)
    )
    at = np.where(inside)[0]
    column, row = pixels.pixel[at].astype(np.int64).T
    z = pixels.depth[at]
    footprint = z / float(min(camera.K[0, 0], camera.K[1, 1]))
    seen = z <= depth[row, column] + tolerance + footprint
    if mesh_depth is not None:
        seen &= z <= mesh_depth[row, column] + footprint
    inside[at] = seen
    return inside
