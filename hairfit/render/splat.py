r"""Samples put into a volume of pixels and layers, and looked up there.

One primitive serves twice: seen from a light the volume is an opacity shadow map
[Kim02, section 6.2.1], seen from a camera soft visibility, the differentiable form of
the visibility bins of section 6.3.1.

`deposit` (`spread` with a gradient) and `look_up` (`pick` with one) are each other's
transpose, with tents for weights. Cells run
over the rows of the picture, its columns, and the layers of each pixel. A volume of
several channels is a tuple of arrays: XLA on CPU composes them four times as fast as
one array of all.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from itertools import product
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

Form = Literal["scatter", "gather", "auto"]
# Releases of jaxlib whose float32 scatter-add on NVIDIA is a loop of compare-and-swap,
# hundreds of times slower [openxla/xla #46225].
SLOW_SCATTER = ((0, 10, 2), (0, 11, 0))
# Samples are read in so many parts, one after the other.
PARTS = 8


@dataclass(frozen=True)
class Grid:
    """Numbers of cells of a volume.

    Attributes:
        height: Rows of the picture.
        width: Columns of the picture.
        layers: Layers along the depth.
        blur: Width over which a sample goes from one pixel to the next, in pixels: 1
            shares it between both always, as a tent does; less, near their border.
    """

    height: int
    width: int
    layers: int
    blur: float = 1.0

    @property
    def cells(self) -> int:
        """The number of all cells."""
        return self.height * self.width * self.layers


class Place(NamedTuple):
    """Where samples are in a volume, in cells; the first centre is at 0."""

    column: Float[Array, " samples"]
    row: Float[Array, " samples"]
    layer: Float[Array, " samples"]


class Axis(NamedTuple):
    """Weights of one of the two cells beside each sample, along one axis.

    Attributes:
        index: The cell, or the nearest one where it lies outside the volume.
        weight: Its weight, 0 outside.
        slope: Change of the weight with the place.
    """

    index: Int[Array, " samples"]
    weight: Float[Array, " samples"]
    slope: Float[Array, " samples"]


class Tap(NamedTuple):
    """Weights of one of the eight cells around each sample.

    Attributes:
        index: The cell in the flat volume.
        weight: Its weight.
        slope: Change of the weight with the place.
    """

    index: Int[Array, " samples"]
    weight: Float[Array, " samples"]
    slope: Place


def fastest_form() -> Form:
    """Return the form of sums that is the faster one on the device in use."""
    release = tuple(int(n) for n in re.findall(r"\d+", version("jaxlib"))[:3])
    slow = SLOW_SCATTER[0] <= release <= SLOW_SCATTER[1]
    return "gather" if slow and jax.default_backend() == "gpu" else "scatter"


def spread(
    place: Place,
    values: tuple[Float[Array, " samples"], ...],
    grid: Grid,
    form: Form = "auto",
) -> tuple[Float[Array, " cells"], ...]:
    """Return a volume in which the values of samples are spread over eight cells each.

    Args:
        place: Where the samples are. What lies more than a cell outside counts nowhere.
        values: What each sample adds, for each channel.
        grid: The volume.
        form: `"scatter"` adds sample by sample; `"gather"` sorts the samples and has
            no scatter. They differ by rounding only.
    """
    if (fastest_form() if form == "auto" else form) == "gather":
        return gathered(place, values, grid)
    volume = [jnp.zeros(grid.cells, place.column.dtype) for _ in values]
    for tap in taps(place, grid):
        for i, value in enumerate(values):
            spot = volume[i].at[tap.index]
            volume[i] = spot.add(tap.weight * value, mode="promise_in_bounds")
    return tuple(volume)


def pick(
    place: Place,
    volume: tuple[Float[Array, " cells"], ...],
    grid: Grid,
    form: Form = "auto",
) -> tuple[Float[Array, " samples"], ...]:
    """Return what a volume holds at places, linear between the centres of cells.

    Args:
        place: Where. Outside of the volume there is nothing.
        volume: The channels of the volume.
        grid: Its numbers of cells.
        form: How its gradient is summed, see `spread`.
    """
    return by_parts(lambda p, _: read(p, volume, grid), place, ())


def read(
    place: Place, volume: tuple[Float[Array, " cells"], ...], grid: Grid
) -> tuple[Float[Array, " samples"], ...]:
    """Return what `pick` does, for all samples at once."""
    found = [jnp.zeros_like(place.column) for _ in volume]
    for tap in taps(place, grid):
        for i, channel in enumerate(volume):
            found[i] = found[i] + tap.weight * held(channel, tap)
    return tuple(found)


def place_gradient(
    place: Place,
    values: tuple[Float[Array, " samples"], ...],
    volume: tuple[Float[Array, " cells"], ...],
    grid: Grid,
) -> Place:
    """Return how the product of a volume with deposited values changes with places."""
    total = [jnp.zeros_like(place.column) for _ in range(3)]
    for tap in taps(place, grid):
        both = zip(values, volume, strict=True)
        here = sum(value * held(channel, tap) for value, channel in both)
        for i, slope in enumerate(tap.slope):
            total[i] = total[i] + slope * here
    return Place(*total)


def held(channel: Float[Array, " cells"], tap: Tap) -> Float[Array, " samples"]:
    """Return what the cells of a tap hold."""
    return channel.at[tap.index].get(mode="promise_in_bounds")


def by_parts(function, place: Place, values: tuple[Float[Array, " samples"], ...]):
    """Return a function's results for all samples, worked out by parts.

    The loop bounds memory. More important, XLA on CPU would compute a volume's cells
    anew in each of the many gathers; what a loop reads is computed before.

    Args:
        function: Takes places and values of samples, and returns a tree of arrays.
        place: Where the samples are.
        values: Values of them.
    """
    number = place.column.size
    rest = -number % PARTS
    outside = Place(*(jnp.pad(x, (0, rest), constant_values=-9.0) for x in place))
    padded = outside, tuple(jnp.pad(x, (0, rest)) for x in values)
    parts = jax.tree.map(lambda x: x.reshape(PARTS, -1), padded)
    found = jax.lax.map(lambda part: function(*part), parts)
    return jax.tree.map(lambda x: x.reshape(-1)[:number], found)


def deposit_forward(place, values, grid, form):
    """Return the volume, and what its gradient needs: no more than the samples."""
    return deposit(place, values, grid, form), (place, values)


def deposit_backward(grid, form, samples, volume):
    """Return gradients by the places and values of samples: only gathers, no sums."""

    def part(place, values):
        by_place = place_gradient(place, values, volume, grid)
        return by_place, read(place, volume, grid)

    return by_parts(part, *samples)


def look_up_forward(place, volume, grid, form):
    """Return what was found, and what its gradient needs."""
    return look_up(place, volume, grid, form), (place, volume)


def look_up_backward(grid, form, kept, values):
    """Return gradients by the places of samples and by the volume."""
    place, volume = kept
    by_place = by_parts(
        lambda p, v: place_gradient(p, v, volume, grid), place, tuple(values)
    )
    return by_place, deposit(place, tuple(values), grid, form)


deposit = jax.custom_vjp(spread, nondiff_argnums=(2, 3))
look_up = jax.custom_vjp(pick, nondiff_argnums=(2, 3))
deposit.defvjp(deposit_forward, deposit_backward)
look_up.defvjp(look_up_forward, look_up_backward)


def taps(place: Place, grid: Grid) -> Iterator[Tap]:
    """Yield the eight cells around each sample, the layers of a pixel in turn."""
    columns = both_sides(place.column, grid.width, grid.blur)
    rows = both_sides(place.row, grid.height, grid.blur)
    layers = both_sides(place.layer, grid.layers)
    for row, column, layer in product(rows, columns, layers):
        index = (row.index * grid.width + column.index) * grid.layers + layer.index
        yield Tap(
            index,
            row.weight * column.weight * layer.weight,
            Place(
                row.weight * column.slope * layer.weight,
                row.slope * column.weight * layer.weight,
                row.weight * column.weight * layer.slope,
            ),
        )


def lower_cell(x: Float[Array, " samples"], count: int) -> Int[Array, " samples"]:
    """Return the cell before each place; -2 or `count` if it has none, nor one after.

    Clipping comes first, as integers cannot hold every float.
    """
    return jnp.floor(jnp.clip(x, -2.0, count)).astype(jnp.int32)


def both_sides(
    x: Float[Array, " samples"], count: int, blur: float = 1.0
) -> tuple[Axis, Axis]:
    """Return the cells before and after each place along one axis."""
    low = lower_cell(x, count)
    ramp = (x - low.astype(x.dtype) - 0.5) / blur + 0.5
    share = jnp.clip(ramp, 0.0, 1.0)
    steep = jnp.where((ramp >= 0.0) & (ramp <= 1.0), 1.0 / blur, 0.0)

    def side(index, weight, slope):
        inside = (index >= 0) & (index < count)
        return Axis(
            jnp.clip(index, 0, count - 1),
            jnp.where(inside, weight, 0.0),
            jnp.where(inside, slope, 0.0),
        )

    return side(low, 1.0 - share, -steep), side(low + 1, share, steep)


def gathered(
    place: Place,
    values: tuple[Float[Array, " samples"], ...],
    grid: Grid,
) -> tuple[Float[Array, " cells"], ...]:
    """Return what `spread` does, by sums over sorted samples.

    Samples are sorted by the cell before them, of a grid with a rim. Sums over the runs
    of equal cells are a scan that starts anew at each run: differences of sums over all
    samples would lose what a cell holds to rounding.
    """
    if place.column.size == 0:
        return tuple(jnp.zeros(grid.cells, place.column.dtype) for _ in values)
    size = grid.height, grid.width, grid.layers
    rim = tuple(n + 3 for n in size)
    counts = grid.width, grid.height, grid.layers
    x, y, z = (lower_cell(u, n) + 2 for u, n in zip(place, counts, strict=True))
    key = (y * rim[1] + x) * rim[2] + z
    order = jnp.argsort(key)
    key, place = key[order], Place(*(u[order] for u in place))
    values = tuple(value[order] for value in values)
    added = [tap.weight * value for tap in taps(place, grid) for value in values]
    sums = iter(run_sums(jnp.stack(added), key))
    after = jnp.searchsorted(key, jnp.arange(math.prod(rim) + 1, dtype=key.dtype))
    first, after = after[:-1].reshape(rim), after[1:].reshape(rim)
    volume = [jnp.zeros(size, place.column.dtype) for _ in values]
    for offset in product((0, 1), repeat=3):
        # Runs of the cell before, by the offset, add to a cell by this tap.
        near = tuple(slice(2 - d, 2 - d + n) for d, n in zip(offset, size, strict=True))
        filled, last = after[near] > first[near], jnp.maximum(after[near] - 1, 0)
        for i in range(len(values)):
            volume[i] = volume[i] + jnp.where(filled, next(sums)[last], 0.0)
    return tuple(channel.reshape(-1) for channel in volume)


def run_sums(
    x: Float[Array, "channels samples"], key: Int[Array, " samples"]
) -> Float[Array, "channels samples"]:
    """Return the sums of each run of equal keys up to each sample."""
    starts = jnp.concatenate([jnp.ones(1, bool), key[1:] != key[:-1]])

    def join(a, b):
        return jnp.where(b[1], b[0], a[0] + b[0]), a[1] | b[1]

    return jax.lax.associative_scan(join, (x, starts[None]), axis=1)[0]
