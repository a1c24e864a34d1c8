"""Photographs made wrong on purpose: one view of a capture at a time."""

import dataclasses
from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation

from hairfit.capture import View
from hairfit.capture.cranium import find_cranium
from hairfit.capture.photos import linear_from_srgb, srgb_from_linear
from hairfit.render import Camera
from hairfit.types import Mesh

TURN_DEG = 2.0
SHAKE = 7.0  # pixels
ACROSS = np.radians(20.0)  # the way in which one photograph is shaken
NEXT = np.radians(137.5)  # by which the next one is shaken another way
BLOB = 0.25  # radius of a blob, as a share of the square root of the hair's area


def turned(view: View, axis: list[float]) -> View:
    """Return a view whose camera is turned by 2 degrees where it stands."""
    turn = np.eye(4)
    turn[:3, :3] = rotation(axis)
    return posed(view, turn @ pose(view))


def orbited(view: View, head: Mesh) -> View:
    """Return a view whose camera is turned by 2 degrees about the head, upright."""
    centre = find_cranium(head).centre
    turn = np.eye(4)
    turn[:3, :3] = rotation([0.0, 1.0, 0.0])
    turn[:3, 3] = centre - turn[:3, :3] @ centre
    return posed(view, pose(view) @ turn)


def rotation(axis: list[float]) -> np.ndarray:
    """Return a turn by 2 degrees about a unit axis."""
    return Rotation.from_rotvec(np.radians(TURN_DEG) * np.asarray(axis)).as_matrix()


def pose(view: View) -> np.ndarray:
    """Return `cam_from_world` of a view's camera."""
    return np.asarray(view.camera.cam_from_world, np.float64)


def posed(view: View, cam_from_world: np.ndarray) -> View:
    """Return a view with another pose of its camera."""
    old = view.camera
    new = jnp.asarray(cam_from_world, old.cam_from_world.dtype)
    return dataclasses.replace(view, camera=Camera(old.K, new, old.width, old.height))


def eroded(view: View) -> View:
    """Return a view whose hair mask has lost about half of its area at the border."""
    depth = np.asarray(ndimage.distance_transform_edt(view.hair))
    half = np.median(depth[view.hair])
    return dataclasses.replace(view, hair=depth > half)


def blotted(view: View, *, add: bool) -> View:
    """Return a view whose hair mask has a blob more beside it, or a hole at its end."""
    row, column = np.nonzero(view.hair)
    radius = BLOB * np.sqrt(len(row))
    low = row > np.percentile(row, 70)
    centre = np.median(row[low]), np.median(column[low])
    if add:
        centre = np.median(row), float(column.max())
    y, x = np.mgrid[: view.hair.shape[0], : view.hair.shape[1]]
    disc = np.hypot(y - centre[0], x - centre[1]) < radius
    return dataclasses.replace(
        view, hair=view.hair | disc if add else view.hair & ~disc
    )


def overexposed(view: View) -> View:
    """Return a view four times as bright, clipped and rounded as a file has it."""
    shade = np.round(255 * srgb_from_linear(4.0 * view.image)) / 255
    return dataclasses.replace(view, image=linear_from_srgb(shade).astype(np.float32))


def shaken(view: View, pixels: float = SHAKE, angle: float = ACROSS) -> View:
    """Return a view whose picture is smeared along a line.

    Args:
        view: The photograph.
        pixels: Length of the smear.
        angle: Angle of the line, from +x towards +y (down), in radians.
    """
    half = int(np.ceil(0.5 * pixels)) + 1
    dot = np.zeros((2 * half + 1, 2 * half + 1))
    dot[half, half] = 1.0
    way = np.sin(angle), np.cos(angle)
    steps = np.multiply.outer(np.linspace(-0.5 * pixels, 0.5 * pixels, 200), way)
    kernel = np.mean([ndimage.shift(dot, step, order=1) for step in steps], axis=0)
    image = [
        ndimage.convolve(np.asarray(channel, np.float64), kernel)
        for channel in np.moveaxis(view.image, 2, 0)
    ]
    image = np.maximum(np.stack(image, axis=2), 0.0)
    return dataclasses.replace(view, image=image.astype(np.float32))


def all_shaken(views: Sequence[View], pixels: float) -> list[View]:
    """Return views that are all shaken, each another way."""
    return [shaken(v, pixels, ACROSS + k * NEXT) for k, v in enumerate(views)]


def mirrored(view: View, *, masks: bool) -> View:
    """Return a view whose picture, perhaps with its masks, is mirrored."""
    new = dataclasses.replace(view, image=view.image[:, ::-1])
    if not masks:
        return new
    body = None if view.body is None else view.body[:, ::-1]
    return dataclasses.replace(new, hair=view.hair[:, ::-1], body=body)


def corruptions(other: View, head: Mesh) -> dict[str, tuple[str, Callable]]:
    """Return all corruptions by name: the kind of doubt they deserve, and a function.

    Args:
        other: A view whose hair mask may stand for that of another.
        head: The head.
    """
    return {
        "mask of another": ("mask", lambda v: dataclasses.replace(v, hair=other.hair)),
        "mask eroded": ("mask", eroded),
        "mask with a hole": ("mask", lambda v: blotted(v, add=False)),
        "mask with a blob": ("mask", lambda v: blotted(v, add=True)),
        "camera nods": ("camera", lambda v: turned(v, [1.0, 0.0, 0.0])),
        "camera swings": ("camera", lambda v: turned(v, [0.0, 1.0, 0.0])),
        "camera rolls": ("camera", lambda v: turned(v, [0.0, 0.0, 1.0])),
        "camera orbits": ("camera", lambda v: orbited(v, head)),
        "overexposed": ("exposure", overexposed),
        "shaken": ("shaken", shaken),
        "picture mirrored": ("mirrored", lambda v: mirrored(v, masks=False)),
        "all mirrored": ("mirrored", lambda v: mirrored(v, masks=True)),
    }
