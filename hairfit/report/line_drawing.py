"""Hair as pen and ink draw it, as in figure 7-4 of the thesis."""

import numpy as np
from jaxtyping import Float, UInt8
from scipy.ndimage import (
    binary_closing,
    gaussian_filter,
    maximum_filter,
    minimum_filter,
)

from ..capture.photos import srgb_from_linear
from ..render.camera import Camera, resized
from ..render.lit import hair_radiance, light_at
from ..render.raster import mesh_depth, rasterise
from ..render.scene import Colour, Scene
from .strokes import Paper, ink_of, place_strokes

# Width of the pen as a share of the picture's short side, and its least, in pixels.
PEN, THINNEST = 0.0032, 1.8
# Smaller pictures than this along their short side are drawn larger, and averaged.
SHORT_SIDE = 800
# The paper's samples in all: large pictures have fewer a pixel.
MOST_SAMPLES = 40_000_000
INK = 0.07
# Depths that differ by more are a border, in metres.
BORDER = 0.006
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def line_drawing(
    scene: Scene, camera: Camera, *, paper: Colour | None = None
) -> UInt8[np.ndarray, "height width 4"]:
    """Return a drawing: outlines, and some strands, more and wider ones in shadow.

    Args:
        scene: Hair, head and lights. Without a colour of the background only the ink
            is drawn, its coverage as alpha.
        camera: Where it is seen from.
        paper: Colour of the paper; white by default.
    """
    size = camera.width, camera.height
    times = int(np.clip(np.ceil(SHORT_SIDE / min(size)), 1, 4))
    pen = times * max(PEN * min(size), THINNEST)
    fine = resized(camera, times * size[0], times * size[1])
    ink = drawn_ink(scene, fine, pen)
    ink = ink.reshape(size[1], times, size[0], times).mean((1, 3))
    return on_paper(ink, scene, paper)


def drawn_ink(
    scene: Scene, camera: Camera, pen: float
) -> Float[np.ndarray, "height width"]:
    """Return how much ink a drawing has in each pixel, from 0 to 1.

    Args:
        scene: Hair, head and lights.
        camera: Where it is seen from.
        pen: Width of the pen, in pixels.
    """
    points = np.asarray(scene.strands, np.float64)
    size = camera.width, camera.height
    skin = np.full(size[::-1], np.inf)
    if scene.head is not None:
        skin = mesh_depth(scene.head, camera)
    drawn = rasterise(points, camera, mesh_depth=skin, radius_px=0.5 * pen)
    shade = shades(scene, camera, drawn.strand, drawn.segment)
    front = np.minimum(drawn.depth, skin)
    strokes = place_strokes(points, Paper(camera, front, shade))
    times = int(np.clip(np.sqrt(MOST_SAMPLES / (size[0] * size[1])), 1, 3))
    ink = ink_of(strokes, size, pen, times)
    hair = smooth(drawn.coverage, pen)
    ink = np.maximum(ink, outline(hair, 0.55 * pen) * overhang(front, pen))
    bare = np.clip(2.0 - 4.0 * hair, 0.0, 1.0)
    return np.maximum(ink, bare * head_lines(skin, pen))


def on_paper(
    ink: Float[np.ndarray, "height width"], scene: Scene, paper: Colour | None
) -> UInt8[np.ndarray, "height width 4"]:
    """Return ink on paper, or alone where the scene has no background."""
    share = np.clip(ink, 0.0, 1.0)[..., None]
    out = np.full((*ink.shape, 4), INK)
    if scene.background.colour is None:
        out[..., 3:] = share
    else:
        ground = srgb_from_linear(
            np.asarray((1.0, 1.0, 1.0) if paper is None else paper)
        )
        out[..., :3] = share * INK + (1.0 - share) * ground
        out[..., 3] = 1.0
    return np.round(255.0 * out).astype(np.uint8)


