"""Lights, and hair that they light, with gradients."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..model import vector
from .camera import Camera
from .opacity_volume import OpacityConfig, opacity_volume
from .shading import Fibre, kajiya_kay
from .strand_samples import DepthRange
from .view import View, camera_view

# A lamp in the hair sees it as from this many radii of the hair.
CLOSEST = 1.05
# Empty pixels at each side of a light's picture.
MARGIN = 2.0


class Arriving(NamedTuple):
    """Light at a place.

    Attributes:
        to_light: Unit vector towards the light.
        radiance: How much arrives if nothing is in the way, linear RGB.
    """

    to_light: Float[Array, " 3"]
    radiance: Float[Array, " 3"]


class LightView(NamedTuple):
    """What a light sees, and between which depths."""

    view: View
    between: DepthRange


@runtime_checkable
class Light(Protocol):
    """What shines on hair."""

    def view(self, points: Float[Array, "strands knots 3"], size: int) -> LightView:
        """Return a view of `size` pixels squared that holds all points."""
        ...

    def arriving(self, p: Float[Array, " 3"]) -> Arriving:
        """Return the light at a point where nothing is in the way."""
        ...


class Ball(NamedTuple):
    """A ball around hair, in metres."""

    centre: Float[Array, " 3"]
    radius: Float[Array, ""]


class DistantLight(eqx.Module):
    """A light so far away that its rays are parallel.

    Attributes:
        to_light: Direction towards the light; any length but 0.
        colour: Its radiance, linear RGB.
    """

    to_light: Float[Array, " 3"]
    colour: Float[Array, " 3"]

    def view(self, points: Float[Array, "strands knots 3"], size: int) -> LightView:
        """Return a view of `size` pixels squared that holds all points.

        It holds a ball around the points, so that its scale and its depths stay the
        same while the light goes around them.
        """
        ball = ball_around(points)
        axes = axes_away(-unit(self.to_light))
        scale = (0.5 * size - MARGIN) / ball.radius
        turned = precise(axes, ball.centre)
        rows = jnp.concatenate([scale * axes[:2], axes[2:], jnp.zeros_like(axes[:1])])
        shift = 0.5 * size - scale * turned[:2]
        last = jnp.concatenate([shift, jnp.array([0.0, 1.0], shift.dtype)])
        matrix = jnp.concatenate([rows, last[:, None]], axis=1)
        between = DepthRange(turned[2] - ball.radius, turned[2] + ball.radius)
        return LightView(View(matrix, scale, size, size), between)

    def arriving(self, p: Float[Array, " 3"]) -> Arriving:
        """Return the light, which is the same everywhere."""
        return Arriving(unit(self.to_light), self.colour)


class PointLight(eqx.Module):
    """A lamp at a place; its light falls with the square of the distance.

    Attributes:
        position: Where it is, in metres.
        intensity: Its radiance at a distance of 1 m, linear RGB.
    """

    position: Float[Array, " 3"]
    intensity: Float[Array, " 3"]

    def view(self, points: Float[Array, "strands knots 3"], size: int) -> LightView:
        """Return a view of `size` pixels squared that holds all points.

        A lamp inside the ball around the points sees only what lies on the side of the
        ball's centre; the rest is lit without shadow.
        """
        ball = ball_around(points)
        way = ball.centre - self.position
        axes = axes_away(unit(way))
        distance = jnp.maximum(vector.norm(way), CLOSEST * ball.radius)
        # The cone that touches the ball.
        focal = (0.5 * size - MARGIN) * jnp.sqrt((distance / ball.radius) ** 2 - 1.0)
        zero, one = jnp.zeros_like(focal), jnp.ones_like(focal)
        half = 0.5 * size * one
        K = jnp.stack([focal, zero, half, zero, focal, half, zero, zero, one])
        shift = -precise(axes, self.position)
        pose = jnp.concatenate([axes, shift[:, None]], axis=1)
        pose = jnp.concatenate([pose, jnp.eye(4, dtype=pose.dtype)[3:]])
        between = DepthRange(distance - ball.radius, distance + ball.radius)
        view = camera_view(Camera(K.reshape(3, 3), pose, size, size))
        return LightView(view, between)

    def arriving(self, p: Float[Array, " 3"]) -> Arriving:
        """Return the light at a point where nothing is in the way."""
        way = self.position - p
        square = jnp.maximum(jnp.sum(way**2), 1e-6)
        return Arriving(unit(way), self.intensity / square)


@dataclass(frozen=True)
class ShadowConfig:
    """How finely shadows are worked out.

    Attributes:
        size: Width and height of each light's picture, in pixels.
        kappa: Opacity of hair for each of its width.
        opacity: Slabs, samples and form of the opacity volumes.
    """

    size: int = 128
    kappa: float = 1.0
    opacity: OpacityConfig = OpacityConfig()


def shade(
    points: Float[Array, "strands knots 3"],
    width: Float[Array, "*widths"],
    eye: Float[Array, " 3"],
    fibre: Fibre,
    lights: Sequence[Light],
    *,
    ambient: Float[Array, " 3"],
    config: ShadowConfig = ShadowConfig(),
) -> Float[Array, "strands knots 3"]:
    r"""Return the light that each knot sends to the eye [Kim02, (6-3) of 6.2.1].

    $\Psi = \Psi_a + \sum \tau (\Psi_d + \Psi_s)$ over the lights, with the terms of
    `kajiya_kay` and the transmittance $\tau$ through the hair before each knot.

    Args:
        points: Strands, in metres.
        width: Width of hair, in metres, as for `opacity_volume`.
        eye: Where the eye is, in metres.
        fibre: What hair is made of.
        lights: What shines on it.
        ambient: Light from all directions, linear RGB.
        config: How finely shadows are worked out.
    """
    flat = points.reshape(-1, 3)
    tangent = knot_tangents(points).reshape(-1, 3)
    total = jnp.broadcast_to((fibre.ambient * ambient)[None], flat.shape)
    bare = eqx.tree_at(lambda f: f.ambient, fibre, jnp.zeros_like(fibre.ambient))

    def unshadowed(p, tangent, light):
        arriving = light.arriving(p)
        sent = kajiya_kay(tangent, arriving.to_light, unit(eye - p), bare)
        return sent * arriving.radiance

    for light in lights:
        view, between = light.view(points, config.size)
        volume = opacity_volume(
            points, width, view, between=between, config=config.opacity
        )
        tau = volume.transmittance(flat, config.kappa)
        sent = jax.vmap(unshadowed, (0, 0, None))(flat, tangent, light)
        total = total + tau[:, None] * sent
    return total.reshape(points.shape)


def knot_tangents(
    points: Float[Array, "strands knots 3"],
) -> Float[Array, "strands knots 3"]:
    """Return unit tangents by central differences; 0 where a strand stands still."""
    ends = jnp.concatenate([points[:, :1], points, points[:, -1:]], axis=1)
    return jax.vmap(jax.vmap(unit))(ends[:, 2:] - ends[:, :-2])


def unit(v: Float[Array, " 3"]) -> Float[Array, " 3"]:
    """Return a vector of length 1 along another; 0 for 0."""
    return vector.unit(v, jnp.zeros_like(v))


def precise(matrix: Float[Array, "3 3"], v: Float[Array, " 3"]) -> Float[Array, " 3"]:
    """Return a product with a matrix, on GPU as exact as on CPU."""
    return jnp.matmul(matrix, v, precision="highest")


def axes_away(away: Float[Array, " 3"]) -> Float[Array, "3 3"]:
    """Return right-handed axes of which the last is given, of length 1."""
    least = jnp.eye(3, dtype=away.dtype)[jnp.argmin(jnp.abs(away))]
    right = unit(jnp.cross(away, least))
    return jnp.stack([right, jnp.cross(away, right), away])


def ball_around(points: Float[Array, "strands knots 3"]) -> Ball:
    """Return a ball that holds all points, without gradient.

    How a light's picture is cut into pixels must not count as an effect of the hair.
    """
    flat = jax.lax.stop_gradient(points.reshape(-1, 3))
    centre = 0.5 * (flat.min(0) + flat.max(0))
    square = jnp.sum((flat - centre[None]) ** 2, axis=1).max()
    return Ball(centre, jnp.sqrt(jnp.maximum(square, 1e-12)))
