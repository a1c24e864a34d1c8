"""Where on a skeleton a point belongs: closest points, alone or along a whole curve."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .curve import BASIS, EXACT
from .vector import TINY, norm

# Samples of the skeleton between two knots, for a first guess.
PER_SEGMENT = 8
ROOT_STEPS = 16
# A root counts as found within this share of a sample's distance from the next.
FOUND = 1e-3
# Beyond this share of the radius of curvature the closest point is not to be trusted.
WITHIN = 0.98
# Another closest point that is farther away by this share counts as equally close.
AS_CLOSE = 1.01


class Axis(NamedTuple):
    """One skeleton, prepared for the search of closest points.

    Attributes:
        cubic: Coefficients of 1, f, f^2, f^3 of the curve from knot to knot, f in
            [0, 1].
        tangent: Tangents at the knots.
        sample: Points of the curve, `PER_SEGMENT` from knot to knot.
    """

    cubic: Float[Array, "segments 4 3"]
    tangent: Float[Array, "knots 3"]
    sample: Float[Array, "samples 3"]


class Nearest(NamedTuple):
    """A place on a skeleton.

    Attributes:
        t: Where: 0 at the root, 1 at the tip, outside on the lines along the ends.
        ambiguous: Whether another place would do as well, or none does exactly.
    """

    t: Float[Array, ""]
    ambiguous: Bool[Array, ""]


class Piece(NamedTuple):
    """The skeleton from one knot to the next.

    Attributes:
        cubic: Coefficients of 1, f, f^2, f^3.
        first: Tangent at its begin.
        last: Tangent at its end.
    """

    cubic: Float[Array, "4 3"]
    first: Float[Array, " 3"]
    last: Float[Array, " 3"]


class Local(NamedTuple):
    """A piece of a skeleton at f, seen from a point.

    Attributes:
        rest: From the skeleton to the point.
        velocity: Derivative of the skeleton by f.
        g: `rest` along the interpolated tangent.
        slope: Derivative of `g` by f.
    """

    rest: Float[Array, " 3"]
    velocity: Float[Array, " 3"]
    g: Float[Array, ""]
    slope: Float[Array, ""]


def make_axis(
    skeleton: Float[Array, "knots 3"], tangent: Float[Array, "knots 3"]
) -> Axis:
    """Return a skeleton and its tangents at the knots, prepared for searching."""
    segments = len(skeleton) - 1
    before = 2.0 * skeleton[:1] - skeleton[1:2]
    after = 2.0 * skeleton[-1:] - skeleton[-2:-1]
    padded = jnp.concatenate([before, skeleton, after])
    taps = jnp.stack([padded[i : i + segments] for i in range(4)], axis=1)
    basis = jnp.asarray(np.array(BASIS).T, skeleton.dtype)
    cubic = jnp.einsum("pi,six->spx", basis, taps, precision=EXACT)
    f = np.arange(PER_SEGMENT) / PER_SEGMENT
    powers = jnp.asarray(f[:, None] ** np.arange(4), skeleton.dtype)
    between = jnp.einsum("fp,spx->sfx", powers, cubic, precision=EXACT)
    sample = jnp.concatenate([between.reshape(-1, 3), skeleton[-1:]])
    return Axis(cubic, tangent, sample)


def squared_distances(axis: Axis, p: Float[Array, " 3"]) -> Float[Array, " samples"]:
    """Return the squared distances of a point from the samples."""
    x, y, z = (axis.sample[:, i] - p[i] for i in range(3))
    return x * x + y * y + z * z


def nearest(axis: Axis, p: Float[Array, " 3"]) -> Nearest:
    r"""Return where on a skeleton the point `p` belongs.

    From the closest of many samples on, this solves $g(t) = (p - C(t)) \cdot T(t) = 0$
    to the last digit: Newton's method, and bisection where it fails. $T$ is the tangent
    of the interpolated frame, not the derivative $C'$: only so does $p - C(t)$ lie in
    the plane of $\bar N(t)$ and $\bar B(t)$, and $V(V^{-1}(p)) = p$. Both tangents are
    the same at the knots, so that the root is in the segment of the closest point.
    Beyond the ends the root is on the line along the end tangent, in closed form.

    `ambiguous` says that the point is beyond the radius of curvature ($g' \ge 0$), or
    that another stretch of the skeleton is as close, or that there is no root near the
    closest sample.

    Differentiable by the implicit function theorem; where the result is ambiguous, `t`
    may be taken as constant.
    """
    distance = squared_distances(axis, p)
    sample = jnp.argmin(distance)
    found = place_near(axis, p, sample)
    far = jnp.full(1, jnp.inf, p.dtype)
    lowest = distance <= jnp.concatenate([far, distance[:-1]])
    lowest &= distance <= jnp.concatenate([distance[1:], far])
    apart = jnp.abs(jnp.arange(len(distance)) - sample) > 1
    rivals = jnp.where(lowest & apart, distance, jnp.inf)
    as_close = jnp.min(rivals) <= AS_CLOSE**2 * distance[sample]
    return Nearest(found.t, found.ambiguous | as_close)


def piece_at(axis: Axis, segment: Int[Array, ""]) -> Piece:
    """Return one piece of a skeleton."""
    first, last = axis.tangent[segment], axis.tangent[segment + 1]
    return Piece(axis.cubic[segment], first, last)


def look(piece: Piece, p: Float[Array, " 3"], f: Float[Array, ""]) -> Local:
    """Return a piece at `f`; outside [0, 1] it goes on along its end tangents."""
    a, b, c, d = piece.cubic
    inside = jnp.clip(f, 0.0, 1.0)
    velocity = b + inside * (2.0 * c + 3.0 * inside * d)
    centre = a + inside * (b + inside * (c + inside * d)) + (f - inside) * velocity
    tangent = piece.first + inside * (piece.last - piece.first)
    turn = jnp.where(f == inside, piece.last - piece.first, 0.0)
    rest = p - centre
    slope = jnp.dot(rest, turn) - jnp.dot(velocity, tangent)
    return Local(rest, velocity, jnp.dot(rest, tangent), slope)


def is_root(here: Local) -> Bool[Array, ""]:
    """Return whether g vanishes, as far as a search can tell."""
    return jnp.abs(here.g) * PER_SEGMENT <= FOUND * norm(here.velocity)


def is_steep(here: Local) -> Bool[Array, ""]:
    """Return whether a place is well within the radius of curvature."""
    return here.slope < -(1.0 - WITHIN) * norm(here.velocity)


def place_near(
    axis: Axis, p: Float[Array, " 3"], sample: Int[Array, ""], reach: float = 1.0
) -> Nearest:
    """Return the root of g near one sample, or the sample's own t if there is none.

    See `nearest`. The value is found without derivatives; one step of Newton's method
    that changes nothing gives it those of the root.

    Args:
        axis: The skeleton.
        p: The point, in metres.
        sample: Index of the sample.
        reach: How far from the sample the root may be, against a piece of the skeleton
            from knot to knot.
    """
    segments = axis.cubic.shape[0]
    knot = sample // PER_SEGMENT
    at_knot = sample % PER_SEGMENT == 0
    behind = jnp.dot(p - axis.sample[sample], axis.tangent[knot]) < 0.0
    segment = jnp.where(at_knot & behind, knot - 1, knot)
    segment = jnp.clip(segment, 0, segments - 1)
    start = sample.astype(p.dtype) / PER_SEGMENT - segment.astype(p.dtype)
    aside = beyond_knot(axis, p, segment, start)
    segment, start = segment + aside, start - aside.astype(p.dtype)
    piece = piece_at(axis, segment)
    fixed, still = jax.lax.stop_gradient((piece, p))

    def step(_, state):
        f, low, high = state
        here = look(fixed, still, f)
        low = jnp.where(here.g > 0.0, f, low)
        high = jnp.where(here.g > 0.0, high, f)
        newton = f - here.g / jnp.where(here.slope < 0.0, here.slope, 1.0)
        good = (here.slope < 0.0) & (newton >= low) & (newton <= high)
        return jnp.where(good, newton, 0.5 * (low + high)), low, high

    within = jnp.clip(start, 0.0, 1.0)
    bracket = (within, jnp.zeros_like(start), jnp.ones_like(start))
    f = jax.lax.fori_loop(0, ROOT_STEPS, step, bracket)[0]
    found = is_root(look(fixed, still, f)) & (jnp.abs(f - start) <= reach)
    f = jnp.where(found, f, start)

    end = look(fixed, still, start)
    first, last = sample == 0, sample == segments * PER_SEGMENT
    outside = (first & (end.g < 0.0)) | (last & (end.g > 0.0))
    speed = norm(end.velocity)
    outside &= speed > TINY
    f = jnp.where(outside, start + end.g / jnp.where(outside, speed, 1.0), f)

    here = look(piece, p, f)
    sound = is_root(here) & is_steep(here)
    slope = jnp.where(sound, jax.lax.stop_gradient(here.slope), 1.0)
    change = (jax.lax.stop_gradient(here.g) - here.g) / slope
    f = f + jnp.where(sound, change, 0.0)
    return Nearest((segment.astype(p.dtype) + f) / segments, ~sound)


def beyond_knot(
    axis: Axis,
    p: Float[Array, " 3"],
    segment: Int[Array, ""],
    start: Float[Array, ""],
) -> Int[Array, ""]:
    """Return -1 or 1 if the root is in the piece before or after, else 0.

    As the tangent is not the derivative, the closest sample may be the first one behind
    a knot, and the root a little before the knot.
    """
    piece, still = jax.lax.stop_gradient((piece_at(axis, segment), p))
    zero = jnp.zeros_like(start)
    before = (start * PER_SEGMENT <= 1.0) & (look(piece, still, zero).g < 0.0)
    after = ((1.0 - start) * PER_SEGMENT <= 1.0) & (look(piece, still, zero + 1).g > 0)
    before &= segment > 0
    after &= segment < axis.cubic.shape[0] - 1
    return after.astype(segment.dtype) - before.astype(segment.dtype)


def follow_samples(axis: Axis, p: Float[Array, "knots 3"]) -> Int[Array, " knots"]:
    """Return the samples of a skeleton that successive knots of another belong to.

    They never go back, and minimise the squared distances plus the squared differences
    between the advance along the skeleton and the distance from knot to knot: the
    cheapest way through all pairs, by dynamic programming.
    """
    distance = jax.vmap(squared_distances, (None, 0))(axis, p)
    pieces = norm(axis.sample[1:] - axis.sample[:-1])
    along = jnp.concatenate([jnp.zeros(1, p.dtype), jnp.cumsum(pieces)])
    place = jnp.arange(len(along))
    step = norm(p[1:] - p[:-1])

    def ways(cost, step, sample):
        advance = along[sample] - along
        return jnp.where(place > sample, jnp.inf, cost + (advance - step) ** 2)

    def forward(cost, knot):
        distance, step = knot
        best = jax.vmap(lambda sample: jnp.min(ways(cost, step, sample)))(place)
        return best + distance, cost

    # The way back is found from the costs: cheaper than to keep where each came from.
    cost, costs = jax.lax.scan(forward, distance[0], (distance[1:], step))

    def back(sample, knot):
        cost, step = knot
        before = jnp.argmin(ways(cost, step, sample))
        return before, before

    last = jnp.argmin(cost)
    rest = jax.lax.scan(back, last, (costs, step), reverse=True)[1]
    return jnp.concatenate([rest, last[None]])
