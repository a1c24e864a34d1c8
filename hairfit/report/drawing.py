"""Previews of hair from any side, by OpenGL where there is one."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, UInt8

from ..render.camera import Camera
from ..render.scene import Scene
from ..render.studio import preview_scene, studio_lights
from ..types import Mesh
from .engines import LightsOf, Shot, draw_shots, open_engine
from .orbit import orbit_camera as orbit_camera
from .orbit import orbit_cameras as orbit_cameras


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
    """Return a picture of a scene for each camera, in light that moves with it."""
    shots = [Shot("preview", camera) for camera in cameras]
    return draw_opaque(scene, shots, studio_lights)


def draw_opaque(
    scene: Scene, shots: Sequence[Shot], lights_of: LightsOf | None
) -> list[UInt8[np.ndarray, "height width 3"]]:
    """Return pictures of a scene without alpha, by OpenGL or, without it, by JAX.

    Args:
        scene: Hair on a head.
        shots: Which pictures.
        lights_of: Lights that move with the camera; None for the scene's own.
    """
    with open_engine(scene) as engine:
        pictures = draw_shots(
            engine, shots, len(shots), lights_of, lambda stage, share: None
        )
        return [np.ascontiguousarray(picture[..., :3]) for picture in pictures]
