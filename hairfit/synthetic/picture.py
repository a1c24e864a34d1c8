"""Pictures of hair on a head, in NumPy: supersampled, shaded and shadowed."""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, UInt8

from ..capture.photos import srgb_from_linear
from ..render import Camera, Fibre, kajiya_kay, mesh_hits, project_points, rasterise
from ..render.camera import resized
from ..render.raster import unit, vertex_normals
from ..types import Mesh
from .head import head_distance
from .voxels import (
    Box,
    Matter,
    Volume,
    hair_matter,
    opacity_volume,
    together,
    transmittance,
)

SUPERSAMPLING = 3
STUDIO = Box(np.array([0.0, -0.03, -0.03]), 0.27, 0.003)
FIBRE_SHADE = jax.jit(jax.vmap(kajiya_kay, (0, None, 0, None)))


@dataclasses.dataclass(frozen=True)
class Light:
    """A far light: the direction towards it and its linear colour."""

    to_light: tuple[float, float, float]
    colour: tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class Look:
    """What pictures look like apart from the hairstyle. Linear RGB, metres.

    Attributes:
        hair: Colour of the hair.
        skin: Colour of the head.
        background: Colour behind it.
        lights: Far lights.
        sky: Light from all sides.
        width: Width of a strand, as it blocks light.
        variation: Share by which strands differ in brightness.
        noise: Standard deviation of the sensor's noise, against white.
    """

    hair: tuple[float, float, float] = (0.21, 0.090, 0.036)
    skin: tuple[float, float, float] = (0.50, 0.31, 0.22)
    background: tuple[float, float, float] = (0.33, 0.36, 0.40)
    lights: tuple[Light, ...] = (
        Light((0.55, 0.70, 0.60), (1.25, 1.20, 1.12)),
        Light((-0.80, 0.25, 0.35), (0.38, 0.42, 0.48)),
        Light((-0.25, 0.60, -0.85), (0.85, 0.88, 0.95)),
    )
    sky: float = 0.40
    width: float = 0.00022
    variation: float = 0.35
    noise: float = 0.004


class Picture(NamedTuple):
    """One photograph of a synthetic scene.

    Attributes:
        image: 8 bit sRGB.
        hair: Where hair covers at least half of the pixel.
        body: Where the head does.
    """

    image: UInt8[np.ndarray, "height width 3"]
    hair: Bool[np.ndarray, "height width"]
    body: Bool[np.ndarray, "height width"]


class Lighting(NamedTuple):
    """Everything about light that does not depend on the camera.

    Attributes:
        shadows: Opacity towards each light.
        open_sky: Opacity towards each of some directions of the sky.
        hair: Share of each light, and of the sky at last, that reaches each point.
    """

    shadows: tuple[Volume, ...]
    open_sky: tuple[Volume, ...]
    hair: Float[np.ndarray, "strands knots lights"]


SKY = (
    (0.0, 1.0, 0.0),
    (0.9, 0.45, 0.0),
    (-0.9, 0.45, 0.0),
    (0.0, 0.45, 0.9),
    (0.0, 0.45, -0.9),
    (0.0, -1.0, 0.1),
)
SKY_SHARES = (0.28, 0.17, 0.17, 0.17, 0.17, 0.04)


def make_lighting(points: Float[np.ndarray, "strands knots 3"], look: Look) -> Lighting:
    """Return the shadows that hair and head cast on hair and head."""
    matter = blocking_matter(points, look)
    shadows = tuple(
        opacity_volume(matter, np.array(light.to_light), STUDIO)
        for light in look.lights
    )
    open_sky = tuple(opacity_volume(matter, np.array(one), STUDIO) for one in SKY)
    reach = Lighting(shadows, open_sky, np.zeros((0, 0, 0)))
    return reach._replace(hair=light_shares(reach, points))


