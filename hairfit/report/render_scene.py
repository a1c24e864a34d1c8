"""What `hairfit render` is asked for, as a scene."""

import dataclasses
import re
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..capture.photos import linear_from_srgb
from ..errors import InputError
from ..render.camera import Camera
from ..render.chiang import HairFibre, chiang
from ..render.gl import FrameStyle
from ..render.lights import DistantLight
from ..render.marschner import marschner
from ..render.picture import PictureStyle
from ..render.pigment import (
    SHADES,
    Pigment,
    colour_of,
    fibre_look,
    fibre_of_colour,
    fibre_of_name,
    fibre_of_pigment,
)
from ..render.scene import MOST_LIGHTS, Background, Colour, HairLook, Light, Scene
from ..render.shadow_style import PREVIEW_SHADOWS, ShadowStyle
from ..render.studio import shown_width, sky_lights, studio_lights
from ..types import Mesh
from .engines import EngineStyle, LightsOf
from .orbit import direction
from .render_options import HairOptions, Quality, RenderOptions

SKY = 0.45
# Hair as its fibres scatter light is brighter than Kajiya's and Kay's of one colour.
SCATTERED = 0.5
SKY_LIGHTS, LEAST_SKY_LIGHTS = 14, 8
MOST_OWN_LIGHTS = MOST_LIGHTS - LEAST_SKY_LIGHTS
# Adaptive layers err less than four times as many even ones.
SHADOWS = {
    "draft": PREVIEW_SHADOWS,
    "normal": ShadowStyle(size=512, slices=16, scheme="adaptive"),
    "high": ShadowStyle(size=1024, slices=32, scheme="adaptive"),
}
STYLES = {
    "draft": EngineStyle(FrameStyle(deep=8, samples=1), PictureStyle(24, 1)),
    "normal": EngineStyle(FrameStyle(deep=8, samples=2), PictureStyle(48, 2)),
    "high": EngineStyle(FrameStyle(deep=16, fine=2), PictureStyle(96, 3, 256)),
}


def check_options(options: RenderOptions) -> None:
    """Refuse what cannot be drawn, before anything is read.

    Raises:
        InputError: If numbers are out of their range, or options exclude each other.
    """
    hair, light = options.hair, options.light
    if hair.colour is not None:
        if hair.melanin is not None:
            raise InputError("--colour and --melanin exclude each other; give one.")
        plain_colour(hair.colour)
    if hair.melanin is not None and not all(0.0 <= x < 100.0 for x in hair.melanin):
        raise InputError(
            f"--melanin must be two numbers from 0 to 100, not {hair.melanin[0]:g} and "
            f"{hair.melanin[1]:g}."
        )
    if hair.width_mm is not None and not 0.001 <= hair.width_mm <= 20.0:
        raise InputError(
            f"--width-mm must be from 0.001 to 20, not {hair.width_mm:g}; hair is "
            "about 0.08 mm wide."
        )
    if not 0.0 < hair.alpha <= 1.0:
        raise InputError(f"--alpha must be above 0 and at most 1, not {hair.alpha:g}.")
    if hair.strands < 1:
        raise InputError(f"--strands must be at least 1, not {hair.strands}.")
    if len(light.light) > MOST_OWN_LIGHTS:
        raise InputError(
            f"--light is given {len(light.light)} times, and {MOST_OWN_LIGHTS} are the "
            "most; leave out the weakest, or raise --sky."
        )
    if not all(np.isfinite(one).all() and one[2] >= 0.0 for one in light.light):
        raise InputError("--light needs two angles in degrees, and a strength over 0.")
    if light.sky is not None and not 0.0 <= light.sky < 1e3:
        raise InputError(f"--sky must be at least 0, not {light.sky:g}.")
    check_background(options)


def check_background(options: RenderOptions) -> None:
    """Refuse backgrounds that exclude each other."""
    asked = options.background
    chosen = [
        name
        for name, is_set in (
            ("--background", asked.background is not None),
            ("--transparent", asked.transparent),
            ("--photo", asked.photo),
            ("--behind", asked.behind is not None),
        )
        if is_set
    ]
    if len(chosen) > 1:
        raise InputError(f"{' and '.join(chosen)} exclude each other; give one.")
    if asked.behind_depth is not None and asked.behind is None:
        raise InputError(
            "--behind-depth needs the picture itself; name it by --behind."
        )
    if asked.photo and options.camera.view is None:
        raise InputError("--photo needs to know which photograph; name it by --view.")
    if options.lines and (asked.photo or asked.behind is not None):
        raise InputError(
            f"--lines are drawn on plain paper; leave out {chosen[0]}, or draw them "
            "with --transparent and put the pictures together."
        )
    if asked.background is not None:
        parse_colour(asked.background, "--background")


