"""Previews of hair on a head by OpenGL, without a window."""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, UInt8

from ...capture.photos import srgb_from_linear
from ...types import Mesh
from ..camera import Camera
from ..opacity import (
    Box,
    Matter,
    hair_matter,
    opacity_volume,
    together,
    transmittance,
)
from ..raster import unit, vertex_normals
from .context import open_context
from .shaders import (
    HAIR_FRAGMENT,
    HAIR_GEOMETRY,
    HAIR_VERTEX,
    HEAD_FRAGMENT,
    HEAD_VERTEX,
)

VOXELS = 110  # along the side of the cube in which shadows are computed
# Towards the lights, in the camera's axes (y down, z forward): the key light over the
# camera's left shoulder, and one behind the head for its outline.
LIGHTS = np.array([[-0.55, -0.75, -0.70], [0.60, -0.80, 0.55]])


@dataclasses.dataclass(frozen=True)
class PreviewStyle:
    """What a preview looks like. Linear RGB.

    Attributes:
        hair: Colour of the hair.
        head: Colour of the head.
        background: Colour behind it.
        width_px: Width of a strand, in pixels.
        opacity: Width of a strand as it blocks light, in metres, for 10 000 strands;
            fewer strands are taken for more hair each.
        variation: Share by which strands differ in brightness.
        supersampling: Samples along the side of a pixel.
    """

    hair: tuple[float, float, float] = (0.24, 0.110, 0.048)
    head: tuple[float, float, float] = (0.42, 0.40, 0.38)
    background: tuple[float, float, float] = (0.82, 0.83, 0.85)
    width_px: float = 0.8
    opacity: float = 0.00012
    variation: float = 0.3
    supersampling: int = 3


class Drawn(NamedTuple):
    """What goes to the graphics card: one row a vertex, and how vertices are joined.

    Attributes:
        rows: Position, direction (tangent or normal), light of each lamp, brightness.
        index: Vertices of each line or triangle.
    """

    rows: Float[np.ndarray, "vertices 9"]
    index: np.ndarray


def render_preview(
    strands: Float[np.ndarray, "strands knots 3"],
    head: Mesh | None,
    camera: Camera,
    *,
    style: PreviewStyle = PreviewStyle(),
) -> UInt8[np.ndarray, "height width 3"]:
    """Return a picture of hair on a head, 8 bit sRGB.

    Args:
        strands: Strands of equal counts of points.
        head: The head, or None for hair alone.
        camera: The camera; two lights move with it.
        style: Colours and widths.

    Raises:
        NoContextError: If no OpenGL context can be made.
    """
    return turntable(strands, head, [camera], style=style)[0]


def turntable(
    strands: Float[np.ndarray, "strands knots 3"],
    head: Mesh | None,
    cameras: Sequence[Camera],
    *,
    style: PreviewStyle = PreviewStyle(),
) -> list[UInt8[np.ndarray, "height width 3"]]:
    """Return a picture for each camera, as `render_preview` but with one context."""
    context = open_context()
    try:
        hair_program = context.program(
            vertex_shader=HAIR_VERTEX,
            geometry_shader=HAIR_GEOMETRY,
            fragment_shader=HAIR_FRAGMENT,
        )
        head_program = context.program(
            vertex_shader=HEAD_VERTEX, fragment_shader=HEAD_FRAGMENT
        )
        programs = (hair_program, head_program)
        return [draw(context, programs, strands, head, one, style) for one in cameras]
    finally:
        context.release()


def draw(
    context: Any,
    programs: tuple[Any, Any],
    strands: Float[np.ndarray, "strands knots 3"],
    head: Mesh | None,
    camera: Camera,
    style: PreviewStyle,
) -> UInt8[np.ndarray, "height width 3"]:
    """Return the picture of one camera."""
    import moderngl

    view = np.asarray(camera.cam_from_world, np.float64)
    lights = LIGHTS / np.linalg.norm(LIGHTS, axis=1, keepdims=True) @ view[:3, :3]
    hair, body = shaded_parts(strands, head, lights, style)
    n = style.supersampling
    size = n * camera.width, n * camera.height
    colour = context.texture(size, 4, dtype="f2")
    target = context.framebuffer([colour], context.depth_renderbuffer(size))
    target.use()
    target.clear(*style.background, 1.0)
    context.enable_only(moderngl.DEPTH_TEST)
    shared = {
        "clip_from_world": clip_from_world(camera, strands, head).T.astype("f4"),
        "eye": -view[:3, :3].T @ view[:3, 3],
        "to_light": lights.astype("f4"),
    }
    own = {"colour": style.hair, "half_width": n * style.width_px * 0.5, "size": size}
    render(context, programs[0], hair, {**shared, **own}, moderngl.LINES)
    if body is not None:
        own = {"colour": style.head}
        render(context, programs[1], body, {**shared, **own}, moderngl.TRIANGLES)
    samples = np.frombuffer(target.read(components=4, dtype="f2"), np.float16)
    for thing in (target, colour):
        thing.release()
    cells = samples.reshape(camera.height, n, camera.width, n, 4)[..., :3]
    linear = cells.astype(np.float32).mean((1, 3))
    return np.round(255.0 * srgb_from_linear(linear)).astype(np.uint8)