def blocking_matter(points: Float[np.ndarray, "strands knots 3"], look: Look) -> Matter:
    """Return hair and the inside of the head as samples that block light."""
    side = 0.004
    grid = np.stack(
        np.meshgrid(*(np.arange(-0.2, 0.2, side),) * 3, indexing="ij"), -1
    ).reshape(-1, 3)
    solid = grid[head_distance(grid) < -0.003]
    weight = np.full(len(solid), side**2)
    return together(hair_matter(points, look.width), Matter(solid, weight))


def light_shares(
    lighting: Lighting, p: Float[np.ndarray, "*points 3"]
) -> Float[np.ndarray, "*points lights"]:
    """Return the share of each light, and of the sky at last, that reaches points."""
    direct = [transmittance(one, p) for one in lighting.shadows]
    sky = [
        share * transmittance(one, p)
        for share, one in zip(SKY_SHARES, lighting.open_sky, strict=True)
    ]
    return np.stack([*direct, sum(sky)], -1)


def take_picture(
    points: Float[np.ndarray, "strands knots 3"],
    head: Mesh,
    camera: Camera,
    lighting: Lighting,
    look: Look,
    rng: np.random.Generator,
) -> Picture:
    """Return the picture that a camera takes of hair on a head.

    Args:
        points: Strands of equal counts of points.
        head: The head.
        camera: The camera.
        lighting: Shadows of the same strands, from `make_lighting`.
        look: Colours and lights.
        rng: Randomness of the sensor's noise.
    """
    with jax.enable_x64(True):  # a camera in double precision stays in it
        n = SUPERSAMPLING
        fine = resized(camera, n * camera.width, n * camera.height)
    hits = mesh_hits(head, fine)
    raster = rasterise(points, fine, mesh_depth=hits.depth, radius_px=1.0)
    colour = np.empty((fine.height, fine.width, 3))
    colour[:] = background(fine.height, look)[:, None]
    skin = (hits.face >= 0) & ~raster.coverage
    colour[skin] = skin_colour(
        head, hits.face[skin], hits.depth, skin, fine, lighting, look
    )
    shade = hair_colour(points, fine, lighting, look)
    colour[raster.coverage] = on_strands(shade, points, fine, raster)
    linear = box_filter(colour)
    linear += look.noise * rng.standard_normal(linear.shape)
    return Picture(
        np.round(255.0 * srgb_from_linear(linear)).astype(np.uint8),
        box_filter(raster.coverage[..., None])[..., 0] >= 0.5,
        box_filter(skin[..., None])[..., 0] > 0.5,
    )


def background(height: int, look: Look) -> Float[np.ndarray, "height 3"]:
    """Return a plain wall that is a little darker towards the floor."""
    fall = np.linspace(1.12, 0.80, height)
    return fall[:, None] * np.array(look.background)


def hair_colour(
    points: Float[np.ndarray, "strands knots 3"],
    camera: Camera,
    lighting: Lighting,
    look: Look,
) -> Float[np.ndarray, "strands knots 3"]:
    """Return the colour of every point of every strand, as the camera sees it."""
    tangent = np.gradient(points, axis=1)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=2, keepdims=True), 1e-12)
    view = np.asarray(camera.cam_from_world, np.float64)
    eye = -view[:3, :3].T @ view[:3, 3]
    to_eye = eye - points
    to_eye /= np.linalg.norm(to_eye, axis=2, keepdims=True)
    base = np.array(look.hair)
    with jax.enable_x64(True):
        highlight = Fibre(*map(jnp.asarray, hair_terms(base)))
        flat = jnp.asarray(tangent.reshape(-1, 3)), jnp.asarray(to_eye.reshape(-1, 3))
        colour = look.sky * lighting.hair[..., -1:] * base * 0.8
        for k, light in enumerate(look.lights):
            direction = np.array(light.to_light) / np.linalg.norm(light.to_light)
            lit = FIBRE_SHADE(flat[0], jnp.asarray(direction), flat[1], highlight)
            lit = np.asarray(lit).reshape(points.shape) * np.array(light.colour)
            colour = colour + lighting.hair[..., k : k + 1] * lit
    rng = np.random.default_rng(len(points))
    strand = np.exp(look.variation * rng.standard_normal((len(points), 1, 1)))
    return colour * strand


