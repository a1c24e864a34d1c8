import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import RADIUS, ball, comb, ring
from scipy import ndimage

from hairfit.capture import View
from hairfit.evaluate.visibility import Sight
from hairfit.fit.appearance import (
    WHITE,
    Appearance,
    Lit,
    brightened,
    exposures,
    find_appearance,
    least_squares,
    skin_colour,
    smoothed,
    solve,
    tidied,
)
from hairfit.fit.bare import CLIPPED, PIXELS, Bare, bare_pixels
from hairfit.render import mesh_depth
from hairfit.render.lights import DistantLight
from hairfit.render.lit import light_at
from hairfit.render.picture import Pictures
from hairfit.render.scene import Background, HairLook, Scene, head_places
from hairfit.render.studio import shown_width

COLOUR = np.array([0.22, 0.10, 0.05])
KEY = np.array([0.8, 0.5, 0.33])


def known(rng, pixels=900, lights=6, views=3):
    """Return pixels in known light, and what light, colours and exposures they had."""
    diffuse, mirror, share = rng.uniform(0.0, 1.0, (3, pixels, lights))
    view = np.arange(pixels) % views
    power, sky = np.array([0.9, 0.0, 0.4, 0.0, 0.0, 0.2]), 0.15
    exposure = np.array([0.8, 1.0, 1.25])
    specular = np.array([0.2, 0.15, 0.12])
    even = exposure[view] * (share * diffuse @ power + sky)
    glint = exposure[view] * (share * mirror**8.0 @ power)
    seen = even[:, None] * COLOUR + glint[:, None] * specular
    none = np.zeros((lights, 3)), np.zeros((0, lights))
    bare = bare_pixels(None, [], *none, rng)
    lit = Lit(seen, view, share * diffuse, mirror, share, bare)
    return lit, power, sky, exposure, specular


def test_light_colour_and_exposures_are_found_where_the_model_holds():
    lit, power, sky, exposure, specular = known(np.random.default_rng(0))
    found = solve(lit, 3, 8.0)
    assert found.error < 0.01
    # Colour and light are known but for a factor.
    scale = found.colour[0] / COLOUR[0]
    assert np.allclose(found.colour, scale * COLOUR, rtol=0.03)
    assert np.allclose(found.specular, scale * specular, rtol=0.1)
    assert np.allclose(found.strength, power / scale, atol=0.04 / scale)
    assert np.isclose(found.sky, sky / scale, rtol=0.15)
    assert np.allclose(found.exposure, exposure, rtol=0.02)


def test_a_head_tells_lights_that_hair_does_not():
    """Hair sends back the same of four lights, and each pixel is a third off."""
    rng = np.random.default_rng(4)
    lit, power, sky, exposure, _ = known(rng)
    alike = lit.diffuse.copy()
    alike[:, 2:] = alike[:, 2:].mean(axis=1, keepdims=True)
    plain = exposure[lit.view] * (alike @ power + sky)
    noise = rng.lognormal(0.0, 0.3, (len(plain), 1))
    dull = np.zeros_like(lit.mirror)
    hair = lit._replace(
        seen=noise * plain[:, None] * COLOUR, diffuse=alike, mirror=dull
    )
    skin, places = np.array([0.6, 0.4, 0.3]), 300
    shade, around = rng.uniform(0.0, 1.0, (places, 6)), rng.uniform(0.5, 1.0, places)
    view = np.arange(places) % 3
    bright = exposure[view] * (shade @ power + sky * around)
    bare = Bare(bright[:, None] * skin, view, shade, around)
    alone, both = (solve(one, 3, 8.0) for one in (hair, hair._replace(bare=bare)))
    lights = [one.strength * power[0] / one.strength[0] for one in (alone, both)]
    assert np.allclose(lights[1], power, atol=0.02)
    assert not np.allclose(lights[0], power, atol=0.2)
    assert np.allclose(both.exposure, exposure, rtol=0.01)
    ways = np.concatenate([np.eye(3), -np.eye(3)])
    found = skin_colour(both._replace(to_light=ways), bare, ways)
    assert found is not None
    assert np.allclose(np.array(found) * both.strength[0], skin * power[0], rtol=0.02)


def test_what_is_not_the_head_counts_little():
    """A quarter of what the mesh covers wears a shirt."""
    rng = np.random.default_rng(5)
    lit, power, _, exposure, _ = known(rng)
    shade, view = rng.uniform(0.0, 1.0, (400, 6)), np.arange(400) % 3
    seen = (exposure[view] * (shade @ power + 0.15))[:, None] * [0.6, 0.4, 0.3]
    seen[::4] = [0.02, 0.05, 0.3]
    found = solve(lit._replace(bare=Bare(seen, view, shade, np.ones(400))), 3, 8.0)
    scale = found.colour[0] / COLOUR[0]
    assert np.allclose(scale * found.strength, power, atol=0.05)
    assert np.allclose(found.exposure, exposure, rtol=0.03)


