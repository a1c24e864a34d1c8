"""Pictures of a scene for the eye, by OpenGL without a window."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import UInt8

from ..camera import Camera
from ..scene import Light, Scene
from .context import open_context
from .frame import Frames
from .pixels import FrameStyle


def draw_frames(
    scene: Scene,
    cameras: Sequence[Camera],
    *,
    style: FrameStyle = FrameStyle(),
    lights_of: Callable[[Camera], tuple[Light, ...]] | None = None,
) -> list[UInt8[np.ndarray, "height width 4"]]:
    """Return a picture for each camera: 8 bit sRGB, and its coverage as alpha.

    Args:
        scene: What is in the pictures.
        cameras: Where they are taken from.
        style: What they may cost.
        lights_of: Lights that move with the camera and take the place of the scene's.

    Raises:
        NoContextError: If there is no OpenGL with compute shaders.
    """
    context = open_context()
    try:
        frames = Frames(context, scene, style)
        pictures = []
        for camera in cameras:
            if lights_of is not None:
                frames.set_lights(lights_of(camera))
            pictures.append(frames.draw(camera))
        return pictures
    finally:
        context.release()
