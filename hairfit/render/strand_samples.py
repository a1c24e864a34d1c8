"""Strands as samples that a view sees: what `splat` deposits."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from .splat import Grid, Place
from .view import View, see_all

# Segments shorter than this, in pixels, have no direction and cover nothing.
SHORTEST = 1e-9


class Segments(NamedTuple):
    """Segments of strands in a view, one after the other.

    Attributes:
        ends: Column and row in pixels, depth and width in pixels, where each segment
            starts and where it ends.
        length: Length in pixels, 0 if it reaches behind the eye.
        turn: Cosine and sine of twice its angle in the picture, from +x towards +y.
    """

    ends: Float[Array, "2 4 segments"]
    length: Float[Array, " segments"]
    turn: Float[Array, "2 segments"]


class Samples(NamedTuple):
    r"""One sample of each segment.

    Attributes:
        pixel: Column and row, in pixels, first centre at (0.5, 0.5).
        depth: Distance along the view's axis, in metres.
        area: Area of the picture that the sample covers, in pixels: the opacity
            $\Omega$ that it adds.
        across: Width of the hair there, in pixels.
    """

    pixel: Float[Array, "2 samples"]
    depth: Float[Array, " samples"]
    area: Float[Array, " samples"]
    across: Float[Array, " samples"]


class DepthRange(NamedTuple):
    """Where a volume's layers begin and end, in metres along the view's axis."""

    near: Float[Array, ""]
    far: Float[Array, ""]


def see_segments(
    points: Float[Array, "strands knots 3"],
    width: Float[Array, "*widths"],
    view: View,
) -> Segments:
    """Return the segments of strands as a view sees them.

    Args:
        points: Strands, in metres.
        width: Width of hair, in metres: one for all, one a strand with shape
            (strands, 1), or one a knot.
        view: What sees them.
    """
    # The lower precision of matrix products on GPU would move points by pixels.
    with jax.default_matmul_precision("highest"):
        seen = jax.vmap(jax.vmap(view.see))(points)
    across = jnp.broadcast_to(width, points.shape[:2]) * seen.scale
    knots = jnp.stack([seen.pixel[..., 0], seen.pixel[..., 1], seen.depth, across])
    ends = pairs(knots)
    ahead = (seen.scale[:, :-1] > 0.0) & (seen.scale[:, 1:] > 0.0)
    step = jnp.where(ahead.reshape(1, -1), ends[1, :2] - ends[0, :2], 0.0)
    square = step[0] ** 2 + step[1] ** 2
    moves = square > SHORTEST**2
    safe = jnp.where(moves, square, 1.0)
    length = jnp.where(moves, jnp.sqrt(safe), 0.0)
    turn = jnp.stack([step[0] ** 2 - step[1] ** 2, 2.0 * step[0] * step[1]])
    return Segments(ends, length, turn / safe[None])


def pairs(
    x: Float[Array, "channels strands knots"],
) -> Float[Array, "2 channels segments"]:
    """Return values at both ends of each segment."""
    return jnp.stack([x[..., :-1], x[..., 1:]]).reshape(2, x.shape[0], -1)


def between_ends(
    ends: Float[Array, "2 channels segments"], share: Float[Array, ""]
) -> Float[Array, "channels segments"]:
    """Return values within segments, at a share of the way from start to end."""
    return (1.0 - share) * ends[0] + share * ends[1]


def sample_segments(segments: Segments, share: Float[Array, ""], count: int) -> Samples:
    """Return a sample of each segment's picture, one of `count`.

    Args:
        segments: What is sampled.
        share: Where, as share of the way from start to end.
        count: Samples a segment in all.
    """
    x, y, depth, across = between_ends(segments.ends, share)
    return Samples(jnp.stack([x, y]), depth, across * segments.length / count, across)


def middles(count: int, kind: jnp.dtype) -> Float[Array, " samples"]:
    """Return the middles of equal parts of a segment, as shares of it."""
    return (jnp.arange(count, dtype=kind) + 0.5) / count


def samples_needed(points: Float[Array, "strands knots 3"], view: View) -> int:
    """Return how many samples a segment keep them a pixel apart in the mean.

    Only segments that touch the picture count. The number sets shapes: call this
    outside of `jax.jit` and `jax.grad`.

    Args:
        points: Strands, in metres.
        view: What sees them.

    Raises:
        ValueError: If the points are being traced.
    """
    if isinstance(points, Tracer) or isinstance(view.matrix, Tracer):
        raise ValueError(
            "the number of samples sets shapes and cannot follow from traced points; "
            "call `samples_needed` first and give what it returns as `samples`."
        )
    seen = see_all(np.asarray(points, np.float64), view)
    size = np.array([view.width, view.height])
    start, end = seen[:, :-1], seen[:, 1:]
    ahead = (start[..., 3] > 0.0) & (end[..., 3] > 0.0)
    low = np.minimum(start[..., :2], end[..., :2])
    high = np.maximum(start[..., :2], end[..., :2])
    shown = ahead & (low < size).all(-1) & (high > 0.0).all(-1)
    length = np.linalg.norm((end - start)[shown][:, :2], axis=-1)
    return max(1, math.ceil(length.mean())) if length.size else 1


def depths_of(depth: Float[Array, "*points"], layers: int) -> DepthRange:
    """Return a range in which the outermost layers' centres are the outermost depths.

    It has no gradient: that the layers follow the hair must not count as an effect.
    """
    near, far = (jax.lax.stop_gradient(f(depth)) for f in (jnp.min, jnp.max))
    half = 0.5 * jnp.maximum(far - near, 1e-6) / (layers - 1)
    return DepthRange(near - half, far + half)


def place_in(samples: Samples, between: DepthRange, grid: Grid) -> Place:
    """Return where samples are in a volume.

    What lies before the first layer's centre is in the first layer, what lies beyond
    the last one's in the last.
    """
    share = (samples.depth - between.near) / (between.far - between.near)
    layer = jnp.clip(share * grid.layers - 0.5, 0.0, grid.layers - 1.0)
    x, y = samples.pixel
    return Place(x - 0.5, y - 0.5, layer)
