"""Fur: short hair grown straight from maps, without clusters; and curls."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray, ScalarLike, UInt32

from .curve import arc_length
from .frame import Frames, rotation_minimising_frames
from .locks import PITCH, Winding
from .maps import (
    RootAttributes,
    ScalpMaps,
    root_attributes,
    sample_map,
    sample_roots_by_density,
)
from .scalp import Scalp, scalp_normal, scalp_point, scalp_tangents
from .vector import norm, perpendicular, unit

# The shortest turn, in metres: finer curls are no more seen than drawn.
LEAST_PITCH = 0.002
# Standard deviation of the phases of hairs about that of their lock, in radians.
LOOSE = 0.8


class FurStyle(eqx.Module):
    """How fur is combed, beside what `ScalpMaps` say of it.

    Attributes:
        length: Length of a hair where the map of lengths is 1, in metres.
        comb: Where the hair leans: a map of vectors in scalp space. Their direction is
            that of the lean, their size its amount: 0 is upright, 1 flat on the skin.
        bend: How much further hair leans at its tip than at its root, in radians.
        length_variation: Share of the length by which hairs vary.
        disorder: How far directions vary from hair to hair, in radians.
    """

    length: Float[Array, ""]
    comb: Float[Array, "rows columns 2"]
    bend: Float[Array, ""]
    length_variation: Float[Array, ""]
    disorder: Float[Array, ""]


class Fur(NamedTuple):
    """Fur, and what the maps say at its roots.

    Attributes:
        strands: Root first, in metres.
        uv: The roots in scalp space.
        attributes: Thickness, colour and the rest of each hair.
    """

    strands: Float[Array, "strands points 3"]
    uv: Float[Array, "strands 2"]
    attributes: RootAttributes


def fur_style(
    length: float,
    *,
    comb: Float[Array, "rows columns 2"] | None = None,
    bend: float = 0.4,
    length_variation: float = 0.15,
    disorder: float = 0.12,
) -> FurStyle:
    """Return a style of fur; without `comb` hair stands upright."""
    dtype = jnp.result_type(float)
    if comb is None:
        comb = jnp.zeros((2, 2, 2), dtype)
    numbers = (jnp.asarray(x, dtype) for x in (bend, length_variation, disorder))
    return FurStyle(jnp.asarray(length, dtype), comb, *numbers)


def grow_fur(
    scalp: Scalp,
    maps: ScalpMaps,
    count: int,
    points: int,
    key: PRNGKeyArray | UInt32[Array, " 2"],
    style: FurStyle,
) -> Fur:
    """Return fur grown straight from maps [Kim02, section 7.5, figure 7-5].

    Roots are even over the scalp's area times the map of densities. Each hair is an arc
    that leans as the comb says, of its map's length, with its map's curls around it.
    Fewer hairs come back only if next to nothing of the scalp has a density.

    Runs outside `jit`.

    Args:
        scalp: The skin.
        maps: What is painted on it.
        count: Number of hairs.
        points: Points of each hair, 2 or more.
        key: Randomness; the same key gives the same fur.
        style: How it is combed.
    """
    root_key, length_key, lean_key, curl_key = jax.random.split(key, 4)
    uv = sample_roots_by_density(scalp, maps.density, count, root_key)
    attributes = root_attributes(maps, uv)
    dtype = uv.dtype
    grown = uv.shape[0]
    vary = jax.random.uniform(length_key, (grown,), dtype)
    share = attributes.length.astype(dtype)
    length = style.length * share * (1.0 - style.length_variation * vary)
    noise = jax.random.normal(lean_key, (grown, 2), dtype) * style.disorder
    lean = jax.vmap(sample_map, (None, 0))(style.comb, uv)
    strands = fur_arcs(scalp, uv, lean, length, noise, style.bend, points)
    strands = curl_each(strands, attributes.curl, curl_key)
    return Fur(strands, uv, attributes)


@eqx.filter_jit
def fur_arcs(
    scalp: Scalp,
    uv: Float[Array, "strands 2"],
    lean: Float[Array, "strands 2"],
    length: Float[Array, " strands"],
    noise: Float[Array, "strands 2"],
    bend: ScalarLike,
    points: int,
) -> Float[Array, "strands points 3"]:
    """Return hairs as arcs of circles that leave the skin as they lean.

    Args:
        scalp: The skin.
        uv: The roots.
        lean: Lean of each hair, as in `FurStyle.comb`.
        length: Length of each, in metres.
        noise: What turns each hair's root away, along u and along v, in radians.
        bend: How much further hair leans at its tip than at its root, in radians.
        points: Number of points.
    """
    along = jnp.linspace(0.0, 1.0, points, dtype=uv.dtype)

    def one(uv, lean, length, noise):
        up = scalp_normal(scalp, uv)
        du, dv = scalp_tangents(scalp, uv)
        du = unit(du, perpendicular(up))
        dv = unit(dv, perpendicular(up))
        amount = jnp.clip(norm(lean), 0.0, 1.0)
        flow = unit(lean[0] * du + lean[1] * dv, perpendicular(up))
        first = 0.5 * jnp.pi * amount
        start = jnp.cos(first) * up + jnp.sin(first) * flow
        start = unit(start + noise[0] * du + noise[1] * dv, up)
        # The plane in which the hair bends on: that of its normal and its start.
        side = start - jnp.dot(start, up) * up
        flow = unit(side, flow)
        angle = jnp.arctan2(jnp.dot(start, flow), jnp.dot(start, up))
        # Upright hair does not bend, or it would have to choose a side.
        turn = bend * jnp.minimum(2.0 * norm(side), 1.0)
        # A chord of an arc: as long as the sine says, in the direction of its middle.
        half = 0.5 * turn * along
        reach = length * along * jnp.sinc(half / jnp.pi)
        rise, out = reach * jnp.cos(angle + half), reach * jnp.sin(angle + half)
        root = scalp_point(scalp, uv)
        return root[None] + rise[:, None] * up[None] + out[:, None] * flow[None]

    return jax.vmap(one)(uv, lean, length, noise)


def curl_each(
    strands: Float[Array, "strands points 3"],
    radius: Float[Array, " strands"],
    key: PRNGKeyArray | UInt32[Array, " 2"],
    winding: Winding | None = None,
) -> Float[Array, "strands points 3"]:
    """Return strands with curls of single hairs, each at a random phase.

    Runs outside `jit`: straight hair compiles nothing.

    Args:
        strands: Strands, root first.
        radius: Radius of the curls of each, in metres; 0 leaves the strand.
        key: Randomness of the phases.
        winding: Of each strand's lock, from whose phase that of the hair deviates by
            `LOOSE`; None where hairs curl each for itself.
    """
    if not radius.any():
        return strands
    radius = radius.astype(strands.dtype)
    if winding is None:
        pitch = curl_pitch(radius)
        own = jax.random.uniform(key, radius.shape, radius.dtype, 0.0, 2.0 * jnp.pi)
        return curl_strands(strands, radius, pitch, own)
    own = LOOSE * jax.random.normal(key, radius.shape, radius.dtype)
    phase = winding.phase.astype(strands.dtype) + own[:, None]
    hand = winding.hand.astype(strands.dtype)
    pitch = curl_pitch(radius, winding.pitch.astype(strands.dtype))
    return wind_strands(strands, radius, pitch, phase, hand)


def curl_pitch(
    radius: Float[Array, " strands"],
    per_radius: Float[Array, " strands"] | float = PITCH,
) -> Float[Array, " strands"]:
    """Return how far hair of some curl runs in a turn, in metres.

    A hair keeps its slope whatever its curls' radius.

    Args:
        radius: Radius of the curls of each hair, in metres.
        per_radius: Length of a turn in radii. That of a helix of 45 degrees is 2 pi,
            about which hair is that curls by itself.
    """
    return jnp.maximum(per_radius * radius, LEAST_PITCH)


@jax.jit
def curl_strands(
    strands: Float[Array, "strands points 3"],
    radius: Float[Array, " strands"],
    pitch: Float[Array, " strands"],
    phase: Float[Array, " strands"],
) -> Float[Array, "strands points 3"]:
    r"""Return strands that wind about what they were: curls of single hairs.

    A hair becomes a helix of its radius about the strand, in its rotation-minimising
    frames; over the first turn the radius grows from 0, so roots do not move.
    Neighbours that share a phase curl together.

    A turn needs some 8 points of the strand: give strands enough of them before.

    Args:
        strands: Strands, root first.
        radius: Radius of the curls of each, in metres; 0 leaves the strand.
        pitch: Length of the strand that one turn takes, in metres, above 0.
        phase: Where about the strand the helix starts, in radians.
    """
    return wind_strands(strands, radius, pitch, phase[:, None], jnp.ones_like(phase))


@jax.jit
def wind_strands(
    strands: Float[Array, "strands points 3"],
    radius: Float[Array, " strands"],
    pitch: Float[Array, " strands"],
    phase: Float[Array, "strands _points"],
    hand: Float[Array, " strands"],
) -> Float[Array, "strands points 3"]:
    """Return strands with curls whose phase may drift along them, see `curl_strands`.

    Args:
        strands: Strands, root first.
        radius: Radius of the curls of each, in metres; 0 leaves the strand.
        pitch: Length of the strand that one turn takes, in metres, above 0.
        phase: Where about the strand the helix stands at each point, beside the turns
            that it has made, in radians; or one number a strand.
        hand: 1 for curls that wind to the right, -1 for those to the left.
    """

    def one(strand, radius, pitch, phase, hand):
        helix = helix_of(strand, radius, pitch)
        angle = phase + hand * helix.angle
        across = jnp.cos(angle)[:, None] * helix.frames.normal
        across = across + jnp.sin(angle)[:, None] * helix.frames.binormal
        return strand + helix.size[:, None] * across

    return jax.vmap(one)(strands, radius, pitch, phase, hand)


class Helix(NamedTuple):
    """What a hair winds about, and how far it has come there.

    Attributes:
        angle: By which it has turned, in radians.
        size: Its radius, in metres.
        frames: Of the strand that it winds about.
    """

    angle: Float[Array, " points"]
    size: Float[Array, " points"]
    frames: Frames


def helix_of(
    strand: Float[Array, "points 3"],
    radius: Float[Array, ""],
    pitch: Float[Array, ""],
) -> Helix:
    """Return the helix of curls of a radius and pitch, in metres, about a strand."""
    turn = arc_length(strand) / jnp.where(pitch > 0.0, pitch, 1.0)
    start = jnp.clip(turn, 0.0, 1.0)
    size = radius * start * start * (3.0 - 2.0 * start)
    up = jnp.array([0.0, 1.0, 0.0], strand.dtype)
    first = perpendicular(unit(strand[1] - strand[0], up))
    frames = rotation_minimising_frames(strand, first)
    return Helix(2.0 * jnp.pi * turn, size, frames)
