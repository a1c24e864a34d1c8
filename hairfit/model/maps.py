"""Maps painted on the scalp: density, length, thickness, colour and curl."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray, ScalarLike, UInt32

from .curve import EXACT, linear_weights
from .scalp import Scalp, sample_roots
from .vector import norm

# Rounds of sampling after which a scalp that is hardly painted counts as exhausted.
ROUNDS = 64


class ScalpMaps(eqx.Module):
    """What is painted on the scalp [Kim02, section 4.9, figure 7-5].

    Texels are the corners of an even grid: `[i, j]` stands at `u = i / (rows - 1)`,
    `v = j / (columns - 1)`; between them values are bilinear.

    Attributes:
        density: Share of the roots that grow, 0 (bald) to 1.
        length: Share of the length that hair grows to, 0 to 1.
        thickness: Diameter of a hair at its root, in metres.
        colour: Linear RGB.
        curl: Radius of the curls of single hairs, in metres; 0 is straight.
    """

    density: Float[Array, "rows columns"]
    length: Float[Array, "rows columns"]
    thickness: Float[Array, "rows columns"]
    colour: Float[Array, "rows columns 3"]
    curl: Float[Array, "rows columns"]


class RootAttributes(NamedTuple):
    """What the maps say at the roots of strands; fields as those of `ScalpMaps`."""

    density: Float[Array, " strands"]
    length: Float[Array, " strands"]
    thickness: Float[Array, " strands"]
    colour: Float[Array, "strands 3"]
    curl: Float[Array, " strands"]


def even_maps(
    rows: int,
    columns: int,
    *,
    density: float = 1.0,
    length: float = 1.0,
    thickness: float = 7e-5,
    colour: tuple[float, float, float] = (0.24, 0.11, 0.048),
    curl: float = 0.0,
) -> ScalpMaps:
    """Return maps of one value each: the canvas to paint on.

    Args:
        rows: Texels along u, 2 or more.
        columns: Texels along v, 2 or more.
        density: See `ScalpMaps`, as for all that follow.
        length: The same.
        thickness: The same; 70 micrometres is a common human hair.
        colour: The same; brown.
        curl: The same.

    Raises:
        ValueError: If there are fewer than 2 texels a side.
    """
    if rows < 2 or columns < 2:
        raise ValueError(
            f"a map needs at least 2 x 2 texels, its corners, got {rows} x {columns}."
        )

    def even(value):
        return jnp.full((rows, columns), value, jnp.result_type(float))

    full = jnp.stack([even(channel) for channel in colour], axis=-1)
    return ScalpMaps(even(density), even(length), even(thickness), full, even(curl))


def sample_map(
    values: Float[Array, "rows columns *channels"], uv: Float[Array, " 2"]
) -> Float[Array, "*channels"]:
    """Return a map's value at a point of scalp space, bilinear between texels.

    Differentiable in both; the slope by `uv` jumps where texels meet. Outside of
    [0, 1] the border's values hold.

    Args:
        values: The map, of numbers or of vectors such as colours.
        uv: Where.
    """
    corner, share = [], []
    for axis in range(2):
        texels = values.shape[axis]
        position = jnp.clip(uv[axis], 0.0, 1.0) * (texels - 1)
        first = jnp.clip(jnp.floor(position), 0.0, max(texels - 2.0, 0.0))
        corner.append(first.astype(jnp.int32))
        share.append((position - first).astype(values.dtype))
    (i, j), (f, g) = corner, share
    near = (1.0 - g) * values[i, j] + g * values[i, j + 1]
    far = (1.0 - g) * values[i + 1, j] + g * values[i + 1, j + 1]
    return (1.0 - f) * near + f * far


@jax.jit
def root_attributes(maps: ScalpMaps, uv: Float[Array, "strands 2"]) -> RootAttributes:
    """Return what the maps say at the roots of strands."""
    fields = (maps.density, maps.length, maps.thickness, maps.colour, maps.curl)
    return RootAttributes(*(jax.vmap(sample_map, (None, 0))(x, uv) for x in fields))


def fill(
    values: Float[Array, "rows columns *channels"],
    value: ScalarLike | Float[Array, "*channels"],
) -> Float[Array, "rows columns *channels"]:
    """Return a map that has one value everywhere."""
    return jnp.broadcast_to(jnp.asarray(value, values.dtype), values.shape)


@jax.jit
def paint(
    values: Float[Array, "rows columns *channels"],
    stroke: Float[Array, "points 2"],
    radius: ScalarLike,
    value: ScalarLike | Float[Array, "*channels"],
    strength: ScalarLike = 1.0,
) -> Float[Array, "rows columns *channels"]:
    r"""Return a map with one stroke of a soft brush on it.

    A texel at the distance d from the stroke is blended with `value` by
    $w = strength\,(1 - x)^2 (1 + 2 x)$, $x = d / radius$: all of it on the stroke,
    nothing from the radius on, without a step in slope. So values stay between what
    was there and what is painted.

    Args:
        values: The map.
        stroke: A polyline in scalp space; one point is a dab.
        radius: Of the brush, in scalp space. Metres differ with place and direction.
        value: What to paint: a number, or a vector for maps of vectors.
        strength: Share of the paint, 0 to 1.
    """
    rows, columns = values.shape[:2]
    u = jnp.linspace(0.0, 1.0, rows, dtype=stroke.dtype)
    v = jnp.linspace(0.0, 1.0, columns, dtype=stroke.dtype)
    texel = jnp.stack(jnp.meshgrid(u, v, indexing="ij"), axis=-1)
    apart = jax.vmap(jax.vmap(stroke_distance, (None, 0)), (None, 0))(stroke, texel)
    size = jnp.asarray(radius, stroke.dtype)
    x = jnp.minimum(apart / jnp.where(size > 0.0, size, 1.0), 1.0)
    weight = jnp.clip(jnp.asarray(strength, stroke.dtype), 0.0, 1.0)
    weight = jnp.where(size > 0.0, weight * (1.0 - x) ** 2 * (1.0 + 2.0 * x), 0.0)
    weight = weight.astype(values.dtype).reshape(
        (rows, columns) + (1,) * (values.ndim - 2)
    )
    return (1.0 - weight) * values + weight * fill(values, value)


def stroke_distance(
    stroke: Float[Array, "points 2"], uv: Float[Array, " 2"]
) -> Float[Array, ""]:
    """Return the distance of a point from a polyline, both in scalp space."""
    start = stroke if stroke.shape[0] == 1 else stroke[:-1]
    step = jnp.zeros_like(stroke) if stroke.shape[0] == 1 else stroke[1:] - start
    square = jnp.sum(step * step, axis=1)
    along = jnp.sum((uv[None] - start) * step, axis=1)
    along = jnp.clip(along / jnp.where(square > 0.0, square, 1.0), 0.0, 1.0)
    return jnp.min(norm(uv[None] - start - along[:, None] * step))


def smooth_map(
    values: Float[Array, "rows columns *channels"], width: float
) -> Float[Array, "rows columns *channels"]:
    """Return a map blurred by a Gaussian; even maps do not change.

    Args:
        values: The map.
        width: Standard deviation of the Gaussian, in scalp space; 0 leaves the map.
    """
    if width <= 0.0:
        return values
    for axis in range(2):
        side = np.linspace(0.0, 1.0, values.shape[axis])
        weights = np.exp(-0.5 * ((side[:, None] - side[None]) / width) ** 2)
        # What lies beyond the border does not count, so that the border is not drawn
        # towards 0.
        weights = jnp.asarray(weights / weights.sum(1, keepdims=True), values.dtype)
        mixed = jnp.tensordot(weights, values, (1, axis), precision=EXACT)
        values = jnp.moveaxis(mixed, 0, axis)
    return values


def mirror_map(
    values: Float[Array, "rows columns *channels"],
) -> Float[Array, "rows columns *channels"]:
    """Return a map with left and right exchanged: u becomes 1 - u."""
    return jnp.flip(values, 0)


def symmetric_map(
    values: Float[Array, "rows columns *channels"], low: bool = True
) -> Float[Array, "rows columns *channels"]:
    """Return a map whose one half along u is the mirror image of the other.

    Args:
        values: The map.
        low: Whether the half below u = 1/2 is kept, else the one above.
    """
    rows = values.shape[0]
    index = np.arange(rows)
    source = np.minimum(index, rows - 1 - index)
    return values[source if low else rows - 1 - source]


def resize_map(
    values: Float[Array, "old_rows old_columns *channels"], rows: int, columns: int
) -> Float[Array, "{rows} {columns} *channels"]:
    """Return a map of other texels with the bilinear values of the old one.

    Nothing is averaged: `smooth_map` before making a map much smaller.

    Args:
        values: The map.
        rows: New texels along u, 2 or more.
        columns: New texels along v, 2 or more.

    Raises:
        ValueError: If there are fewer than 2 texels a side.
    """
    if rows < 2 or columns < 2:
        raise ValueError(
            f"a map needs at least 2 x 2 texels, its corners, got {rows} x {columns}."
        )
    for axis, texels in enumerate((rows, columns)):
        at = jnp.linspace(0.0, 1.0, texels, dtype=values.dtype)
        weights = linear_weights(values.shape[axis], at)
        mixed = jnp.tensordot(weights, values, (1, axis), precision=EXACT)
        values = jnp.moveaxis(mixed, 0, axis)
    return values


def keep_roots(
    maps: ScalpMaps,
    uv: Float[Array, "strands 2"],
    key: PRNGKeyArray | UInt32[Array, " 2"],
) -> Bool[Array, " strands"]:
    """Return which roots grow: where the density is d, the share d of them.

    Each root is kept by a random number of its own, so that a root that grows at some
    density grows at all higher ones.

    Args:
        maps: The maps.
        uv: The roots.
        key: Randomness.
    """
    density = root_attributes(maps, uv).density
    return jax.random.uniform(key, density.shape, density.dtype) < density


def sample_roots_by_density(
    scalp: Scalp,
    density: Float[Array, "rows columns"],
    count: int,
    key: PRNGKeyArray | UInt32[Array, " 2"],
) -> Float[Array, "strands 2"]:
    """Return `count` random roots, even over the scalp's area times a density.

    Roots that are even over the area are rejected where the density says so. Fewer come
    back only if next to nothing of the scalp has a density, and none if nothing has.

    Runs outside `jit`.

    Args:
        scalp: The patch.
        density: A map; only its ratios count.
        count: Number of roots.
        key: Randomness.
    """
    highest = float(jnp.max(density))
    found: list[np.ndarray] = [np.zeros((0, 2), scalp.control.dtype)]
    if highest <= 0.0:
        return jnp.asarray(found[0])
    at_roots = jax.jit(jax.vmap(sample_map, (None, 0)))
    missing, batch = count, max(2 * count, 256)
    for round_key in jax.random.split(key, ROUNDS):
        if missing <= 0:
            break
        root_key, keep_key = jax.random.split(round_key)
        uv = sample_roots(scalp, batch, root_key)
        share = np.asarray(at_roots(density, uv)) / highest
        kept = np.asarray(jax.random.uniform(keep_key, (batch,))) < share
        found.append(np.asarray(uv)[kept])
        missing -= int(kept.sum())
    return jnp.asarray(np.concatenate(found)[:count])