def render(context: Any, program: Any, part: Drawn, uniforms: dict, mode: int) -> None:
    """Draw lines or triangles."""
    for name, value in uniforms.items():
        if name in program:
            program[name].write(np.ascontiguousarray(value, "f4").tobytes())
    if len(part.index) == 0:
        return
    buffer = context.buffer(np.ascontiguousarray(part.rows, "f4").tobytes())
    index = context.buffer(np.ascontiguousarray(part.index, "i4").tobytes())
    layout = (buffer, "3f 3f 2f 1f", "position", "direction", "light", "brightness")
    array = context.vertex_array(program, [layout], index)
    array.render(mode)
    for thing in (array, buffer, index):
        thing.release()


def shaded_parts(
    strands, head: Mesh | None, lights, style: PreviewStyle
) -> tuple[Drawn, Drawn | None]:
    """Return hair and head with the share of each light that reaches them."""
    count, knots, _ = strands.shape
    points = np.asarray(strands, np.float64)
    width = style.opacity * 10_000 / max(count, 1)
    matter = hair_matter(points, width)
    if head is not None:
        matter = together(matter, head_matter(head))
    volumes = []
    if len(matter.points):
        low, high = matter.points.min(0), matter.points.max(0)
        reach = 0.5 * float(np.linalg.norm(high - low)) + 1e-3
        box = Box(0.5 * (low + high), reach, 2.0 * reach / VOXELS)
        volumes = [opacity_volume(matter, one, box) for one in lights]

    def lit(p):
        return np.stack([transmittance(one, p) for one in volumes], -1)

    tangent = unit(np.gradient(points, axis=1)) if count else points
    rng = np.random.default_rng(0)
    bright = np.exp(style.variation * rng.standard_normal(count))
    bright = np.repeat(bright, knots)[:, None]
    flat = points.reshape(-1, 3)
    light = lit(flat) if count else np.zeros((0, 2))
    first = np.arange(count * knots).reshape(count, knots)[:, :-1].reshape(-1)
    rows = np.concatenate([flat, tangent.reshape(-1, 3), light, bright], 1)
    hair = Drawn(rows, np.stack([first, first + 1], 1))
    if head is None:
        return hair, None
    normal = vertex_normals(head)
    off = 2.0 * volumes[0].box.cell * normal
    light = lit(np.asarray(head.vertices, np.float64) + off)
    one = np.ones((len(normal), 1))
    rows = np.concatenate([head.vertices, normal, light, one], 1)
    return hair, Drawn(rows, np.asarray(head.faces))


def head_matter(head: Mesh) -> Matter:
    """Return a mesh as matter that lets next to no light through."""
    corner = np.asarray(head.vertices, np.float64)[head.faces]
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return Matter(corner.mean(1), 2.0 * np.linalg.norm(cross, axis=1))


def clip_from_world(
    camera: Camera, strands, head: Mesh | None
) -> Float[np.ndarray, "4 4"]:
    """Return OpenGL's projection of an OpenCV camera.

    The picture's first row is OpenGL's lowest, so that the rows read back are in order.
    """
    K = np.asarray(camera.K, np.float64)
    view = np.asarray(camera.cam_from_world, np.float64)
    parts = [strands.reshape(-1, 3)] + ([] if head is None else [head.vertices])
    z = np.concatenate(parts) @ view[2, :3] + view[2, 3]
    far = max(float(z.max(initial=1.0)), 2e-3) * 1.01
    near = max(float(z.min(initial=far)) * 0.99, 1e-3 * far)
    size = np.array([camera.width, camera.height])
    clip = np.zeros((4, 4))
    clip[:2, :3] = 2.0 * K[:2] / size[:, None]
    clip[:2, 2] -= 1.0
    clip[2, 2], clip[2, 3] = (far + near) / (far - near), -2 * far * near / (far - near)
    clip[3, 2] = 1.0
    return clip @ view
