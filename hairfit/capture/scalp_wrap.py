"""Wrap a scalp patch over any head, its border at the hairline.

The thesis has the user place the 13 by 13 control points by hand, 20 minutes a head
[Kim02, figure 4-8]. Here a square grid is laid around the cranium like a cap, drawn in
to where the photographs show hair, and projected onto the mesh.
"""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float
from scipy import ndimage

from ..host import on_device
from ..model.curve import catmull_rom_weights
from ..model.scalp import SIDE, Scalp
from ..render.raster import cells, project_points
from ..types import Mesh
from .capture import View
from .cranium import Cranium, find_cranium, skin_distance, square_to_disc
from .distance import signed_distance

# How far down hair grows on people, as polar angles at every 30 degrees of azimuth
# from the face to the nape: forehead, temple, above the ear, behind it, nape.
LOWEST = np.radians([78.0, 80.0, 92.0, 80.0, 105.0, 115.0, 118.0])
HIGHEST = np.radians(35.0)
AZIMUTHS, POLARS, SAMPLES = 72, 48, 37


class SeenHead(NamedTuple):
    """A photograph and the depth of the head in it, in metres; infinite beside it."""

    view: View
    depth: Float[np.ndarray, "height width"]


@functools.cache
def cap_weights() -> Float[np.ndarray, "samples 13"]:
    """Return how a patch's control points weigh at the samples of its cap."""
    share = on_device(np.linspace(0.0, 1.0, SAMPLES))
    weights = jax.jit(catmull_rom_weights, static_argnums=0)(SIDE, share)
    return np.asarray(weights, np.float64)


def wrap_scalp(head: Mesh, seen: Sequence[SeenHead] = ()) -> Scalp:
    """Return a scalp patch on a head, inside the hairline that the photographs show.

    Args:
        head: The head; +y up, +z to the face, anywhere in the world.
        seen: Photographs with masks of hair; without any, hair grows as on most people.

    Returns:
        The patch. Its surface lies on the mesh, nowhere deeper than about 0.5 mm.
    """
    cranium = find_cranium(head)
    border = _hairline(head, cranium, seen)
    share = np.linspace(0.0, 1.0, SAMPLES)
    u, v = (x.ravel() for x in np.meshgrid(share, share, indexing="ij"))
    polar, azimuth = _square_to_cap(u, v, border)
    rays = cranium.direction(polar, azimuth)
    radii = skin_distance(head, cranium, rays).reshape(SAMPLES, SAMPLES)
    # Ears, collars and gaps between parts of a mesh are not the cranium.
    radii = ndimage.gaussian_filter(ndimage.median_filter(radii, 5), 1.0)
    target = cranium.centre + radii.reshape(-1, 1) * rays
    weights = cap_weights()
    solve = np.linalg.pinv(weights)
    lift = np.zeros(len(target))
    control = np.zeros((13, 13, 3))
    for _ in range(6):
        grid = (target + lift[:, None] * rays).reshape(SAMPLES, SAMPLES, 3)
        control = np.einsum("ip,pqc,jq->ijc", solve, grid, solve)
        surface = np.einsum("pi,ijc,qj->pqc", weights, control, weights).reshape(-1, 3)
        depth = -signed_distance(head, surface)
        lift += np.clip(depth, -0.002, 0.01)
    return Scalp(on_device(control))


def _square_to_cap(
    u: Float[np.ndarray, " points"],
    v: Float[np.ndarray, " points"],
    border: Float[np.ndarray, " azimuths"],
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    """Map the unit square onto the cap inside the border, as (polar, azimuth)."""
    x, y = square_to_disc(2 * u - 1, 2 * v - 1)
    azimuth = np.arctan2(x, y)
    at = azimuth / (2 * np.pi) * len(border)
    limit = ndimage.map_coordinates(border, at[None], order=1, mode="grid-wrap")
    return np.hypot(x, y) * limit, azimuth


def _hairline(
    head: Mesh, cranium: Cranium, seen: Sequence[SeenHead]
) -> Float[np.ndarray, " azimuths"]:
    """Return the polar angle of the hairline at even azimuths.

    Along each meridian every view that sees the skin votes hair or no hair; the border
    is where the sum of the votes inside it is greatest.
    """
    azimuth = np.arange(AZIMUTHS) * (2 * np.pi / AZIMUTHS)
    folded = np.abs((azimuth + np.pi) % (2 * np.pi) - np.pi)
    lowest = np.interp(folded, np.linspace(0, np.pi, len(LOWEST)), LOWEST)
    share = (np.arange(POLARS) + 1) / POLARS
    polar = share[:, None] * lowest[None, :]
    rays = cranium.direction(
        polar.ravel(), np.broadcast_to(azimuth, polar.shape).ravel()
    )
    points = cranium.centre + rays * skin_distance(head, cranium, rays)[:, None]
    votes = np.zeros(len(points))
    for one in seen:
        votes += _votes(one, points, rays)
    gained = np.cumsum(votes.reshape(polar.shape) * np.sin(polar), axis=0)
    # The lowest of equal borders: what no view sees is hair.
    best = POLARS - 1 - np.argmax(gained[::-1], axis=0)
    border = share[best] * lowest
    border = ndimage.median_filter(border, 5, mode="wrap")
    border = ndimage.gaussian_filter1d(border, 1.5, mode="wrap")
    return np.clip(border, HIGHEST, None)


def _votes(
    seen: SeenHead,
    points: Float[np.ndarray, "points 3"],
    outward: Float[np.ndarray, "points 3"],
) -> Float[np.ndarray, " points"]:
    """Return +1 where the view sees hair at a point of the skin, -1 where skin."""
    view = seen.view
    pixels = project_points(points, view.camera)
    y, x, inside = cells(pixels, view.camera.width, view.camera.height)
    to_camera = np.asarray(view.camera.centre, np.float64) - points
    to_camera /= np.linalg.norm(to_camera, axis=1, keepdims=True)
    facing = (to_camera * outward).sum(axis=1)
    open_sight = inside & (facing > 0.2) & (pixels.depth < seen.depth[y, x] + 0.005)
    return np.where(open_sight, np.where(view.hair[y, x], 1.0, -1.0), 0.0)