def hair_terms(base: Float[np.ndarray, " 3"]):
    """Return ambient, diffuse and specular colours, and the shininess."""
    return 0.0 * base, 0.62 * base, 0.10 + 0.55 * base, np.float64(22.0)


def on_strands(shade, points, camera: Camera, raster) -> Float[np.ndarray, "covered 3"]:
    """Return the colour of every pixel with hair, from the colours of its segment."""
    row, column = np.nonzero(raster.coverage)
    strand, segment = raster.strand[row, column], raster.segment[row, column]
    pixel = project_points(points, camera).pixel
    start, end = pixel[strand, segment], pixel[strand, segment + 1]
    step = end - start
    offset = np.stack([column + 0.5, row + 0.5], 1) - start
    square = np.maximum((step**2).sum(1), 1e-12)
    share = np.clip((offset * step).sum(1) / square, 0.0, 1.0)[:, None]
    across = (offset[:, 0] * step[:, 1] - offset[:, 1] * step[:, 0]) / np.sqrt(square)
    # A strand is round: its sides turn away.
    round_off = 0.55 + 0.45 * np.sqrt(np.clip(1.0 - (across / 1.6) ** 2, 0.0, 1.0))
    colour = (1.0 - share) * shade[strand, segment] + share * shade[strand, segment + 1]
    return colour * round_off[:, None]


def skin_colour(head: Mesh, face, depth, skin, camera: Camera, lighting, look: Look):
    """Return the colour of the head in the pixels `skin`, with smooth normals."""
    row, column = np.nonzero(skin)
    z = depth[row, column]
    K = np.asarray(camera.K, np.float64)
    view = np.asarray(camera.cam_from_world, np.float64)
    p_cam = np.stack(
        [
            (column + 0.5 - K[0, 2]) / K[0, 0] * z,
            (row + 0.5 - K[1, 2]) / K[1, 1] * z,
            z,
        ],
        1,
    )
    p = (p_cam - view[:3, 3]) @ view[:3, :3]
    normal = smooth_normals(head, face, p)
    share = light_shares(lighting, p + 0.004 * normal)
    up = 0.65 + 0.35 * normal[:, 1:2]
    total = look.sky * share[:, -1:] * up * np.ones(3)
    for k, light in enumerate(look.lights):
        direction = np.array(light.to_light) / np.linalg.norm(light.to_light)
        lit = np.clip((normal @ direction + 0.15) / 1.15, 0.0, None)
        total = total + (share[:, k] * lit)[:, None] * np.array(light.colour)
    return 0.8 * total * np.array(look.skin)


def smooth_normals(head: Mesh, face, p) -> Float[np.ndarray, "points 3"]:
    """Return the normals at points on faces, interpolated between the corners'."""
    corner = head.vertices[head.faces]
    flat = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    vertex = vertex_normals(head)
    a, b, c = (corner[face, k] for k in range(3))
    area = flat[face]
    size = np.maximum((area**2).sum(1), 1e-30)
    weight = [
        (np.cross(second - first, p - first) * area).sum(1) / size
        for first, second in ((b, c), (c, a), (a, b))
    ]
    normal = np.zeros_like(p)
    for k, share in enumerate(weight):
        normal += share[:, None] * vertex[head.faces[face, k]]
    return unit(normal)


def box_filter(fine: np.ndarray) -> Float[np.ndarray, "height width channels"]:
    """Return the mean over each pixel's samples."""
    n = SUPERSAMPLING
    height, width, channels = fine.shape
    cells = fine.reshape(height // n, n, width // n, n, channels)
    return cells.mean((1, 3), dtype=np.float64)
