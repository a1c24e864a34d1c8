"""How much light reaches a point inside hair: opacity shadow maps on voxels."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter, map_coordinates


class Matter(NamedTuple):
    """What stands in the way of light.

    Attributes:
        points: Samples of hair and head.
        area: Area that each of them blocks, in square metres.
    """

    points: Float[np.ndarray, "samples 3"]
    area: Float[np.ndarray, " samples"]


class Box(NamedTuple):
    """The cube that voxels fill.

    Attributes:
        centre: Its centre.
        reach: Half of its side, in metres.
        cell: Side of a voxel, in metres.
    """

    centre: Float[np.ndarray, " 3"]
    reach: float
    cell: float


class Volume(NamedTuple):
    """Opacity towards one light, in a frame whose first axis runs away from it.

    Attributes:
        box: Where it is; the frame's axes are its axes.
        axes: The frame's axes, one a row.
        opacity: Opacity between the light and the centre of each voxel.
    """

    box: Box
    axes: Float[np.ndarray, "3 3"]
    opacity: Float[np.ndarray, "n n n"]


def opacity_volume(
    matter: Matter, to_light: Float[np.ndarray, " 3"], box: Box
) -> Volume:
    r"""Return the opacity $\Omega$ between a far light and every voxel [Kim02, (6-1)].

    The area that blocks light, per area of a voxel's face, is summed away from the
    light: prefix sums of a histogram, the opacity shadow maps of section 6.2.1 with
    all their slices at once. A voxel counts half of what it holds itself.
    """
    axes = light_frame(to_light)
    number = int(2 * box.reach / box.cell)
    place = voxel_coordinates(matter.points, box, axes)
    index = np.clip(np.round(place), 0, number - 1).astype(np.int64)
    flat = np.ravel_multi_index(tuple(index), (number,) * 3)
    blocked = np.bincount(flat, matter.area / box.cell**2, number**3)
    blocked = gaussian_filter(blocked.reshape((number,) * 3), 0.6)
    return Volume(box, axes, np.cumsum(blocked, 0) - 0.5 * blocked)


def transmittance(
    volume: Volume, p: Float[np.ndarray, "*points 3"]
) -> Float[np.ndarray, "*points"]:
    """Return the share of light that reaches points, from 0 (dark) to 1 (lit).

    A point does not shadow itself: it looks up one voxel towards the light.
    """
    flat = p.reshape(-1, 3) - volume.box.cell * volume.axes[0]
    at = voxel_coordinates(flat, volume.box, volume.axes)
    opacity = map_coordinates(volume.opacity, at, order=1, mode="nearest")
    return np.exp(-opacity).reshape(p.shape[:-1])


def voxel_coordinates(
    p: Float[np.ndarray, "points 3"], box: Box, axes: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "3 points"]:
    """Return where points lie in the voxels, counted in voxels."""
    # Coordinates as rows: many times faster than one small product a point.
    return (axes @ (p - box.centre).T + box.reach) / box.cell - 0.5


def light_frame(to_light: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Return right-handed axes of which the first runs away from the light."""
    away = -np.asarray(to_light, np.float64) / np.linalg.norm(to_light)
    side = np.cross(away, np.eye(3)[np.argmin(np.abs(away))])
    side /= np.linalg.norm(side)
    return np.stack([away, side, np.cross(away, side)])


def hair_matter(points: Float[np.ndarray, "strands knots 3"], width: float) -> Matter:
    """Return strands of a width as matter: one sample a segment."""
    steps = np.diff(points, axis=1)
    middle = points[:, :-1] + 0.5 * steps
    area = np.linalg.norm(steps, axis=2) * width
    return Matter(middle.reshape(-1, 3), area.reshape(-1))


def together(*parts: Matter) -> Matter:
    """Return all matter as one."""
    return Matter(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.area for part in parts]),
    )
