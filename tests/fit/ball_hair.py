"""A ball with hair combed down its meridians, and what cameras see of it."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import trimesh
from numpy.typing import ArrayLike

from hairfit.capture import View
from hairfit.capture.orientation import OrientationMap
from hairfit.fit.density import TEXELS
from hairfit.fit.grid import Grid
from hairfit.fit.hull import Hull, hull_of
from hairfit.model import Scalp
from hairfit.model.strand import Hair
from hairfit.render import Camera, mesh_depth, rasterise
from hairfit.synthetic.scene import looking_at
from hairfit.types import Mesh

RADIUS = 0.08  # of the head
WIDTH, HEIGHT, FOCAL, DISTANCE = 128, 128, 160.0, 0.6


def ball(radius=RADIUS, centre=(0.0, 0.0, 0.0)) -> Mesh:
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    return Mesh(np.asarray(mesh.vertices) + centre, np.asarray(mesh.faces, np.int64))


def dome() -> Scalp:
    """The upper half, nearly, of the ball."""
    side = np.linspace(-1.0, 1.0, 13)
    x, z = np.meshgrid(side, side, indexing="ij")
    up = np.stack([x, np.full_like(x, 0.6), -z], axis=-1)
    return Scalp(jnp.asarray(RADIUS * up / np.linalg.norm(up, axis=-1, keepdims=True)))


def meridian(polar, azimuth, height: ArrayLike = 0.0):
    """Return the point at `height` above the ball; polar 0 is the crown, +y."""
    level = np.sin(polar)
    out = level * np.sin(azimuth), np.cos(polar), level * np.cos(azimuth)
    direction = np.stack(np.broadcast_arrays(*out), axis=-1)
    return (RADIUS + np.asarray(height)[..., None]) * direction


def comb(roots, length=0.09, height=0.006, knots=12):
    """Return strands that rise from roots on the ball and run down its meridians."""
    polar = np.arccos(np.clip(roots[:, 1] / np.linalg.norm(roots, axis=1), -1, 1))
    azimuth = np.arctan2(roots[:, 0], roots[:, 2])
    share = np.linspace(0.0, 1.0, knots)[None]
    down = np.minimum(polar[:, None] + share * length / RADIUS, np.radians(150.0))
    return meridian(down, azimuth[:, None], height * np.minimum(4 * share, 1.0))


def every_root(count, rng):
    """Return roots even over the ball's cap, and where they are in scalp space."""
    polar = np.arccos(rng.uniform(np.cos(1.2), 1.0, count))
    azimuth = rng.uniform(0.0, 2 * np.pi, count)
    # Equal areas of the cap are equal areas of the disc of its chords.
    chord = np.sin(0.5 * polar) / np.sin(0.6)
    x, y = chord * np.sin(azimuth), chord * np.cos(azimuth)
    return meridian(polar, azimuth), 0.5 + 0.45 * np.stack([x, y], axis=1)


def hair_of(roots, uv) -> Hair:
    none = jnp.zeros(len(uv))
    strands = jnp.asarray(comb(roots))
    return Hair(strands, jnp.asarray(uv), none.astype(jnp.int32), none)


def no_hair() -> Hair:
    return Hair(
        jnp.zeros((0, 8, 3)), jnp.zeros((0, 2)), jnp.zeros(0, int), jnp.zeros(0)
    )


def texels_at(values, uv):
    """Return what a map of `TEXELS` a side has at the texels next to places."""
    nearest = np.round(np.asarray(uv) * (TEXELS - 1)).astype(int)
    return np.asarray(values)[tuple(nearest.T)]


def camera_at(eye, target=(0.0, 0.0, 0.0), finer=1) -> Camera:
    pose = looking_at(np.asarray(eye, float), np.asarray(target, float))
    K = [[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1.0 / finer]]
    K = finer * jnp.asarray(K)
    return Camera(K, jnp.asarray(pose), finer * WIDTH, finer * HEIGHT)


def ring(count, finer=1) -> list[Camera]:
    angles = 2 * np.pi * np.arange(count) / count
    eyes = [[DISTANCE * np.sin(a), 0.1, DISTANCE * np.cos(a)] for a in angles]
    return [camera_at(eye, finer=finer) for eye in eyes]


def view_of(camera, hair, name="00") -> View:
    return View(name, camera, np.zeros((*hair.shape, 3)), hair)


def rays(camera):
    """Return the ray through each pixel's centre, of depth 1, in the world."""
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    pixel = np.stack([x, y, np.ones_like(x)], axis=-1)
    return pixel @ np.linalg.inv(camera.K).T @ np.asarray(camera.cam_from_world)[:3, :3]


def sphere_depth(camera, radius):
    """Return the depth at which each ray meets a sphere about the origin, or inf."""
    ray, eye = rays(camera), np.asarray(camera.centre)
    a, b, c = (ray**2).sum(-1), ray @ eye, eye @ eye - radius**2
    root = b**2 - a * c
    return np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0.0))) / a, np.inf)


class Photographs(NamedTuple):
    """What a fit knows of the hair, found from the strands themselves."""

    views: list[View]
    maps: list[OrientationMap]
    depths: list[np.ndarray]


def photograph(strands, cameras, head: Mesh | None, radius_px=1.5) -> Photographs:
    views, maps, depths = [], [], []
    for k, camera in enumerate(cameras):
        none = np.full((camera.height, camera.width), np.inf)
        depth = none if head is None else mesh_depth(head, camera)
        raster = rasterise(strands, camera, mesh_depth=depth, radius_px=radius_px)
        views.append(view_of(camera, raster.coverage, f"{k:02d}"))
        sure = raster.coverage.astype(float)
        maps.append(OrientationMap(raster.orientation, sure, np.full_like(sure, 0.07)))
        depths.append(depth)
    return Photographs(views, maps, depths)


def hull_where(inside, low, high, spacing, head=None) -> Hull:
    """Return the hull of voxels whose centres are `inside`, a function of points."""
    grid = Grid.around(np.asarray(low, float), np.asarray(high, float), spacing)
    points = grid.centres(np.ones(grid.shape, bool))
    hair = np.asarray(inside(points)).reshape(grid.shape)
    skin = np.full(grid.shape, 0.02)
    if head is not None:
        skin = np.asarray(head(points), float).reshape(grid.shape)
    return hull_of(grid, hair, skin)


def all_centres(hull: Hull):
    """Return the centre of every voxel of the hull's grid, an array (x, y, z, 3)."""
    everywhere = np.ones(hull.grid.shape, bool)
    return hull.grid.centres(everywhere).reshape(*hull.grid.shape, 3)
