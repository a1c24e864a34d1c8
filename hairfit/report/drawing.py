"""Previews of hair from any side, by OpenGL where there is one."""

from collections.abc import Sequence
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, UInt8

from ..capture.cameras import CameraEntry, read_cameras
from ..capture.head import load_head
from ..capture.photos import encode_picture, srgb_from_linear, stem
from ..errors import InputError
from ..evaluate.visibility import even_strands
from ..io.atomic import atomic_path
from ..render.camera import Camera
from ..render.gl import NoContextError, draw_frames
from ..render.raster import mesh_depth, rasterise
from ..render.scene import Scene
from ..render.studio import preview_scene, studio_lights
from ..types import Mesh
from .hairstyles import must_exist, read_strands
from .pictures import to_bytes
from .result import captured_from, is_result

BROWN = np.array([0.30, 0.135, 0.055])
GREY = np.array([0.45, 0.45, 0.45])


def draw(
    hair: Path,
    out: Path,
    *,
    capture: Path | None,
    view: str | None,
    degrees: tuple[float, float],
    size: tuple[int, int],
) -> None:
    """Write a picture of a hairstyle.

    Args:
        hair: A result, a tree or strands.
        out: The PNG.
        capture: The capture whose head and cameras are used; a result knows its own.
        view: The photograph whose camera is used; None for `degrees`.
        degrees: Azimuth and elevation to look from.
        size: Width and height, where no photograph tells.

    Raises:
        InputError: If something cannot be read.
    """
    points = even_strands(read_strands(hair))
    if capture is None and is_result(hair):
        capture = captured_from(hair)
    entries: tuple[CameraEntry, ...] = ()
    head = None
    if capture is not None:
        must_exist(capture)
        entries = read_cameras(capture / "cameras.json")
        if (capture / "head.obj").exists():
            head = load_head(capture / "head.obj", entries)
    if view is None:
        azimuth, elevation = np.radians(degrees)
        camera = orbit_camera(points, float(azimuth), float(elevation), size)
    else:
        camera = camera_named(view, entries, capture)
    (picture,) = draw_hair(points, head, [camera])
    with atomic_path(out) as new:
        new.write_bytes(encode_picture(picture, ".png"))


def camera_named(
    view: str, entries: tuple[CameraEntry, ...], capture: Path | None
) -> Camera:
    """Return the camera of a photograph."""
    if capture is None:
        raise InputError(
            f"--view {view} needs the capture with that photograph; name it with "
            "--capture."
        )
    cameras = {entry.name: entry.camera for entry in entries}
    if stem(view) not in cameras:
        raise InputError(f"no view '{view}'; the capture has {', '.join(cameras)}.")
    return cameras[stem(view)]


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
    flat = points.reshape(-1, 3)
    target = (flat.min(axis=0) + flat.max(axis=0)) / 2
    radius = max(float(np.linalg.norm(flat - target, axis=1).max()), 0.05)
    distance = 5.0 * radius
    level = np.cos(elevation)
    backwards = np.array(
        [level * np.sin(azimuth), np.sin(elevation), level * np.cos(azimuth)]
    )
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
    points: Float[np.ndarray, "strands knots 3"], turns: int, size: tuple[int, int]
) -> list[Camera]:
    """Return cameras evenly around hair and a little above it, the first in front."""
    azimuths = 2 * np.pi * np.arange(turns) / turns
    return [orbit_camera(points, float(a), np.radians(8.0), size) for a in azimuths]


def draw_hair(
    points: Float[np.ndarray, "strands knots 3"],
    head: Mesh | None,
    cameras: Sequence[Camera],
) -> list[UInt8[np.ndarray, "height width 3"]]:
    """Return a picture of hair for each camera, as previews show it."""
    return draw_preview(preview_scene(points, head), cameras)


def draw_preview(
    scene: Scene, cameras: Sequence[Camera]
) -> list[UInt8[np.ndarray, "height width 3"]]:
    """Return a picture of a scene for each camera, in light that moves with it.

    By OpenGL or, without it, by NumPy.
    """
    try:
        pictures = draw_frames(scene, cameras, lights_of=studio_lights)
    except NoContextError:
        return [plain_preview(scene.strands, scene.head, one) for one in cameras]
    return [np.ascontiguousarray(picture[..., :3]) for picture in pictures]


def plain_preview(
    points: Float[np.ndarray, "strands knots 3"], head: Mesh | None, camera: Camera
) -> UInt8[np.ndarray, "height width 3"]:
    """Return a simple picture of hair by NumPy.

    A strand is bright where it runs across the light, which comes from above, and the
    head where it faces the camera.
    """
    depth = None if head is None else mesh_depth(head, camera)
    drawn = rasterise(points, camera, mesh_depth=depth)
    linear = np.full((camera.height, camera.width, 3), 0.8)
    if depth is not None:
        slope = np.hypot(*np.gradient(np.where(np.isfinite(depth), depth, np.nan)))
        facing = 1.0 / np.sqrt(1.0 + (float(camera.K[0, 0]) * slope / depth) ** 2)
        linear = np.where(
            np.isfinite(facing)[..., None], GREY * facing[..., None], linear
        )
    bright = 0.25 + 0.9 * np.abs(np.cos(drawn.orientation))
    linear = np.where(drawn.coverage[..., None], BROWN * bright[..., None], linear)
    return to_bytes(srgb_from_linear(linear))