def test_a_wrong_exponent_explains_less():
    lit, *_ = known(np.random.default_rng(1))
    assert solve(lit, 3, 8.0).error < 0.5 * solve(lit, 3, 50.0).error


def test_pixels_that_are_not_hair_count_little():
    lit, *_ = known(np.random.default_rng(2))
    seen = lit.seen.copy()
    seen[::10] = [0.1, 0.9, 0.2]
    found = np.array(solve(lit._replace(seen=seen), 3, 8.0).colour)
    assert np.allclose(found / found[0], COLOUR / COLOUR[0], atol=0.05)


def test_least_squares_has_no_negative_numbers():
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(200, 4))
    wanted = columns @ np.array([1.0, -2.0, 0.5, 0.0])
    found = least_squares(columns, wanted)
    assert (found >= 0).all() and found[1] == 0.0
    free = np.array([1.0, 0.0, 0.5, 0.3])
    assert np.allclose(least_squares(columns, columns @ free), free, atol=1e-4)


def test_a_photograph_without_hair_is_exposed_as_others():
    model = np.ones((6, 3))
    view = np.array([0, 0, 0, 2, 2, 2])
    gain = np.array([1.0, 1.0, 1.0, 4.0, 4.0, 4.0])
    found = exposures(view, model, gain[:, None] * model, 3)
    assert np.isclose(found[2] / found[0], 4.0)
    assert np.isclose(np.prod(found), 1.0)


def test_weak_lights_become_sky_and_white_paper_as_bright_as_said():
    ways = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])
    found = Appearance(
        (0.2, 0.1, 0.05), (0.1, 0.1, 0.1), 8.0, ways, np.array([3.0, 1.0, 0.02]), 0.5,
        np.ones(2), 0.1,
    )  # fmt: skip
    tidy = tidied(found, 0.4)
    assert len(tidy.lights) == 2
    # Paper that faces the strongest of two lights at right angles.
    assert np.isclose(tidy.strength[0] + tidy.sky, 0.4)
    product = tidy.strength[0] * tidy.colour[0]
    assert np.isclose(product, 3.0 * 0.2)
    assert np.isclose(tidy.sky * tidy.colour[0], (0.5 + 0.25 * 0.02) * 0.2)


@pytest.fixture(scope="module")
def photographs():
    """Photographs of combed hair under a key light, drawn by JAX."""
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(2500, 3))
    roots[:, 1] = np.abs(roots[:, 1]) + 0.3
    strands = comb(RADIUS * roots / np.linalg.norm(roots, axis=1, keepdims=True))
    red, green, blue = (float(c) for c in COLOUR)
    scene = Scene(
        strands,
        HairLook(
            colour=(red, green, blue),
            width=shown_width(strands),
            ambient=1.0,
            diffuse=1.0,
            specular=(0.05, 0.05, 0.05),
            coloured=0.0,
            variation=0.0,
        ),
        head=ball(),
        skin=(0.0, 0.0, 0.0),  # what is seen between hairs has no colour
        lights=(DistantLight(jnp.asarray(KEY), jnp.full(3, 0.7)),),
        sky=(0.1, 0.1, 0.1),
        background=Background((WHITE, WHITE, WHITE)),
    )
    pictures, sights = Pictures(scene), []
    for k, camera in enumerate(ring(4)):
        drawn = np.asarray(pictures.draw_linear(camera), np.float64)
        # Where hair covers most of a white head; on the black one it is hardly seen.
        white = dataclasses.replace(scene, skin=(1.0, 1.0, 1.0), sky=(1.0, 1.0, 1.0))
        haired, bare = (
            np.asarray(Pictures(one).draw_linear(camera), np.float64)[..., :3]
            for one in (white, dataclasses.replace(white, strands=strands[:0]))
        )
        hair = np.abs(haired - bare).max(axis=-1) > 0.3
        hair = ndimage.binary_erosion(hair, iterations=3)
        view = View(f"{k:02}", camera, drawn[..., :3], hair)
        sights.append(Sight(view, mesh_depth(ball(), camera)))
    return strands, sights


