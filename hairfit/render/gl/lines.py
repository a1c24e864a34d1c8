"""Hair drawn as lines, by what OpenGL 3.3 has [Kim02, sections 3.3.2 and 6.3.1].

Four ways: lines one pixel wide as they are; segments blended in the order of their
visibility; many pictures shifted by parts of a pixel; and many samples a pixel, the
truth that the others are measured by.
"""

from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from ..camera import Camera, shifted
from ..pieces import strips_needed
from ..scene import Background, Scene
from ..tiles import background_of, camera_of, tiles
from ..view import box_corners, camera_view, see_all
from ..visibility import DrawingOrder, visibility_bins
from .buffers import Buffers, picture, point_rows
from .context import set_uniforms, source
from .solid import Solid

Mode = Literal["plain", "blended", "accumulated"]
Shape = Literal["line", "quad", "cover"]
GEOMETRY = {"line": "line", "quad": "quad", "cover": "quad"}
FRAGMENT = {"line": "opaque", "quad": "opaque", "cover": "cover"}
HEAD_SAMPLES = 2  # along the side of a pixel, of what hides blended hair
LONGEST = 2048  # samples along the side of what is drawn at once


def draw_lines(
    context: Any,
    scene: Scene,
    colours: Float[np.ndarray, "strands knots 3"],
    camera: Camera,
    *,
    mode: Mode = "blended",
    bins: int = 512,
    passes: int = 16,
) -> Float[np.ndarray, "height width 4"]:
    """Return a picture of hair over a head and a background, linear, premultiplied.

    Args:
        context: OpenGL of version 3.3 or more.
        scene: Strands, their width and opacity, the head and what is behind; its lights
            are not used.
        colours: What each vertex of the strands sends to the eye, linear RGB.
        camera: The camera.
        mode: "plain" for lines as they are, "blended" for hair as wide as it is in the
            order of its visibility, "accumulated" for the average of many pictures.
        bins: Bins of the order, if blended.
        passes: Number of pictures, if accumulated.
    """
    lines = HairLines(context, scene, colours, bins=bins)
    if mode == "accumulated":
        out = lines.accumulated(camera, passes)
    else:
        out = lines.plain(camera) if mode == "plain" else lines.blended(camera)
    lines.release()
    return out


def supersampled(
    context: Any,
    scene: Scene,
    colours: Float[np.ndarray, "strands knots 3"],
    camera: Camera,
    factor: int = 16,
) -> Float[np.ndarray, "height width 4"]:
    """Return the picture that has `factor` x `factor` samples a pixel.

    Arguments are those of `draw_lines`. Hair is opaque here, whatever `alpha` says.
    """
    lines = HairLines(context, scene, colours)
    out = lines.supersampled(camera, factor)
    lines.release()
    return out


