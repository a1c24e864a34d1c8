"""Hair whose measures are known."""

import jax.numpy as jnp
import numpy as np

from hairfit.capture.capture import View
from hairfit.render.camera import Camera
from hairfit.types import Strands


def ragged(*strands):
    """Return strands from lists of points."""
    offsets = np.concatenate([[0], np.cumsum([len(s) for s in strands])])
    return Strands(np.concatenate(strands).astype(np.float64), offsets)


def parallel(side=4, gap=0.02, length=0.05, knots=6):
    """Return `side`² straight strands along -y, `gap` apart."""
    x, z = np.meshgrid(np.arange(side) * gap, np.arange(side) * gap)
    root = np.stack([x.ravel(), np.zeros(side**2), z.ravel()], 1)
    fall = np.linspace(0, length, knots)[:, None] * [0, -1, 0]
    return Strands.from_array(root[:, None] + fall)


def moved(strands, shift):
    return Strands(strands.points + np.asarray(shift), strands.offsets)


def wild(rng, strands=20, knots=8, size=0.03, step=0.004):
    """Return strands that run anywhere within a cube."""
    root = rng.uniform(0, size, (strands, 1, 3))
    steps = rng.normal(0, step, (strands, knots, 3))
    return Strands.from_array(root + np.cumsum(steps, axis=1))


def front_camera(width=96, height=96, focal=200.0, distance=0.5):
    """Return a camera on +z that looks towards -z at the origin."""
    return Camera(
        jnp.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]]),
        jnp.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, distance], [0, 0, 0, 1]]),
        width,
        height,
    )


def striped(angle_deg, size=96):
    """Return a picture of fine lines at an angle, and a mask of its middle."""
    y, x = np.mgrid[:size, :size] + 0.5
    angle = np.radians(angle_deg)
    across = -np.sin(angle) * x + np.cos(angle) * y
    grey = 0.4 + 0.2 * np.sin(2 * np.pi * across / 6.0)
    hair = np.zeros((size, size), bool)
    hair[16:80, 16:80] = True
    image = np.repeat(grey[..., None], 3, axis=2).astype(np.float32)
    return View("one", front_camera(size, size), image, hair)


def lines(angle_deg, count=200, size=0.08):
    """Return strands in the plane z = 0 at an angle in the picture, y being up."""
    angle = np.radians(angle_deg)
    along = np.array([np.cos(angle), -np.sin(angle), 0.0])
    across = np.array([np.sin(angle), np.cos(angle), 0.0])
    shift = np.linspace(-size, size, count)[:, None, None] * across
    return shift + np.linspace(-size, size, 5)[None, :, None] * along
