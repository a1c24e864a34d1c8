"""Maps painted on the scalp and the fur that they grow: figure 7-5.

Run `python examples/fur.py`.
"""

import argparse
import dataclasses
import pathlib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, UInt8
from sheet import PICTURES, Sheet, look_from

from hairfit.capture.photos import srgb_from_linear
from hairfit.model.fur import Fur, FurStyle, fur_style, grow_fur
from hairfit.model.maps import ScalpMaps, even_maps, paint, smooth_map, symmetric_map
from hairfit.render.camera import Camera
from hairfit.render.scene import HairLook
from hairfit.render.studio import preview_scene
from hairfit.report.drawing import draw_preview
from hairfit.synthetic.gallery import make_subject

TEXELS = 65
CREAM, TAN, BLACK = (0.62, 0.45, 0.26), (0.42, 0.20, 0.06), (0.025, 0.018, 0.015)
SILVER = (0.45, 0.43, 0.42)
WIDTH = 0.00015  # of a hair, in metres


@dataclasses.dataclass(frozen=True)
class Look:
    """Fur for one row of the sheet.

    Attributes:
        title: What it is called.
        maps: What is painted.
        style: How it is combed.
        points: Points of each hair.
        azimuth_deg: Where the picture is taken from.
    """

    title: str
    maps: ScalpMaps
    style: FurStyle
    points: int = 14
    azimuth_deg: float = 35.0


def combed_back(lean: float) -> Float[jax.Array, "rows columns 2"]:
    """Return a map of hair that leans to the nape, v."""
    return jnp.tile(jnp.array([0.0, lean])[None, None], (2, 2, 1))


def spotted() -> Look:
    """Return short fur with dark rosettes on tan, pale towards the face."""
    maps = even_maps(TEXELS, TEXELS, colour=TAN, density=1.0, length=0.7)
    brow = jnp.array([[0.0, 0.0], [1.0, 0.0]])
    colour = paint(maps.colour, brow, 0.45, jnp.asarray(CREAM))
    rng = np.random.default_rng(7)
    places: list[np.ndarray] = []
    while len(places) < 26:
        new = rng.uniform(0.04, 0.96, size=2)
        if all(np.linalg.norm(new - p) > 0.135 for p in places):
            places.append(new)
    for place in places:
        dab = jnp.asarray(place)[None]
        size = rng.uniform(0.085, 0.115)
        for _ in range(2):  # twice, for a darker ring with a sharper edge
            colour = paint(colour, dab, size, jnp.asarray(BLACK))
        colour = paint(colour, dab, 0.5 * size, jnp.asarray(TAN))
    length = paint(maps.length, brow, 0.5, 0.35)
    maps = eqx.tree_at(lambda m: (m.colour, m.length), maps, (colour, length))
    return Look(
        "Spotted", maps, fur_style(0.020, comb=combed_back(0.72)), azimuth_deg=140.0
    )


def curly() -> Look:
    """Return a curly coat, clipped in a band, with a straight pale forelock."""
    maps = even_maps(TEXELS, TEXELS, colour=BLACK, curl=0.0028)
    band = jnp.array([[0.0, 0.45], [0.5, 0.62], [1.0, 0.45]])
    density = paint(maps.density, band, 0.10, 0.06)
    length = paint(maps.length, band, 0.18, 0.30)
    lock = jnp.array([[0.5, 0.0], [0.5, 0.2]])
    curl = paint(maps.curl, lock, 0.25, 0.0)
    colour = paint(maps.colour, lock, 0.25, jnp.asarray(CREAM))
    maps = eqx.tree_at(
        lambda m: (m.density, m.length, m.colour, m.curl),
        maps,
        (density, length, colour, curl),
    )
    style = fur_style(0.040, comb=combed_back(0.35), bend=0.5, disorder=0.25)
    return Look("Curly", maps, style, points=40)


def maned() -> Look:
    """Return a long mane along the middle over short silver sides."""
    maps = even_maps(TEXELS, TEXELS, colour=SILVER, length=0.10, density=0.55)
    middle = jnp.array([[0.5, 0.0], [0.5, 1.0]])
    length = paint(maps.length, middle, 0.20, 1.0)
    density = paint(maps.density, middle, 0.22, 1.0)
    colour = paint(maps.colour, middle, 0.30, jnp.asarray(TAN))
    colour = paint(colour, middle, 0.10, jnp.asarray(BLACK))
    stripe = jnp.array([[0.10, 0.25], [0.28, 0.9]])
    colour = symmetric_map(paint(colour, stripe, 0.07, jnp.asarray(BLACK)))
    colour = smooth_map(colour, 0.008)
    maps = eqx.tree_at(
        lambda m: (m.length, m.density, m.colour), maps, (length, density, colour)
    )
    style = fur_style(0.11, comb=combed_back(0.38), bend=1.3, disorder=0.10)
    return Look("Maned", maps, style, points=24, azimuth_deg=70.0)


def coloured(fur: Fur, camera: Camera) -> UInt8[np.ndarray, "height width 3"]:
    """Return a picture of fur in its own colours."""
    scene = preview_scene(np.asarray(fur.strands, np.float64), make_subject().head)
    tint = np.asarray(fur.attributes.colour, np.float64)
    look = HairLook(width=WIDTH, specular=(0.1, 0.1, 0.1))
    return draw_preview(dataclasses.replace(scene, tint=tint, look=look), [camera])[0]


def draw_map(sheet: Sheet, title: str, values: np.ndarray, top: float) -> None:
    """Draw one map: u to the right, v from the forehead down to the nape."""
    axes = sheet.add(title, None)
    values = np.moveaxis(values, 0, 1)
    if values.ndim == 3:
        axes.imshow(srgb_from_linear(np.asarray(values, np.float64)))
    else:
        axes.imshow(values, cmap="gray", vmin=0.0, vmax=top)
    axes.set(xticks=[], yticks=[])


def main(out: pathlib.Path, hairs: int = 40_000) -> None:
    """Draw the sheet.

    Args:
        out: The JPEG.
        hairs: Hairs of each look.
    """
    sheet = Sheet(3, 5, (300, 340))
    scalp = make_subject().scalp
    size = (420, 476)
    for look in (spotted(), curly(), maned()):
        maps = look.maps
        for title, values, top in (
            ("density", maps.density, 1.0),
            ("length", maps.length, 1.0),
            ("colour", maps.colour, 1.0),
            ("curl, 0 to 3 mm", maps.curl, 0.003),
        ):
            draw_map(sheet, f"{look.title}: {title}", np.asarray(values), top)
        key = jax.random.key(0)
        fur = grow_fur(scalp, maps, hairs, look.points, key, look.style)
        camera = look_from(
            look.azimuth_deg,
            22.0,
            size,
            low=(-0.075, -0.045, -0.10),
            high=(0.075, 0.155, 0.08),
        )
        sheet.add("7-5: the fur", coloured(fur, camera))
    sheet.save(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=PICTURES / "fur.jpg")
    main(parser.parse_args().out)
