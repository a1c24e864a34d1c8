"""What draws a scene: OpenGL, or JAX where there is none."""

import contextlib
import dataclasses
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import UInt8

from ..render.camera import Camera
from ..render.gl import Frames, FrameStyle, NoContextError, open_context
from ..render.gl.frame import encoded
from ..render.picture import Pictures, PictureStyle
from ..render.scene import Background, Light, Scene
from ..render.tiles import background_of, camera_of, tiles
from .progress import say
from .render_options import EngineName

# Pixels along the side of what OpenGL draws at once: small enough for a bar to move.
AT_ONCE = 1024

LightsOf = Callable[[Camera], tuple[Light, ...]]


class Shot(NamedTuple):
    """One picture of a scene.

    Attributes:
        name: What it is called.
        camera: Where it is taken from.
        background: What is behind, in place of the scene's own.
    """

    name: str
    camera: Camera
    background: Background | None = None


@dataclasses.dataclass(frozen=True)
class EngineStyle:
    """What a picture costs with each engine."""

    frame: FrameStyle = FrameStyle()
    picture: PictureStyle = PictureStyle()


@runtime_checkable
class Engine(Protocol):
    """What draws pictures of one scene.

    Attributes:
        name: What it is called.
    """

    name: str

    def draw(
        self,
        shot: Shot,
        lights: tuple[Light, ...] | None,
        progress: Callable[[float], None],
    ) -> UInt8[np.ndarray, "height width 4"]:
        """Return a picture, 8 bit sRGB with its coverage as alpha.

        Args:
            shot: Which picture.
            lights: Lights in place of those there are; None to leave them.
            progress: Takes the share of the picture that is done.
        """
        ...


class GlEngine:
    """Draws by OpenGL."""

    name = "gl"

    def __init__(self, context, scene: Scene, style: FrameStyle):
        self.frames = Frames(context, scene, style)
        self.background = scene.background

    def draw(self, shot, lights, progress):
        """Return a picture, see `Engine.draw`."""
        frames, camera = self.frames, shot.camera
        if lights is not None:
            frames.set_lights(lights)
        whole = shot.background or self.background
        out = np.empty((camera.height, camera.width, 4), np.uint8)
        parts = list(tiles(camera.width, camera.height, AT_ONCE))
        for k, tile in enumerate(parts):
            progress(k / len(parts))
            frames.set_background(background_of(tile, whole))
            out[tile.slices] = frames.draw(camera_of(tile, camera))
        return out


class JaxEngine:
    """Draws by JAX."""

    name = "jax"

    def __init__(self, scene: Scene, style: PictureStyle):
        self.pictures = Pictures(scene, style)

    def draw(self, shot, lights, progress):
        """Return a picture, see `Engine.draw`."""
        if lights is not None:
            self.pictures.set_lights(lights)
        if shot.background is not None:
            self.pictures.set_background(shot.background)
        return encoded(self.pictures.draw_linear(shot.camera, progress))


@contextlib.contextmanager
def open_engine(
    scene: Scene,
    name: EngineName = "auto",
    style: EngineStyle = EngineStyle(),
    *,
    quiet: bool = True,
) -> Iterator[Engine]:
    """Give what draws a scene.

    Args:
        scene: What is in the pictures.
        name: `gl`, `jax`, or `auto` for OpenGL where there is one.
        style: What a picture may cost.
        quiet: Whether to say nothing when JAX takes over.

    Raises:
        NoContextError: If it shall be OpenGL and there is none.
    """
    with contextlib.ExitStack() as stack:
        engine: Engine | None = None
        if name != "jax":
            try:
                context = open_context()
                stack.callback(context.release)
                engine = GlEngine(context, scene, style.frame)
            except NoContextError:
                if name == "gl":
                    raise
                words = "there is no OpenGL 4.3 here; JAX draws instead, more slowly."
                say(words, quiet=quiet)
        yield engine or JaxEngine(scene, style.picture)


def draw_shots(
    engine: Engine,
    shots: Iterable[Shot],
    count: int,
    lights_of: LightsOf | None,
    progress: Callable[[str, float], None],
) -> Iterator[UInt8[np.ndarray, "height width 4"]]:
    """Yield pictures of a scene, one by one.

    Args:
        engine: What draws.
        shots: Which pictures.
        count: How many these are.
        lights_of: Lights that move with the camera; None for the scene's own.
        progress: Takes what is done, and the share of all.
    """
    for k, shot in enumerate(shots):

        def part(share: float, k: int = k) -> None:
            progress("drawing", (k + share) / count)

        part(0.0)
        lights = None if lights_of is None else lights_of(shot.camera)
        yield engine.draw(shot, lights, part)
    progress("drawing", 1.0)