class HairLines:
    """Hair of which one picture after another is drawn.

    Attributes:
        bins: Bins into which segments are sorted.
        turn_deg: Angle in degrees by which the view may turn before they are sorted
            anew. Small errors of old orders are not seen (figure 6-15).
        order: The order that they were last drawn in, or None.
        sorted: How often they were sorted.
    """

    def __init__(
        self,
        context: Any,
        scene: Scene,
        colours: Float[np.ndarray, "strands knots 3"],
        *,
        bins: int = 512,
        turn_deg: float = 10.0,
    ):
        self.context, self.scene = context, scene
        self.bins, self.turn_deg = bins, turn_deg
        self.order: DrawingOrder | None = None
        self.sorted = 0
        self.looked = np.zeros(3)
        strands, knots, _ = scene.strands.shape
        self.count = strands * knots
        self.buffers = Buffers(context)
        self.buffers.write("point", point_rows(scene.strands, scene.look.width))
        self.buffers.reserve("index", strands * (knots - 1) * 8)
        self.set_colours(colours)
        self.set_head_colours(np.tile(scene.skin, (self.skin, 1)))
        self.box = box_corners(scene.strands.reshape(-1, 3))
        self.solids: dict[int, Solid] = {}
        self.frames: dict[int, tuple[Any, Any]] = {}
        self.arrays: dict[Shape, Any] = {}
        average = context.program(
            vertex_shader=source("screen.vert"), fragment_shader=source("average.frag")
        )
        self.average = context.vertex_array(average, [])
        self.target: list[Any] = []

    @property
    def skin(self) -> int:
        """Number of the head's vertices."""
        return 0 if self.scene.head is None else len(self.scene.head.vertices)

    def set_colours(self, colours: Float[np.ndarray, "strands knots 3"]) -> None:
        """Take what each vertex of hair sends to the eye, linear RGB."""
        if colours.shape != self.scene.strands.shape:
            raise ValueError(
                f"strands of shape {self.scene.strands.shape} need a colour for each "
                f"vertex, got colours of shape {colours.shape}."
            )
        self.buffers.write("colour", np.asarray(colours, np.float32))

    def set_head_colours(self, colours: Float[np.ndarray, "vertices 3"]) -> None:
        """Take what each vertex of the head sends to the eye; at first its skin's."""
        rows = np.ones((self.skin, 4), np.float32)
        rows[:, :3] = colours
        self.buffers.write("head", rows)

    def plain(self, camera: Camera) -> Float[np.ndarray, "height width 4"]:
        """Return lines one pixel wide, the nearest in each pixel: not antialiased."""
        return picture(self.opaque(camera, self.scene.background, 1, "line"))

    def accumulated(
        self, camera: Camera, passes: int = 16
    ) -> Float[np.ndarray, "height width 4"]:
        """Return the average of pictures shifted by parts of a pixel (3.3.2).

        Hair is drawn as wide as it is: lines one pixel wide would be too thick.
        """
        frame = self.frame(camera.width, camera.height)
        for shift in 0.5 - subpixels(passes):
            K = shifted(camera.K, *map(float, shift))
            moved = Camera(K, camera.cam_from_world, camera.width, camera.height)
            drawn = self.opaque(moved, self.scene.background, 1, "quad")
            self.add(drawn, frame, 1, 1.0 / passes)
        return picture(self.target[0])

    def supersampled(
        self, camera: Camera, factor: int = 16
    ) -> Float[np.ndarray, "height width 4"]:
        """Return the picture that has `factor` x `factor` samples a pixel."""
        out = np.empty((camera.height, camera.width, 4), np.float32)
        for tile in tiles(camera.width, camera.height, max(LONGEST // factor, 1)):
            part = camera_of(tile, camera)
            background = background_of(tile, self.scene.background)
            drawn = self.opaque(part, background, factor, "quad")
            self.add(drawn, self.frame(tile.width, tile.height), factor)
            out[tile.slices] = picture(self.target[0])
        return out

    def blended(self, camera: Camera) -> Float[np.ndarray, "height width 4"]:
        """Return segments blended from the farthest to the nearest bin (6.3.1).

        What a segment covers of a pixel is exact, and equals `visibility.composite`.
        """
        import moderngl

        self.sort(camera)
        solid = self.solid(camera, self.scene.background, HEAD_SAMPLES)
        frame = self.frame(camera.width, camera.height)
        self.add(solid.targets["colour"], frame, HEAD_SAMPLES)
        frame.use()
        self.context.enable_only(moderngl.BLEND)
        self.context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        strips = strips_needed(self.box, self.scene.look.width, camera_view(camera))
        self.draw("cover", camera, 1, solid, strips=strips)
        return picture(self.target[0])

    def sort(self, camera: Camera) -> None:
        """Sort segments, if the view has turned enough since they were last sorted.

        The distance (6-4) of all points changes alike when the camera only moves.
        """
        looks = np.asarray(camera.cam_from_world, np.float64)[2, :3]
        if self.order is not None:
            chord = float(np.linalg.norm(looks - self.looked))
            if 2.0 * np.arcsin(min(0.5 * chord, 1.0)) <= np.radians(self.turn_deg):
                return
        strands = np.asarray(self.scene.strands, np.float64)
        self.order = visibility_bins(strands, camera_view(camera), self.bins)
        self.looked, self.sorted = looks, self.sorted + 1
        segment = self.order.order
        vertex = segment + segment // (strands.shape[1] - 1)
        ends = np.stack([vertex, vertex + 1], 1).astype(np.uint32)
        self.buffers.write("index", ends)

    def opaque(
        self, camera: Camera, background: Background, samples: int, shape: Shape
    ) -> Any:
        """Return a texture of samples of opaque hair, head and background."""
        import moderngl

        solid = self.solid(camera, background, samples)
        colour, zbuffer = solid.targets["colour"], solid.targets["zbuffer"]
        if samples not in self.frames or self.frames[samples][0] is not colour:
            if samples in self.frames:
                self.frames[samples][1].release()
            frame = self.context.framebuffer([colour], zbuffer)
            self.frames[samples] = colour, frame
        frame = self.frames[samples][1]
        frame.color_mask = False, False, False, False
        frame.clear(depth=1.0)
        frame.color_mask = True, True, True, True
        frame.use()
        self.context.enable_only(moderngl.DEPTH_TEST)
        self.draw(shape, camera, samples, solid)
        return colour

    def draw(
        self, shape: Shape, camera: Camera, samples: int, solid: Solid, **own: Any
    ) -> None:
        """Draw all hair into what is in use, as it is set."""
        import moderngl

        if self.count == 0:
            return
        view = camera_view(camera)
        matrix = np.array(view.matrix, np.float64)
        matrix[:2] *= samples
        depth = see_all(self.box, view)[..., 2]
        array = self.array(shape)
        solid.targets["metres"].use(location=0)
        set_uniforms(
            array.program,
            {
                "view_matrix": matrix,
                "pixels_per_metre": samples * float(view.pixels_per_metre),
                "size": (float(samples * view.width), float(samples * view.height)),
                "range": (float(depth.min()) - 1e-3, float(depth.max()) + 1e-3),
                "alpha": self.scene.look.alpha,
                "metres": 0,
                **own,
            },
        )
        array.render(moderngl.LINES if shape == "cover" else moderngl.LINE_STRIP)

    def array(self, shape: Shape) -> Any:
        """Return the program and buffers that draw one shape of hair."""
        if shape not in self.arrays:
            constants = {"COLOURED": 1, "COVERED": int(shape == "cover")}
            program = self.context.program(
                vertex_shader=source("hair.vert", **constants),
                geometry_shader=source(f"{GEOMETRY[shape]}.geom", **constants),
                fragment_shader=source(f"{FRAGMENT[shape]}.frag", SAMPLES=HEAD_SAMPLES),
            )
            buffers = self.buffers
            layout = [
                (buffers["point"], "4f", "point"),
                (buffers["colour"], "3f", "colour"),
            ]
            index = buffers["index"] if shape == "cover" else None
            self.arrays[shape] = self.context.vertex_array(program, layout, index)
        return self.arrays[shape]

    def solid(self, camera: Camera, background: Background, samples: int) -> Solid:
        """Return what is not hair, drawn."""
        if samples not in self.solids:
            self.solids[samples] = Solid(self.context, samples)
            self.solids[samples].set_head(self.scene.head)
        self.solids[samples].draw(camera, background, self.buffers.get("head"))
        return self.solids[samples]

    def frame(self, width: int, height: int) -> Any:
        """Return an empty target, a pixel each."""
        if not self.target or self.target[0].size != (width, height):
            for thing in self.target:
                thing.release()
            texture = self.context.texture((width, height), 4, dtype="f4")
            self.target = [texture, self.context.framebuffer([texture])]
        self.target[1].clear()
        return self.target[1]

    def add(self, drawn: Any, frame: Any, samples: int, share: float = 1.0) -> None:
        """Add the averages of a texture's samples to a target."""
        import moderngl

        frame.use()
        self.context.enable_only(moderngl.BLEND)
        self.context.blend_func = moderngl.ONE, moderngl.ONE
        drawn.use(location=0)
        uniforms = {"picture": 0, "samples": samples, "share": share}
        set_uniforms(self.average.program, uniforms)
        self.average.render(moderngl.TRIANGLES, vertices=3)

    def release(self) -> None:
        """Give the memory back."""
        for array in (self.average, *self.arrays.values()):
            array.program.release()
            array.release()
        frames = [frame for _, frame in self.frames.values()]
        for thing in (*self.target, *frames, *self.solids.values(), self.buffers):
            thing.release()


def subpixels(count: int) -> Float[np.ndarray, "count 2"]:
    """Return places in a pixel that fill it evenly, after Hammersley (1960)."""
    k = np.arange(count)
    bits = np.arange(max(count - 1, 1).bit_length())
    mirrored = (((k[:, None] >> bits) & 1) * 0.5 ** (bits + 1)).sum(1)
    return np.stack([(k + 0.5) / count, mirrored + 0.5 ** (len(bits) + 1)], 1)
