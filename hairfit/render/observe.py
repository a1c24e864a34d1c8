r"""What a camera measures of hair, with gradients.

Visibility is soft: hair's opacity $\Omega$ is put into layers of depth, and each layer
is seen through those before it, $T_l = \exp(-\sum_{k<l} \Omega_k)$. These are the
visibility bins of section 6.3.1 [Kim02], made differentiable.
"""

from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .splat import Form, Grid, Place, deposit, look_up
from .strand_samples import (
    DepthRange,
    Samples,
    between_ends,
    depths_of,
    middles,
    pairs,
    place_in,
    sample_segments,
    samples_needed,
    see_segments,
)
from .view import View

# Less coverage than this is none: there depth is 0.
FAINTEST = 1e-6
# Hair as wide as a pixel would have no end of opacity.
WIDEST = 0.95


@dataclass(frozen=True)
class ObserveConfig:
    """How finely hair is observed.

    Attributes:
        layers: Layers of depth; hair hides hair one or two layers behind it.
        samples: Samples a segment; by default as `samples_needed` says, which `jax.jit`
            does not allow.
        form: How samples are summed, see `splat.spread`.
        softness: Depth in metres over which hair fades beneath a head's surface.
        blur: Width in pixels over which hair goes from one pixel to the next, see
            `splat.Grid`.
    """

    layers: int = 16
    samples: int | None = None
    form: Form = "auto"
    softness: float = 0.005
    blur: float = 1.0

    def __post_init__(self):
        if self.layers < 2:
            raise ValueError(f"visibility needs at least 2 layers, got {self.layers}.")
        if not 0.0 < self.blur <= 1.0:
            raise ValueError(f"`blur` must be above 0 and at most 1, got {self.blur}.")


class Appearance(eqx.Module):
    """What strands look like.

    Attributes:
        width: Width of hair, in metres: one for all, one a strand with shape
            (strands, 1), or one a knot.
        radiance: Light that each knot sends to the eye, linear RGB, see `lights.shade`.
    """

    width: Float[Array, "*widths"]
    radiance: Float[Array, "strands knots 3"]


class Observation(NamedTuple):
    r"""What is seen in each pixel.

    Attributes:
        coverage: Share of the pixel that hair covers, $1 - \exp(-\sum\Omega)$.
        orientation: Mean of $(\cos 2a, \sin 2a)$ of the visible hair, times coverage;
            $a$ is the angle in the picture from +x towards +y, half of what `arctan2`
            says. Its length is below the coverage where hair crosses.
        depth: Mean depth of the visible hair, in metres; 0 where there is none.
        colour: Light of the visible hair, linear RGB, times coverage.
    """

    coverage: Float[Array, "height width"]
    orientation: Float[Array, "height width 2"]
    depth: Float[Array, "height width"]
    colour: Float[Array, "height width 3"]


def observe(
    points: Float[Array, "strands knots 3"],
    view: View,
    appearance: Appearance,
    *,
    head_depth: Float[Array, "height width"] | None = None,
    between: DepthRange | None = None,
    config: ObserveConfig = ObserveConfig(),
) -> Observation:
    """Return what a camera measures of hair.

    It is differentiable by all arrays. Memory grows with segments and with pixels, not
    with their product.

    Args:
        points: Strands, in metres.
        view: The camera's view.
        appearance: Width and light of the strands.
        head_depth: Depth of what hides hair, in metres, infinite where nothing does.
        between: Depths between which the layers lie; by default those of the hair.
        config: How finely.
    """
    number = config.samples or samples_needed(points, view)
    segments = see_segments(points, appearance.width, view)
    if between is None:
        between = depths_of(segments.ends[:, 2], config.layers)
    grid = Grid(view.height, view.width, config.layers, config.blur)
    colour = pairs(jnp.moveaxis(appearance.radiance, -1, 0))

    def row(share):
        samples = sample_segments(segments, share, number)
        area = samples.area * solid_share(samples.across)
        if head_depth is not None:
            area = area * in_front(samples, head_depth, between, config)
        deep = (samples.depth - between.near) / (between.far - between.near)
        features = [*segments.turn, deep, *between_ends(colour, share)]
        return place_in(samples, between, grid), [area, *(area * x for x in features)]

    # A loop keeps XLA from computing the samples anew in each of the many scatters.
    place, values = jax.lax.map(row, middles(number, points.dtype))
    place = Place(*(x.reshape(-1) for x in place))
    volume = deposit(place, tuple(x.reshape(-1) for x in values), grid, config.form)
    opacity, *sums = (channel.reshape(-1, grid.layers) for channel in volume)
    coverage, mean = compose(opacity, sums)
    covered = coverage > FAINTEST
    share = mean[2] / jnp.where(covered, coverage, 1.0)
    depth = between.near + (between.far - between.near) * share
    size = view.height, view.width
    return Observation(
        coverage.reshape(size),
        jnp.stack(mean[:2], -1).reshape(*size, 2),
        jnp.where(covered, depth, 0.0).reshape(size),
        jnp.stack(mean[3:], -1).reshape(*size, 3),
    )


