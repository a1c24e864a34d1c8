r"""What hair looks like and what light shone on it, from the photographs.

Inverse lighting [Marschner and Greenberg 1997]: how bright each pixel of hair would be
in light from each of many directions, shadowed by hair and head, is known once the hair
is; what shone from where, and the colour of the hair, follow by least squares.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int
from scipy import ndimage, optimize

from ..abreast import abreast
from ..capture.capture import View
from ..evaluate.coverage import narrowest_width
from ..evaluate.visibility import Sight
from ..host import on_device
from ..render.lights import DistantLight
from ..render.lit import light_at, number
from ..render.raster import rasterise, unit
from ..render.scene import Colour, HairLook, Scene, head_places
from ..render.shading import Fibre, kajiya_kay
from ..render.shadow_style import ShadowStyle
from ..render.studio import shared_width, sky_lights
from ..types import Mesh
from .bare import CLIPPED, PIXELS, Bare, bare_pixels

LIT = 6000  # strands of a fit whose light is compared with photographs
CASTING = 3000  # strands that cast shadows
SHADOWS = ShadowStyle(size=128, slices=24)
SMOOTH = 2.0  # pixels: single hairs of the photograph are not those of the fit
LIGHTS = 18  # directions from which light may come
SHININESS = (3.0, 8.0, 20.0, 50.0)
ROUNDS = 12
DARK = 0.3  # of the mean brightness, added where errors are made relative
HEAD_COUNTS = 2.0  # a pixel of the head, against one of hair
OUTLIER = 1.5  # medians of the error beyond which a pixel counts less
BRIGHT = 99.0  # per cent of a photograph that is no brighter than white
WHITE = 0.9  # what white paper sends back
LEAST_SHARE = 0.06  # of all light; weaker lights become sky
BRIGHTEST_EXPOSURE = 4.0  # photographs are exposed within so many times the mean
FEWEST = 50  # pixels of hair without which nothing is known of its looks
LIGHTEST_SKIN = 0.7  # what skin sends back at most of a colour


class Appearance(NamedTuple):
    """Looks of hair, and light. Linear RGB.

    Only products of colour, light and exposure are seen. Light is taken to be white,
    exposures to be 1 in the mean, and the brightest parts of the photographs to be of
    a nearly white matt surface that faces most of the light, unless the head would then
    be brighter than skin is.

    Attributes:
        colour: Colour of the hair.
        specular: Colour of its highlight, $K_s$.
        shininess: Exponent of its highlight, $p$.
        to_light: Unit vectors towards the lights there are.
        strength: What a white matt surface that faces each sends back.
        sky: Light from all sides.
        exposure: How much brighter than the mean each photograph is.
        skin: Colour of the head where no hair is, None where it is not seen.
        error: Root mean square error of brightness, relative.
        total_width: The widths of all strands with which they cover the masks, in
            metres: half as many are twice as wide.
    """

    colour: Colour
    specular: Colour
    shininess: float
    to_light: Float[np.ndarray, "lights 3"]
    strength: Float[np.ndarray, " lights"]
    sky: float
    exposure: Float[np.ndarray, " views"]
    error: float
    skin: Colour | None = None
    total_width: float = 0.0

    def look(self, count: int) -> HairLook:
        """Return the hair as pictures draw it with so many strands."""
        return HairLook(
            colour=self.colour,
            width=shared_width(self.total_width, count),
            ambient=1.0,
            diffuse=1.0,
            specular=self.specular,
            coloured=0.0,
            shininess=self.shininess,
        )

    @property
    def lights(self) -> tuple[DistantLight, ...]:
        """The lights as pictures take them."""
        return tuple(
            DistantLight(jnp.asarray(way), jnp.full(3, power))
            for way, power in zip(self.to_light, self.strength, strict=True)
        )


class Lit(NamedTuple):
    """Pixels of hair in all photographs, and what light from each direction would do.

    Attributes:
        seen: What the photographs show, linear RGB.
        view: The photograph of each pixel.
        diffuse: Brightness of white hair in each light, shadowed.
        mirror: The cosine of which a power is the highlight; 0 where it is negative.
        share: How much of each light arrives.
        bare: What is seen of the head beside.
    """

    seen: Float[np.ndarray, "pixels 3"]
    view: Int[np.ndarray, " pixels"]
    diffuse: Float[np.ndarray, "pixels lights"]
    mirror: Float[np.ndarray, "pixels lights"]
    share: Float[np.ndarray, "pixels lights"]
    bare: Bare


def find_appearance(
    strands: Float[np.ndarray, "strands knots 3"],
    sights: Sequence[Sight],
    head: Mesh | None,
    seed: int = 0,
) -> Appearance | None:
    """Return looks and light that explain the photographs, None if they show no hair.

    Args:
        strands: The hair, in metres.
        sights: The photographs, and the depth of the head in them.
        head: The head, which casts shadows as well.
        seed: Of the choice of pixels.
    """
    around = sky_lights((1.0, 1.0, 1.0), LIGHTS)
    ways = unit(np.stack([np.asarray(one.to_light, np.float64) for one in around]))
    few = some_of(strands, CASTING)
    total_width = len(strands) * narrowest_width(strands, sights)
    look = HairLook(width=total_width / len(few))
    scene = Scene(few, look=look, head=head, shadows=SHADOWS)
    lit = light_pixels(strands, sights, scene, ways, seed)
    if lit is None:
        return None
    found = [solve(lit, len(sights), shininess) for shininess in SHININESS]
    best = min(found, key=lambda one: one.error)
    some = [sight.view.image[::4, ::4].max(axis=-1) for sight in sights]
    bright = [np.percentile(picture, BRIGHT) for picture in some]
    white = max(float(np.median(bright)), 1e-3) / WHITE
    best = best._replace(to_light=ways, total_width=total_width)
    looks = tidied(best, white)
    skin = skin_colour(looks, lit.bare, ways)
    if skin is None:
        return looks
    # More light, where a head would otherwise have to send back more than skin does.
    more = max(1.0, max(skin) / LIGHTEST_SKIN)
    return brightened(looks._replace(skin=skin), more)


def some_of(
    strands: Float[np.ndarray, "strands knots 3"], most: int
) -> Float[np.ndarray, "_strands knots 3"]:
    """Return every so many-th strand, such that there are no more than `most`."""
    return strands[:: -(-len(strands) // most)]


def light_pixels(
    strands: Float[np.ndarray, "strands knots 3"],
    sights: Sequence[Sight],
    scene: Scene,
    ways: Float[np.ndarray, "lights 3"],
    seed: int,
) -> Lit | None:
    """Return some pixels of hair of each photograph, in light from given directions."""
    rng = np.random.default_rng(seed)
    places, tangents, eyes, seen, view = [], [], [], [], []

    def draw(sight):
        camera, behind = sight.view.camera, sight.behind
        drawn = rasterise(strands, camera, mesh_depth=behind, radius_px=1.0)
        return drawn, smoothed(sight.view)

    for k, (drawn, smooth) in enumerate(abreast(draw, sights)):
        photo = sights[k].view
        free = drawn.coverage & photo.hair & (smooth.max(axis=-1) < CLIPPED)
        y, x = np.nonzero(free)
        some = rng.choice(len(y), min(PIXELS, len(y)), replace=False)
        strand, segment = (
            drawn.strand[y[some], x[some]],
            drawn.segment[y[some], x[some]],
        )
        start, end = strands[strand, segment], strands[strand, segment + 1]
        places.append(0.5 * (start + end))
        tangents.append(end - start)
        eyes.append(np.asarray(photo.camera.centre, np.float64) - places[-1])
        seen.append(smooth[y[some], x[some]])
        view.append(np.full(len(some), k))
    at = np.concatenate(places)
    count = len(at)
    if count < FEWEST:
        return None
    if scene.head is not None:
        at = np.concatenate([at, head_places(scene.head)])
    lights = tuple(DistantLight(on_device(way), jnp.ones(3)) for way in ways)
    share = np.asarray(light_at(at, scene, lights).radiance)[..., 0].T
    bare = bare_pixels(scene.head, sights, ways, share[count:], rng)
    share = share[:count]
    given = unit(np.concatenate(tangents)), ways, unit(np.concatenate(eyes))
    sent = both_terms(*(on_device(part, number()) for part in given))
    diffuse, mirror = (np.asarray(part, np.float64) for part in sent)
    return Lit(
        np.concatenate(seen),
        np.concatenate(view),
        share * diffuse,
        mirror,
        share,
        bare,
    )


def skin_colour(
    looks: Appearance, bare: Bare, ways: Float[np.ndarray, "lights 3"]
) -> Colour | None:
    """Return the colour of a matt head that explains what is seen of it, or None.

    Args:
        looks: The lights, which are some of those of `ways`, the sky and the exposures.
        bare: What is seen of the head, in light from `ways`.
        ways: Unit vectors towards lights.
    """
    if len(bare.seen) < FEWEST:
        return None
    some = np.argmax(looks.to_light @ ways.T, axis=1)
    shade = bare.shade[:, some] @ looks.strength + looks.sky * bare.sky
    shade = looks.exposure[bare.view] * shade
    return as_colour(np.median(bare.seen / np.maximum(shade, 1e-3)[:, None], axis=0))


@jax.jit
def both_terms(tangents, ways, eyes):
    """Return both terms of `kajiya_kay` of all pixels in all lights."""
    one, none = jnp.ones(3, number()), jnp.zeros(3, number())

    def term(fibre):
        def of(tangent, way, eye):
            return kajiya_kay(tangent, way, eye, fibre)[0]

        lights = jax.vmap(of, (None, 0, None))
        return jax.vmap(lights, (0, None, 0))(tangents, ways, eyes)

    plain = jnp.ones(())
    diffuse = term(Fibre(none, one, none, plain))
    return diffuse, term(Fibre(none, none, one, plain))


def smoothed(view: View) -> Float[np.ndarray, "height width 3"]:
    """Return the hair of a photograph without its finest texture, linear RGB.

    Black where there is no hair.
    """
    out = np.zeros(view.image.shape)
    for box in ndimage.find_objects(view.hair.astype(np.uint8)):
        mask = view.hair[box].astype(np.float64)[..., None]
        around = ndimage.gaussian_filter(mask, (SMOOTH, SMOOTH, 0))
        light = ndimage.gaussian_filter(view.image[box] * mask, (SMOOTH, SMOOTH, 0))
        out[box] = mask * light / np.maximum(around, 1e-6)
    return out


def solve(lit: Lit, views: int, shininess: float) -> Appearance:
    """Return the looks and lights of one exponent that come closest, by turns.

    Light, looks and exposures each by non-negative least squares, errors relative to
    the brightness, pixels far off counting less. The head is lit by the same light.
    """
    bare, hair = lit.bare, len(lit.seen)
    seen = np.concatenate([lit.seen, bare.seen])
    view = np.concatenate([lit.view, bare.view])
    highlight = lit.share * lit.mirror**shininess
    level = float(lit.seen.mean())
    on_head = bare.seen.sum(axis=0) / max(len(bare.seen), 1)
    # A head may be all black.
    head_level = max(float(on_head.mean()), level)
    weight = np.concatenate(
        [relative(lit.seen, level), HEAD_COUNTS * relative(bare.seen, head_level)]
    )
    colour, skin = lit.seen.mean(axis=0) / level, on_head / level
    specular = 0.1 * colour
    exposure, robust = np.ones(views), np.ones(len(seen))
    power, sky, error = np.zeros(lit.share.shape[1]), 0.0, np.inf
    for _ in range(ROUNDS):
        gain = exposure[view]
        w = weight * robust[:, None] ** 0.5
        # What shines: each column is one light, the last the sky.
        columns = []
        for k in range(3):
            strands = colour[k] * lit.diffuse + specular[k] * highlight
            lights = np.concatenate([strands, skin[k] * bare.shade])
            around = np.concatenate([np.full(hair, colour[k]), skin[k] * bare.sky])
            both = np.concatenate([lights, around[:, None]], axis=1)
            columns.append((gain * w[:, k])[:, None] * both)
        found = least_squares(np.concatenate(columns), (w * seen).T.ravel())
        power, sky = found[:-1], float(found[-1])
        # What hair sends back of it, channel by channel, and the head.
        sent = np.stack([lit.diffuse @ power + sky, highlight @ power], axis=1)
        sent *= gain[:hair, None]
        colour, specular = channel_wise(w[:hair], sent, lit.seen)
        matt = gain[hair:] * (bare.shade @ power + sky * bare.sky)
        (skin,) = channel_wise(w[hair:], matt[:, None], bare.seen)
        model = np.concatenate(
            [sent @ np.stack([colour, specular]), matt[:, None] * skin]
        )
        exposure = exposures(view, model / gain[:, None] * w, seen * w, views)
        model *= (exposure[view] / gain)[:, None]
        off = np.sqrt(np.mean((weight * (model - seen)) ** 2, axis=1))
        robust = np.concatenate([reliance(off[:hair]), reliance(off[hair:])])
        error = float(np.sqrt(np.average(off[:hair] ** 2, weights=robust[:hair])))
    return Appearance(
        as_colour(colour),
        as_colour(specular),
        shininess,
        np.zeros((len(power), 3)),
        power,
        sky,
        exposure,
        error,
    )


def relative(
    seen: Float[np.ndarray, "pixels 3"], level: float
) -> Float[np.ndarray, "pixels 3"]:
    """Return by what errors are multiplied, so that they are relative to brightness.

    Args:
        seen: What the photographs show, linear RGB.
        level: A usual brightness; what is much darker counts as somewhat brighter.
    """
    rough = DARK * level + seen.mean(axis=1, keepdims=True)
    return 1.0 / np.broadcast_to(rough, seen.shape)


def reliance(off: Float[np.ndarray, " pixels"]) -> Float[np.ndarray, " pixels"]:
    """Return how much pixels count that are off by so much."""
    if not len(off):
        return off
    scale = OUTLIER * float(np.median(off)) + 1e-9
    return 1.0 / (1.0 + (off / scale) ** 2)


def channel_wise(
    weight: Float[np.ndarray, "pixels 3"],
    sent: Float[np.ndarray, "pixels terms"],
    seen: Float[np.ndarray, "pixels 3"],
) -> Float[np.ndarray, "terms 3"]:
    """Return the colours by which what white would send comes closest to what is seen.

    Args:
        weight: What errors are multiplied by.
        sent: What white sends back in each way.
        seen: What the photographs show, linear RGB.
    """
    return np.stack(
        [
            least_squares(weight[:, [k]] * sent, weight[:, k] * seen[:, k])
            for k in range(3)
        ],
        axis=1,
    )


def as_colour(values: Float[np.ndarray, " 3"]) -> Colour:
    """Return three numbers as a colour."""
    red, green, blue = (float(value) for value in values)
    return red, green, blue


def least_squares(
    columns: Float[np.ndarray, "rows unknowns"], wanted: Float[np.ndarray, " rows"]
) -> Float[np.ndarray, " unknowns"]:
    """Return the least squares solution without negative numbers."""
    square = columns.T @ columns
    square += 1e-6 * (np.trace(square) / len(square) + 1e-12) * np.eye(len(square))
    factor = np.linalg.cholesky(square)
    right = np.linalg.solve(factor, columns.T @ wanted)
    return optimize.nnls(factor.T, right)[0]


def exposures(
    view: Int[np.ndarray, " pixels"],
    model: Float[np.ndarray, "pixels 3"],
    seen: Float[np.ndarray, "pixels 3"],
    views: int,
) -> Float[np.ndarray, " views"]:
    """Return how bright each photograph is beside its model, 1 in the mean."""
    both = np.bincount(view, (model * seen).sum(axis=1), minlength=views)
    own = np.bincount(view, (model**2).sum(axis=1), minlength=views)
    gain = np.where(own > 0, both / np.maximum(own, 1e-12), 1.0)
    gain = np.maximum(gain, 1e-6) / np.exp(np.mean(np.log(np.maximum(gain, 1e-6))))
    return np.clip(gain, 1.0 / BRIGHTEST_EXPOSURE, BRIGHTEST_EXPOSURE)


def tidied(found: Appearance, white: float) -> Appearance:
    """Return an appearance of few lights, in which they light white to `white`."""
    power, ways = found.strength, found.to_light
    total = power.sum() + found.sky
    some = power > LEAST_SHARE * total
    # What is weak is spread over the sky as a matt surface takes it: half of it faces.
    sky = found.sky + 0.25 * float(power[~some].sum())
    power, ways = power[some], ways[some]
    facing = np.maximum(ways @ ways.T, 0.0) @ power if len(ways) else np.zeros(1)
    few = found._replace(to_light=ways, strength=power, sky=sky)
    return brightened(few, white / max(float(facing.max()) + sky, 1e-9))


def brightened(looks: Appearance, gain: float) -> Appearance:
    """Return the same products of colour and light, with so much more light."""
    return looks._replace(
        colour=as_colour(np.asarray(looks.colour) / gain),
        specular=as_colour(np.asarray(looks.specular) / gain),
        strength=gain * looks.strength,
        sky=gain * looks.sky,
        skin=None if looks.skin is None else as_colour(np.asarray(looks.skin) / gain),
    )
