"""Pinhole cameras, as OpenCV has them: x right, y down, z forward."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class Projected(NamedTuple):
    """Where a point lands: pixels (first centre at 0.5, 0.5), and depth in metres."""

    pixel: Float[Array, " 2"]
    depth: Float[Array, ""]


class Camera(eqx.Module):
    """One photograph's camera without distortion (photographs are undistorted on load).

    Attributes:
        K: Intrinsic matrix, in pixels.
        cam_from_world: Rigid transform from the world to the camera, in metres.
        width: Width of the picture, in pixels.
        height: Height of the picture, in pixels.
    """

    K: Float[Array, "3 3"]
    cam_from_world: Float[Array, "4 4"]
    width: int = eqx.field(static=True)
    height: int = eqx.field(static=True)

    @property
    def centre(self) -> Float[Array, " 3"]:
        """The camera's position in the world, in metres."""
        return _centre(self.cam_from_world)

    @property
    def focal(self) -> float:
        """The focal length along x, in pixels. Outside `jit` only."""
        return float(np.asarray(self.K)[0, 0])

    def project(self, p_world: Float[Array, " 3"]) -> Projected:
        """Return the pixel and the depth of one point of the world.

        Points behind the camera have a depth that is not positive and no useful pixel.
        """
        p_cam = self.cam_from_world[:3, :3] @ p_world + self.cam_from_world[:3, 3]
        depth = jnp.where(jnp.abs(p_cam[2]) < 1e-9, 1e-9, p_cam[2])
        return Projected((self.K @ (p_cam / depth))[:2], p_cam[2])


def resized(camera: Camera, width: int, height: int) -> Camera:
    """Return a camera that takes the same picture with other numbers of pixels."""
    ratio = width / camera.width, height / camera.height
    return Camera(_scaled(camera.K, *ratio), camera.cam_from_world, width, height)


# One program each, not one for every operation: cameras are asked before anything else.
@jax.jit
def shifted(
    K: Float[Array, "3 3"], across: Float[Array, ""], down: Float[Array, ""]
) -> Float[Array, "3 3"]:
    """Return intrinsics that put all so many pixels further right and down."""
    return K.at[0, 2].add(across).at[1, 2].add(down)


@jax.jit
def _centre(cam_from_world: Float[Array, "4 4"]) -> Float[Array, " 3"]:
    return -cam_from_world[:3, :3].T @ cam_from_world[:3, 3]


@jax.jit
def _scaled(
    K: Float[Array, "3 3"], across: Float[Array, ""], down: Float[Array, ""]
) -> Float[Array, "3 3"]:
    return K * jnp.stack([across, down, 1.0])[:, None].astype(K.dtype)
