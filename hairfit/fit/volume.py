"""What strands and the space around them disagree about, as differentiable losses.

Photographs see the outside of hair. Inside, the field of directions that was diffused
from them holds, and that no part of the hull is empty. Each loss is in units of its own
standard deviation and a mean over what it counts.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..host import on_device
from ..model.collide import DistanceField
from .evidence import Field, matrix_entries
from .grid import trilinear_many
from .hull import Hull
from .residuals import point_of, subdivided, tree_of_many

SIGMA_INSIDE_HEAD = 0.0005  # metres
CLEARANCE = 0.001  # metres between skin and hair
SIGMA_FIELD = 0.3  # radians: how far hair inside differs from the diffused field
SIGMA_GAP = 0.003  # metres
GAP = 0.003  # metres from a strand where the hull counts as empty
FARTHEST = 0.03  # metres beyond which an empty place draws nothing
DEEP = 0.003  # metres within the hull from which on there should be hair
PROBES, DRAWN = 20000, 4096  # places that are asked, and those used at most
FINER = 4  # points for one, where strands fill space
SHAPES = 64  # voxels along an edge of a grid: a multiple of so many


class HairVolume(eqx.Module):
    """What is known of the space around the hair.

    Attributes:
        head: The head's distance field.
        tensor: Entries xx, yy, zz, xy, xz, yz of $d d^T$ times how sure it is, on the
            same grid.
    """

    head: DistanceField
    tensor: Float[Array, "x y z 6"]


class Gaps(eqx.Module):
    """Empty places of the hull, and the strand's point that is nearest to each.

    Attributes:
        strand: Index of the strand.
        point: Index of its point.
        place: The place, in metres.
        share: Weight; all weights add up to the empty share of the places asked.
    """

    strand: Int[Array, " gaps"]
    point: Int[Array, " gaps"]
    place: Float[Array, "gaps 3"]
    share: Float[Array, " gaps"]


def hair_volume(hull: Hull, field: Field) -> HairVolume:
    """Return what the losses need of a hull and its field."""
    tensor = matrix_entries(field.direction.reshape(-1, 3))
    tensor = tensor.reshape(*hull.grid.shape, 6) * field.anisotropy[..., None]
    return HairVolume(head_field(hull), on_device(roomy(tensor), jnp.float32))


def roomy(values: Float[np.ndarray, "x y z *c"]) -> Float[np.ndarray, "_ _ _ *c"]:
    """Return values on a grid that goes on as at its border, to a shape of `room_for`.

    What is compiled for a shape then serves other hairstyles as well.
    """
    shape = values.shape[:3]
    rest = [(0, room - n) for n, room in zip(shape, room_for(shape), strict=True)]
    return np.pad(values, rest + [(0, 0)] * (values.ndim - 3), mode="edge")


def room_for(shape: tuple[int, ...]) -> tuple[int, int, int]:
    """Return a grid's shape, rounded up to few different ones."""
    x, y, z = (-(-n // SHAPES) * SHAPES for n in shape)
    return x, y, z


def inner_places(hull: Hull) -> Float[np.ndarray, "places 3"]:
    """Return the voxels' centres where hair should be: well within the hull."""
    return hull.grid.centres(hull.hair & (hull.distance < -DEEP))


def head_field(hull: Hull) -> DistanceField:
    """Return the head's distance field of a hull."""
    return DistanceField(
        on_device(hull.grid.origin, jnp.float32),
        on_device(hull.grid.spacing, jnp.float32),
        on_device(roomy(hull.head), jnp.float32),
    )


def head_loss(
    strands: Float[Array, "strands knots 3"], field: DistanceField
) -> Float[Array, ""]:
    """Return how deep strands run in the skin; their roots are free."""
    points = strands[:, 1:].reshape(-1, 3)
    distance = trilinear_many(
        field.distance[..., None], field.origin, field.cell, points
    )
    deep = jnp.maximum(CLEARANCE - distance, 0.0) / SIGMA_INSIDE_HEAD
    return jnp.mean(deep**2 / (1.0 + deep))


def field_loss(
    strands: Float[Array, "strands knots 3"], volume: HairVolume
) -> Float[Array, ""]:
    r"""Return how far strands are from the field: the mean of the angle's sine.

    A segment along $t$ has $\sin^2 = 1 - t^T T t / \operatorname{tr} T$; the trace of
    $T$, how sure the field is, is its weight.
    """
    along = (strands[:, 1:] - strands[:, :-1]).reshape(-1, 3)
    middle = (0.5 * (strands[:, 1:] + strands[:, :-1])).reshape(-1, 3)
    grid = volume.head
    t = trilinear_many(volume.tensor, grid.origin, grid.cell, middle)
    square = jnp.sum(along**2, axis=1) + 1e-12
    x, y, z = along[:, 0], along[:, 1], along[:, 2]
    entries = jnp.stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z], axis=1)
    sure = t[:, 0] + t[:, 1] + t[:, 2]
    beside = jnp.maximum(sure - jnp.sum(t * entries, axis=1) / square, 0.0)
    # Segments count by their length, as hair does.
    weight = jnp.sqrt(square)
    sine = jnp.sqrt(beside * sure + 1e-6) - 1e-3
    total = jnp.sum(weight * sure) + 1e-6
    return jnp.sum(weight * sine) / total / SIGMA_FIELD


def find_gaps(
    strands: Float[np.ndarray, "strands knots 3"],
    places: Float[np.ndarray, "places 3"],
    seed: int,
) -> Gaps:
    """Return what draws strands into places that they leave empty."""
    rng = np.random.default_rng(seed)
    count = min(PROBES, len(places))
    places = places[rng.choice(len(places), count, replace=False)]
    fine = subdivided(strands, FINER)
    knots = fine.shape[1]
    apart, nearest = map(
        np.asarray, tree_of_many(fine.reshape(-1, 3)).query(places, workers=-1)
    )
    empty = np.flatnonzero((apart > GAP) & (apart < FARTHEST))[:DRAWN]
    index = nearest[empty]
    point = point_of(index % knots, FINER)
    spare = DRAWN - len(empty)
    return Gaps(
        on_device(np.pad(index // knots, (0, spare)), jnp.int32),
        on_device(np.pad(point, (0, spare)), jnp.int32),
        on_device(np.pad(places[empty], ((0, spare), (0, 0))), jnp.float32),
        on_device(
            np.pad(np.full(len(empty), 1.0 / max(count, 1)), (0, spare)), jnp.float32
        ),
    )


def gap_loss(strands: Float[Array, "strands knots 3"], gaps: Gaps) -> Float[Array, ""]:
    """Return how far strands are from the empty places that they should fill."""
    away = strands[gaps.strand, gaps.point] - gaps.place
    metres = jnp.sqrt(jnp.sum(away**2, axis=1) + 1e-10)
    return jnp.sum(gaps.share * jnp.minimum(metres, FARTHEST)) / SIGMA_GAP
