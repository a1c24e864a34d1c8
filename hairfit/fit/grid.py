"""A regular grid of voxels and what is sampled on it."""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy import ndimage


class Voxels(NamedTuple):
    """The voxels of points, the first one for those outside the grid."""

    at: tuple[np.ndarray, ...]
    inside: Bool[np.ndarray, " points"]


@dataclasses.dataclass(frozen=True)
class Grid:
    """Cubic voxels in the world frame.

    Attributes:
        origin: Lower corner of the first voxel, in metres.
        spacing: Edge of a voxel, in metres.
        shape: Number of voxels along x, y and z.
    """

    origin: Float[np.ndarray, " 3"]
    spacing: float
    shape: tuple[int, int, int]

    @classmethod
    def around(
        cls, low: Float[np.ndarray, " 3"], high: Float[np.ndarray, " 3"], spacing: float
    ) -> "Grid":
        """Return the smallest grid that holds the box from `low` to `high`."""
        counts = np.maximum(np.ceil((high - low) / spacing), 1).astype(int)
        return cls(
            np.asarray(low, np.float64),
            spacing,
            (int(counts[0]), int(counts[1]), int(counts[2])),
        )

    def centres(self, mask: Bool[np.ndarray, "x y z"]) -> Float[np.ndarray, "voxels 3"]:
        """Return the centres of the voxels in `mask`, in metres."""
        return self.origin + (np.argwhere(mask) + 0.5) * self.spacing

    def voxel(self, points: Float[np.ndarray, "points 3"]) -> Int[np.ndarray, "_ 3"]:
        """Return the voxel that holds each point; it may lie outside the grid."""
        return np.floor((points - self.origin) / self.spacing).astype(int)

    def inside(self, voxels: Int[np.ndarray, "points 3"]) -> Bool[np.ndarray, " _"]:
        """Return which voxels lie in the grid."""
        return np.all((voxels >= 0) & (voxels < np.array(self.shape)), axis=1)

    def locate(self, points: Float[np.ndarray, "points 3"]) -> Voxels:
        """Return the voxels of points as indices, and which points are inside."""
        voxel = self.voxel(points)
        inside = self.inside(voxel)
        return Voxels(tuple(np.where(inside[:, None], voxel, 0).T), inside)


def in_coarser(
    fine: Grid, coarse: Grid, mask: Bool[np.ndarray, "x y z"]
) -> Bool[np.ndarray, "_ _ _"]:
    """Return the voxels of a grid whose centres lie in a mask on a coarser one.

    Beyond the coarser grid its border holds.
    """
    voxel = coarse.voxel(fine.centres(np.ones(fine.shape, bool)))
    voxel = np.clip(voxel, 0, np.array(coarse.shape) - 1)
    return mask[tuple(voxel.T)].reshape(fine.shape)


def nearest_in(
    mask: Bool[np.ndarray, "x y z"],
) -> tuple[Int[np.ndarray, "x y z"], ...]:
    """Return the indices of the voxel of a mask that is nearest to each voxel."""
    nearest = np.zeros((3, *mask.shape), np.int32)
    ndimage.distance_transform_edt(
        ~mask, return_distances=False, return_indices=True, indices=nearest
    )
    return tuple(np.asarray(axis) for axis in nearest)


def blurred(
    mask: Bool[np.ndarray, "x y z"], values: Float[np.ndarray, " voxels"], sigma: float
) -> Float[np.ndarray, "x y z"]:
    """Return values of the voxels of a mask, 0 elsewhere, blurred over the grid.

    Args:
        mask: The voxels.
        values: One for each of them.
        sigma: Standard deviation of the Gaussian, in voxels.
    """
    spread = np.zeros(mask.shape)
    spread[mask] = values
    return np.asarray(ndimage.gaussian_filter(spread, sigma))


def uphill(values: Float[np.ndarray, "x y z"]) -> Float[np.ndarray, "x y z 3"]:
    """Return the unit gradient at every voxel, 0 where there is none."""
    x, y, z = np.gradient(values)
    slope = np.stack([x, y, z], axis=-1)
    return slope / np.maximum(np.linalg.norm(slope, axis=-1, keepdims=True), 1e-12)


def neighbours(
    index: Int[np.ndarray, "voxels 3"], steps: Int[np.ndarray, "steps 3"]
) -> Int[np.ndarray, "voxels steps"]:
    """Return the row of the voxel one step away, the number of voxels for none.

    Args:
        index: The voxels.
        steps: By how many voxels along each axis, at most one.
    """
    row = np.full(tuple(index.max(axis=0) + 3), len(index))
    inner = index + 1
    row[tuple(inner.T)] = np.arange(len(index))
    return np.stack([row[tuple((inner + step).T)] for step in steps], axis=1)


def trilinear(
    field: Float[Array, "x y z channels"],
    origin: Float[Array, " 3"],
    spacing: Float[Array, ""],
    point: Float[Array, " 3"],
) -> Float[Array, " channels"]:
    """Return the field at a point in metres; outside the grid its border holds."""
    index, weight = corners(field.shape[:3], origin, spacing, point)
    return weight @ field[index[:, 0], index[:, 1], index[:, 2]]


def corners(
    shape: tuple[int, ...],
    origin: Float[Array, " 3"],
    spacing: Float[Array, ""],
    point: Float[Array, " 3"],
) -> tuple[Int[Array, "8 3"], Float[Array, " 8"]]:
    """Return the eight voxels around a point, and their trilinear weights."""
    limit = jnp.array(shape, jnp.int32) - 1
    at = jnp.clip((point - origin) / spacing - 0.5, 0.0, limit.astype(point.dtype))
    low = jnp.clip(jnp.floor(at).astype(jnp.int32), 0, jnp.maximum(limit - 1, 0))
    share = at - low.astype(point.dtype)
    both = (0, 1)
    steps = jnp.array([[i, j, k] for i in both for j in both for k in both], jnp.int32)
    index = jnp.minimum(low[None, :] + steps, limit[None, :])
    weight = jnp.prod(jnp.where(steps == 1, share[None, :], 1.0 - share[None, :]), 1)
    return index, weight


trilinear_many = jax.vmap(trilinear, (None, None, None, 0))