def shades(
    scene: Scene,
    camera: Camera,
    strand: np.ndarray,
    segment: np.ndarray,
) -> Float[np.ndarray, "strands knots"]:
    """Return how bright each knot is, from the darkest to the brightest hair seen.

    Args:
        scene: The hair and its lights.
        camera: Where it is seen from.
        strand: The strand that each pixel shows, -1 for none.
        segment: Which of its segments.
    """
    points = np.asarray(scene.strands, np.float64)
    arrived = light_at(points.reshape(-1, 3), scene, scene.lights)
    eye = np.asarray(camera.centre, np.float64)
    # Hairs differ in brightness, strokes shall not.
    light = np.asarray(hair_radiance(scene, arrived, eye), np.float64) @ LUMINANCE
    light = np.log(light / scene.tints[:, 3:] + 1e-3)
    seen = strand >= 0
    if not seen.any():
        return np.zeros(points.shape[:2])
    low, high = np.quantile(light[strand[seen], segment[seen]], [0.1, 0.92])
    return np.clip((light - low) / max(high - low, 1e-6), 0.0, 1.0)


def smooth(mask: np.ndarray, pen: float) -> Float[np.ndarray, "height width"]:
    """Return a mask without holes between hairs, from 0 to 1 over a few pens' width."""
    reach = max(round(1.5 * pen), 1)
    padded = np.pad(mask, 2 * reach, mode="edge")
    closed = binary_closing(padded, iterations=reach)
    cut = slice(2 * reach, -2 * reach)
    return gaussian_filter(closed.astype(np.float64), 1.2 * pen)[cut, cut]


def outline(
    field: Float[np.ndarray, "height width"], width: float
) -> Float[np.ndarray, "height width"]:
    """Return the ink of the line where a smooth mask is one half.

    The line is wider below and to the right, as in shadow.

    Args:
        field: The mask.
        width: Width of the line, in pixels.
    """
    down, right = np.gradient(field)
    slope = np.hypot(down, right)
    distance = np.abs(field - 0.5) / np.maximum(slope, 1e-9)
    shadow = (-down - right) / np.maximum(slope, 1e-9) / np.sqrt(2.0)
    reach = 0.5 * width * (1.0 + 0.5 * shadow)
    return np.where(slope > 1e-4, np.clip(reach + 0.5 - distance, 0.0, 1.0), 0.0)


def overhang(
    depth: Float[np.ndarray, "height width"], pen: float
) -> Float[np.ndarray, "height width"]:
    """Return where something is before something else, from 0 to 1.

    A border of hair is a line there, but not where hair grows out of the head.

    Args:
        depth: What is seen, in metres, infinite for nothing.
        pen: Width of the pen, in pixels.
    """
    solid = np.isfinite(depth)
    filled = np.where(solid, depth, depth[solid].max(initial=1.0) + 1.0)
    size = 2 * max(round(2.0 * pen), 1) + 1
    spread = maximum_filter(filled, size) - minimum_filter(filled, size)
    return np.clip(gaussian_filter(2.0 * (spread > 2.5 * BORDER) - 0.5, pen), 0.0, 1.0)


def head_lines(
    depth: Float[np.ndarray, "height width"], pen: float
) -> Float[np.ndarray, "height width"]:
    """Return the ink of a head's outline, and of what in it hides what is behind."""
    solid = np.isfinite(depth)
    if not solid.any():
        return np.zeros(depth.shape)
    ink = outline(smooth(solid, 0.4 * pen), 0.6 * pen)
    filled = np.where(solid, depth, depth[solid].max())
    jump = np.zeros(depth.shape)
    for axis in (0, 1):
        step = np.abs(np.diff(filled, axis=axis)) > BORDER
        pad = [(0, 1) if k == axis else (0, 0) for k in (0, 1)]
        jump = np.maximum(jump, np.pad(step, pad))
    inside = smooth(solid, 0.4 * pen) > 0.95
    soft = gaussian_filter(jump * inside, 0.3 * pen)
    return np.maximum(ink, np.clip(1.6 * soft / max(soft.max(), 1e-9), 0.0, 1.0))