def make_scene(
    points: Float[np.ndarray, "strands knots 3"],
    head: Mesh | None,
    options: RenderOptions,
) -> Scene:
    """Return hair on a head, with what was asked for."""
    asked = options.background
    colour: Colour | None = Background().colour
    if asked.transparent:
        colour = None
    elif asked.background is not None:
        colour = parse_colour(asked.background, "--background")
    sky = sky_of(options)
    return Scene(
        points,
        look=hair_look(options.hair, points),
        head=head,
        lights=own_lights(options),
        sky=(0.0, 0.0, 0.0) if shadowed_sky(options) else (sky, sky, sky),
        shadows=None if options.light.no_shadows else SHADOWS[options.quality],
        background=Background(colour=colour),
    )


def style_of(quality: Quality) -> EngineStyle:
    """Return what pictures of a quality may cost."""
    return STYLES[quality]


def hair_look(
    hair: HairOptions, strands: Float[np.ndarray, "strands knots 3"]
) -> HairLook:
    """Return what strands look like."""
    given = hair.width_mm
    width = shown_width(strands) if given is None else given / 1000.0
    if hair.shading != "kajiya-kay":
        model = {"chiang": chiang, "marschner": marschner}[hair.shading]
        return fibre_look(fibre_of(hair), model, width=width, alpha=hair.alpha)
    if hair.melanin is not None:
        colour = colour_of(fibre_of(hair))
    else:
        colour = plain_colour(hair.colour or "brown")
    return HairLook(colour=colour, width=width, alpha=hair.alpha)


def fibre_of(hair: HairOptions) -> HairFibre:
    """Return the fibre that hair is made of, brown if nothing else is said."""
    if hair.melanin is not None:
        return fibre_of_pigment(Pigment(*hair.melanin))
    name = hair.colour or "brown"
    return (
        fibre_of_name(name) if name in SHADES else fibre_of_colour(plain_colour(name))
    )


def plain_colour(text: str) -> Colour:
    """Return the linear RGB of hair of a name, or of a colour."""
    return SHADES[text] if text in SHADES else parse_colour(text, "--colour")


def parse_colour(text: str, option: str) -> Colour:
    """Return the linear RGB of a colour as screens have it, such as `7a4a2b`.

    Raises:
        InputError: If it is none.
    """
    if not re.fullmatch(r"#?[0-9a-fA-F]{6}", text):
        names = f"{', '.join(SHADES)}, or " if option == "--colour" else ""
        raise InputError(
            f"{option} '{text}' is no colour; give {names}six hexadecimal digits as "
            "'#7a4a2b'."
        )
    code = np.array(list(bytes.fromhex(text.removeprefix("#")))) / 255.0
    red, green, blue = (float(x) for x in linear_from_srgb(code))
    return red, green, blue


def shadowed_sky(options: RenderOptions) -> bool:
    """Return whether the sky is made of far lights that hair shadows."""
    return options.hair.shading != "kajiya-kay"


def sky_of(options: RenderOptions) -> float:
    """Return the light from all sides."""
    if options.light.sky is not None:
        return options.light.sky
    return SCATTERED * SKY if shadowed_sky(options) else SKY


def own_lights(options: RenderOptions) -> tuple[Light, ...]:
    """Return the lights that stand still: those asked for, and those of the sky."""
    lights = tuple(far_light(*one) for one in options.light.light)
    return (*lights, *lights_of_sky(options, len(lights) or 2))


def far_light(azimuth_deg: float, elevation_deg: float, strength: float) -> Light:
    """Return a far white light."""
    angles = np.radians([azimuth_deg, elevation_deg])
    towards = direction(float(angles[0]), float(angles[1]))
    return DistantLight(jnp.asarray(towards), jnp.full(3, strength))


def lights_of_sky(options: RenderOptions, beside: int) -> tuple[Light, ...]:
    """Return the lights of a sky that hair shadows, beside so many others."""
    sky = sky_of(options)
    if not shadowed_sky(options) or sky == 0.0:
        return ()
    return sky_lights((sky, sky, sky), min(SKY_LIGHTS, MOST_LIGHTS - beside))


def moving_lights(options: RenderOptions, scene: Scene) -> LightsOf | None:
    """Return lights that move with the camera, None if others were asked for."""
    if options.light.light:
        return None
    strength = SCATTERED if shadowed_sky(options) else 1.0

    def lights_of(camera: Camera) -> tuple[Light, ...]:
        studio = (
            DistantLight(light.to_light, strength * light.colour)
            for light in studio_lights(camera)
        )
        return (*studio, *scene.lights)

    return lights_of


def still(scene: Scene, lights_of: Callable | None) -> Scene:
    """Return a scene without lights that every picture brings anew."""
    return scene if lights_of is None else dataclasses.replace(scene, lights=())