@pytest.mark.slow
def test_colour_and_light_of_photographs_are_found(photographs):
    strands, sights = photographs
    found = find_appearance(strands, sights, ball())
    assert found is not None
    colour = np.array(found.colour)
    assert np.allclose(colour / colour[0], COLOUR / COLOUR[0], rtol=0.15)
    assert colour[0] < COLOUR[0]  # between thin hair it is dark
    mean = found.strength @ found.to_light
    key = KEY / np.linalg.norm(KEY)
    assert mean @ key / np.linalg.norm(mean) > np.cos(np.radians(35.0))
    assert np.allclose(found.exposure, 1.0, atol=0.1)
    # Hair in the photographs is as wide as that.
    width = shown_width(strands)
    assert found.total_width == pytest.approx(len(strands) * width, rel=0.15)
    assert found.look(len(strands)).width == pytest.approx(width, rel=0.15)
    assert found.look(2 * len(strands)).width == pytest.approx(0.5 * width, rel=0.15)


def test_the_colour_of_a_bare_head_is_found_in_known_light():
    skin = (0.5, 0.35, 0.25)
    light = DistantLight(jnp.asarray(KEY), jnp.full(3, 0.7))
    scene = Scene(
        np.zeros((0, 2, 3)),
        head=ball(),
        skin=skin,
        lights=(light,),
        sky=(0.1, 0.1, 0.1),
    )
    pictures, sights = Pictures(scene), []
    for k, camera in enumerate(ring(3)):
        image = 1.5 * np.asarray(pictures.draw_linear(camera), np.float64)[..., :3]
        view = View(f"{k:02}", camera, image, np.zeros(image.shape[:2], bool))
        sights.append(Sight(view, mesh_depth(ball(), camera)))
    way = KEY[None] / np.linalg.norm(KEY)
    looks = Appearance(
        (0.2, 0.1, 0.05), (0.0, 0.0, 0.0), 8.0, way, np.array([0.7]), 0.1,
        np.full(3, 1.5), 0.1,
    )  # fmt: skip
    ways = np.concatenate([-way, way])
    places = head_places(ball())
    share = np.asarray(light_at(places, scene, (light,)).radiance)[..., 0].T / 0.7
    share = np.concatenate([np.zeros_like(share), share], axis=1)

    def seen_of(head, sights):
        rng = np.random.default_rng(0)
        return bare_pixels(head, sights, ways, share, rng)

    bare = seen_of(ball(), sights)
    assert len(bare.seen) == 3 * PIXELS and (bare.seen.max(axis=1) < CLIPPED).all()
    found = skin_colour(looks, bare, ways)
    assert found is not None and np.allclose(found, skin, rtol=0.03)
    assert skin_colour(looks, seen_of(None, sights), ways) is None
    all_hair = [
        Sight(dataclasses.replace(view, hair=np.ones_like(view.hair)), behind)
        for view, behind in sights
    ]
    assert skin_colour(looks, seen_of(ball(), all_hair), ways) is None
    half = np.arange(sights[0].view.hair.shape[1]) < sights[0].view.hair.shape[1] // 2
    painted = [
        Sight(
            dataclasses.replace(
                view,
                hair=view.hair | half,
                image=np.where(half[:, None], [0.0, 0.9, 0.0], view.image),
            ),
            behind,
        )
        for view, behind in sights
    ]
    some = seen_of(ball(), painted)
    assert len(some.seen) and (some.seen[:, 1] < 0.9).all()


def test_more_light_and_less_colour_are_the_same_picture():
    looks = Appearance(
        (0.2, 0.1, 0.05), (0.1, 0.2, 0.3), 8.0, KEY[None], np.array([0.7]), 0.1,
        np.ones(1), 0.1,
    )  # fmt: skip
    assert brightened(looks, 2.0).skin is None
    found = brightened(looks._replace(skin=(0.8, 0.6, 0.4)), 2.0)
    assert found.skin is not None and np.allclose(found.skin, (0.4, 0.3, 0.2))
    assert np.allclose(np.array(found.colour) * 2.0, looks.colour)
    assert np.allclose(np.array(found.specular) * 2.0, looks.specular)
    assert np.allclose(found.strength, 1.4) and np.isclose(found.sky, 0.2)


@pytest.mark.slow
def test_the_same_seed_finds_the_same(photographs):
    strands, sights = photographs
    first, second = (find_appearance(strands, sights, ball(), 1) for _ in range(2))
    assert first is not None and second is not None
    assert first.colour == second.colour and np.array_equal(
        first.strength, second.strength
    )


def test_without_hair_nothing_is_found(photographs):
    strands, sights = photographs
    bald = [
        Sight(dataclasses.replace(view, hair=np.zeros_like(view.hair)), behind)
        for view, behind in sights
    ]
    assert find_appearance(strands, bald, ball()) is None


def test_hair_is_smoothed_without_what_is_beside_it(photographs):
    _, sights = photographs
    view = sights[0].view
    painted = np.where(view.hair[..., None], 0.3, 0.9) * np.ones(3)
    found = smoothed(dataclasses.replace(view, image=painted))
    assert np.allclose(found[view.hair], 0.3)
