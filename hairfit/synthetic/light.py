"""How much light reaches a point inside hair: opacity shadow maps on voxels."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter, map_coordinates

CELL = 0.003
REACH = 0.27  # the volume is a cube of twice this side around the head
CENTRE = np.array([0.0, -0.03, -0.03])


class Volume(NamedTuple):
    """A quantity on voxels, in a frame whose first axis runs away from the light.

    Attributes:
        axes: The frame's axes, one a row.
        value: The quantity at the centres of the voxels.
    """

    axes: Float[np.ndarray, "3 3"]
    value: Float[np.ndarray, "n n n"]


class Matter(NamedTuple):
    """What stands in the way of light.

    Attributes:
        points: Samples of hair and head.
        area: Area that each of them blocks, in square metres.
    """

    points: Float[np.ndarray, "samples 3"]
    area: Float[np.ndarray, " samples"]


def opacity_volume(matter: Matter, to_light: Float[np.ndarray, " 3"]) -> Volume:
    r"""Return the opacity $\Omega$ between a far light and every voxel [Kim02, (6-1)].

    The area that blocks light, per area of a voxel's face, is summed away from the
    light: prefix sums of a histogram, the opacity shadow maps of section 6.2.1 with
    all their slices at once. A voxel counts half of what it holds itself.
    """
    axes = light_frame(to_light)
    number = int(2 * REACH / CELL)
    place = voxel_coordinates(matter.points, axes)
    index = np.clip(np.round(place), 0, number - 1).astype(np.int64)
    flat = np.ravel_multi_index(tuple(index), (number,) * 3)
    blocked = np.bincount(flat, matter.area / CELL**2, number**3)
    blocked = gaussian_filter(blocked.reshape((number,) * 3), 0.6)
    return Volume(axes, np.cumsum(blocked, 0) - 0.5 * blocked)


def transmittance(
    volume: Volume, p: Float[np.ndarray, "*points 3"]
) -> Float[np.ndarray, "*points"]:
    """Return the share of light that reaches points, from 0 (dark) to 1 (lit).

    A point does not shadow itself: it looks up one voxel towards the light.
    """
    flat = p.reshape(-1, 3) - CELL * volume.axes[0]
    at = voxel_coordinates(flat, volume.axes)
    opacity = map_coordinates(volume.value, at, order=1, mode="nearest")
    return np.exp(-opacity).reshape(p.shape[:-1])


def voxel_coordinates(
    p: Float[np.ndarray, "points 3"], axes: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "3 points"]:
    """Return where points lie in the voxels, counted in voxels."""
    return (((p - CENTRE) @ axes.T + REACH) / CELL - 0.5).T


def light_frame(to_light: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Return right-handed axes of which the first runs away from the light."""
    away = -np.asarray(to_light) / np.linalg.norm(to_light)
    side = np.cross(away, np.eye(3)[np.argmin(np.abs(away))])
    side /= np.linalg.norm(side)
    return np.stack([away, side, np.cross(away, side)])
