"""Pen strokes along strands: where they go, how wide they are, and their ink."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..render.camera import Camera
from ..render.raster import project_points

# The grid in which strokes keep apart has so many cells along the picture's short side.
CELLS = 420
# Distance of strokes in cells: in the dark, and how much more in full light.
DARK_GAP, LIGHT_GAP = 1.3, 7.5
# Steps along strokes, and the shortest stroke, in cells; holes in what is seen of a
# strand up to so many steps do not end its stroke.
STEP, SHORTEST, HOLE = 0.8, 18.0, 6
# Shorter strokes than this are thinner, in cells.
LONG = 90.0
# Strands that are tried at most, and points of a strand.
MOST_TRIED, MOST_STEPS = 6000, 900
# How far into hair strokes are drawn, in metres.
SEE_INTO = 0.006


class Stroke(NamedTuple):
    """A stroke of the pen.

    Attributes:
        pixel: Its points.
        width: Its width at each, in widths of the pen.
    """

    pixel: Float[np.ndarray, "points 2"]
    width: Float[np.ndarray, " points"]


class Paper(NamedTuple):
    """What a stroke must know of the picture.

    Attributes:
        camera: Where it is seen from.
        front: Depth of the front-most hair, or of the head before it, in metres.
        shade: How bright each knot of hair is, from 0 to 1.
    """

    camera: Camera
    front: Float[np.ndarray, "height width"]
    shade: Float[np.ndarray, "strands knots"]


def place_strokes(
    points: Float[np.ndarray, "strands knots 3"], paper: Paper, seed: int = 0
) -> list[Stroke]:
    """Return strokes along strands that are seen: dense in shadow, few in light.

    Strands are tried one after the other and drawn where they keep away from strokes
    drawn before [after Jobard and Lefer 1997, Creating evenly-spaced streamlines].

    Args:
        points: The strands, in metres.
        paper: The picture.
        seed: Of the order in which they are tried.
    """
    camera = paper.camera
    pixel, depth = project_points(points, camera)
    cell = min(camera.width, camera.height) / CELLS
    shape = int(camera.height / cell) + 1, int(camera.width / cell) + 1
    taken = np.zeros(shape, bool)
    out = []
    for index in np.random.default_rng(seed).permutation(len(points))[:MOST_TRIED]:
        at, z, light = resampled(
            pixel[index], depth[index], paper.shade[index], STEP * cell
        )
        column, row = np.floor(at / cell).astype(int).T
        inside = ((at >= 0.0) & (at < [camera.width, camera.height])).all(1) & (z > 0.0)
        if not inside.any():
            continue
        row, column = row.clip(0, shape[0] - 1), column.clip(0, shape[1] - 1)
        x, y = np.where(inside[:, None], at, 0.0).astype(int).T
        free = inside & (z <= paper.front[y, x] + SEE_INTO) & ~taken[row, column]
        for first, last in runs(free, int(SHORTEST / STEP)):
            part = slice(first, last)
            out.append(Stroke(at[part], tapered(light[part])))
            gap = DARK_GAP + LIGHT_GAP * light[part] ** 1.5
            stamp(taken, np.stack([column[part], row[part]], 1), gap)
    return out


def resampled(
    pixel: Float[np.ndarray, "knots 2"],
    depth: Float[np.ndarray, " knots"],
    shade: Float[np.ndarray, " knots"],
    step: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return pixel, depth and shade at even steps along a strand's picture."""
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(pixel, axis=0), axis=1)))
    at = np.linspace(0.0, along[-1], min(int(along[-1] / step) + 2, MOST_STEPS))
    values = [np.interp(at, along, x) for x in (*pixel.T, depth, shade)]
    return np.stack(values[:2], 1), values[2], values[3]


def runs(free: Bool[np.ndarray, " steps"], least: int) -> list[tuple[int, int]]:
    """Return first and last step of the parts that are free, short holes included."""
    steps = np.flatnonzero(free)
    if len(steps) == 0:
        return []
    breaks = np.flatnonzero(np.diff(steps) > HOLE)
    firsts = steps[np.append(0, breaks + 1)].tolist()
    lasts = (steps[np.append(breaks, len(steps) - 1)] + 1).tolist()
    return [(a, b) for a, b in zip(firsts, lasts, strict=True) if b - a >= least]


def tapered(light: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
    """Return the width of a stroke: thin at its ends, in the light, and if short."""
    share = (np.arange(len(light)) + 0.5) / len(light)
    # Pens land faster than they lift.
    profile = np.minimum(np.sqrt(share / 0.2), ((1.0 - share) / 0.55) ** 0.8)
    # A stroke has inertia: its width does not follow every shimmer of light.
    size = max(len(light) // 8, 1)
    even = np.convolve(np.pad(light, size, mode="edge"), np.ones(size) / size, "same")
    weight = min(len(light) * STEP / LONG, 1.0) ** 0.5
    return weight * np.minimum(profile, 1.0) * (1.25 - 0.95 * even[size:-size])


def stamp(
    taken: Bool[np.ndarray, "rows columns"],
    cells: Int[np.ndarray, "points 2"],
    radius: Float[np.ndarray, " points"],
) -> None:
    """Mark the cells within a radius of points."""
    reach = int(radius.max(initial=0.0))
    rows, columns = taken.shape
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            column, row = cells[np.hypot(dx, dy) <= radius].T + [[dx], [dy]]
            inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
            taken[row[inside], column[inside]] = True


def ink_of(
    strokes: list[Stroke], size: tuple[int, int], pen: float, times: int
) -> Float[np.ndarray, "height width"]:
    """Return how much of each pixel strokes cover.

    Args:
        strokes: The strokes.
        size: Width and height of the picture, in pixels.
        pen: Width of the pen, in pixels.
        times: Samples along the side of a pixel.
    """
    width, height = size
    fine = np.zeros((times * height, times * width), bool)
    if strokes:
        centres, radii = [], []
        for stroke in strokes:
            step = 0.6 / times
            length = np.linalg.norm(np.diff(stroke.pixel, axis=0), axis=1)
            along = np.append(0.0, np.cumsum(length))
            at = np.linspace(0.0, along[-1], int(along[-1] / step) + 2)
            xy = [np.interp(at, along, x) for x in stroke.pixel.T]
            centres.append(np.stack(xy, 1))
            radii.append(0.5 * pen * np.interp(at, along, stroke.width))
        pixel = (times * np.concatenate(centres)).astype(int)
        stamp(fine, pixel, times * np.concatenate(radii))
    return fine.reshape(height, times, width, times).mean((1, 3))
