"""Lines, coverage and the order of hair: figures 6-12, 6-13, 6-15 and 6-16.

Run `python examples/antialiasing.py`. Needs OpenGL 4.3. Above: a few lines and a bob,
one pixel wide and as wide as they are. In the middle: hair, dark and light, blended in
a wrong order and in the right one, by the order of a view 30 degrees away, and what
that changes. Below: hair of four opacities.
"""

import argparse
import dataclasses
import pathlib

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, UInt8
from sheet import PICTURES, Sheet, look_from

from hairfit.capture.photos import srgb_from_linear
from hairfit.model import sample_strands
from hairfit.render.camera import Camera
from hairfit.render.gl import Frames, open_context
from hairfit.render.gl.lines import HairLines
from hairfit.render.lights import DistantLight
from hairfit.render.scene import Background, HairLook, Scene
from hairfit.synthetic.gallery import make_gallery_tree, make_subject

SIZE = (420, 440)
BUST = (-0.095, -0.13, -0.1), (0.095, 0.13, 0.1)
ALPHAS = (0.09, 0.25, 0.60, 1.00)
AZIMUTH, TURN = 35.0, 30.0  # degrees


def shown(linear: Float[np.ndarray, "height width 4"]) -> UInt8[np.ndarray, "..."]:
    """Return opaque light as a picture."""
    return np.round(255.0 * srgb_from_linear(np.clip(linear[..., :3], 0, 1))).astype(
        "u1"
    )


def enlarged(picture: np.ndarray, rows: slice, columns: slice) -> np.ndarray:
    """Return a part of a picture, its pixels four times as large."""
    return np.repeat(np.repeat(picture[rows, columns], 4, 0), 4, 1)


def rays(count: int = 23) -> Float[np.ndarray, "strands 2 3"]:
    """Return lines that leave a corner in many directions."""
    angle = np.linspace(0.02, np.pi / 2 - 0.02, count)
    end = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], -1)
    return np.stack([0.15 * end, end], 1)


def draw_lines(sheet: Sheet, context) -> None:
    """Add lines without and with antialiasing (figure 6-12a and b)."""
    K = jnp.array([[100.0, 0.0, 2.0], [0.0, 100.0, 2.0], [0.0, 0.0, 1.0]])
    camera = Camera(K, jnp.eye(4).at[2, 3].set(1.0), 105, 110)
    scene = Scene(rays(), look=HairLook(width=0.01), background=Background((1, 1, 1)))
    lines = HairLines(context, scene, np.zeros((len(scene.strands), 2, 3)))
    for title, picture in (
        ("6-12 (a): lines one pixel wide", lines.plain(camera)),
        ("6-12 (b): what they cover", lines.blended(camera)),
    ):
        sheet.add(title, enlarged(shown(picture), slice(0, 110), slice(0, 105)))


def colours_of(context, scene: Scene, camera: Camera) -> Float[np.ndarray, "..."]:
    """Return what every vertex of the hair sends to the camera."""
    frames = Frames(context, scene)
    found = frames.colours(camera)
    frames.release()
    return found


def draw_hair(sheet: Sheet, context, scene: Scene, camera: Camera) -> None:
    """Add hair without and with antialiasing (figure 6-12c)."""
    lines = HairLines(context, scene, colours_of(context, scene, camera))
    part = slice(80, 190), slice(200, 305)
    for title, picture in (
        ("6-12 (c): hair as plain lines", lines.plain(camera)),
        ("6-12 (c): antialiased", lines.blended(camera)),
    ):
        sheet.add(title, enlarged(shown(picture), *part))
    lines.release()


def draw_orders(sheet: Sheet, context, scene: Scene, camera: Camera) -> None:
    """Add hair blended in wrong, right and old orders (figures 6-13 and 6-15)."""
    # Dark hair beneath light hair, so that the order is seen.
    height = scene.strands[:, 12, 1]
    tint = np.where(height > np.quantile(height, 0.5), 1.8, 0.1)[:, None]
    look = dataclasses.replace(scene.look, alpha=0.8)
    thin = dataclasses.replace(scene, look=look, tint=tint * scene.look.colour)
    colours = colours_of(context, thin, camera)

    def ordered_from(azimuth_deg: float, elevation_deg: float):
        """Return the picture, blended in the order that is right for another view."""
        lines = HairLines(context, thin, colours, turn_deg=181.0)
        lines.blended(look_from(azimuth_deg, elevation_deg, SIZE, *BUST))
        picture = lines.blended(camera)
        lines.release()
        return picture

    right = ordered_from(AZIMUTH, 8.0)
    old = ordered_from(AZIMUTH + TURN, 8.0)
    wrong = ordered_from(AZIMUTH + 180.0, -8.0)
    difference = np.abs(shown(old).astype(int) - shown(right)).astype(np.uint8)
    for title, picture in (
        ("6-13: nearest hair first", shown(wrong)),
        ("6-13: farthest hair first", shown(right)),
        (f"6-15: the order of a view {TURN:.0f}° away", shown(old)),
        (
            "6-15: what it changes, times 16",
            np.minimum(16 * difference.astype(int), 255),
        ),
    ):
        sheet.add(title, picture.astype(np.uint8))


def draw_opacities(sheet: Sheet, context, scene: Scene, camera: Camera) -> None:
    """Add hair of several opacities (figure 6-16)."""
    for alpha in ALPHAS:
        look = dataclasses.replace(scene.look, alpha=alpha)
        frames = Frames(context, dataclasses.replace(scene, look=look))
        sheet.add(f"6-16: alpha {alpha:.2f}", frames.draw(camera)[..., :3])
        frames.release()


def main(out: pathlib.Path, strands: int = 6_000) -> None:
    """Draw the sheet.

    Args:
        out: The JPEG.
        strands: Strands of the hair.
    """
    sheet = Sheet(3, 4, SIZE)
    hair = sample_strands(make_gallery_tree("bob"), strands, 48, jax.random.key(0))
    light = DistantLight(jnp.array([0.55, 0.7, 0.45]), jnp.full(3, 1.6))
    scene = Scene(
        np.asarray(hair, np.float64),
        look=HairLook(width=0.0002, colour=(0.3, 0.17, 0.08)),
        head=make_subject().head,
        lights=(light,),
    )
    camera = look_from(AZIMUTH, 8.0, SIZE, *BUST)
    context = open_context()
    draw_lines(sheet, context)
    draw_hair(sheet, context, scene, camera)
    draw_orders(sheet, context, scene, camera)
    draw_opacities(sheet, context, scene, camera)
    sheet.save(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    default = PICTURES / "antialiasing.jpg"
    parser.add_argument("--out", type=pathlib.Path, default=default)
    main(parser.parse_args().out)
