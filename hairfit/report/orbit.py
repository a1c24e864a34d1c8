"""Cameras around hair."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..render.camera import Camera

# How far above the horizon a turntable looks from, in degrees.
TURN_ELEVATION = 8.0


class Ball(NamedTuple):
    """A ball that holds hair, in metres."""

    centre: Float[np.ndarray, " 3"]
    radius: float


def ball_around(points: Float[np.ndarray, "strands knots 3"]) -> Ball:
    """Return a ball about the middle of the hair's box, no smaller than a fist."""
    flat = points.reshape(-1, 3)
    middle = (flat.min(axis=0) + flat.max(axis=0)) / 2
    far = float(np.linalg.norm(flat - middle, axis=1).max())
    return Ball(middle, max(far, 0.05))


def orbit_camera(
    points: Float[np.ndarray, "strands knots 3"],
    azimuth: float,
    elevation: float,
    size: tuple[int, int],
) -> Camera:
    """Return a camera that has all hair in its picture, at a distance of its own size.

    Args:
        points: The hair.
        azimuth: Direction from the hair to the camera, in radians from +z towards +x.
        elevation: The same above the horizon.
        size: Width and height of the picture, in pixels.
    """
    return camera_around(ball_around(points), azimuth, elevation, size)


def camera_around(
    ball: Ball, azimuth: float, elevation: float, size: tuple[int, int]
) -> Camera:
    """Return a camera that has a ball in its picture; see `orbit_camera`."""
    target, radius = ball
    distance = 5.0 * radius
    backwards = direction(azimuth, elevation)
    # At the poles the azimuth still says which way is right.
    right = np.array([np.cos(azimuth), 0.0, -np.sin(azimuth)])
    down = np.cross(right, backwards)
    cam_from_world = np.eye(4)
    cam_from_world[:3, :3] = [right, down, -backwards]
    eye = target + distance * backwards
    cam_from_world[:3, 3] = -cam_from_world[:3, :3] @ eye
    focal = 0.46 * min(size) * np.sqrt(distance**2 - radius**2) / radius
    K = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1]])
    return Camera(jnp.asarray(K), jnp.asarray(cam_from_world), *size)


def orbit_cameras(
    points: Float[np.ndarray, "strands knots 3"],
    turns: int,
    size: tuple[int, int],
    elevation_deg: float = TURN_ELEVATION,
) -> list[Camera]:
    """Return cameras evenly around hair and a little above it, the first in front."""
    azimuths = 2 * np.pi * np.arange(turns) / turns
    elevation = float(np.radians(elevation_deg))
    ball = ball_around(points)
    return [camera_around(ball, float(a), elevation, size) for a in azimuths]


def direction(azimuth: float, elevation: float) -> Float[np.ndarray, " 3"]:
    """Return the unit vector of an azimuth from +z towards +x, and an elevation."""
    level = np.cos(elevation)
    return np.array(
        [level * np.sin(azimuth), np.sin(elevation), level * np.cos(azimuth)]
    )
