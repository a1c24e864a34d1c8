r"""Opacity shadow maps with gradients [Kim02, section 6.2.1].

All maps at once are a volume: hair is put into slabs between slices, and the opacity
$\Omega$ at a slice is the sum of all slabs before it.
"""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .splat import Form, Grid, Place, deposit, look_up
from .strand_samples import (
    DepthRange,
    depths_of,
    middles,
    place_in,
    sample_segments,
    samples_needed,
    see_segments,
)
from .view import View


@dataclass(frozen=True)
class OpacityConfig:
    """How finely opacity is stored.

    Attributes:
        slabs: Slabs along the depth; there is one slice more.
        samples: Samples a segment; by default as `samples_needed` says, which `jax.jit`
            does not allow.
        form: How samples are summed, see `splat.spread`.
    """

    slabs: int = 32
    samples: int | None = None
    form: Form = "auto"

    def __post_init__(self):
        if self.slabs < 2:
            raise ValueError(f"opacity needs at least 2 slabs, got {self.slabs}.")


class OpacityVolume(eqx.Module):
    r"""Opacity between a light and every place.

    Attributes:
        view: What the light sees.
        between: Depths of the first and the last slice.
        opacity: $\Omega$ at the slices of each pixel, row by row; 0 at the first slice.
        config: How finely.
    """

    view: View
    between: DepthRange
    opacity: Float[Array, " cells"]
    config: OpacityConfig = eqx.field(static=True)

    def at(self, points: Float[Array, "points 3"]) -> Float[Array, " points"]:
        r"""Return $\Omega$ at points, linear between slices and pixels [Kim02, (6-2)].

        Nearer than the first slice and beside the picture it is 0, beyond the last
        slice all that lies before. Matter counts half at its own place.
        """
        with jax.default_matmul_precision("highest"):
            seen = jax.vmap(self.view.see)(points)
        share = (seen.depth - self.between.near) / (
            self.between.far - self.between.near
        )
        layer = jnp.clip(share, 0.0, 1.0) * self.config.slabs
        beside = jnp.full_like(layer, -9.0)
        x, y = seen.pixel[:, 0] - 0.5, seen.pixel[:, 1] - 0.5
        place = Place(jnp.where(seen.scale > 0.0, x, beside), y, layer)
        grid = Grid(self.view.height, self.view.width, self.config.slabs + 1)
        return look_up(place, (self.opacity,), grid, self.config.form)[0]

    def transmittance(
        self, points: Float[Array, "points 3"], kappa: float | Float[Array, ""] = 1.0
    ) -> Float[Array, " points"]:
        r"""Return the share of light that reaches points, $e^{-\kappa\Omega}$.

        Args:
            points: Where, in metres.
            kappa: Opacity of hair for each of its width.
        """
        return jnp.exp(-kappa * self.at(points))


def opacity_volume(
    points: Float[Array, "strands knots 3"],
    width: Float[Array, "*widths"],
    view: View,
    *,
    between: DepthRange | None = None,
    config: OpacityConfig = OpacityConfig(),
) -> OpacityVolume:
    """Return the opacity that strands cast along the rays of a view.

    It is differentiable by all arrays. A sample's matter is spread over a pixel and a
    slab around it.

    Args:
        points: Strands, in metres.
        width: Width of hair, in metres: one for all, one a strand with shape
            (strands, 1), or one a knot.
        view: What the light sees.
        between: Depths of the first and the last slice; by default those of the hair.
        config: How finely.
    """
    number = config.samples or samples_needed(points, view)
    segments = see_segments(points, width, view)
    if between is None:
        between = depths_of(segments.ends[:, 2], config.slabs)
    grid = Grid(view.height, view.width, config.slabs)

    def row(share):
        samples = sample_segments(segments, share, number)
        return place_in(samples, between, grid), samples.area

    # A loop keeps XLA from computing the samples anew in each of the eight scatters.
    place, area = jax.lax.map(row, middles(number, points.dtype))
    place = Place(*(x.reshape(-1) for x in place))
    (volume,) = deposit(place, (area.reshape(-1),), grid, config.form)
    return OpacityVolume(view, between, sums_before(volume, config.slabs), config)


def sums_before(volume: Float[Array, " cells"], slabs: int) -> Float[Array, " slices"]:
    """Return at each slice of each pixel the sum of the slabs before it."""
    upto = jnp.triu(jnp.ones((slabs, slabs + 1), volume.dtype), 1)
    # As a product with a matrix: XLA's prefix sums on CPU are much slower.
    before = jnp.matmul(volume.reshape(-1, slabs), upto, precision="highest")
    return before.reshape(-1)
