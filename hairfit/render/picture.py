"""Pictures of a scene by JAX, for places without OpenGL; what `render.gl` draws too."""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .camera import Camera, resized
from .lit import (
    hair_radiance,
    head_radiance,
    light_at,
    number,
    rounded_up,
)
from .observe import Appearance, Observation, ObserveConfig, observe
from .raster import mesh_hits, unit
from .scene import Background, Light, Scene, head_places
from .strand_samples import DepthRange, depths_of, samples_needed
from .tiles import Tile, background_of, camera_of, tiles
from .view import View, camera_view, see_all

# Width over which hair goes from one pixel to the next, in pixels.
BLUR = 0.5
# A hair is drawn as at most so many thin ones side by side.
MOST_STRIPS = 16


@dataclasses.dataclass(frozen=True)
class PictureStyle:
    """What a picture costs.

    Attributes:
        layers: Layers of depth; hair hides hair one or two layers behind it.
        samples: Samples along the side of a pixel, of the head.
        longest: Pixels along the side of what is drawn at once.
    """

    layers: int = 48
    samples: int = 2
    longest: int = 320


class Ground(NamedTuple):
    """What hair is drawn over.

    Attributes:
        colour: Light and coverage, premultiplied.
        depth: Depth of what hides hair, in metres, infinite where nothing does.
    """

    colour: Float[np.ndarray, "height width 4"]
    depth: Float[np.ndarray, "height width"]


