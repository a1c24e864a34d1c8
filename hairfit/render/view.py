"""Picture planes seen along rays: what a camera, a lamp and a far light share."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.spatial import ConvexHull, QhullError

from .camera import Camera

# Nearer than this to a camera or lamp, in metres, nothing is drawn.
NEAREST = 1e-3


class Seen(NamedTuple):
    """Where a point lands in a view.

    Attributes:
        pixel: Pixels, first centre at (0.5, 0.5).
        depth: Distance along the axis, in metres; what is nearer hides what is farther.
        scale: Pixels per metre across the ray, not positive behind the eye.
    """

    pixel: Float[Array, " 2"]
    depth: Float[Array, ""]
    scale: Float[Array, ""]


class View(eqx.Module):
    """A picture plane and the rays through it, parallel or from one point.

    The same splat seen from a light is an opacity shadow map (6.2.1) and seen from a
    camera soft visibility (6.3.1): both take a view.

    Attributes:
        matrix: What takes a homogeneous point to `(x w, y w, depth, w)`, with `x` and
            `y` in pixels. `w` is 1 for parallel rays, else the depth.
        pixels_per_metre: Across the ray where `w` is 1.
        width: Width of the picture, in pixels.
        height: Height of the picture, in pixels.
    """

    matrix: Float[Array, "4 4"]
    pixels_per_metre: Float[Array, ""]
    width: int = eqx.field(static=True)
    height: int = eqx.field(static=True)

    def see(self, p_world: Float[Array, " 3"]) -> Seen:
        """Return where one point of the world lands."""
        x, y, depth, w = self.matrix[:, :3] @ p_world + self.matrix[:, 3]
        ahead = w > NEAREST
        safe = jnp.where(ahead, w, 1.0)
        scale = jnp.where(ahead, self.pixels_per_metre / safe, 0.0)
        return Seen(jnp.stack([x, y]) / safe, depth, scale)


def camera_view(camera: Camera) -> View:
    """Return the view of a pinhole camera."""
    matrix, scale = _through(camera.K, camera.cam_from_world)
    return View(matrix, scale, camera.width, camera.height)


@jax.jit
def _through(
    K: Float[Array, "3 3"], cam_from_world: Float[Array, "4 4"]
) -> tuple[Float[Array, "4 4"], Float[Array, ""]]:
    seen = K @ cam_from_world[:3]
    matrix = jnp.concatenate([seen[:2], cam_from_world[2:3], seen[2:]])
    # Pixels need not be square: an area across the ray is what must come out right.
    return matrix, jnp.sqrt(jnp.abs(K[0, 0] * K[1, 1]))


def distant_view(
    to_light: Float[np.ndarray, " 3"],
    points: Float[np.ndarray, "points 3"],
    size: int,
    margin: float = 2.0,
) -> View:
    """Return the view of a far light, that holds all points.

    Args:
        to_light: Direction towards the light; any length but 0.
        points: What must be in the picture, in metres.
        size: Width and height of the picture, in pixels.
        margin: Empty pixels at each side.

    Raises:
        ValueError: If the direction has no length or there are no points.
    """
    axes = light_axes(to_light)
    low, high = bounds(points @ axes.T)
    scale = (size - 2.0 * margin) / max(float((high - low)[:2].max()), 1e-6)
    matrix = np.zeros((4, 4))
    matrix[:2, :3] = scale * axes[:2]
    matrix[:2, 3] = 0.5 * size - scale * 0.5 * (low + high)[:2]
    matrix[2, :3] = axes[2]
    matrix[3, 3] = 1.0
    return View(jnp.asarray(matrix), jnp.asarray(scale), size, size)


def lamp_view(
    position: Float[np.ndarray, " 3"],
    points: Float[np.ndarray, "points 3"],
    size: int,
    margin: float = 2.0,
) -> View:
    """Return the view of a lamp at a place outside the hair, that holds all points.

    Args:
        position: Where the lamp is, in metres.
        points: What must be in the picture.
        size: Width and height of the picture, in pixels.
        margin: Empty pixels at each side.

    Raises:
        ValueError: If the lamp is so near that points lie beside or behind it.
    """
    low, high = bounds(points)
    axes = light_axes(position - 0.5 * (low + high))
    seen = (points - position) @ axes.T
    nearest = float(seen[:, 2].min())
    if nearest <= NEAREST:
        raise ValueError(
            f"a lamp at {np.round(position, 3).tolist()} m is within the hair; move it "
            "away, or use a distant light."
        )
    low, high = bounds(seen[:, :2] / seen[:, 2:])
    focal = (size - 2.0 * margin) / max(float((high - low).max()), 1e-6)
    K = np.diag([focal, focal, 1.0])
    K[:2, 2] = 0.5 * size - focal * 0.5 * (low + high)
    cam_from_world = np.eye(4)
    cam_from_world[:3] = np.concatenate([axes, -(axes @ position)[:, None]], 1)
    return camera_view(Camera(jnp.asarray(K), jnp.asarray(cam_from_world), size, size))


def light_axes(to_light: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Return right-handed axes of which the last runs away from the light."""
    length = float(np.linalg.norm(to_light))
    if not length > 0.0:
        raise ValueError("the direction to a light needs a length, got [0, 0, 0].")
    away = -np.asarray(to_light, np.float64) / length
    right = np.cross(away, np.eye(3)[np.argmin(np.abs(away))])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(away, right), away])


def outermost(
    points: Float[np.ndarray, "points 3"],
) -> Float[np.ndarray, "some 3"]:
    """Return those points that are the outermost ones in some direction, or all.

    Few, and any view that holds them holds all.
    """
    try:
        return points[ConvexHull(points).vertices]
    except (QhullError, ValueError):  # too few, or all in one plane
        return points


def box_corners(points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "some 1 3"]:
    """Return the corners of the box around points, each as a strand of one point.

    Nothing within is nearer than the nearest one. There are none without points.
    """
    if len(points) == 0:
        return np.zeros((0, 1, 3))
    ends = np.stack([points.min(0), points.max(0)], 1).astype(np.float64)
    return np.stack(np.meshgrid(*ends), -1).reshape(8, 1, 3)


def bounds(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest coordinates of points."""
    if len(points) == 0:
        raise ValueError("a view of light needs at least one point to look at, got 0.")
    return points.min(0), points.max(0)


def see_all(
    points: Float[np.ndarray, "*points 3"], view: View
) -> Float[np.ndarray, "*points 4"]:
    """Return pixel (x, y), depth and scale of points, as `View.see` but in NumPy."""
    matrix = np.asarray(view.matrix, np.float64)
    out = points @ matrix[:, :3].T + matrix[:, 3]
    ahead = out[..., 3] > NEAREST
    safe = np.where(ahead, out[..., 3], 1.0)
    out[..., :2] /= safe[..., None]
    out[..., 3] = np.where(ahead, float(view.pixels_per_metre) / safe, 0.0)
    return out
