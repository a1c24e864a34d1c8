"""Opacity shadow maps and what they do: figures 6-5, 6-8 and 6-10 of the thesis.

Run `python examples/shadows.py`. Needs OpenGL 4.3. Above: eight of the 60 opacity maps
of a bob and the depth of the head from the light. In the middle: light from before and
from behind, and hair without and with shadows. Below: fur in light from its left with
250 maps, and a bright and a dark part of it with fewer.
"""

import argparse
import dataclasses
import pathlib
from typing import NamedTuple

import fur
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, UInt8
from sheet import PICTURES, Sheet, look_from

from hairfit.model import sample_strands
from hairfit.model.fur import grow_fur
from hairfit.render.camera import Camera
from hairfit.render.gl import draw_frames, open_context
from hairfit.render.gl.frame import Frames
from hairfit.render.gl.solid import FAR, Solid
from hairfit.render.lights import DistantLight
from hairfit.render.scene import HairLook, Scene, light_view
from hairfit.render.shadow_style import ShadowStyle
from hairfit.synthetic.gallery import make_gallery_tree, make_subject

SIZE = (420, 460)
MAPS = (1, 6, 14, 20, 26, 40, 52, 60)
FEW = (6, 16, 60)
MANY = 250


class Part(NamedTuple):
    """A part of a picture, and what it is called."""

    title: str
    rows: slice
    columns: slice


PARTS = (
    Part("bright", slice(105, 175), slice(130, 200)),
    Part("dark", slice(250, 320), slice(230, 300)),
)


def light(*way: float, strength: float = 1.6) -> DistantLight:
    """Return a far white light."""
    towards = jnp.array(way) / jnp.linalg.norm(jnp.array(way))
    return DistantLight(towards, jnp.full(3, strength))


def photographed(scene: Scene, camera: Camera) -> UInt8[np.ndarray, "height width 3"]:
    """Return a picture of a scene."""
    return draw_frames(scene, [camera])[0][..., :3]


def grey(values: Float[np.ndarray, "height width"]) -> UInt8[np.ndarray, "..."]:
    """Return numbers from 0 to 1 as a grey picture."""
    return np.repeat(np.round(255.0 * values).astype(np.uint8)[..., None], 3, -1)


def draw_maps(sheet: Sheet, scene: Scene) -> None:
    """Add what opacity maps hold, and the depth of the head (figure 6-5)."""
    context = open_context()
    frames = Frames(context, scene)
    assert frames.maps is not None and scene.head is not None
    opacity = frames.maps.opacity()
    flat = np.asarray(scene.strands).reshape(-1, 3)
    view = light_view(
        scene.lights[0],
        np.concatenate([flat, scene.head.vertices]),
        frames.maps.style.size,
    )
    solid = Solid(context, 1)
    solid.set_head(scene.head)
    texture = solid.depth_from(view)
    depth = np.frombuffer(texture.read(), np.float32).reshape(opacity.shape[1:])
    context.release()
    # The hair is in the middle of what the light sees.
    filled = np.argwhere(opacity[-1] > 0.0)
    low, high = filled.min(0), filled.max(0)
    side = int((high - low).max())
    part = tuple(slice(max(a, 0), a + side) for a in (low + high - side) // 2)
    shown = [grey(1.0 - np.exp(-opacity[k - 1][part])) for k in MAPS]
    for k in range(0, len(MAPS), 2):
        pair = np.concatenate(shown[k : k + 2], 1)
        sheet.add(f"6-5: opacity maps {MAPS[k]} and {MAPS[k + 1]} of 60", pair)
    hit = depth < FAR / 2
    near, far = depth[hit].min(), depth[hit].max()
    sheet.add(
        "6-5: the head's depth", grey(np.where(hit, (far - depth) / (far - near), 0))
    )


def draw_lights(sheet: Sheet, scene: Scene, camera: Camera) -> None:
    """Add hair in light from before and behind, without and with shadows (6-8)."""
    before, behind = light(0.3, 0.5, 1.0), light(-0.3, 0.5, -1.0, strength=2.5)
    side = light(1.0, 0.6, 0.2)
    for title, lights, shadows in (
        ("6-8: light from before", (before,), scene.shadows),
        ("6-8: light from behind", (behind,), scene.shadows),
        ("6-8: from the side, no shadows", (side,), None),
        ("6-8: with shadows", (side,), scene.shadows),
    ):
        lit = dataclasses.replace(scene, lights=lights, shadows=shadows)
        sheet.add(title, photographed(lit, camera))
    clear = dataclasses.replace(scene.look, forward=(0.6, 0.45, 0.3))
    lit = dataclasses.replace(scene, lights=(behind,), look=clear)
    sheet.add("from behind, as hair lets light through", photographed(lit, camera))


def draw_fur(sheet: Sheet, hairs: int) -> None:
    """Add fur with many maps, and two parts of it with fewer (figure 6-10)."""
    maned = fur.maned()
    grown = grow_fur(
        make_subject().scalp,
        maned.maps,
        hairs,
        maned.points,
        jax.random.key(0),
        maned.style,
    )
    scene = Scene(
        np.asarray(grown.strands, np.float64),
        look=HairLook(width=0.0002, specular=(0.15, 0.15, 0.15)),
        tint=np.asarray(grown.attributes.colour, np.float64),
        head=make_subject().head,
        lights=(light(0.25, 0.35, 0.95, strength=2.5),),
    )
    camera = look_from(
        75.0, 12.0, SIZE, low=(-0.1, -0.07, -0.12), high=(0.1, 0.17, 0.1)
    )
    pictures = {
        count: photographed(
            dataclasses.replace(scene, shadows=ShadowStyle(size=256, slices=count)),
            camera,
        )
        for count in (MANY, *FEW)
    }
    sheet.add(f"6-10: {MANY} maps", pictures[MANY])
    for count in (MANY, *reversed(FEW)):
        both = [pictures[count][part.rows, part.columns] for part in PARTS]
        sheet.add(f"6-10: bright and dark, {count} maps", np.concatenate(both, 0))


def main(out: pathlib.Path, strands: int = 12_000, hairs: int = 30_000) -> None:
    """Draw the sheet.

    Args:
        out: The JPEG.
        strands: Strands of the bob.
        hairs: Hairs of the fur.
    """
    sheet = Sheet(3, 5, SIZE)
    hair = sample_strands(make_gallery_tree("bob"), strands, 48, jax.random.key(0))
    scene = Scene(
        np.asarray(hair, np.float64),
        look=HairLook(width=0.00015, colour=(0.3, 0.17, 0.08)),
        head=make_subject().head,
        lights=(light(0.6, 0.8, 0.6),),
        sky=(0.15, 0.15, 0.15),
        shadows=ShadowStyle(slices=60),
    )
    draw_maps(sheet, scene)
    bust = (-0.095, -0.13, -0.1), (0.095, 0.13, 0.1)
    draw_lights(sheet, scene, look_from(35.0, 8.0, SIZE, *bust))
    draw_fur(sheet, hairs)
    sheet.save(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=PICTURES / "shadows.jpg")
    main(parser.parse_args().out)
