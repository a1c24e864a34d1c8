"""Pictures of hair by compute shaders: light, shading, and pixels [Kim02, ch. 6]."""

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, UInt8

from ...capture.photos import srgb_from_linear
from ..camera import Camera, resized
from ..colour import tone
from ..phase_table import PhaseTable
from ..pieces import strips_needed
from ..raster import vertex_normals
from ..scene import (
    MOST_LIGHTS,
    Background,
    Light,
    PointLight,
    Scene,
    head_places,
    light_view,
)
from ..tiles import Tile, background_of, camera_of, halves, tiles
from ..view import box_corners, camera_view, outermost, see_all
from .buffers import Buffers, point_rows
from .context import COMPUTE, Kernel, NoContextError, read
from .cover import Cover
from .pixels import FrameStyle, Pixels, TooManyPiecesError
from .shadows import ShadowMaps
from .solid import Solid

POINTS, LIGHT, TINT, COLOUR = 0, 3, 5, 6
UNLIT = np.array(
    [0.0, 1.0], np.float32
)  # no hair before it, and all light past the head
LONGEST = 2048  # pixels along the side of what is drawn at once


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
        self.context = context
        self.relit = 0
        self.shaders = {
            name: Kernel(context, f"{name}.comp")
            for name in ("shade_hair", "shade_head")
        }
        self.buffers = Buffers(context)
        self.solid = Solid(context, style.samples)
        self.pixels = Pixels(context, style)
        self.maps: ShadowMaps | None = None
        self.table: Any = None
        self.cover: Cover | None = None
        self.set_scene(scene)

    def set_scene(self, scene: Scene) -> None:
        """Take another scene; its light is computed here."""
        self.scene = scene
        strands, knots, _ = scene.strands.shape
        self.count = strands * knots
        tints = np.repeat(scene.tints[:, None].astype(np.float32), knots, 1)
        self.buffers.write("points", point_rows(scene.strands, scene.look.width))
        self.buffers.write("tint", tints)
        self.buffers.reserve("colour", 16 * self.count)
        self.set_table(scene.look.table)
        self.set_cover()
        self.solid.set_head(scene.head)
        if scene.head is not None:
            self.set_head()
        flat = np.asarray(scene.strands, np.float64).reshape(-1, 3)
        self.hull = self.outside = outermost(flat)
        self.box = box_corners(self.hull)
        if scene.head is not None:
            both = np.concatenate([self.hull, scene.head.vertices])
            self.outside = outermost(both)
        self.relight()

    def set_table(self, table: PhaseTable | None) -> None:
        """Take another scattering function."""
        if self.table is not None:
            self.table.release()
        values = np.zeros((1, 1, 1, 3), "f4") if table is None else table.values
        size = values.shape[2::-1]
        self.table = self.context.texture3d(size, 3, values.tobytes(), dtype="f4")
        self.table.repeat_x = self.table.repeat_y = self.table.repeat_z = False

    def set_cover(self) -> None:
        """Take the surface that hair lies within, where shadows are adaptive."""
        if self.cover is not None:
            self.cover.release()
        self.cover = None
        style, surface = self.scene.shadows, self.scene.cover
        if surface is not None and style is not None and style.scheme == "adaptive":
            self.cover = Cover(self.context, surface)

    def set_lights(self, lights: tuple[Light, ...]) -> None:
        """Take other lights; the rest of the scene stays."""
        self.scene = dataclasses.replace(self.scene, lights=lights)
        self.relight()

    def set_background(self, background: Background) -> None:
        """Take another background; light does not depend on it."""
        self.scene = dataclasses.replace(self.scene, background=background)

    def set_head(self) -> None:
        """Write where the head looks for light, a little outside, and its normals."""
        head = self.scene.head
        assert head is not None
        normal = vertex_normals(head)
        n = len(normal)
        rows = np.zeros((2, n, 4), np.float32)
        rows[0, :, :3] = head_places(head)
        rows[1, :, :3] = normal
        self.buffers.write("head_points", rows[0])
        self.buffers.write("head_normals", rows[1])
        self.buffers.reserve("head_colour", 16 * n)

    def relight(self) -> None:
        """Compute what every light lets through to hair and head."""
        scene = self.scene
        self.relit += 1
        skin = 0 if scene.head is None else len(scene.head.vertices)
        shadowed = scene.shadows is not None and self.count > 0
        for name, count in (("light", self.count), ("head_light", skin)):
            number = count * len(scene.lights)
            self.buffers.reserve(name, 8 * number)
            if not shadowed:
                self.buffers.write(name, np.tile(UNLIT, (number, 1)))
        if scene.shadows is None or self.count == 0:
            return
        if self.maps is None or self.maps.style != scene.shadows:
            if self.maps is not None:
                self.maps.release()
            self.maps = ShadowMaps(self.context, scene.shadows)
        # Slices that follow the hair's density need all of it.
        depths = self.hull
        if scene.shadows.scheme == "density":
            depths = np.asarray(scene.strands, np.float64).reshape(-1, 3)
        points = self.buffers["points"]
        for k, light in enumerate(scene.lights):
            view = light_view(light, self.outside, scene.shadows.size)
            known = None if self.cover is None else self.cover.range(view)
            depth = see_all(depths, view)[:, 2]
            self.maps.build(points, self.count, view, depth, known)
            head = self.solid.depth_from(view)
            at = self.buffers["light"], k * self.count
            self.maps.light(points, self.count, *at, head)
            if skin:
                at = self.buffers["head_light"], k * skin
                self.maps.light(self.buffers["head_points"], skin, *at, head)

    def draw(self, camera: Camera) -> UInt8[np.ndarray, "height width 4"]:
        """Return a picture, 8 bit sRGB with its coverage as alpha."""
        if self.pixels.style.fine > 1:
            return encoded(self.draw_linear(camera), self.pixels.style.white)
        packed = self.drawn(camera, linear=False)
        return packed.view(np.uint8).reshape(camera.height, camera.width, 4)

    def draw_linear(
        self,
        camera: Camera,
        colours: Float[np.ndarray, "strands knots 3"] | None = None,
    ) -> Float[np.ndarray, "height width 4"]:
        """Return light and coverage, linear and premultiplied.

        Args:
            camera: The camera.
            colours: What each vertex of hair sends to it, instead of what light does.
        """
        n = self.pixels.style.fine
        fine = resized(camera, n * camera.width, n * camera.height)
        drawn = self.drawn(fine, linear=True, colours=colours)
        if n == 1:
            return drawn
        return drawn.reshape(camera.height, n, camera.width, n, 4).mean((1, 3))

    def colours(self, camera: Camera) -> Float[np.ndarray, "strands knots 3"]:
        """Return what every vertex of hair sends to a camera, linear RGB."""
        self.shade(np.asarray(camera.centre, np.float64))
        shape = *self.scene.strands.shape[:2], 4
        return read(self.buffers["colour"], np.float32, shape)[..., :3]

    def drawn(
        self, camera: Camera, linear: bool, colours: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the picture of a camera, packed or linear."""
        self.background = enlarged(self.scene.background, self.pixels.style.fine)
        self.shade(np.asarray(camera.centre, np.float64))
        if colours is not None:
            rows = np.ones((*colours.shape[:2], 4), np.float32)
            rows[..., :3] = colours
            self.buffers.write("colour", rows)
        shape = (camera.height, camera.width)
        out = np.empty(shape + (4,) if linear else shape, "f4" if linear else "u4")
        for tile in tiles(camera.width, camera.height, LONGEST):
            self.fill(out, tile, camera)
        return out

    def fill(self, out: np.ndarray, tile: Tile, camera: Camera) -> None:
        """Draw a part of a picture, or its halves if it holds too much hair."""
        scene = self.scene
        part = camera_of(tile, camera)
        view = camera_view(part)
        background = background_of(tile, self.background)
        self.solid.draw(part, background, self.buffers.get("head_colour"))
        try:
            out[tile.slices] = self.pixels.draw(
                view,
                self.buffers,
                self.count,
                self.solid,
                strips=strips_needed(self.box, scene.look.width, view),
                width=scene.look.width,
                alpha=scene.look.alpha,
                linear=out.ndim == 3,
            )
        except TooManyPiecesError:
            for half in halves(tile):
                self.fill(out, half, camera)

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
        self.table.use(location=0)
        self.shaders["shade_hair"].run(
            self.count,
            buffers,
            **light,
            eye=tuple(eye),
            ambient=(look.ambient,) * 3,
            diffuse=look.diffuse,
            specular=look.specular,
            coloured=look.coloured,
            shininess=look.shininess,
            tabled=look.table is not None,
            phase=0,
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
        self.shaders["shade_head"].run(
            count, buffers, **light, skin=scene.skin, eye=tuple(eye)
        )

    def light_uniforms(self) -> dict[str, Any]:
        """Return the lights as the shaders take them."""
        scene = self.scene
        place, colour = np.zeros((MOST_LIGHTS, 4)), np.zeros((MOST_LIGHTS, 3))
        for k, light in enumerate(scene.lights):
            if isinstance(light, PointLight):
                place[k], colour[k] = [*np.asarray(light.position), 1], light.intensity
            else:
                place[k], colour[k] = [*np.asarray(light.to_light), 0], light.colour
        return {
            "lights": len(scene.lights),
            "light_place": [tuple(row) for row in place],
            "light_colour": [tuple(row) for row in colour],
            "kappa": tuple(scene.kappa),
            "sky": scene.sky,
        }

    def release(self) -> None:
        """Give all memory back."""
        parts = self.buffers, self.solid, self.pixels, self.maps, self.table, self.cover
        for part in parts:
            if part is not None:
                part.release()


def encoded(
    linear: Float[np.ndarray, "height width 4"], white: float = 0.0
) -> UInt8[np.ndarray, "height width 4"]:
    """Return premultiplied light as 8 bit sRGB, as `blend.comp` does."""
    cover = linear[..., 3:]
    colour = linear[..., :3] / np.where(cover > 0.0, cover, 1.0)
    if white > 0.0:
        colour = np.asarray(tone(jnp.asarray(colour), white))
    shown = np.concatenate([srgb_from_linear(colour), cover], -1)
    return np.round(255.0 * np.clip(shown, 0.0, 1.0)).astype(np.uint8)


def enlarged(background: Background, factor: int) -> Background:
    """Return a background whose picture has more pixels of the same."""

    def more(picture):
        if picture is None or factor == 1:
            return picture
        return np.repeat(np.repeat(picture, factor, 0), factor, 1)

    return dataclasses.replace(
        background, picture=more(background.picture), depth=more(background.depth)
    )
