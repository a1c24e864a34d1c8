"""Pictures of hair by compute shaders: shadows, shading, and pixels [Kim02, ch. 6]."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from ..camera import Camera
from ..pieces import strips_needed
from ..raster import vertex_normals
from ..scene import MOST_LIGHTS, PointLight, Scene, light_view
from ..view import camera_view, see_all
from .context import COMPUTE, Kernel, NoContextError, read
from .shadows import ShadowMaps
from .solid import Solid

POINTS, SEEN, HEADS, RECORDS, COUNTER, TINT, COLOUR, SCATTERED = range(8)
LIGHT = 3
RECORD = 16  # bytes of a piece of hair in a list


@dataclasses.dataclass(frozen=True)
class FrameStyle:
    """What a frame costs.

    Attributes:
        deep: Pieces of hair a pixel that are blended in order; those behind them are
            blended as one (a k-buffer).
        samples: Samples along the side of a pixel for the head.
        white: Luminance that becomes white by the tone curve; 0 for no curve.
    """

    deep: int = 8
    samples: int = 2
    white: float = 0.0


class Frames:
    """Draws a scene for one camera after another; light is computed only once.

    Attributes:
        relit: How often shadows were computed.
    """

    def __init__(self, context: Any, scene: Scene, style: FrameStyle = FrameStyle()):
        if context.version_code < COMPUTE:
            raise NoContextError(
                f"this OpenGL is of version {context.version_code / 100:.1f}, and "
                "compute shaders need 4.3; use `--engine jax`, or a newer driver."
            )
        self.context, self.style = context, style
        self.relit = 0
        constants = {"SAMPLES": style.samples, "DEEP": style.deep, "MODEL": 0}
        self.kernels = {
            name: Kernel(context, f"{name}.comp", **constants)
            for name in ("see", "shade_hair", "shade_head", "fragments")
        }
        for linear, pixel in ((0, "uint"), (1, "vec4")):
            self.kernels[f"blend{linear}"] = Kernel(
                context, "blend.comp", LINEAR=linear, PIXEL=pixel, **constants
            )
        limit = context.info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"]
        self.most_pieces = min(int(limit), 1 << 31) // RECORD
        self.buffers: dict[str, Any] = {"counter": context.buffer(reserve=16)}
        self.solid = Solid(context, style.samples)
        self.maps: ShadowMaps | None = None
        self.set_scene(scene)

    def set_scene(self, scene: Scene) -> None:
        """Take another scene; its light is computed here."""
        self.scene = scene
        strands, knots, _ = scene.strands.shape
        self.count = strands * knots
        rows = np.zeros((strands, knots, 4), np.float32)
        rows[..., :3] = scene.strands
        rows[:, :-1, 3] = scene.look.width
        tints = np.ones((strands, knots, 4), np.float32)
        tints[..., :3] = scene.tints[:, None]
        self.write("points", rows)
        self.write("tint", tints)
        self.reserve("seen", 16 * self.count)
        self.reserve("colour", 16 * self.count)
        self.solid.set_head(scene.head)
        if scene.head is not None:
            self.set_head()
        self.relight()

    def set_head(self) -> None:
        """Write where the head looks for light, a little outside, and its normals."""
        head = self.scene.head
        assert head is not None
        normal = vertex_normals(head)
        n = len(normal)
        rows = np.zeros((2, n, 4), np.float32)
        rows[0, :, :3] = np.asarray(head.vertices) + 0.002 * normal
        rows[1, :, :3] = normal
        self.write("head_points", rows[0])
        self.write("head_normals", rows[1])
        self.reserve("head_colour", 16 * n)

    def relight(self) -> None:
        """Compute what every light lets through to hair and head."""
        scene = self.scene
        self.relit += 1
        skin = 0 if scene.head is None else len(scene.head.vertices)
        lights = max(len(scene.lights), 1)
        for name, count in (("light", self.count), ("head_light", skin)):
            unlit = np.tile(np.array([0.0, 1.0], np.float32), (lights * count, 1))
            self.write(name, unlit)
        if scene.shadows is None or self.count == 0:
            return
        if self.maps is None or self.maps.style != scene.shadows:
            if self.maps is not None:
                self.maps.release()
            self.maps = ShadowMaps(self.context, scene.shadows)
        flat = np.asarray(scene.strands, np.float64).reshape(-1, 3)
        parts = [flat] if scene.head is None else [flat, scene.head.vertices]
        everything = np.concatenate(parts)
        points = self.buffers["points"]
        for k, light in enumerate(scene.lights):
            view = light_view(light, everything, scene.shadows.size)
            self.maps.build(points, self.count, view, see_all(flat, view)[:, 2])
            depth = self.solid.depth_from(view)
            at = self.buffers["light"], k * self.count
            self.maps.light(points, self.count, *at, depth)
            if skin:
                at = self.buffers["head_light"], k * skin
                self.maps.light(self.buffers["head_points"], skin, *at, depth)

    def draw(self, camera: Camera) -> UInt8[np.ndarray, "height width 4"]:
        """Return a picture, 8 bit sRGB with its coverage as alpha."""
        packed = self.drawn(camera, linear=False)
        return packed.view(np.uint8).reshape(camera.height, camera.width, 4)

    def draw_linear(self, camera: Camera) -> Float[np.ndarray, "height width 4"]:
        """Return light and coverage, linear and premultiplied."""
        return self.drawn(camera, linear=True)

    def drawn(self, camera: Camera, linear: bool) -> np.ndarray:
        """Return the picture of a camera, packed or linear."""
        view = camera_view(camera)
        eye = np.asarray(camera.centre, np.float64)
        self.shade(eye)
        seen = {
            "view_matrix": np.asarray(view.matrix, np.float64),
            "pixels_per_metre": float(view.pixels_per_metre),
        }
        pair = {0: self.buffers["points"], 1: self.buffers["seen"]}
        self.kernels["see"].run(self.count, pair, **seen)
        self.solid.draw(camera, self.scene.background, self.buffers.get("head_colour"))
        pixels = camera.width * camera.height
        self.write("heads", np.zeros(pixels, np.uint32))
        self.gather(camera, self.strips(view))
        name = f"blend{int(linear)}"
        size = 16 if linear else 4
        self.reserve("image", size * pixels)
        self.solid.bind()
        self.kernels[name].run(
            pixels,
            {
                HEADS: self.buffers["heads"],
                RECORDS: self.buffers["records"],
                COLOUR: self.buffers["image"],
            },
            size=(camera.width, camera.height),
            white=self.style.white,
            ground=0,
        )
        shape = (camera.height, camera.width)
        if linear:
            return read(self.buffers["image"], np.float32, (*shape, 4))
        return read(self.buffers["image"], np.uint32, shape)

    def strips(self, view) -> int:
        """Return how many thin lines one hair is drawn as."""
        if self.count == 0:
            return 1
        # The nearest corner of the hair's box has the widest hair.
        flat = self.scene.strands.reshape(-1, 3)
        low, high = flat.min(0), flat.max(0)
        corners = np.array(np.meshgrid(*np.stack([low, high], 1))).reshape(3, -1).T
        return strips_needed(corners[:, None], self.scene.look.width, view)

    def gather(self, camera: Camera, strips: int) -> None:
        """List the pieces of hair of every pixel."""
        if "records" not in self.buffers:
            guess = min(8 * self.count, self.most_pieces)
            self.reserve("records", RECORD * max(guess, 1))
        self.solid.bind()
        while True:
            self.buffers["counter"].write(np.zeros(4, np.uint32).tobytes())
            capacity = self.buffers["records"].size // RECORD
            self.kernels["fragments"].run(
                self.count - 1,
                {
                    POINTS: self.buffers["points"],
                    SEEN: self.buffers["seen"],
                    HEADS: self.buffers["heads"],
                    RECORDS: self.buffers["records"],
                    COUNTER: self.buffers["counter"],
                    COLOUR: self.buffers["colour"],
                },
                capacity=capacity,
                size=(camera.width, camera.height),
                strips=strips,
                alpha=self.scene.look.alpha,
                solid=1,
            )
            used = int(read(self.buffers["counter"], np.uint32, (1,))[0])
            if used <= capacity:
                return
            if used > self.most_pieces:
                raise TooManyPiecesError(used)
            self.reserve("records", RECORD * min(used * 5 // 4, self.most_pieces))
            pixels = camera.width * camera.height
            self.write("heads", np.zeros(pixels, np.uint32))

    def shade(self, eye: Float[np.ndarray, " 3"]) -> None:
        """Compute what every vertex of hair and head sends to the eye."""
        scene, look = self.scene, self.scene.look
        light = {**self.light_uniforms(), "stride": self.count}
        buffers = {
            POINTS: self.buffers["points"],
            LIGHT: self.buffers["light"],
            TINT: self.buffers["tint"],
            COLOUR: self.buffers["colour"],
        }
        self.kernels["shade_hair"].run(
            self.count,
            buffers,
            **light,
            eye=tuple(eye),
            ambient=(look.ambient,) * 3,
            diffuse=look.diffuse,
            specular=look.specular,
            coloured=look.coloured,
            shininess=look.shininess,
        )
        if scene.head is None:
            return
        count = len(scene.head.vertices)
        buffers = {
            POINTS: self.buffers["head_points"],
            LIGHT: self.buffers["head_light"],
            TINT: self.buffers["head_normals"],
            COLOUR: self.buffers["head_colour"],
        }
        light["stride"] = count
        self.kernels["shade_head"].run(count, buffers, **light, skin=scene.skin)

    def light_uniforms(self) -> dict[str, Any]:
        """Return the lights as the shaders take them."""
        scene = self.scene
        place, colour = np.zeros((MOST_LIGHTS, 4)), np.zeros((MOST_LIGHTS, 3))
        for k, light in enumerate(scene.lights):
            if isinstance(light, PointLight):
                place[k], colour[k] = [*np.asarray(light.position), 1], light.intensity
            else:
                place[k], colour[k] = [*np.asarray(light.to_light), 0], light.colour
        kappa = 1.0 if scene.shadows is None else scene.shadows.kappa
        return {
            "lights": len(scene.lights),
            "light_place": [tuple(row) for row in place],
            "light_colour": [tuple(row) for row in colour],
            "kappa": tuple(kappa * (1.0 - np.asarray(scene.look.forward))),
            "sky": scene.sky,
        }

    def write(self, name: str, value: np.ndarray) -> None:
        """Write an array to a buffer, made larger if it must be."""
        self.reserve(name, value.nbytes)
        if value.nbytes:
            self.buffers[name].write(np.ascontiguousarray(value))

    def reserve(self, name: str, size: int) -> None:
        """Make sure that a buffer has so many bytes."""
        size = max(size, 16)
        if name in self.buffers and self.buffers[name].size >= size:
            return
        if name in self.buffers:
            self.buffers[name].release()
        self.buffers[name] = self.context.buffer(reserve=size)

    def release(self) -> None:
        """Give all memory back."""
        for buffer in self.buffers.values():
            buffer.release()
        self.solid.release()
        if self.maps is not None:
            self.maps.release()


class TooManyPiecesError(RuntimeError):
    """A picture has more pieces of hair than a buffer can hold: draw it by tiles."""