class Composed(NamedTuple):
    """A volume seen through: coverage, and the sums of features times visibility."""

    coverage: Float[Array, " pixels"]
    features: list[Float[Array, " pixels"]]


def compose(
    opacity: Float[Array, "pixels layers"], sums: list[Float[Array, "pixels layers"]]
) -> Composed:
    r"""Return layers seen one through the other, the first one in front.

    A layer's feature is $\sum\Omega f / \sum\Omega$ and its weight $T_l (1 -
    e^{-\Omega_l})$; their product needs no division by an opacity that may be 0.

    Args:
        opacity: Opacity of each layer.
        sums: For each feature, opacity times feature.
    """
    layers = opacity.shape[1]
    before = jnp.triu(jnp.ones((layers, layers), opacity.dtype), 1)
    # As a product with a matrix: XLA's prefix sums on CPU are much slower.
    hidden = jnp.matmul(opacity, before, precision="highest")
    weight = jnp.exp(-hidden) * seen_share(opacity)
    coverage = -jnp.expm1(-jnp.sum(opacity, axis=1))
    return Composed(coverage, [jnp.sum(weight * x, axis=1) for x in sums])


def seen_share(opacity: Float[Array, "*cells"]) -> Float[Array, "*cells"]:
    r"""Return $(1 - e^{-\Omega}) / \Omega$, 1 where there is nothing."""
    # Below the threshold the series is exact to rounding, in float32 and nearly in 64.
    thick = opacity > 1e-5
    safe = jnp.where(thick, opacity, 1.0)
    return jnp.where(thick, -jnp.expm1(-safe) / safe, 1.0 - 0.5 * opacity)


def solid_share(across: Float[Array, " samples"]) -> Float[Array, " samples"]:
    r"""Return how much more opacity than area hair has that hides what is behind it.

    Where hair $w$ pixels wide crosses a pixel, $1 - e^{-\Omega} = w$ is to be hidden.

    Args:
        across: Width of hair, in pixels.
    """
    width = jnp.clip(across, 1e-4, WIDEST)
    return -jnp.log1p(-width) / width


def in_front(
    samples: Samples,
    head_depth: Float[Array, "height width"],
    between: DepthRange,
    config: ObserveConfig,
) -> Float[Array, " samples"]:
    """Return 1 for samples outside of a head, fading to 0 beneath its surface.

    Args:
        samples: Samples of strands.
        head_depth: Depth of the surface, in metres, infinite where there is none.
        between: Depths of hair.
        config: How far the fading reaches.
    """
    height, width = head_depth.shape
    # Infinity has no linear interpolation: beyond all hair is far enough.
    surface = jnp.minimum(head_depth, between.far + config.softness)
    x = jnp.clip(samples.pixel[0] - 0.5, 0.0, width - 1.0)
    y = jnp.clip(samples.pixel[1] - 0.5, 0.0, height - 1.0)
    place = Place(x, y, jnp.zeros_like(x))
    grid = Grid(height, width, 1)
    (depth,) = look_up(place, (surface.reshape(-1),), grid, config.form)
    share = jnp.clip(1.0 - (samples.depth - depth) / config.softness, 0.0, 1.0)
    return share**2 * (3.0 - 2.0 * share)
