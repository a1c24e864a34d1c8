"""What is not hair: the head and the background, as colour and depth."""

from typing import Any

import numpy as np
from jaxtyping import Float

from ...types import Mesh
from ..camera import Camera
from ..scene import Background
from ..view import NEAREST, View, camera_view, see_all
from .context import set_uniforms, source

FAR = 1e30  # depth of what hides no hair


class Solid:
    """Draws the head over the background, into textures that shaders of hair read.

    Attributes:
        samples: Samples along the side of a pixel.
        head: The head, or None.
    """

    def __init__(self, context: Any, samples: int):
        self.context, self.samples = context, samples
        self.programs = {
            name: context.program(
                vertex_shader=source(f"{name}.vert"),
                fragment_shader=source(f"{name}.frag"),
            )
            for name in ("solid", "depth")
        }
        self.head: Mesh | None = None
        self.mesh: list[Any] = []
        self.targets: dict[str, Any] = {}
        self.light: dict[str, Any] = {}

    def set_head(self, head: Mesh | None) -> None:
        """Take another head."""
        for buffer in self.mesh:
            buffer.release()
        self.head = head if head is not None and len(head.faces) else None
        self.mesh = []
        if self.head is not None:
            points = np.ascontiguousarray(self.head.vertices, np.float32)
            faces = np.ascontiguousarray(self.head.faces, np.int32)
            self.mesh = [
                self.context.buffer(part.tobytes()) for part in (points, faces)
            ]

    def draw(self, camera: Camera, background: Background, colour: Any) -> None:
        """Draw background and head.

        Args:
            camera: The camera.
            background: What is behind the head.
            colour: Buffer of a colour for each vertex of the head; None if there is
                none.
        """
        import moderngl

        n = self.samples
        self.resize(n * camera.width, n * camera.height)
        self.draw_background(camera, background)
        if self.head is None:
            return
        program = self.programs["solid"]
        texture = None
        if background.depth is not None:
            limit = np.minimum(background.depth, FAR).astype(np.float32)
            size = camera.width, camera.height
            texture = self.context.texture(size, 1, limit.tobytes(), dtype="f4")
            texture.use(location=2)
        limited = texture is not None
        set_uniforms(program, {"limited": limited, "samples": n, "limit": 2})
        self.targets["both"].use()
        self.context.enable_only(moderngl.DEPTH_TEST)
        self.render(program, camera_view(camera), [(colour, "4f", "colour")])
        if texture is not None:
            texture.release()

    def draw_background(self, camera: Camera, background: Background) -> None:
        """Fill colour and depth, and clear the z-buffer."""
        n = self.samples
        self.targets["both"].clear(depth=1.0)
        plain = background.colour
        clear = (0.0,) * 4 if plain is None else (*plain, 1.0)
        self.targets["colour only"].clear(*clear)
        self.targets["metres only"].clear(FAR, FAR, FAR, FAR)
        if background.picture is not None:
            back = np.ones((camera.height, camera.width, 4), np.float32)
            back[..., :3] = background.picture
            self.targets["colour"].write(np.repeat(np.repeat(back, n, 0), n, 1))
        if background.depth is not None:
            depth = np.minimum(background.depth, FAR).astype(np.float32)
            self.targets["metres"].write(np.repeat(np.repeat(depth, n, 0), n, 1))

    def render(self, program: Any, view: View, more: list) -> None:
        """Draw the head's triangles into the target in use."""
        assert self.head is not None
        points, faces = self.mesh
        set_uniforms(program, projection(view, self.head.vertices))
        layout = [(points, "3f", "position"), *more]
        array = self.context.vertex_array(program, layout, faces)
        array.render()
        array.release()

    def depth_from(self, view: View) -> Any:
        """Return a texture of the head's depth in a light's view; None for no head."""
        import moderngl

        if self.head is None:
            return None
        size = view.width, view.height
        if not self.light or self.light["metres"].size != size:
            for thing in self.light.values():
                thing.release()
            metres = self.context.texture(size, 1, dtype="f4")
            zbuffer = self.context.depth_renderbuffer(size)
            target = self.context.framebuffer([metres], zbuffer)
            self.light = {"metres": metres, "zbuffer": zbuffer, "target": target}
        self.light["target"].use()
        self.light["target"].clear(FAR, FAR, FAR, FAR, depth=1.0)
        self.context.enable_only(moderngl.DEPTH_TEST)
        self.render(self.programs["depth"], view, [])
        return self.light["metres"]

    def bind(self) -> None:
        """Give colour to texture unit 0, and depth to unit 1."""
        self.targets["colour"].use(location=0)
        self.targets["metres"].use(location=1)

    def resize(self, width: int, height: int) -> None:
        """Make targets of a size in samples."""
        if self.targets and self.targets["colour"].size == (width, height):
            return
        for thing in self.targets.values():
            thing.release()
        size = width, height
        colour = self.context.texture(size, 4, dtype="f4")
        metres = self.context.texture(size, 1, dtype="f4")
        zbuffer = self.context.depth_renderbuffer(size)
        frame = self.context.framebuffer
        self.targets = {
            "colour": colour,
            "metres": metres,
            "zbuffer": zbuffer,
            "both": frame([colour, metres], zbuffer),
            "colour only": frame([colour]),
            "metres only": frame([metres]),
        }

    def release(self) -> None:
        """Give all memory back."""
        for things in (self.targets, self.light):
            for thing in things.values():
                thing.release()
        for buffer in self.mesh:
            buffer.release()


def projection(view: View, points: Float[np.ndarray, "*points 3"]) -> dict[str, Any]:
    """Return what a shader needs to know of a view that sees points."""
    depth = see_all(np.asarray(points, np.float64), view)[..., 2].reshape(-1)
    row = tuple(np.asarray(view.matrix, np.float64)[2])
    return {"clip_from_world": clip_from_world(view, depth), "depth_row": row}


def clip_from_world(
    view: View, depth: Float[np.ndarray, " points"]
) -> Float[np.ndarray, "4 4"]:
    """Return OpenGL's projection of a view that holds these depths.

    The picture's first row is OpenGL's lowest, so that the rows read back are in order.
    """
    far = max(float(depth.max(initial=1.0)), 2.0 * NEAREST) * 1.01
    near = float(depth.min(initial=far))
    matrix = np.asarray(view.matrix, np.float64)
    x, y, z, w = matrix
    clip = np.stack([2.0 * x / view.width - w, 2.0 * y / view.height - w, z, w])
    parallel = not matrix[3, :3].any()
    if parallel:
        near, far = near - 0.01, float(depth.max(initial=near)) + 0.01
        clip[2] = (2.0 * z - (far + near) * w) / (far - near)
        return clip
    near = max(0.99 * near, 1e-3 * far)
    clip[2] = (far + near) / (far - near) * z
    clip[2, 3] -= 2.0 * far * near / (far - near)
    return clip