class Pictures:
    """Draws a scene for one camera after another; light is computed only once."""

    def __init__(self, scene: Scene, style: PictureStyle = PictureStyle()):
        self.scene, self.style = scene, style
        self.set_lights(scene.lights)

    def set_lights(self, lights: tuple[Light, ...]) -> None:
        """Take other lights; the rest of the scene stays."""
        scene = self.scene
        flat = np.asarray(scene.strands, np.float64).reshape(-1, 3)
        self.on_hair = light_at(flat, scene, lights)
        if scene.head is not None:
            self.on_head = light_at(head_places(scene.head), scene, lights)

    def set_background(self, background: Background) -> None:
        """Take another background; the rest of the scene stays."""
        self.scene = dataclasses.replace(self.scene, background=background)

    def draw_linear(
        self, camera: Camera, progress: Callable[[float], None] = lambda share: None
    ) -> Float[np.ndarray, "height width 4"]:
        """Return light and coverage, linear and premultiplied.

        Args:
            camera: Where the picture is taken from.
            progress: Takes the share of the picture that is done.
        """
        camera = jax.tree.map(lambda x: jnp.asarray(x, number()), camera)
        eye = np.asarray(camera.centre, np.float64)
        hair = hair_radiance(self.scene, self.on_hair, eye)
        skin = None
        if self.scene.head is not None:
            skin = head_radiance(self.scene, self.on_head, eye)
        out = np.empty((camera.height, camera.width, 4), np.float32)
        strips = as_strips(self.scene, hair, camera)
        parts = list(tiles(camera.width, camera.height, self.style.longest))
        for k, tile in enumerate(parts):
            progress(k / len(parts))
            ground = self.ground(tile, camera, skin)
            out[tile.slices] = self.over(ground, tile, camera, strips)
        return out

    def ground(
        self, tile: Tile, camera: Camera, skin: Float[np.ndarray, "vertices 3"] | None
    ) -> Ground:
        """Return background and head of a part of a picture."""
        background = background_of(tile, self.scene.background)
        shape = tile.height, tile.width
        colour = np.zeros((*shape, 4))
        if background.picture is not None:
            colour[..., :3], colour[..., 3] = background.picture, 1.0
        elif background.colour is not None:
            colour[:] = *background.colour, 1.0
        depth = np.full(shape, np.inf)
        if background.depth is not None:
            depth = np.asarray(background.depth, np.float64)
        if skin is None or self.scene.head is None:
            return Ground(colour, depth)
        n = self.style.samples
        colour = np.repeat(np.repeat(colour, n, 0), n, 1)
        limit = np.repeat(np.repeat(depth, n, 0), n, 1)
        part = camera_of(tile, camera)
        fine = resized(part, n * part.width, n * part.height)
        hits = mesh_hits(self.scene.head, fine)
        shown = (hits.face >= 0) & (hits.depth <= limit)
        face = self.scene.head.faces[hits.face[shown]]
        share = barycentric(
            np.asarray(self.scene.head.vertices, np.float64)[face],
            points_at(fine, hits.depth)[shown],
        )
        colour[shown, :3] = np.einsum("ij,ijk->ik", share, skin[face])
        colour[shown, 3] = 1.0
        colour = colour.reshape(shape[0], n, shape[1], n, 4).mean((1, 3))
        nearest = np.minimum(limit, hits.depth)[n // 2 :: n, n // 2 :: n]
        return Ground(colour, nearest)

    def over(
        self, ground: Ground, tile: Tile, camera: Camera, hair: "Strips"
    ) -> Float[np.ndarray, "height width 4"]:
        """Return a part of a picture with hair drawn over the ground."""
        # Parts of one size are compiled once, the last ones are cut.
        most = self.style.longest
        width, height = min(most, camera.width), min(most, camera.height)
        whole = tile._replace(width=width, height=height)
        view = camera_view(camera_of(whole, camera))
        chosen = touching(hair, view, alone=whole == tile and tile[:2] == (0, 0))
        if chosen is None:
            return ground.colour.astype(np.float32)
        pad = (0, height - tile.height), (0, width - tile.width)
        depth = np.pad(ground.depth, pad, constant_values=np.inf)
        # The mean is too few where long segments run by: they would be dotted.
        count = rounded_up(2 * samples_needed(chosen.points, view))
        seen = seen_hair(
            Appearance(chosen.width, chosen.radiance),
            chosen.points,
            view,
            jnp.asarray(np.minimum(depth, 1e6), number()),
            hair.between,
            ObserveConfig(self.style.layers, count, blur=BLUR),
        )
        cut = slice(tile.height), slice(tile.width)
        coverage = np.asarray(seen.coverage)[cut][..., None]
        own = np.concatenate([np.asarray(seen.colour)[cut], coverage], -1)
        return (own + (1.0 - coverage) * ground.colour).astype(np.float32)


class Strips(NamedTuple):
    """Hair as thin lines that add up.

    Attributes:
        points: The lines, in metres.
        width: Their widths, in metres.
        radiance: Light that each knot sends to the eye, linear RGB.
        between: Between which depths they are.
    """

    points: Float[Array, "strands knots 3"]
    width: Float[Array, "strands knots"]
    radiance: Float[Array, "strands knots 3"]
    between: DepthRange


def as_strips(
    scene: Scene, radiance: Float[Array, "strands knots 3"], camera: Camera
) -> Strips:
    """Return hair as lines of at most a pixel, more of them for wide hair.

    Args:
        scene: The hair.
        radiance: Light that each knot sends to the eye.
        camera: Where the eye is.
    """
    points = np.asarray(scene.strands, np.float64)
    seen = see_all(points, camera_view(camera))
    pixels = scene.look.width * seen[..., 3]
    count = int(np.clip(np.ceil(pixels.max(initial=1.0)), 1, MOST_STRIPS))
    width = np.full(points.shape[:2], scene.look.width * scene.look.alpha / count)
    tangent = np.gradient(points, axis=1)
    aside = unit(np.cross(tangent, np.asarray(camera.centre) - points))
    steps = ((np.arange(count) + 0.5) / count - 0.5) * scene.look.width
    lines = np.concatenate([points + step * aside for step in steps])
    depth = jnp.asarray(seen[..., 2][seen[..., 3] > 0.0], number())
    if depth.size == 0:
        depth = jnp.ones(1, number())
    return Strips(
        jnp.asarray(lines, number()),
        jnp.asarray(np.tile(width, (count, 1)), number()),
        jnp.tile(radiance, (count, 1, 1)),
        depths_of(depth, 64),
    )


def touching(hair: Strips, view: View, *, alone: bool) -> Strips | None:
    """Return the strands that touch a part of a picture, None if there are none.

    Args:
        hair: All strands.
        view: What the part sees.
        alone: Whether the part is the whole picture, that needs all of them.
    """
    if hair.points.size == 0:
        return None
    if alone:
        return hair
    seen = see_all(np.asarray(hair.points, np.float64), view)
    ahead = seen[..., 3] > 0.0
    low = np.where(ahead[..., None], seen[..., :2], np.inf).min(1)
    high = np.where(ahead[..., None], seen[..., :2], -np.inf).max(1)
    there = (low < [view.width + 1.0, view.height + 1.0]).all(1) & (high > -1.0).all(1)
    (index,) = np.nonzero(there)
    if len(index) == 0:
        return None
    # Few different counts, so that few programs are compiled; what is added is nothing.
    more = rounded_up(len(index)) - len(index)
    index = np.append(index, np.full(more, index[0]))
    width = hair.width[index].at[len(index) - more :].set(0.0)
    return hair._replace(
        points=hair.points[index], width=width, radiance=hair.radiance[index]
    )


@partial(jax.jit, static_argnames="config")
def seen_hair(
    appearance: Appearance,
    points: Float[Array, "strands knots 3"],
    view: View,
    head_depth: Float[Array, "height width"],
    between: DepthRange,
    config: ObserveConfig,
) -> Observation:
    """Return what a view sees of hair; compiled once for each size."""
    return observe(
        points, view, appearance, head_depth=head_depth, between=between, config=config
    )


def points_at(
    camera: Camera, depth: Float[np.ndarray, "height width"]
) -> Float[np.ndarray, "height width 3"]:
    """Return the points of the world that a depth picture shows; anything for none."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    safe = np.where(np.isfinite(depth), depth, 1.0)[..., None]
    ray = (
        np.stack([x, y, np.ones_like(x)], -1)
        @ np.linalg.inv(np.asarray(camera.K, np.float64)).T
    )
    view = np.asarray(camera.cam_from_world, np.float64)
    return (safe * ray - view[:3, 3]) @ view[:3, :3]


def barycentric(
    corner: Float[np.ndarray, "points 3 3"], p: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, "points 3"]:
    """Return the shares of triangles' corners in points on them."""
    a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    normal = np.cross(a, b)
    square = np.maximum(np.einsum("ij,ij->i", normal, normal), 1e-300)
    offset = p - corner[:, 0]
    second = np.einsum("ij,ij->i", np.cross(offset, b), normal) / square
    third = np.einsum("ij,ij->i", np.cross(a, offset), normal) / square
    share = np.stack([1.0 - second - third, second, third], 1)
    return np.clip(share, 0.0, 1.0)
